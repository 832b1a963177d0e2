"""The detector, built once and used for every frame, and its results."""

import operator
import os
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from markergen_detect import Verdict
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.detection import MAX_COPIES, Engine
from markergen.detect.presentation import as_dict, draw, in_words, reason
from markergen.detect.results import Detection
from markergen.errors import InputError, brief
from markergen.estimators.budget import ErrorSources
from markergen.estimators.weighted_pose import PoseEstimate
from markergen.maths.rotation import logarithm
from markergen.model.body_json import load_marker_or_rig
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.rig import Rig, Target, planned_print
from markergen.options import as_list
from markergen.options.kinds import CameraLike, TargetLike
from markergen.read.cameras.covariance import camera_covariance as covariance_of
from markergen.read.cameras.covariance import counted, is_exact
from markergen.read.images import check_frame, grey_frame, read_image
from markergen.units import parse_length

CovarianceSource = str | Path | Array | None
FrameLike = NDArray[Any] | str | os.PathLike[str]


@dataclass(frozen=True, eq=False)
class SecondPose:
    """Second pose T_camera_marker that fits a flat marker, with its likelihood relative to the first.

    Attributes
    ----------
    rotation, translation : arrays (3, 3) and (3,), m
    likelihood_ratio : float
        Likelihood ratio of this pose to the first one, 0 to 1.
    """

    rotation: Array
    translation: Array
    likelihood_ratio: float

    @property
    def rvec(self) -> Array:
        """Rotation vector (3, 1), rad, in OpenCV's form."""
        return logarithm(self.rotation)[:, None]

    @property
    def tvec(self) -> Array:
        """Translation (3, 1), m, in OpenCV's form."""
        return self.translation[:, None]


@dataclass(frozen=True, eq=False, repr=False)
class Found:
    """The result for one marker in one frame.

    If labels are ambiguous, `pixels` still has the dots, and `ids` is empty. Without a pose (there is no camera, or the
    marker was not found), everything that depends on it is None.

    Attributes
    ----------
    detection : Detection
        Complete result of the detection engine.
    markers : tuple of Marker or Rig
        Markers and rigs that were looked for.
    names : tuple of str
        Names of the markers: their files, where they came from one.
    camera : Camera or None

    Examples
    --------
    The pose can be passed to OpenCV functions that take ``rvec`` and ``tvec``:

    >>> import cv2, numpy as np
    >>> from markergen.detect import Detector
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.camera import Camera
    >>> from markergen.model.marker import build_marker
    >>> from markergen.render import Optics, render_view
    >>> square = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
    >>> marker = build_marker(square, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> camera = Camera(160, 120, 200, 200, 80, 60)
    >>> rotation, translation = np.diag([1.0, -1.0, -1.0]), np.array([0.01, 0, 0.4])
    >>> frame = render_view(marker, camera, rotation, translation, Optics(), np.random.default_rng(0))
    >>> (found,) = Detector(marker, camera)(frame)
    >>> found.ids
    array([0, 1, 2, 3])
    >>> pixels, _ = cv2.projectPoints(found.xyz, found.rvec, found.tvec, camera.matrix, camera.cv2_distortion)
    >>> bool(np.abs(pixels[:, 0] - found.pixels).max() < 0.1)
    True
    >>> found.draw(frame).shape
    (120, 160, 3)
    """

    detection: Detection = field(repr=False)
    markers: tuple[Target, ...]
    names: tuple[str, ...]
    camera: Camera | None

    @property
    def ok(self) -> bool:
        """True if four or more control points were found, with unique labels."""
        return self.detection.found

    @property
    def reason(self) -> str:
        """Reason why the marker was not found; empty otherwise."""
        return reason(self.detection, self.names)

    @property
    def index(self) -> int:
        """Index of the marker among those that were looked for."""
        return self.detection.marker

    @property
    def marker(self) -> Target:
        """The marker or rig itself."""
        return self.markers[self.index]

    @property
    def name(self) -> str:
        """Name of the marker."""
        return self.names[self.index]

    @property
    def ids(self) -> NDArray[np.intp]:
        """Ids (k,) of the control points found; empty if labels are ambiguous.

        For a rig, they are the numbers of the control points through all its markers, in the order of `Rig.xyz`;
        `Rig.dots` has the name of each one's marker, and its id there.
        """
        return self.detection.ids

    @cached_property
    def xyz(self) -> Array:
        """Control points (k, 3) for `ids`, m, frame of the marker or rig."""
        row = {number: i for i, number in enumerate(self.marker.ids.tolist())}
        return self.marker.xyz[[row[int(i)] for i in self.ids]]

    @property
    def pixels(self) -> Array:
        """Images (k, 2) of the control points in the frame as taken, px; pixel centers at integer coordinates.

        If labels are ambiguous, these are all dots of the best labeling, in no particular order.
        """
        unlabeled = self.detection.unlabeled
        return self.detection.pixels if unlabeled is None else unlabeled.pixels

    @property
    def pixel_covariance(self) -> Array:
        """Covariance (k, 2, 2) of `pixels` from the image's noise, px^2."""
        unlabeled = self.detection.unlabeled
        return self.detection.covariance if unlabeled is None else unlabeled.covariance

    @property
    def pose(self) -> PoseEstimate | None:
        """Pose with its error budget, chi2 and the second solution."""
        return self.detection.pose

    @property
    def rotation(self) -> Array | None:
        """Rotation matrix (3, 3) of T_camera_marker: X_camera = R X_marker + t."""
        return None if self.pose is None else self.pose.rotation

    @property
    def translation(self) -> Array | None:
        """Translation (3,) of T_camera_marker, m."""
        return None if self.pose is None else self.pose.translation

    @property
    def rvec(self) -> Array | None:
        """Rotation vector (3, 1), rad, as cv2.solvePnP returns it."""
        return None if self.pose is None else logarithm(self.pose.rotation)[:, None]

    @property
    def tvec(self) -> Array | None:
        """Translation (3, 1), m, as cv2.solvePnP returns it."""
        return None if self.pose is None else self.pose.translation[:, None]

    @property
    def covariance(self) -> Array | None:
        """Covariance (6, 6) of the pose from image, print and calibration, of (w, dt) in rad and m.

        w and dt are a small rotation and a translation in the camera frame: R <- exp([w]x) R, from the left, and
        t <- t + dt. This is not the covariance of `rvec`. `pose.budget` has the three parts.
        """
        return None if self.pose is None else self.pose.budget.total

    @property
    def second(self) -> SecondPose | None:
        """Other pose from which a flat marker looks much the same, if it is likely enough."""
        if self.pose is None or self.pose.alternative is None:
            return None
        return SecondPose(*self.pose.alternative, self.pose.likelihood_ratio)

    @property
    def homography(self) -> Array | None:
        """H (3, 3) from the marker's plane, m, to px of a camera without distortion; None for a marker with relief."""
        return self.detection.homography

    @property
    def tag(self) -> Array | None:
        """Corners (4, 2) of the marker's tag, px, in the order of `Tag.corners`; None if none was read."""
        return self.detection.tag

    @property
    def tag_state(self) -> str:
        """What became of the marker's tag: ``read``, ``other``, ``not read``, or ``none`` for a marker without one."""
        if self.detection.state == "other tag":
            return "other"
        return {"read": "read", "none": "none"}.get(self.detection.tag_state, "not read")

    @property
    def verdict(self) -> Verdict | None:
        """Whether image, print and camera agree, with likely causes if they do not; None without a pose."""
        return self.detection.verdict

    @property
    def turns(self) -> Array:
        """Angles (k,), rad, by which other labelings that are about as likely are turned about the marker's normal."""
        return self.detection.turns

    def draw(self, frame: NDArray[Any]) -> NDArray[Any]:
        """Draw the outline, the dots with their ids and the axes into a frame, and return it.

        A color frame is modified in place, as by OpenCV's functions; for a grey frame, a BGR copy is returned. Without
        a pose there are no axes; dots with ambiguous labels are marked by crosses only.

        Parameters
        ----------
        frame : array (h, w, 3) BGR or (h, w, 4) BGRA, or grey (h, w) or (h, w, 1), of uint8 or uint16

        Raises
        ------
        InputError
            If the frame has another form, or is in color and read-only.
        """
        return draw(frame, self.marker, self.camera, self.detection)

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain JSON values, as ``markergen detect --json`` writes them (docs/detect.md)."""
        return as_dict(self.detection, self.markers, self.names)

    def __str__(self) -> str:
        return in_words(self.detection, self.markers, self.names)

    def __repr__(self) -> str:
        return f"<Found: {self}>"

    def _repr_html_(self) -> str:
        rows = {"marker": self.name, "found": f"{len(self.ids)} of {len(self.marker)} dots" if self.ok else self.reason}
        if self.pose is not None:
            sigma = self.pose.budget
            rows["translation"] = f"{np.array2string(self.pose.translation, precision=5)} m"
            rows["rotation vector"] = f"{np.array2string(logarithm(self.pose.rotation), precision=5)} rad"
            rows["1 sigma"] = f"{sigma.rotation_deg['total']:.2g} deg, {1e3 * sigma.translation['total']:.2g} mm"
        cells = "".join(f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in rows.items())
        return f"<table>{cells}</table>"


class Detector:
    """Finds markers in the frames of one camera; built once, used for every frame.

    Everything that depends only on markers and camera is checked and computed once. A detector is immutable: it may be
    shared by threads, and be sent to other processes.

    Parameters
    ----------
    markers : Marker or Rig, path of a marker.json or rig.json, or its content as a dict; or several of these
        Markers and rigs to find, with all their copies.
    camera : Camera, path of a calibration, or None
        Without one there are pixels and homographies, but no poses.
    print_sigma : str, float or None
        Standard deviation of a printed dot's position along each axis: a length such as ``"0.1mm"``, or m; None is that of
        the design, or 0.1 mm.
    camera_covariance : array (k, k) or (k,), path, or None
        Covariance or standard deviations of the calibration's parameters: fx, fy, cx, cy and the distortion coefficients,
        or the first four alone, in px for those. None takes that in the camera's file, if it has one; ``"none"`` takes
        the calibration as exact.
    copies : int
        Maximum number of copies of each marker to look for in a frame.
    symmetric : str
        ``"none"``: a marker whose layout repeats under a turn is ambiguous; ``"any"``: one of its labelings is taken,
        the same from frame to frame, and `Found.turns` has the others.
    smallest : float
        Diameter of the smallest dots to look for, px: with larger ones, large images take less time.

    Raises
    ------
    InputError
        If a marker or the camera cannot be read or is of the wrong type, a marker has fewer than four dots, collinear
        dots, dots without size, or relief and there is no camera, or another argument is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from markergen.detect import Detector
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.camera import Camera
    >>> from markergen.model.marker import build_marker
    >>> from markergen.render import Optics, render_view
    >>> square = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
    >>> marker = build_marker(square, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> camera = Camera(160, 120, 200, 200, 80, 60)
    >>> detector = Detector(marker, camera)
    >>> rotation, translation = np.diag([1.0, -1.0, -1.0]), np.array([0.01, 0, 0.4])
    >>> frame = render_view(marker, camera, rotation, translation, Optics(), np.random.default_rng(0))
    >>> for found in detector(frame):
    ...     print(found.ok, found.ids, found.tvec.round(3).ravel())
    True [0 1 2 3] [0.01 0.   0.4 ]
    >>> (found,) = detector(np.full((120, 160, 3), 255, np.uint8))
    >>> found.ok, found.reason
    (False, 'found 0 dots in the image, at least 4 are needed')
    >>> detector(None)
    Traceback (most recent call last):
    markergen.errors.InputError: expected an image as a numpy array, found None; cv2.imread returns None when it cannot read the file: check the path
    """  # noqa: E501 - the error is one line

    def __init__(
        self,
        markers: TargetLike | Iterable[TargetLike],
        camera: CameraLike | None = None,
        *,
        print_sigma: str | float | None = None,
        camera_covariance: CovarianceSource = None,
        copies: int = MAX_COPIES,
        symmetric: str = "none",
        smallest: float = 0.0,
    ) -> None:
        self._camera = camera if camera is None or isinstance(camera, Camera) else Camera.load(camera)
        covariance = None
        if self._camera is not None:
            covariance = covariance_of(camera_covariance, camera, self._camera)
        elif camera_covariance is not None and not is_exact(camera_covariance):
            raise InputError(
                "a camera that the covariance belongs to",
                "camera_covariance alone",
                "give its calibration as well, with --camera, or camera= from Python",
            )
        self._note = counted(camera_covariance, camera, covariance)
        sources = as_list(markers)
        named = [_marker(each, f"marker {k}" if len(sources) > 1 else "marker") for k, each in enumerate(sources)]
        self._names = tuple(name for _, name in named)
        self._targets = tuple(marker for marker, _ in named)
        printed = planned_print(*self._targets) if print_sigma is None else parse_length(print_sigma, "print_sigma")
        self._errors = ErrorSources(printed, covariance)
        if symmetric not in ("none", "any"):
            raise InputError("symmetric: none or any", brief(symmetric), "give one of these")
        if not (isinstance(smallest, int | float) and 0 <= smallest < float("inf")):
            raise InputError("a diameter of 0 px or more", f"smallest={brief(smallest)}", "give a number of px")
        self._engine = Engine(
            self._targets, self._camera, self._errors, _count(copies), symmetric=symmetric == "any", smallest=smallest
        )

    @property
    def markers(self) -> tuple[Target, ...]:
        """Markers and rigs that the detector looks for."""
        return self._targets

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the markers: their files, where they came from one."""
        return self._names

    @property
    def note(self) -> str:
        """Sentence on a covariance taken from the camera's file; empty without one."""
        return self._note

    @property
    def camera(self) -> Camera | None:
        """Camera that takes the frames."""
        return self._camera

    def __call__(
        self,
        frame: FrameLike,
        near: "Found | Iterable[Found] | None" = None,
        deadline: float | None = None,
    ) -> list[Found]:
        """Find the markers in a frame.

        With `near`, the result of the frame before, only the surroundings of what was found there are looked at, which
        takes a few milliseconds at any image size. The whole frame is searched if any of these markers is not found
        again for certain, or `near` says that one was not found: pass on each frame's whole result to find every marker
        in every frame. Further copies of a marker are noticed only when the whole frame is searched: leave out `near`
        now and then if copies may enter. What is found must pass the same tests as in a whole frame: a wrong `near`
        costs time, and changes no label. Dots within 3 px of the image's edge are left out.

        Parameters
        ----------
        frame : array (h, w) or (h, w, 1) grey, (h, w, 3) BGR or (h, w, 4) BGRA, of uint8 or uint16; or path of an image
            As cv2.VideoCapture returns it, in any memory layout; it is not changed. Colors are converted to luminance,
            0.299 R + 0.587 G + 0.114 B, and transparent areas to white. A file is read as the sensor took it, while
            cv2.imread rotates what has an EXIF orientation, and the calibration no longer applies.
        near : Found, several of them, or None
            Results for the frame before, of this detector or another one with these markers.
        deadline : float or None
            Seconds after which nothing more is begun; the reasons of what was not found then tell so.

        Returns
        -------
        list of Found
            Every copy found, best first, then one result with the reason for each marker that was looked for and not
            found.

        Raises
        ------
        InputError
            If the frame is no such array or image, or not of the camera's size, or `near` is not such results.

        Examples
        --------
        >>> import numpy as np
        >>> from markergen.detect import Detector
        >>> from markergen.model.boundary import Circle
        >>> from markergen.model.camera import Camera
        >>> from markergen.model.marker import build_marker
        >>> from markergen.render import Optics, render_view
        >>> points = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03], [0.005, 0.0]])
        >>> marker = build_marker(points, Circle(0.06), diameter=0.02, clearance=0.002)
        >>> camera = Camera(160, 120, 200, 200, 80, 60)
        >>> detector, found = Detector(marker, camera), None
        >>> for x in (0.01, 0.012, 0.014):
        ...     rotation, translation = np.diag([1.0, -1.0, -1.0]), np.array([x, 0, 0.4])
        ...     frame = render_view(marker, camera, rotation, translation, Optics(), np.random.default_rng(0))
        ...     found = detector(frame, near=found)
        ...     print(found[0].tvec.round(3)[[0, 2], 0])
        [0.01 0.4 ]
        [0.012 0.4  ]
        [0.014 0.4  ]
        """
        grey = grey_frame(self._read(frame))
        before = [] if near is None else self._before(near)
        tracked = before if all(detection.found for detection in before) else []
        return [
            Found(detection, self.markers, self._names, self._camera)
            for detection in self._engine(grey, tracked, deadline)
        ]

    def dots(self, frame: FrameLike) -> Array:
        """Return the centers (m, 2) in px of the image ellipses of all dots in a frame, unlabeled, of a marker or not.

        They are dark dots, light dots, or both, as the markers have them, the dark ones first. They are not corrected
        for perspective, which would take the pose. Takes and raises the same as `__call__`.
        """
        return self._engine.dots(grey_frame(self._read(frame)))

    def __repr__(self) -> str:
        names = ", ".join(self._names[:3]) + (f" and {len(self._names) - 3} more" if len(self._names) > 3 else "")
        camera = f"{self._camera.width}x{self._camera.height} px" if self._camera else "no camera"
        return f"Detector({names}; {camera})"

    def _read(self, frame: object) -> NDArray[Any]:
        """Pixels of a frame of the camera, whose file is read if this is a path."""
        pixels = read_image(Path(frame)).grey if isinstance(frame, str | os.PathLike) else check_frame(frame)
        height, width = pixels.shape[:2]
        if self._camera is not None and (width, height) != (self._camera.width, self._camera.height):
            turned = (height, width) == (self._camera.width, self._camera.height)
            raise InputError(
                f"an image of the camera's {self._camera.width}x{self._camera.height} px",
                f"{width}x{height} px",
                "give the file's path, which is read as the sensor took it: cv2.imread rotates by EXIF orientation"
                if turned
                else "give the calibration for this size: cropped or scaled images have another",
            )
        return pixels

    def _before(self, near: "Found | Iterable[Found]") -> list[Detection]:
        """Return the detections of results for another frame, numbered as this detector's markers."""
        given = [near] if isinstance(near, Found) else list(near) if isinstance(near, Iterable) else [near]
        before = []
        for each in given:
            if not isinstance(each, Found):
                raise InputError(
                    "near: results for the frame before", brief(each), "give what the detector returned for that frame"
                )
            if each.markers is self.markers:
                before.append(each.detection)
            elif each.marker in self.markers:
                before.append(replace(each.detection, marker=self.markers.index(each.marker)))
            else:
                raise InputError(
                    "near: results for markers of this detector",
                    f"one for {each.name}",
                    "give what this detector returned for the frame before",
                )
        return before


def _marker(source: Any, name: str) -> tuple[Target, str]:
    """Return a marker or rig and its name."""
    if isinstance(source, Marker | Rig):
        return source, name
    return load_marker_or_rig(source), str(Path(source)) if isinstance(source, str | os.PathLike) else name


def _count(copies: object) -> int:
    if not (hasattr(copies, "__index__") and operator.index(copies) >= 1):
        raise InputError("one copy or more of each marker", f"copies={brief(copies)}", "give a whole number from 1")
    return operator.index(copies)
