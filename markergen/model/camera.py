"""Camera model: image size, intrinsics and lens distortion."""

import math
import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from numbers import Real
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from markergen.arrays import Array
from markergen.errors import InputError, among, brief
from markergen.maths import distortion as lens
from markergen.maths.conics import fitted_centers
from markergen.maths.lenses import LENSES
from markergen.maths.projection import from_pixels, perspective, to_camera, to_pixels
from markergen.registry import door

LARGEST_SIDE = 20_000
"""Maximum width and height of an image in px, larger than those of any camera."""


LARGEST_COEFFICIENT = 1e12
"""Maximum distortion coefficient: k3 of a long telephoto lens may reach 1e9."""


@dataclass(frozen=True)
class Distortion:
    """Lens distortion in normalized coordinates; see `maths.distortion` for the formulas and the domain.

    Attributes
    ----------
    model : str
        ``none``, ``radtan`` (Brown-Conrady), ``rational``, ``equidistant`` (the fisheye of OpenCV and Kalibr), or
        another of `markergen.maths.lenses.LENSES`.
    coefficients : tuple of float
        In OpenCV's order: radtan k1 k2 p1 p2 [k3]; rational k1 k2 p1 p2 k3 k4 k5 k6; equidistant k1 k2 k3 k4.

    Raises
    ------
    InputError
        If the model is unknown, or the coefficients are not numbers, too many, too few, not finite or above 1e12.

    Examples
    --------
    >>> Distortion("radtan", (-0.28, 0.07, 0, 0)).names
    ('k1', 'k2', 'p1', 'p2')
    """

    model: str = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.model, str) or self.model not in LENSES:
            raise InputError("a known distortion model", brief(self.model), among(self.model, LENSES))
        if isinstance(self.coefficients, str | bytes | Mapping) or not hasattr(self.coefficients, "__iter__"):
            raise InputError("a list of distortion coefficients", brief(self.coefficients), "give numbers")
        object.__setattr__(self, "coefficients", tuple(self.coefficients))
        counts = [len(names) for names in LENSES[self.model].coefficients]
        if len(self.coefficients) not in counts:
            raise InputError(
                f"{' or '.join(map(str, counts))} coefficients of the distortion model {self.model!r}",
                str(len(self.coefficients)),
                f"give {' or '.join(' '.join(names) or 'none' for names in LENSES[self.model].coefficients)}",
            )
        for name, value in zip(self.names, self.coefficients, strict=True):
            number = _number(value)
            if number is None or not abs(number) <= LARGEST_COEFFICIENT:  # NaN fails every comparison.
                raise InputError("finite distortion coefficients", f"{name}={brief(value)}", "check the calibration")
        object.__setattr__(self, "coefficients", tuple(float(value) for value in self.coefficients))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, in order."""
        return next(names for names in LENSES[self.model].coefficients if len(names) == len(self.coefficients))


NO_DISTORTION = Distortion()


@dataclass(frozen=True, repr=False)
class Camera:
    """A camera, in px; pixel centers have integer coordinates, and (0, 0) is the middle of the top-left pixel.

    Without distortion it is a pinhole camera, whose pixels are called ideal px.

    Raises
    ------
    InputError
        If a side is not a whole number of 1 to 20000 px, a focal length is not a positive finite number, the principal
        point is not finite, or one of them is not a number.

    Examples
    --------
    >>> camera = Camera(width=640, height=480, fx=800, fy=800, cx=319.5, cy=239.5)
    >>> camera
    Camera(width=640, height=480, fx=800, fy=800, cx=319.5, cy=239.5)
    >>> print(camera)
    640x480 px, fx 800, fy 800, cx 319.5, cy 239.5, no distortion
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Distortion = NO_DISTORTION

    def __post_init__(self) -> None:
        # Non-numbers become nan, which fails every comparison. Not converted to float: a huge integer would overflow.
        largest, nan = sys.float_info.max, float("nan")
        names = ("width", "height", "fx", "fy", "cx", "cy")
        numbers = {name: _number(getattr(self, name)) for name in names}
        plain = {name: nan if number is None else number for name, number in numbers.items()}
        for name in ("width", "height"):
            if 1 <= plain[name] <= LARGEST_SIDE and plain[name] == int(plain[name]):
                plain[name] = int(plain[name])
                continue
            raise InputError(
                f"an image size of 1 to {LARGEST_SIDE} pixels",
                f"{brief(self.width)}x{brief(self.height)}",
                "give the camera's width and height in whole pixels",
            )
        if not (0 < plain["fx"] <= largest and 0 < plain["fy"] <= largest):
            actual = f"fx={brief(self.fx)}, fy={brief(self.fy)}"
            raise InputError("finite positive focal lengths", actual, "check the camera matrix")
        if not (abs(plain["cx"]) <= largest and abs(plain["cy"]) <= largest):
            actual = f"cx={brief(self.cx)}, cy={brief(self.cy)}"
            raise InputError("a finite principal point", actual, "check the camera matrix")
        if not isinstance(self.distortion, Distortion):
            actual = f"{type(self.distortion).__name__} {brief(self.distortion)}"
            raise InputError("a Distortion", actual, 'give Distortion("radtan", (k1, k2, p1, p2)), for example')
        for name, number in plain.items():
            object.__setattr__(self, name, number)

    @classmethod
    def load(cls, source: "str | os.PathLike[str] | IO[str] | IO[bytes] | Mapping[str, Any]") -> "Camera":
        """Read a calibration of OpenCV, ROS, Kalibr or COLMAP, or a table of plain numbers as returned by `as_dict`.

        Parameters
        ----------
        source : str, path, open file or mapping
            A path, a file open for text or bytes, or its parsed values. ``path#NAME`` selects one of several cameras in
            a file, such as ``camchain.yaml#cam1``.

        Raises
        ------
        InputError
            If the source is none of these, cannot be read, is in no known format, is incomplete or contradicts itself.

        Examples
        --------
        >>> Camera.load({"width": 640, "height": 480, "fx": 800, "fy": 800, "cx": 319.5, "cy": 239.5})
        Camera(width=640, height=480, fx=800.0, fy=800.0, cx=319.5, cy=239.5)
        >>> import io
        >>> Camera.load(io.StringIO("cam0: {camera_model: pinhole, intrinsics: [460, 460, 367, 248],"
        ...                         " distortion_model: none, resolution: [752, 480]}"))
        Camera(width=752, height=480, fx=460.0, fy=460.0, cx=367.0, cy=248.0)
        """
        return door("read.cameras.load_camera")(source)

    def save(
        self, path: "str | os.PathLike[str]", covariance: ArrayLike | None = None, rms: float | None = None
    ) -> None:
        """Write a calibration file that `load` reads, in the format that the end of its name says.

        ``.yaml``, ``.xml`` and ``.json`` are OpenCV's, ``.ros.yaml`` a camera_info, ``.kalibr.yaml`` a camchain,
        ``cameras.txt`` and ``.colmap.txt`` COLMAP's, which counts pixels from the corner; ``.toml`` holds every lens.

        Parameters
        ----------
        covariance : array (k, k) or (k,), or None
            Covariance or standard deviations of `parameter_names`, which ``--camera-covariance`` reads from the file;
            other programs skip the key.
        rms : float or None
            RMS of the residuals in px, OpenCV's ``avg_reprojection_error``.

        Raises
        ------
        InputError
            If the name has no known ending, the format cannot hold the lens, or the covariance is none.
        OutputError
            If the file cannot be written.
        """
        door("read.cameras.files.camera_file")(self, path, covariance, rms)

    @classmethod
    def from_message(cls, message: Any) -> "Camera":
        """Convert a ROS message sensor_msgs/CameraInfo: ROS 1, ROS 2, or the message as a dict.

        K and D are read, which apply to the image as taken, not P, which applies to the rectified one.

        Parameters
        ----------
        message : object or mapping
            With height, width, distortion_model, D and K or d and k; binning_x, binning_y and roi are used if present.

        Raises
        ------
        InputError
            If it is incomplete or contradicts itself, was never calibrated, has an unknown lens model, or describes a
            binned image or a part of one.

        Examples
        --------
        >>> from types import SimpleNamespace
        >>> info = SimpleNamespace(width=640, height=480, distortion_model="plumb_bob", d=[0.1, -0.2, 0, 0, 0],
        ...                        k=[800, 0, 319.5, 0, 800, 239.5, 0, 0, 1], binning_x=0, binning_y=0)
        >>> print(Camera.from_message(info))
        640x480 px, fx 800, fy 800, cx 319.5, cy 239.5, radtan k1 0.1, k2 -0.2, p1 0, p2 0, k3 0
        """
        return door("read.cameras.calibration.camera_of_message")(message)

    @classmethod
    def from_cv2(cls, matrix: Any, distortion: Any, size: Sequence[int], fisheye: bool = False) -> "Camera":
        """Convert the results of cv2.calibrateCamera or cv2.fisheye.calibrate.

        Parameters
        ----------
        matrix : array (3, 3)
        distortion : array (k,), (k, 1), (1, k), or None
            In OpenCV's order: 4, 5 or 8 coefficients, or 12 or 14 whose last ones are 0; None is no distortion.
        size : (width, height)
            In OpenCV's order; ``image.shape[1::-1]`` for an image.
        fisheye : bool
            True if the coefficients are the four of cv2.fisheye.

        Raises
        ------
        InputError
            If a shape is wrong, the matrix has skew or is transposed, the coefficients are of thin prisms or a tilted
            sensor, or matrix and size belong to different images.

        Examples
        --------
        >>> matrix = np.array([[800, 0, 319.5], [0, 800, 239.5], [0, 0, 1]])
        >>> Camera.from_cv2(matrix, None, (640, 480))
        Camera(width=640, height=480, fx=800.0, fy=800.0, cx=319.5, cy=239.5)
        >>> Camera.from_cv2(matrix, [[0.1, -0.2, 0, 0, 0]], (640, 480)).distortion.model
        'radtan'
        """
        return door("read.cameras.calibration.camera_of_arrays")(matrix, distortion, size, fisheye)

    def __repr__(self) -> str:
        parts = [f"{name}={getattr(self, name)!r}" for name in ("width", "height", "fx", "fy", "cx", "cy")]
        parts += [] if self.distortion == NO_DISTORTION else [f"distortion={self.distortion!r}"]
        return f"Camera({', '.join(parts)})"

    def __str__(self) -> str:
        lengths = ", ".join(f"{name} {getattr(self, name):.7g}" for name in ("fx", "fy", "cx", "cy"))
        lens = zip(self.distortion.names, self.distortion.coefficients, strict=True)
        model = f"{self.distortion.model} {', '.join(f'{name} {value:.7g}' for name, value in lens)}"
        distorted = "no distortion" if self.distortion == NO_DISTORTION else model
        return f"{self.width}x{self.height} px, {lengths}, {distorted}"

    @property
    def matrix(self) -> Array:
        """K = [fx 0 cx; 0 fy cy; 0 0 1], shape (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=float)

    @property
    def focal(self) -> Array:
        """Focal lengths (fx, fy) in px, shape (2,)."""
        return np.array([self.fx, self.fy], dtype=float)

    @property
    def ideal(self) -> "Camera":
        """The same camera without lens distortion."""
        return self if self.distortion == NO_DISTORTION else replace(self, distortion=NO_DISTORTION)

    def scaled(self, factor: float) -> "Camera":
        """Return the camera with `factor` times as many pixels along both axes; the image's edges stay where they are.

        >>> Camera(640, 480, 800, 800, 319.5, 239.5).scaled(2)
        Camera(width=1280, height=960, fx=1600, fy=1600, cx=639.5, cy=479.5)
        """
        if not (isinstance(factor, Real) and 0 < factor < float("inf")):
            raise InputError("a factor above 0", brief(factor), "give a number: 0.5 for half as many pixels per side")
        return replace(
            self,
            width=max(1, round(factor * self.width)),
            height=max(1, round(factor * self.height)),
            fx=factor * self.fx,
            fy=factor * self.fy,
            cx=factor * (self.cx + 0.5) - 0.5,
            cy=factor * (self.cy + 0.5) - 0.5,
        )

    @property
    def fields_of_view(self) -> dict[str, float]:
        """Angles in rad between the rays of opposite edges and corners of the image; nan beyond the lens model."""
        right, low = self.width - 0.5, self.height - 0.5
        pairs = {
            "horizontal": [[-0.5, self.cy], [right, self.cy]],
            "vertical": [[self.cx, -0.5], [self.cx, low]],
            "diagonal": [[-0.5, -0.5], [right, low]],
        }
        rays = self.from_pixels(np.array([*pairs.values()], dtype=float))
        return dict(zip(pairs, np.arctan(np.linalg.norm(rays, axis=-1)).sum(axis=-1).tolist(), strict=True))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the k parameters, in the order of `parameter_jacobian`: fx, fy, cx, cy, then the distortion's."""
        return ("fx", "fy", "cx", "cy", *self.distortion.names)

    def as_dict(self) -> dict[str, Any]:
        """Return the camera as plain JSON values in px; the key of the distortion is left out without distortion."""
        values = asdict(self.ideal)
        del values["distortion"]
        if self.distortion != NO_DISTORTION:
            model, coefficients = self.distortion.model, list(self.distortion.coefficients)
            values["distortion"] = {"model": model, "coefficients": coefficients}
        return values

    def to_pixels(self, normalized: Array) -> Array:
        """Map normalized coordinates (..., 2) = (X/z, Y/z) to image points (..., 2) in px, through the lens.

        nan beyond the radius at which the distortion folds over (see `maths.distortion`): nothing is visible there.
        """
        return to_pixels(self._distorted(normalized), self.matrix)

    def dot_centers(self, center: Array, shape: Array) -> Array:
        """Return the centers (..., 2) in px of the ellipses that a detector fits to dots; see `maths.conics`."""
        if self.distortion == NO_DISTORTION:
            return self.to_pixels(center)
        return fitted_centers(center, shape, self.to_pixels)

    def from_pixels(self, pixels: Array) -> Array:
        """Invert `to_pixels`, to 1e-13 of the focal length; nan where no ray reaches the pixel."""
        normalized = from_pixels(pixels, self.matrix)
        return lens.undistort(self.distortion.model, normalized, self.distortion.coefficients)

    def pixel_jacobian(self, normalized: Array) -> Array:
        """Return the derivative (..., 2, 2) of `to_pixels`, px; nan where that is nan."""
        if self.distortion == NO_DISTORTION:
            return np.broadcast_to(np.diag(self.focal), (*normalized.shape[:-1], 2, 2))
        jacobian = lens.distortion_jacobian(self.distortion.model, normalized, self.distortion.coefficients)
        return self.focal[:, None] * jacobian

    def parameter_jacobian(self, normalized: Array) -> Array:
        """Return the derivative (..., 2, k) of `to_pixels` by the k `parameter_names`; nan where that is nan."""
        model, coefficients = self.distortion.model, self.distortion.coefficients
        distorted = self._distorted(normalized)
        jacobian = np.zeros((*normalized.shape[:-1], 2, 4 + len(coefficients)))
        jacobian[..., 0, 0], jacobian[..., 1, 1] = distorted[..., 0], distorted[..., 1]
        jacobian[..., 0, 2] = jacobian[..., 1, 3] = 1
        jacobian[..., 4:] = self.focal[:, None] * lens.coefficient_jacobian(model, normalized, coefficients)
        jacobian[np.isnan(distorted).any(axis=-1)] = np.nan
        return jacobian

    def project(self, points: Array, rotation: Array, translation: Array) -> Array:
        """Project marker points (..., n, 2 or 3) under P poses to image points (..., P, n, 2) in px, through the lens.

        Points behind the camera come out mirrored, as the formula gives them; `to_camera` returns the depth.
        """
        return self.to_pixels(perspective(to_camera(points, rotation, translation)))

    def sees(self, pixels: Array) -> NDArray[np.bool_]:
        """Return which points (..., 2) lie on the sensor, from the first pixel's outer edge to the last one's."""
        size = np.array([self.width, self.height])
        return np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=-1)

    def _distorted(self, normalized: Array) -> Array:
        return lens.distort(self.distortion.model, normalized, self.distortion.coefficients)

    @property
    def cv2_distortion(self) -> Array:
        """Distortion coefficients for OpenCV, to go with `matrix`, shape (4,), (5,) or (8,); zeros without distortion.

        Those of the model ``equidistant`` are for `cv2.fisheye`: `cv2.projectPoints`, `cv2.solvePnP` and
        `cv2.drawFrameAxes` do not support it, and would misinterpret them.
        """
        return np.array(self.distortion.coefficients or (0.0,) * 5, dtype=float)


def _number(value: object) -> int | float | None:
    """Return a Python number for a number of Python or NumPy; None for anything else."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    return int(value) if isinstance(value, int) else float(value)


PAPER_CAMERA = Camera(640, 480, 800.0, 800.0, 320.0, 240.0)
"""The simulated camera of Acuna & Willert (2018), section IV."""

NAMED_CAMERAS = {"webcam": PAPER_CAMERA, "phone": Camera(4032, 3024, 3000.0, 3000.0, 2015.5, 1511.5)}
"""Typical cameras, by the names that stand for their files: 44 degrees wide, and 68."""

SIZE_AND_ANGLE = "1280x720@60deg"
"""How to write a camera without a calibration: the size of its images and its horizontal angle of view."""


def typical_camera(text: object) -> Camera | None:
    """Return the camera of a name, or of `SIZE_AND_ANGLE` with square pixels and no distortion; None for other texts.

    >>> round(typical_camera("1280x720@60deg").fx)
    1109
    """
    match = re.fullmatch(r"(\d{1,6})x(\d{1,6})@(\d{1,3}(?:\.\d+)?)deg", str(text))
    if not match:
        return NAMED_CAMERAS.get(str(text))
    width, height, angle = int(match[1]), int(match[2]), float(match[3])
    if not 0 < angle < 180:
        expected = "a horizontal angle of view above 0 and below 180 degrees"
        raise InputError(expected, brief(text), f"write such as {SIZE_AND_ANGLE}")
    focal = width / 2 / math.tan(math.radians(angle) / 2)
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
