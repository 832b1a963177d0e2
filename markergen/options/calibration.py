"""Options of a calibration, also of a camera on a robot."""

# tests: tests/cli/test_completion.py tests/api/test_handeye.py

from typing import Annotated, TypedDict

from markergen.defaults import RULER_SIGMA
from markergen.options import ERRORS, FILES, VIEW, Option
from markergen.options.kinds import Files, Length, Poses, Texts
from markergen.options.shared import Calibrated, ImageSize, Printed, Workers


class CalibrateKeywords(TypedDict, total=False):
    """Options of a calibration, besides the marker, the photographs and the camera."""

    image_size: ImageSize
    poses: Annotated[
        Poses,
        Option(
            VIEW,
            "Poses over which the expected error is reported, in any form of markergen validate --poses.",
            otherwise="those of the design",
            metavar="NAME|FILE",
        ),
    ]
    geometry: Annotated[
        str,
        Option(
            ERRORS,
            "free: every dot is measured; nominal: the dots are where they were designed, as on a machined marker, and "
            "only the camera is estimated.",
            "free",
            metavar="NAME",
        ),
    ]
    measured: Annotated[
        Texts,
        Option(
            ERRORS,
            "Length measured between the centers of two dots, by id: 0-2=244.1mm, with a sigma 0-2=244.1mm+-0.1mm; of "
            "the second marker 2:0-2=244.1mm; may be repeated.",
            metavar="A-B=LENGTH",
        ),
    ]
    ruler_sigma: Annotated[
        Length,
        Option(
            ERRORS,
            "Standard deviation of measured lengths that state none of their own, and of the rulers that markergen "
            "rescale was given.",
            f"{1e3 * RULER_SIGMA:g}mm",
        ),
    ]
    camera_covariance: Calibrated
    print_sigma: Printed
    scale_sigma: Annotated[
        float,
        Option(
            ERRORS,
            "Standard deviation of the print's scale along x and y while nothing measures it, part of the covariances: "
            "0.002 is 0.2 %.",
            0.002,
            metavar="SHARE",
        ),
    ]
    workers: Workers
    also: Annotated[
        Files,
        Option(
            FILES,
            "Another marker in the photos, with an -o ....json of its own in the same order; may be repeated.",
            metavar="MARKER.JSON",
        ),
    ]


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
