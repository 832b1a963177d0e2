"""Options of a hand-eye calibration."""
# tests: tests/api/test_handeye.py

from typing import Annotated, TypedDict

from markergen.options import ERRORS, FILES, VIEW, Option
from markergen.options.shared import Calibrated, ImageSize, Printed, Workers


class HandeyeKeywords(TypedDict, total=False):
    """Options of a hand-eye calibration, besides the marker, the photographs, the robot's poses and the camera."""

    mounting: Annotated[
        str,
        Option(
            VIEW,
            "eye-in-hand: the camera is on the flange, the marker beside the robot; eye-to-hand: the marker is on the "
            "flange, the camera beside the robot.",
            "eye-in-hand",
            metavar="NAME",
        ),
    ]
    image_size: ImageSize
    camera_covariance: Calibrated
    print_sigma: Printed
    one_axis: Annotated[
        bool,
        Option(
            ERRORS,
            "Accept a robot that turns about parallel axes only, as SCARA robots do: the offset along them stays open.",
            False,
            flags="--one-axis",
        ),
    ]
    robot_frame: Annotated[
        str,
        Option(
            FILES,
            "What the robot's poses are: flange-in-base, T_base_flange, or base-in-flange, its inverse.",
            otherwise="as the file states",
            metavar="NAME",
        ),
    ]
    robot_unit: Annotated[
        str,
        Option(FILES, "Unit of their translations: mm, cm, m, in, ft.", otherwise="as the file states", metavar="UNIT"),
    ]
    robot_rotation: Annotated[
        str,
        Option(
            FILES,
            "Their rotation: quaternion xyzw or wxyz, rotvec, matrix, Euler angles about moving axes such as ZYX or "
            "fixed ones such as zyx; or as abb, fanuc, kawasaki, kuka, staubli, ur or yaskawa show it.",
            otherwise="as the file states",
            metavar="NAME",
        ),
    ]
    robot_angle: Annotated[
        str,
        Option(
            FILES,
            "Unit of their angles: deg or rad.",
            otherwise="as the file or --robot-rotation states",
            metavar="UNIT",
        ),
    ]
    workers: Workers
