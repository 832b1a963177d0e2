"""What the formats share: their names of distortion models, and the checks that file and camera agree."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from markergen.errors import InputError, brief
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera, Distortion

SHORTEST, LONGEST = 1e-3, 1e6
"""Focal lengths in image sides: a field of view of nearly 180 degrees, and one of a fifth of an arc second."""


@contextmanager
def located(place: str) -> Iterator[None]:
    """Add the place in the file to what is wrong with a value."""
    try:
        yield
    except InputError as error:
        expected, found, remedy = error.args
        raise InputError(f"{expected} at {place}", found, remedy) from None


def make_distortion(name: str, coefficients: Sequence[float], model_place: str, place: str) -> Distortion:
    """Distortion of a model by any of its names; without a name OpenCV's, which their number decides.

    `model_place` and `place` tell where the name and the coefficients stand.
    """
    model = _opencv(coefficients) if name == "" else _named(name.lower(), model_place)
    # A pinhole camera is no fisheye without distortion: that images angles.
    if not coefficients and LENSES[model].opencv:
        return Distortion()
    # OpenCV pads with zeros: 12 coefficients have thin prisms, 14 a tilted sensor, too.
    most = max(map(len, LENSES[model].coefficients))
    cut = coefficients if any(coefficients[most:]) else coefficients[:most]
    with located(place):
        if len(cut) in (12, 14) and model == "rational":
            raise InputError(
                "no thin prism and no tilted sensor, coefficients 9 to 14",
                f"{len(cut)} coefficients that are not 0",
                "calibrate without these terms",
            )
        return Distortion(model, tuple(cut))


def _named(name: str, place: str) -> str:
    """Model of `Distortion` by a name that ROS, Kalibr or OpenCV's users give it."""
    if name in LENSES:
        with located(place):
            LENSES[name]  # A plug-in that does not work says so.
        return name
    aliases = {alias: model for model in LENSES for alias in LENSES[model].aliases}
    if name not in aliases:
        known = dict.fromkeys(word for model in LENSES for word in (model, *LENSES[model].aliases))
        raise InputError(f"a known distortion model at {place}", brief(name), f"known: {', '.join(known)}")
    return aliases[name]


def _opencv(coefficients: Sequence[float]) -> str:
    return "radtan" if len(coefficients) < 8 else "rational"


def make_camera(
    width: int,
    height: int,
    matrix: tuple[float, float, float, float],
    distortion: Distortion,
    place: str,
    size_place: str,
) -> Camera:
    """Camera of an image size and (fx, fy, cx, cy); `place` and `size_place` tell where these stand.

    Raises
    ------
    InputError
        As `Camera` does, if the focal lengths are no such of a lens, or if the principal point is not in the image:
        then size and matrix are of two cameras, of two resolutions of one, or width and height are exchanged.
    """
    fx, fy, cx, cy = matrix
    with located(size_place):
        Camera(width, height, 1.0, 1.0, 0.0, 0.0)
    with located(place):
        camera = Camera(width, height, fx, fy, cx, cy, distortion)
        if not (SHORTEST * width <= fx <= LONGEST * width and SHORTEST * height <= fy <= LONGEST * height):
            raise InputError(
                f"focal lengths in px that go with an image of {width}x{height} px", f"fx={fx}, fy={fy}",
                "check the camera matrix; are these mm?",
            )  # fmt: skip
        if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
            raise InputError(
                f"a principal point inside the image of {width}x{height} px",
                f"cx={cx}, cy={cy}",
                "give the calibration of this image size",
            )
    return camera


def pinhole_of(matrix: Sequence[float], place: str) -> tuple[float, float, float, float]:
    """(fx, fy, cx, cy) of the nine entries of a camera matrix, row by row.

    Raises
    ------
    InputError
        If it is not of the form [fx 0 cx; 0 fy cy; 0 0 1]: skew is not modeled, and Matlab's is the transpose.
    """
    if len(matrix) != 9:
        raise InputError(f"a 3x3 camera matrix at {place}", f"{len(matrix)} numbers", "correct the file")
    fx, skew, cx, a, fy, cy, b, c, one = matrix
    # Rounding may leave traces, far below what a pixel could tell.
    if not (abs(skew) <= 1e-9 * abs(fx) and a == b == c == 0 and one == 1) and any(matrix):
        raise InputError(
            f"a camera matrix [fx 0 cx; 0 fy cy; 0 0 1] at {place}",
            f"[{fx} {skew} {cx}; {a} {fy} {cy}; {b} {c} {one}]",
            "transpose it if it is Matlab's, or calibrate without skew",
        )
    return fx, fy, cx, cy


def no_choice(file: str, choice: str | None) -> None:
    """Refuse the name of a camera in a file that holds one."""
    if choice is not None:
        raise InputError(f"no camera's name after {file}", brief(choice), "leave it out: the file holds one camera")
