"""Options of a rig."""
# tests: tests/docs/test_book.py tests/studio/test_look.py

from typing import Annotated

from markergen.defaults import PRINT_SIGMA_TEXT
from markergen.options import DOTS, FILES, LAYOUT, SEARCH, VIEW, Option
from markergen.options.kinds import File, Files, Length, LengthOrAuto, ObjectiveLike, Poses, Texts
from markergen.options.shared import (
    Aggregate,
    Camera,
    CameraInBody,
    ImageSize,
    PosesAxes,
    PosesFrame,
    PosesUnit,
    Restarts,
    Seed,
    SheetKeywords,
    Time,
)


class RigKeywords(SheetKeywords, total=False):
    """Options of a rig, besides its shape."""

    template: Annotated[
        File, Option(LAYOUT, "Start from a ready-made rig; see markergen templates.", metavar="NAME|FILE")
    ]
    edge: Annotated[
        Length,
        Option(
            LAYOUT,
            "Edge of a cube, or of a prism's polygon; of a pair, width of the plates around the room of their dots.",
            otherwise="80mm of a cube, 60mm of a prism, 2mm of a pair",
        ),
    ]
    height: Annotated[Length, Option(LAYOUT, "Height of a prism.", otherwise="--edge")]
    pitch: Annotated[Length, Option(LAYOUT, "Distance between the middles of a wall's plates.", otherwise="500mm")]
    plate: Annotated[
        Length,
        Option(LAYOUT, "Side of the square plates of a wall or pair.", otherwise="0.4 times --pitch; 150mm of a pair"),
    ]
    angle: Annotated[
        float,
        Option(
            LAYOUT,
            "Angle between the normals of a pair; negative: the plates face each other.",
            otherwise="90",
            metavar="DEGREES",
        ),
    ]
    thickness: Annotated[
        Length, Option(LAYOUT, "Thickness of a pair's plates, which touch at their edges.", otherwise="3mm")
    ]
    without: Annotated[
        Texts,
        Option(LAYOUT, "Face to leave out, such as -z of a body on a stand; may be repeated.", metavar="FACE"),
    ]
    n: Annotated[int, Option(LAYOUT, "Number of control points of each plate, 4 to 200.", 6)]
    camera: Camera
    image_size: ImageSize
    poses: Annotated[
        Poses,
        Option(
            VIEW,
            "Camera poses T_camera_rig: sphere:distance=0.3..0.8m, cone:distance=0.4..1m,tilt=0..60 about the rig's z "
            "axis, or a CSV, JSON, TUM or COLMAP file.",
            otherwise="a sphere around a body, a cone before a wall or pair, by its size",
            metavar="SPHERE|CONE|FILE",
        ),
    ]
    poses_frame: PosesFrame
    poses_axes: PosesAxes
    poses_unit: PosesUnit
    camera_in_body: CameraInBody
    print_sigma: Annotated[
        Length, Option(VIEW, "Standard deviation of a printed dot's position along each axis.", PRINT_SIGMA_TEXT)
    ]
    dot: Annotated[
        LengthOrAuto,
        Option(
            DOTS,
            "Dot diameter; auto minimizes the predicted error of a plate.",
            otherwise="8 px where a plate is the one seen best, if there is room",
            metavar="LENGTH|auto",
        ),
    ]
    clearance: Annotated[Length, Option(DOTS, "Smallest gap around dots.", otherwise="0.3 times --dot")]
    tag: Annotated[
        str,
        Option(
            DOTS,
            "Square tags tell the plates apart, one id for each from this one on: aruco:DICT_4X4_50, or "
            "apriltag:36h11:10.",
            otherwise="the plates' layouts differ instead",
            metavar="FAMILY[:ID]",
        ),
    ]
    tag_size: Annotated[
        Length, Option(DOTS, "Side of a tag's black square, without its white edge.", otherwise="a third of the radius")
    ]
    objective: Annotated[
        ObjectiveLike,
        Option(SEARCH, "What to minimize of the joint pose: pose, rotation or translation.", "pose", metavar="NAME"),
    ]
    aggregate: Aggregate
    seed: Seed
    restarts: Restarts
    time: Time
    output: Annotated[
        Files,
        Option(
            FILES,
            "Output file; its suffix selects the format, see markergen export; may be repeated; rig.json always comes "
            "with it.",
            otherwise="rig.json",
            metavar="PATH",
            flags="-o --output",
        ),
    ]
