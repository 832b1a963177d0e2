"""Detection in grey images, by the compiled detector of its own distribution, markergen_detect."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import markergen_detect as engine
import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.results import Detection, Unlabeled
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources, PoseBudget
from markergen.estimators.weighted_pose import DEFAULT_ERRORS, PoseEstimate
from markergen.maths.lenses import LENSES
from markergen.model.body import Body
from markergen.model.camera import Camera
from markergen.model.detector_json import detector_content
from markergen.model.marker import check_supported
from markergen.model.rig import Target
from markergen.read.images import LARGEST_FRAME

Image = NDArray[np.uint8] | NDArray[np.uint16]

MAX_COPIES = 32
"""Maximum number of copies of one marker in one image."""

_MAP_PX = 8
"""Distance of the places, px, at which a plug-in's lens is sampled."""


class Engine:
    """The compiled detector of bodies and a camera, prepared for many images; immutable.

    Parameters
    ----------
    camera : Camera or None
        Without one, there are homographies and no poses.
    errors : ErrorSources
        Errors of print and calibration, for the weights of the dots and the pose's covariance.
    copies : int
        Maximum number of copies of each body.
    symmetric : bool
        True to take any of several labelings that are equally likely.
    smallest : float
        Diameter in px of the smallest dots to look for.

    Raises
    ------
    InputError
        If a body has fewer than four dots, collinear dots, dots without size, or relief and there is no camera; also as
        `check_supported` does.
    """

    def __init__(
        self,
        targets: Sequence[Target],
        camera: Camera | None = None,
        errors: ErrorSources = DEFAULT_ERRORS,
        copies: int = MAX_COPIES,
        *,
        symmetric: bool = False,
        smallest: float = 0.0,
    ) -> None:
        if not targets:
            raise InputError("one marker or more", "none", "say what to look for")
        self.targets, self.camera, self.errors = tuple(targets), camera, errors
        for target in self.targets:
            _check(target, camera is not None)
        names = [f"body {k}" for k in range(len(self.targets))]
        self._detector = engine.Detector(
            detector_content(self.targets, names),
            None if camera is None else described(camera),
            print_sigma=errors.print_sigma,
            scale_sigma=errors.scale_sigma,
            camera_covariance=errors.camera_covariance,
            copies=copies,
            symmetric=symmetric,
            smallest=smallest,
        )

    def __call__(self, image: Image, near: Sequence[Detection] = (), deadline: float | None = None) -> list[Detection]:
        """Find the bodies in a grey image (h, w), best first, then one result for each that was not found.

        With `near`, detections of the frame before, these are looked for where they were.
        """
        _check_image(image)
        tracks = [_placed(detection) for detection in near if detection.track is not None]
        findings = self._detector(image, near=tracks if len(tracks) == len(near) else (), deadline=deadline)
        return [self._detection(finding) for finding in findings]

    def dots(self, image: Image) -> Array:
        """Return the centers (m, 2) in px of all dots' outlines in an image, of a body or not; dark ones first."""
        _check_image(image)
        lights = sorted({target.plates[0].marker.light for target in self.targets})
        return np.concatenate([detect_dots(image, light).center for light in lights])

    def _detection(self, finding: engine.Finding) -> Detection:
        unlabeled = None
        labeled = finding.state in ("ambiguous", "claimed", "hidden tag")
        if labeled and len(finding.pixels):
            places = finding.pixels, finding.pixel_covariance, finding.ellipse_centers
            unlabeled = Unlabeled(*places, finding.guess.astype(np.intp))
        common: dict[str, Any] = {
            "reason": finding.reason,
            "state": finding.state,
            "marker": finding.body,
            "rival": finding.facts.get("rival"),
            "tag_state": finding.tag_state,
            "turns": finding.turns,
            "evidence": finding.evidence,
            "tracked": finding.tracked,
        }
        if not finding.ok:
            return Detection(False, unlabeled=unlabeled, **common)
        return Detection(
            True,
            finding.ids.astype(np.intp),
            finding.pixels,
            finding.pixel_covariance,
            finding.ellipse_centers,
            finding.homography,
            _pose(finding),
            dropped=finding.dropped.astype(np.intp),
            tag=finding.tag_corners,
            misfit=finding.misfit,
            verdict=finding.verdict,
            track=finding,
            **common,
        )


def _placed(detection: Detection) -> engine.Finding:
    """Where a detection's marker was, by its pose if it has one."""
    track: engine.Finding = detection.track
    if detection.pose is None:
        return track
    placed = track.placed.copy()
    placed["R"], placed["t"] = detection.pose.rotation.ravel(), detection.pose.translation
    return track._replace(body=detection.marker, placed=placed)


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


def _check_image(image: object) -> None:
    if not (isinstance(image, np.ndarray) and image.ndim == 2 and image.dtype in (np.uint8, np.uint16)):
        found = f"{image.shape} of {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
        raise InputError("a grey image (h, w) of uint8 or uint16", found, "convert the image to grey")
    if image.size > LARGEST_FRAME:
        height, width = image.shape
        raise InputError(f"an image of up to {LARGEST_FRAME} pixels", f"{width}x{height}", "scale it down")


def described(camera: Camera) -> engine.Camera:
    """Return a camera as the engine takes it: with the lens's coefficients, or a sampled map of a plug-in's lens."""
    numbers = camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
    model, coefficients = camera.distortion.model, tuple(map(float, camera.distortion.coefficients))
    if model in engine.LENSES:
        return engine.Camera(*numbers, model, coefficients)
    assert model in LENSES

    columns, rows = (int(np.ceil(side / _MAP_PX)) + 1 for side in (camera.width, camera.height))
    x, y = (np.linspace(-0.5, side - 0.5, count) for side, count in ((camera.width, columns), (camera.height, rows)))
    lens = camera.from_pixels(np.stack(np.meshgrid(x, y), axis=-1))
    sampled = engine.Camera(*numbers, "sampled", (), lens)
    between = np.stack(np.meshgrid(x[:-1] + np.diff(x) / 2, y[:-1] + np.diff(y) / 2), axis=-1).reshape(-1, 2)
    error = camera.focal * np.abs(sampled.rays(between) - camera.from_pixels(between))
    return replace(sampled, error_px=float(np.nanmax(error, initial=0.0)))


def _pose(finding: engine.Finding) -> PoseEstimate | None:
    if finding.rotation is None or finding.translation is None:
        return None
    parts = finding.image_covariance, finding.print_covariance, finding.camera_covariance, finding.covariance
    budget = PoseBudget(*(np.asarray(part) for part in parts))
    second = finding.second
    return PoseEstimate(
        finding.rotation,
        finding.translation,
        budget,
        finding.chi2,
        finding.degrees_of_freedom,
        finding.scale,
        None if second is None else (second.rotation, second.translation),
        0.0 if second is None else second.likelihood_ratio,
    )


def detect(
    image: Image, marker: Target, camera: Camera | None = None, errors: ErrorSources = DEFAULT_ERRORS
) -> Detection:
    """Find one marker or rig in a grey image; if there are several copies, the one with the most dots.

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
        If the image is not grey of uint8 or uint16, or as `Engine` does. An image without the marker is not an error.
    """
    return detect_all(image, [marker], camera, errors, copies=1)[0]


def detect_all(
    image: Image,
    markers: Sequence[Target],
    camera: Camera | None = None,
    errors: ErrorSources = DEFAULT_ERRORS,
    copies: int = MAX_COPIES,
) -> list[Detection]:
    """Find all copies of all markers and rigs in a grey image, best first; raises as `Engine` does.

    A blob that two markers claim with labelings about as likely is assigned to neither. A tag that is read decides
    between markers that differ by their tags, and between labelings; otherwise, dots and key ring do.
    """
    _check_image(image)
    if not image.size or (camera is not None and image.shape != (camera.height, camera.width)):
        height, width = image.shape
        size = "pixels" if camera is None else f"the camera's {camera.width}x{camera.height} px"
        reason = f"found 0 dots in an image of {width}x{height} px; expected {size}"
        return [Detection(False, reason=reason, marker=k, state="few") for k in range(len(markers))]
    return _prepared(tuple(markers), camera, _Same(errors), copies)(image)


class _Same:
    """Errors that are the same only if they are the same object."""

    def __init__(self, errors: ErrorSources) -> None:
        self.errors = errors

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.errors is self.errors

    def __hash__(self) -> int:
        return id(self.errors)


@lru_cache(maxsize=16)
def _prepared(targets: tuple[Target, ...], camera: Camera | None, errors: _Same, copies: int) -> Engine:
    # Calls of `detect`, one for each image, prepare a marker once.
    return Engine(targets, camera, errors.errors, copies)


def detect_dots(image: Image, light: bool = False) -> "engine.Dots":
    """Find all dark or light dots in a grey image, fitted to the grey levels: their centers, semi-axes and angles."""
    _check_image(image)
    return engine.find_dots(image, light)


def body_poses(
    detection: Detection, body: Body, camera: Camera, errors: ErrorSources
) -> "list[tuple[int, PoseEstimate]]":
    """Return the number of each constellation of a body and its pose from its own dots alone, where these suffice."""
    from markergen.estimators.weighted_pose import estimate_pose

    poses = []
    rows = {int(number): k for k, number in enumerate(detection.ids)}
    for k, part in enumerate(body.constellations):
        own = [(i, rows[number]) for i, number in enumerate(body.ids[part.dots].tolist()) if number in rows]
        if len(own) < 4:
            continue
        dots, seen = (np.array(column) for column in zip(*own, strict=True))
        places = part.marker.xyz[dots]
        pixels, covariance = detection.pixels[seen], detection.covariance[seen]
        pose = estimate_pose(places, pixels, covariance, camera, errors.of(part.marker, dots))
        if pose is not None:
            poses.append((k, pose))
    return poses


__all__ = ["MAX_COPIES", "Detection", "Engine", "body_poses", "detect", "detect_all", "detect_dots"]
