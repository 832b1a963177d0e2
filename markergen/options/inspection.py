"""Options of ``markergen inspect``."""
# tests: tests/api/test_inspect.py

from typing import Annotated, TypedDict

from markergen.options import LAYOUT, RUN, Option
from markergen.options.shared import CameraInBody, ImageSize, PosesAxes, PosesFrame, PosesUnit


class InspectKeywords(TypedDict, total=False):
    """Options for reading a file to inspect."""

    kind: Annotated[
        str,
        Option(
            RUN,
            "What the file is: camera, poses, outline, marker, rig, spec or points.",
            otherwise="by its content",
            metavar="NAME",
        ),
    ]
    image_size: ImageSize
    poses_frame: PosesFrame
    poses_axes: PosesAxes
    poses_unit: PosesUnit
    camera_in_body: CameraInBody
    boundary_unit: Annotated[
        str, Option(LAYOUT, "Unit of drawings that do not specify one: mm, cm, m, in, pt, px.", metavar="UNIT")
    ]
    layer: Annotated[
        str, Option(LAYOUT, "Layer of the drawing that the boundary is on.", otherwise="all", metavar="NAME")
    ]
    ignore_open: Annotated[
        bool, Option(LAYOUT, "Leave out lines of drawings that bound nothing, and list them.", False)
    ]
