"""Options that several functions have: the sheet, the plate, the process, print and calibration, search and workers."""
# tests: tests/api/test_export.py tests/cli/test_completion.py

from typing import Annotated, TypedDict

from markergen.defaults import PRINT_SIGMA_TEXT
from markergen.options import ERRORS, LAYOUT, RUN, SEARCH, SHEET, SOLID, VIEW, Option
from markergen.options.kinds import CameraLike, Covariance, Duration, File, Length, Shape, Texts

Printed = Annotated[
    Length,
    Option(
        ERRORS,
        "Standard deviation of a printed dot's position along each axis.",
        otherwise=f"that of the design, or {PRINT_SIGMA_TEXT}",
    ),
]
Scaled = Annotated[
    float, Option(ERRORS, "Standard deviation of the print's scale along x and y; 0.001 is 0.1 %.", 0, metavar="SHARE")
]
Calibrated = Annotated[
    Covariance,
    Option(
        ERRORS,
        "Covariance, or a row of standard deviations, of fx, fy, cx, cy, ..., or none: take the calibration as exact.",
        otherwise="that in the camera's file, if it has one",
        metavar="FILE",
    ),
]
Camera = Annotated[
    CameraLike,
    Option(
        VIEW,
        "Calibration file: OpenCV, ROS camera_info, Kalibr or COLMAP; or, without one, webcam, phone, or "
        "1280x720@60deg: size of the images and horizontal angle of view.",
        otherwise="webcam, 640 x 480 px and 44 degrees wide",
        metavar="FILE|NAME",
    ),
]
Aggregate = Annotated[
    str,
    Option(
        SEARCH,
        "Aggregate over the poses: rms, mean, logmean, max or cvar:0.9.",
        otherwise="depends on the objective",
        metavar="NAME",
    ),
]
Seed = Annotated[int, Option(SEARCH, "Seed for the random starts; the same seed gives the same bytes.", 0)]
Restarts = Annotated[int, Option(SEARCH, "Number of random starts.", otherwise="depends on the objective", metavar="N")]
Time = Annotated[
    Duration,
    Option(
        SEARCH,
        "Longest time to search, such as 30s or 2min: the best layout by then is taken, and marked, as after Ctrl-C.",
        otherwise="until the search ends",
        metavar="TIME",
    ),
]
Workers = Annotated[int, Option(RUN, "Number of parallel workers.", otherwise="one for each processor", metavar="N")]


ImageSize = Annotated[
    str, Option(VIEW, "Size of the images in px, for a camera's file without it: 640x480.", metavar="WxH")
]

PosesFrame = Annotated[
    str,
    Option(
        VIEW,
        "What a file's poses are: marker-in-camera, camera-in-marker, or body, of a robot or IMU in the marker's "
        "frame, with --camera-in-body.",
        otherwise="as its format says",
        metavar="NAME",
    ),
]

PosesAxes = Annotated[
    str,
    Option(
        VIEW,
        "Axes of the camera in a file of poses: opencv, y down and z forward, or opengl, y up and z backward.",
        otherwise="as its format says",
        metavar="NAME",
    ),
]

PosesUnit = Annotated[
    str, Option(VIEW, "Unit of a file of poses: mm, cm, m, in, ft.", otherwise="as it states, or m", metavar="UNIT")
]

BoundaryUnit = Annotated[
    str, Option(LAYOUT, "Unit of drawings that do not specify one: mm, cm, m, in, pt, px.", metavar="UNIT")
]
Layer = Annotated[str, Option(LAYOUT, "Layer of the drawing that the boundary is on.", otherwise="all", metavar="NAME")]
IgnoreOpen = Annotated[bool, Option(LAYOUT, "Leave out lines of drawings that bound nothing, and list them.", False)]

CameraInBody = Annotated[File, Option(VIEW, "File with the one pose of the camera in the body.", metavar="FILE")]


class SheetKeywords(TypedDict, total=False):
    """Options for the sheet that a marker is printed on."""

    paper: Annotated[
        str,
        Option(
            SHEET,
            "A0..A5, letter, legal, tabloid, or a size such as 300x400mm.",
            otherwise="the smallest ISO size that holds it",
            metavar="NAME|WxH",
        ),
    ]
    orientation: Annotated[
        str,
        Option(SHEET, "portrait or landscape.", otherwise="portrait unless only landscape holds it", metavar="NAME"),
    ]
    margin: Annotated[
        Length, Option(SHEET, "Margin that the printer leaves white.", otherwise="10 to 24 mm, depending on the paper")
    ]
    tile: Annotated[
        bool,
        Option(
            SHEET,
            "Spread a marker that is larger than the paper over several sheets.",
            True,
            flags="--tile/--no-tile",
        ),
    ]
    overlap: Annotated[Length, Option(SHEET, "Width of the strip that neighboring sheets both print.", "10mm")]
    dpi: Annotated[int, Option(SHEET, "Resolution of a .png in pixels per inch.", 600, metavar="N")]
    colors: Annotated[
        str,
        Option(
            SHEET,
            "black, inverted, or two colors as #rrggbb,#rrggbb; append ,cut:NAME for a spot color of the cut lines, "
            "such as black,cut:CutContour.",
            "black",
            metavar="NAME|INK,PAPER",
        ),
    ]


class PlateKeywords(TypedDict, total=False):
    """Options for the plate that carries the dots of a solid."""

    thickness: Annotated[Length, Option(SOLID, "Thickness of the plate.", "3mm")]
    edge: Annotated[
        Length,
        Option(SOLID, "Minimum width of the plate around a disk or rectangle; a drawing is the plate itself.", "2mm"),
    ]
    corner_radius: Annotated[Length, Option(SOLID, "Radius of the plate's corners, in plan view.", "0mm")]
    chamfer: Annotated[Length, Option(SOLID, "Chamfer around the plate's upper face, at 45 degrees.", "0mm")]
    outline: Annotated[
        Shape,
        Option(
            SOLID,
            "Outline of the plate with its holes, instead of the boundary's: rect:0.3x0.2, or a drawing in "
            "the marker frame, which moves with the boundary that --boundary takes from one.",
            metavar="SHAPE|FILE[#LAYER]",
        ),
    ]
    mount: Annotated[
        Texts,
        Option(
            SOLID,
            "Mounting holes: 4xM3@120mm on a pitch circle, 4xM3@120mm/0 with the first one at 0 degrees, 4xM3c@120mm "
            "countersunk, 4x3.4mm@120mm by diameter, or M3:40mm,-20mm;-40mm,-20mm; may be repeated.",
            metavar="HOLES",
        ),
    ]
    dowel: Annotated[
        Texts,
        Option(
            SOLID,
            "Holes for dowel pins on the x axis: 2x4mm@130mm, or in the forms of --mount; may be repeated.",
            metavar="HOLES",
        ),
    ]


class ProcessKeyword(TypedDict, total=False):
    """Option for the manufacturing process of a solid."""

    process: Annotated[
        str,
        Option(
            SOLID,
            "Manufacturing process of solids: one of those that markergen export --help lists.",
            "fdm",
            metavar="NAME",
        ),
    ]


class MadeKeywords(ProcessKeyword, total=False):
    """Options for how a solid is made, besides its plate."""

    depth: Annotated[
        Length, Option(SOLID, "Depth of pockets, engraving or recess.", otherwise="depends on the process")
    ]
    gap: Annotated[Length, Option(SOLID, "Gap between an inlay and its pocket.", otherwise="depends on the process")]
    fit: Annotated[
        str, Option(SOLID, "Fit of discs in milled pockets: slip or press.", otherwise="slip", metavar="NAME")
    ]
    through: Annotated[
        bool,
        Option(SOLID, "Make dots as through holes, instead of milled pockets with discs.", False, flags="--through"),
    ]
    tool: Annotated[
        Length, Option(SOLID, "Diameter of the nozzle, end mill or beam.", otherwise="depends on the process")
    ]
    dome: Annotated[str, Option(SOLID, "Shape for --process dome: half or ball.", "half", metavar="NAME")]
    draft: Annotated[
        float,
        Option(SOLID, "Draft angle of the pillars of a relief, which widen toward the plate.", 0, metavar="DEGREES"),
    ]
    foot: Annotated[Length, Option(SOLID, "Radius of the fillet around a pillar's foot.", "1mm")]
    engrave: Annotated[
        bool,
        Option(
            SOLID,
            "Engrave name, spec, numbers, origin and x axis on the back of the plate.",
            True,
            flags="--engrave/--no-engrave",
        ),
    ]
