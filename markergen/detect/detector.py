"""The detector, built once and used for every frame, and detection in single images."""

# tests: tests/detect/test_detector.py tests/detect/test_detection.py

import operator
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import markergen_detect as engine
import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.results import Found
from markergen.errors import InputError, brief
from markergen.estimators.budget import ErrorSources
from markergen.estimators.weighted_pose import DEFAULT_ERRORS, PoseEstimate, estimate_pose
from markergen.maths.rotation import rotation_z
from markergen.model.body import Body
from markergen.model.body_json import load_marker_or_rig
from markergen.model.camera import Camera, typical_camera
from markergen.model.detector_json import detector_content
from markergen.model.marker import Marker, check_supported
from markergen.model.rescale import poor_fit_sentence
from markergen.model.rig import Rig, Target, planned_print
from markergen.options import as_list, signature_of
from markergen.options.kinds import CameraLike, TargetLike
from markergen.read.cameras.covariance import camera_covariance as covariance_of
from markergen.read.cameras.covariance import counted, is_exact
from markergen.read.images import check_frame, grey_frame, read_image
from markergen.units import parse_length

FrameLike = NDArray[Any] | str | os.PathLike[str]

MAX_COPIES = engine.detector.MOST_COPIES
"""Maximum number of copies of one marker in one image."""

_MAP_PX = 8
"""Distance of the places, px, at which a plug-in's lens is sampled."""


NO_POSES = "dots and homographies without a camera; for poses give --camera FILE (markergen calibrate measures one)"
TYPICAL = (
    "--camera {} is a typical one, not yours: sigmas leave out how they differ; markergen calibrate measures yours"
)
"""What a detector without a camera has to say."""


def check_deadline(deadline: float | None) -> None:
    """Refuse a deadline that is not above 0 s; None stands for none."""
    if deadline is not None and not deadline > 0:
        raise InputError("a deadline above 0 s", f"{deadline:g}", "give seconds such as 0.1, or leave it out")


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
        ``"none"``: a marker whose layout repeats under a rotation is ambiguous; ``"any"``: one of its labelings is taken,
        the same from frame to frame, and `Found.turns` has the others.
    smallest : float
        Diameter of the smallest dots to look for, px: with larger ones, large images take less time.
    scale_sigma : float
        Standard deviation of the print's scale along x, and along y, as a fraction; measured dots have none.

    Raises
    ------
    InputError
        If a marker or the camera cannot be read or is of the wrong type, a marker has fewer than four dots, collinear
        dots, dots without size, or relief and there is no camera, or another argument is out of range.

    Examples
    --------
    The pose can be passed to OpenCV functions that take ``rvec`` and ``tvec``:

    >>> import cv2, numpy as np
    >>> from markergen.detect import Detector
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.camera import NAMED_CAMERAS, Camera
    >>> from markergen.model.marker import build_marker
    >>> from markergen.render import Optics, render_view
    >>> square = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
    >>> marker = build_marker(square, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> camera = Camera(160, 120, 200, 200, 80, 60)
    >>> detector = Detector(marker, camera)
    >>> rotation, translation = np.diag([1.0, -1.0, -1.0]), np.array([0.01, 0, 0.4])
    >>> frame = render_view(marker, camera, rotation, translation, Optics(), np.random.default_rng(0))
    >>> (found,) = detector(frame)
    >>> print(found.ok, found.ids, found.tvec.round(3).ravel())
    True [0 1 2 3] [0.01 0.   0.4 ]
    >>> pixels, _ = cv2.projectPoints(found.xyz, found.rvec, found.tvec, camera.matrix, camera.cv2_distortion)
    >>> bool(np.abs(pixels[:, 0] - found.pixels).max() < 0.1)
    True
    >>> found.draw(frame).shape
    (120, 160, 3)
    >>> moved = render_view(marker, camera, rotation, translation + 0.002, Optics(), np.random.default_rng(1))
    >>> (found,) = detector(moved, near=found)
    >>> found.tvec.round(3).ravel()
    array([0.012, 0.002, 0.402])
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
        camera_covariance: str | Path | Array | None = None,
        copies: int = MAX_COPIES,
        symmetric: str = "none",
        smallest: float = 0.0,
        scale_sigma: float = 0.0,
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
        self._note = NO_POSES if camera is None else counted(camera_covariance, camera, covariance)
        if isinstance(camera, str | Path) and typical_camera(camera):
            self._note = TYPICAL.format(camera)
        sources = as_list(markers)
        if not sources:
            raise InputError("one marker or more", "none", "say what to look for")
        named = [_marker(source, f"marker {k}" if len(sources) > 1 else "marker") for k, source in enumerate(sources)]
        self._markers = tuple(marker for marker, _ in named)
        self._names = tuple(name for _, name in named)
        doubts = [f"{name}: {doubt}" for marker, name in named if (doubt := poor_fit_sentence(marker))]
        self._note = "\n".join(filter(None, [self._note, *doubts]))
        printed = planned_print(*self._markers) if print_sigma is None else parse_length(print_sigma, "print_sigma")
        errors = ErrorSources(printed, covariance, scale_sigma=scale_sigma)
        if not isinstance(symmetric, str) or symmetric not in ("none", "any"):
            raise InputError("symmetric: none or any", brief(symmetric), "give one of these")
        if not (isinstance(smallest, int | float) and 0 <= smallest < float("inf")):
            raise InputError("a diameter of 0 px or more", f"smallest={brief(smallest)}", "give a number of px")
        if not (hasattr(copies, "__index__") and operator.index(copies) >= 1):
            raise InputError("one copy or more of each marker", f"copies={brief(copies)}", "give a whole number from 1")
        self._symmetric, self._print_sigma = symmetric == "any", errors.print_sigma
        for target in self._markers:
            _check(target, self._camera is not None)
        self._engine = engine.Detector(
            detector_content(self._markers, self._names),
            None if self._camera is None else described(self._camera),
            print_sigma=errors.print_sigma,
            scale_sigma=errors.scale_sigma,
            camera_covariance=errors.camera_covariance,
            copies=min(operator.index(copies), MAX_COPIES),
            symmetric=self._symmetric,
            smallest=smallest,
        )

    @property
    def markers(self) -> tuple[Target, ...]:
        """Markers and rigs that the detector looks for."""
        return self._markers

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the markers: their files, where they came from one."""
        return self._names

    @property
    def note(self) -> str:
        """Lines on what is not as usual: no camera, a covariance taken from its file, a doubtful print; or empty."""
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
        whole: bool = False,
    ) -> list[Found]:
        """Find the markers in a frame.

        With `near`, the result of the frame before, only the surroundings of what was found there are looked at, which
        takes a few milliseconds at any image size. The whole frame is searched if any of these markers is not found
        again for certain, or `near` says that one was not found: pass on each frame's whole result to find every marker
        in every frame. Further copies of a marker are noticed only when the whole frame is searched: give `whole` now
        and then if copies may enter. What is found must pass the same tests as in a whole frame: a wrong `near` costs
        time, and changes no label but those of a symmetric layout. Dots within 3 px of the image's edge are left out.

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
        whole : bool
            Search the whole frame in any case; `near` then only keeps the labels of symmetric layouts.

        Returns
        -------
        list of Found
            Every copy found, best first, then one result with the reason for each marker that was looked for and not
            found.

        Raises
        ------
        InputError
            If the frame is no such array or image, or not of the camera's size, `near` is not such results, or the
            deadline is not above 0.
        """
        check_deadline(deadline)
        grey = grey_frame(self._read(frame))
        before = () if near is None else [self._before(one) for one in as_list(near)]
        findings = self._engine(grey, near=() if whole else before, deadline=deadline)
        if self._symmetric:
            findings = [_labeled_as_before(finding, before, self._markers[finding.body]) for finding in findings]
        return [Found(finding, self._markers, self._names, self._camera, self._print_sigma) for finding in findings]

    def dots(self, frame: FrameLike) -> Array:
        """Return the centers (m, 2) in px of the image ellipses of all dots in a frame, unlabeled, of a marker or not.

        They are dark dots, light dots, or both, as the markers have them, the dark ones first. They are not corrected
        for perspective, which would take the pose. Takes and raises the same as `__call__`.
        """
        grey = grey_frame(self._read(frame))
        lights = sorted({marker.plates[0].marker.light for marker in self._markers})
        return np.concatenate([engine.find_dots(grey, light).center for light in lights])

    def __repr__(self) -> str:
        names = ", ".join(self._names[:3]) + (f" and {len(self._names) - 3} more" if len(self._names) > 3 else "")
        camera = f"{self._camera.width}x{self._camera.height} px" if self._camera else "no camera"
        return f"Detector({names}; {camera})"

    def _read(self, frame: object) -> NDArray[Any]:
        """Pixels of a frame of the camera, whose file is read if this is a path."""
        pixels = read_image(Path(frame)).grey if isinstance(frame, str | os.PathLike) else check_frame(frame)
        height, width = pixels.shape[:2]
        if self._camera is not None and (width, height) != (self._camera.width, self._camera.height):
            is_sideways = (height, width) == (self._camera.width, self._camera.height)
            raise InputError(
                f"an image of the camera's {self._camera.width}x{self._camera.height} px",
                f"{width}x{height} px",
                "give the file's path, which is read as the sensor took it: cv2.imread rotates by EXIF orientation"
                if is_sideways
                else "give the calibration for this size: cropped or scaled images have another",
            )
        return pixels

    def _before(self, result: object) -> engine.Finding:
        """Return where a marker was in another frame, numbered as this detector's markers."""
        if not isinstance(result, Found):
            raise InputError(
                "near: results for the frame before", brief(result), "give what the detector returned for that frame"
            )
        if result.markers is self._markers:
            return result.finding
        if result.marker not in self._markers:
            raise InputError(
                "near: results for markers of this detector",
                f"one for {result.name}",
                "give what this detector returned for the frame before",
            )
        return result.finding._replace(body=self._markers.index(result.marker))


Detector.__signature__ = signature_of(Detector)  # type: ignore[attr-defined]


def _marker(source: Any, name: str) -> tuple[Target, str]:
    """Return a marker or rig and its name."""
    if isinstance(source, Marker | Rig):
        return source, name
    return load_marker_or_rig(source), str(Path(source)) if isinstance(source, str | os.PathLike) else name


def _labeled_as_before(finding: engine.Finding, before: Iterable[engine.Finding], target: Target) -> engine.Finding:
    """Return a marker whose layout repeats with those labels by which it is turned least since the frame before."""
    earlier = [past.placed["R"].reshape(3, 3) for past in before if past.body == finding.body and past.ok]
    if not (finding.ok and len(finding.turns) and earlier and isinstance(target, Marker)):
        return finding
    rotation = finding.placed["R"].reshape(3, 3)
    symmetries = [np.eye(3), *rotation_z(finding.turns)]
    symmetry = max(symmetries, key=lambda candidate: max(np.trace(past.T @ rotation @ candidate) for past in earlier))
    # Dot i is at Q (X - c) + c, with X the place of dot k, as which it is seen when turned.
    row, xyz, center = {number: i for i, number in enumerate(target.ids.tolist())}, target.xyz, target.xyz.mean(axis=0)
    seen = [row[number] for number in finding.ids.tolist()]
    ids = target.ids[np.linalg.norm((xyz[seen] - center) @ symmetry + center - xyz[:, None], axis=-1).argmin(axis=0)]
    order, offset = np.argsort(ids), center - symmetry @ center
    plane = np.array([[*symmetry[0, :2], offset[0]], [*symmetry[1, :2], offset[1]], [0, 0, 1]])
    placed = finding.placed.copy()
    placed["t"] += rotation @ offset
    placed["R"] = (rotation @ symmetry).ravel()
    second = finding.second and finding.second._replace(
        rotation=finding.second.rotation @ symmetry,
        translation=finding.second.translation + finding.second.rotation @ offset,
    )
    posed = finding.rotation is not None
    return finding._replace(
        ids=ids[order],
        guess=ids[order],
        **{name: getattr(finding, name)[order] for name in ("pixels", "pixel_covariance", "ellipse_centers")},
        rotation=rotation @ symmetry if posed else None,
        translation=placed["t"] if posed else None,
        homography=None if finding.homography is None else finding.homography @ plane,
        second=second,
        placed=placed,
    )


def _check(target: Target, calibrated: bool) -> None:
    """Refuse what cannot be detected."""
    for plate in target.plates:
        marker = plate.marker
        check_supported(marker, "to detect")
        if len(marker) < 4:
            raise InputError("4 or more control points", f"n={len(marker)}", "a pose needs four")
        if not marker.radii.all():
            raise InputError("dots that can be seen", "a dot of diameter 0", "design the marker with --dot above 0")
        points = marker.search_xyz - marker.search_xyz.mean(axis=0)
        scatter = np.linalg.eigvalsh(points.T @ points)
        if scatter[1] <= 1e-6 * scatter[2]:
            raise InputError(
                "control points that span a plane", "all of them on one line", "use a layout that spans the plane"
            )
        if not calibrated and np.ptp(marker.search_xyz[:, 2]):
            raise InputError("a camera for a marker with relief", "none", "give the camera's calibration")
    if not calibrated and target.frame == "rig":
        raise InputError("a camera for a rig", "none", "give the camera's calibration")


def described(camera: Camera) -> engine.Camera:
    """Return a camera as the engine takes it: with the lens's coefficients, or a sampled map of a plug-in's lens."""
    numbers = camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
    model, coefficients = camera.distortion.model, tuple(map(float, camera.distortion.coefficients))
    if model in engine.LENSES:
        return engine.Camera(*numbers, model, coefficients)
    columns, rows = (int(np.ceil(side / _MAP_PX)) + 1 for side in (camera.width, camera.height))
    x, y = (np.linspace(-0.5, side - 0.5, count) for side, count in ((camera.width, columns), (camera.height, rows)))
    lens = camera.from_pixels(np.stack(np.meshgrid(x, y), axis=-1))
    sampled = engine.Camera(*numbers, "sampled", (), lens)
    between = np.stack(np.meshgrid(x[:-1] + np.diff(x) / 2, y[:-1] + np.diff(y) / 2), axis=-1).reshape(-1, 2)
    error = camera.focal * np.abs(sampled.rays(between) - camera.from_pixels(between))
    return replace(sampled, error_px=float(np.nanmax(error, initial=0.0)))


Image = NDArray[np.uint8] | NDArray[np.uint16]


@lru_cache(maxsize=16)
def _prepared(markers: tuple[Target, ...], camera: Camera | None, errors: ErrorSources, copies: int) -> Detector:
    return Detector(
        markers,
        camera,
        print_sigma=errors.print_sigma,
        scale_sigma=errors.scale_sigma,
        camera_covariance=None if camera is None else errors.camera_covariance,
        copies=copies,
    )


def detect(image: Image, marker: Target, camera: Camera | None = None, errors: ErrorSources = DEFAULT_ERRORS) -> Found:
    """Find one marker or rig in an image; if there are several copies, the one with the most dots.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    camera : Camera or None
        Without one, labels follow from the homography alone, and there is no pose.
    errors : ErrorSources
        Errors of print and calibration, for the weights of the dots and the pose's covariance.

    Raises
    ------
    InputError
        As `Detector` does. An image without the marker is not an error.
    """
    return detect_all(image, [marker], camera, errors, copies=1)[0]


def detect_all(
    image: Image,
    markers: Sequence[Target],
    camera: Camera | None = None,
    errors: ErrorSources = DEFAULT_ERRORS,
    copies: int = MAX_COPIES,
) -> list[Found]:
    """Find all copies of all markers and rigs in an image, best first; raises as `Detector` does.

    A blob that two markers claim with labelings about as likely is assigned to neither. A tag that is read decides
    between markers that differ by their tags, and between labelings; otherwise, dots and key ring do.
    """
    return _prepared(tuple(markers), camera, errors, copies)(image)


def body_poses(result: Found, body: Body, camera: Camera, errors: ErrorSources) -> "list[tuple[int, PoseEstimate]]":
    """Return the number of each constellation of a body and its pose from its own dots alone, where these suffice."""
    poses = []
    rows = {int(number): k for k, number in enumerate(result.ids)}
    for k, part in enumerate(body.constellations):
        pairs = [(i, rows[number]) for i, number in enumerate(body.ids[part.dots].tolist()) if number in rows]
        if len(pairs) < 4:
            continue
        dots, seen = (np.array(column) for column in zip(*pairs, strict=True))
        places = part.marker.xyz[dots]
        pixels, covariance = result.pixels[seen], result.pixel_covariance[seen]
        pose = estimate_pose(places, pixels, covariance, camera, errors.of(part.marker, dots))
        if pose is not None:
            poses.append((k, pose))
    return poses
