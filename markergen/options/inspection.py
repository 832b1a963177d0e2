"""Options of ``markergen inspect``."""
# tests: tests/api/test_inspect.py

from typing import Annotated, TypedDict

from markergen.options import RUN, Option
from markergen.options.shared import (
    BoundaryUnit,
    CameraInBody,
    IgnoreOpen,
    ImageSize,
    Layer,
    PosesAxes,
    PosesFrame,
    PosesUnit,
)


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
    boundary_unit: BoundaryUnit
    layer: Layer
    ignore_open: IgnoreOpen
