"""Photographs of a calibration: the dots of the markers found in them, and a start for an unknown camera."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.calibration.adjustment import UndeterminedError
from markergen.calibration.labels import UNKNOWN_LENS, Guess, alternatives, relabelings, settle, turned_to_design
from markergen.calibration.network import CameraFreedom, Network, Views
from markergen.calibration.outliers import adjust_robustly
from markergen.calibration.sightings import Sightings
from markergen.detect.batch import detect_files
from markergen.detect.detection import detect_dots
from markergen.detect.detector import Detector, Found
from markergen.detect.pose import fit_pose
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.options import Progress, as_list
from markergen.read.images import check_frame, find_images, grey_frame, image_size, read_image

Array = NDArray[np.float64]

SEARCH_SIGMA = 5e-4
"""Standard deviation in m of a printed dot while the print is unknown: no dot is to be taken for an outlier."""

FOCALS = np.geomspace(0.35, 5, 25)
"""Focal lengths tried for an unknown camera, in image widths."""

SCOUTS, ENOUGH = 8, 4
"""Number of photographs that are searched for an unknown camera, which takes much longer than with one, and number of
these that must show a marker; otherwise all are."""

SCANNED = 12
"""Maximum number of views that choose among them."""

MAJORITY = 2 / 3
"""Least share of the photographs that must have one size, for those of other sizes to be left out."""

START = ("fx", "cx", "cy", "k1", "k2")
"""Parameters estimated before an unknown camera's photographs are searched again with it."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """Labeled dots of one marker in one photograph; if `open`, the labels are one of several that fit it."""

    photo: int
    marker: int
    index: NDArray[np.intp]
    centers: Array
    covariance: Array
    open: bool = False


def find_dots(
    markers: Sequence[Marker],
    photos: Any,
    camera: Camera | None,
    *,
    camera_covariance: Array | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> tuple[Sightings, Camera]:
    """Find the labeled dots of all markers in photographs.

    Parameters
    ----------
    photos : path, folder, pattern, array (h, w[, 3]), or several of these
    camera : Camera or None
        None: some photographs are searched without a camera, a camera is estimated from what was found, and all are
        searched with it, so that a strong lens costs neither photographs nor dots.

    Returns
    -------
    sightings : Sightings
    camera : Camera
        The one given, or an estimate.

    Raises
    ------
    InputError
        If there are no photographs, no size is that of most of them or none is the camera's, or a marker cannot be
        looked for.
    """
    raised = next((marker for marker in markers if np.ptp(marker.as_designed.xyz[:, 2])), None)
    if camera is None and raised is not None:
        raise InputError("a camera for a marker with relief", "none", "give a rough one with --camera-covariance")
    given = camera is not None
    notes: dict[str, None] = {}
    every = _sources(photos, notes)
    names = [f"photo {k}" if isinstance(each, np.ndarray) else str(each) for k, each in enumerate(every)]
    size, odd = _one_size(every, names, camera)
    fitting = [k for k in range(len(every)) if k not in odd]
    sources = [every[k] for k in fitting]
    chosen = sources if given else _some(sources)
    results, reasons = _searched(markers, chosen, camera, camera_covariance, progress, workers, notes)
    if camera is None:
        seen = _labeled(markers, results, {})
        if len({each.photo for each in seen}) < ENOUGH and len(chosen) < len(sources):
            results, reasons = _searched(markers, sources, None, None, progress, workers, notes)
            seen = _labeled(markers, results, {})
        camera = _rough_camera(markers, seen, size)
        if seen:
            camera = _adjusted(markers, seen, camera)
            results, reasons = _searched(markers, sources, camera, None, progress, workers, notes)
    seen = _labeled(markers, results, reasons)
    if not given and seen:
        camera = _adjusted(markers, seen, camera)
    seen, doubts = _told_apart(markers, seen, camera, sources)
    if not given and seen:
        camera = _adjusted(markers, seen, camera)
    views, kept = _views(markers, seen, camera)
    for lost in sorted({each.photo for each in seen} - {seen[k].photo for k in kept}):
        reasons[lost] = "no pose sees the dots from the front"
    photo = np.array([fitting[seen[k].photo] for k in kept], dtype=np.intp)
    marker = np.array([seen[k].marker for k in kept], dtype=np.intp)
    unused = odd | {fitting[k]: reason for k, reason in reasons.items()}
    return Sightings(tuple(names), size, views, photo, marker, unused, doubts, tuple(notes)), camera


def _sources(photos: Any, notes: dict[str, None]) -> list[Any]:
    """Arrays, or paths of image files; notes what was left out."""
    sources: list[Any] = [photos] if isinstance(photos, np.ndarray) else list(as_list(photos))
    if sources and isinstance(sources[0], np.ndarray):
        return sources
    return list(find_images(sources, lambda said: notes.update({said: None})))


def _one_size(
    sources: Sequence[Any], names: Sequence[str], camera: Camera | None
) -> tuple[tuple[int, int], dict[int, str]]:
    """Size in px that counts, the camera's or else that of most photographs, and why those of others are left out."""
    sizes = [check_frame(each).shape[1::-1] if isinstance(each, np.ndarray) else image_size(each) for each in sources]
    counts = Counter(size for size in sizes if size is not None)
    if not counts:
        # It raises: its header could not be read.
        read_image(sources[0])
    size, most = counts.most_common(1)[0]
    whose = "the others have"
    if camera is not None:
        size, whose = (camera.width, camera.height), "the camera has"
        most = counts[size]
    if not most or (camera is None and most < MAJORITY * counts.total()):
        common = counts.most_common(3)
        firsts = (f"{count} of {_px(each)} ({names[sizes.index(each)]}{'...' * (count > 1)})" for each, count in common)
        raise InputError(
            "photographs of one size" if camera is None else f"photographs of the camera's {_px(size)}",
            ", ".join(firsts),
            "give all as the camera stored them: not rotated, cropped, zoomed or shrunk",
        )
    odd = {k: f"{_px(each)}, {whose} {_px(size)}" for k, each in enumerate(sizes) if each not in (None, size)}
    return size, odd


def _px(size: tuple[int, int] | None) -> str:
    return "" if size is None else f"{size[0]}x{size[1]} px"


def _some(sources: Sequence[Any]) -> list[Any]:
    """Return at most `SCOUTS` photographs, spread evenly."""
    return [sources[k] for k in np.unique(np.linspace(0, len(sources) - 1, min(SCOUTS, len(sources))).astype(int))]


def _searched(
    markers: Sequence[Marker],
    sources: Sequence[Any],
    camera: Camera | None,
    camera_covariance: Array | None,
    progress: Progress | None,
    workers: int | None,
    notes: dict[str, None],
) -> tuple[list[tuple[Found, ...]], dict[int, str]]:
    """Results for each photograph, and why some could not be used; notes remarks of the reader, each of them once."""
    if isinstance(sources[0], np.ndarray):
        detector = Detector(markers, camera, camera_covariance=camera_covariance, print_sigma=SEARCH_SIGMA)
        results: list[tuple[Found, ...]] = []
        for image in sources:
            results.append(tuple(detector(image)))
            if progress:
                progress("detecting", len(results), len(sources))
        return results, {}
    found = detect_files(
        sources, markers, camera,
        camera_covariance=camera_covariance, print_sigma=SEARCH_SIGMA, workers=workers, progress=progress,
    )  # fmt: skip
    notes.update(dict.fromkeys(note for each in found for note in each.notes))
    return [each.markers for each in found], {k: each.error for k, each in enumerate(found) if each.error}


def _labeled(markers: Sequence[Marker], results: Sequence[tuple[Found, ...]], reasons: dict[int, str]) -> list[_Seen]:
    """Dots of the markers found in each photograph; fills in why a photograph has none."""
    seen = []
    for photo, found in enumerate(results):
        own: list[_Seen] = []
        for number, marker in enumerate(markers):
            copies = [each.detection for each in found if each.ok and each.detection.marker == number]
            if len(copies) > 1:
                reasons[photo] = f"{len(copies)} copies of a marker: each print is calibrated alone"
                own = []
                break
            guessed = [each.detection for each in found if each.detection.marker == number]
            place = {point.id: k for k, point in enumerate(marker.control_points)}
            if copies:
                index = np.array([place[int(name)] for name in copies[0].ids], dtype=np.intp)
                own.append(_Seen(photo, number, index, copies[0].ellipse_centers, copies[0].covariance))
            elif guessed and guessed[0].unlabeled is not None and guessed[0].rival is None:
                dots = guessed[0].unlabeled
                index = np.array([place[int(name)] for name in dots.guess], dtype=np.intp)
                own.append(_Seen(photo, number, index, dots.ellipse_centers, dots.covariance, open=True))
        if not own and found:
            reasons.setdefault(photo, "; ".join(dict.fromkeys(each.reason for each in found if each.reason)))
        seen += own
    return seen


def _told_apart(
    markers: Sequence[Marker], seen: list[_Seen], camera: Camera, sources: Sequence[Any]
) -> tuple[list[_Seen], tuple[str, ...]]:
    """Labels of symmetric layouts, told apart by all photographs together; and what remains in doubt."""
    told, doubts = list(seen), []
    for number, marker in enumerate(markers):
        own = [k for k, each in enumerate(seen) if each.marker == number]
        if not any(seen[k].open for k in own):
            continue
        points, radii, rings = (
            marker.search_xyz,
            _radii(marker),
            np.array([p.feature.kind == "ring" for p in marker.control_points]),
        )
        group, options, kept = relabelings(points, rings), [], []
        for k in own:
            pose = _pose(markers, seen[k], camera)
            if pose is None:
                continue
            guess = Guess(seen[k].index, seen[k].centers, seen[k].covariance, pose[0], pose[1])
            kept.append(k)
            if not seen[k].open:
                options.append([guess])
                continue
            blobs = detect_dots(_grey(sources[seen[k].photo]), marker.light)
            dots = blobs.center, blobs.covariance, np.pi * blobs.semi.prod(axis=1)
            options.append(alternatives(guess, group, points, radii, camera, dots))
        settled = settle(options, points, radii, camera)
        if all(seen[k].open for k in kept):
            settled, told_by_sizes = turned_to_design(settled, group, points, radii, camera)
            if not told_by_sizes:
                doubts.append(
                    "The layout looks the same when turned: the labels of all photographs are those nearest the "
                    "design, and may all be turned together"
                )
        if len(kept) > 1 and not settled.sure:
            doubts.append(
                f"The photographs hardly tell the labels of the symmetric layout apart: chi2 {settled.chi2:.3g}, for "
                f"others {settled.runner_up:.3g}; take more from one side"
            )
        for k, guess in zip(kept, settled.guesses, strict=True):
            told[k] = replace(seen[k], index=guess.index, centers=guess.centers, covariance=guess.covariance)
    return told, tuple(doubts)


def _grey(source: Any) -> NDArray[Any]:
    return grey_frame(source) if isinstance(source, np.ndarray) else read_image(source).grey


def _radii(marker: Marker) -> Array:
    return np.array([point.feature.diameter / 2 for point in marker.control_points])


def _dots_of(markers: Sequence[Marker], seen: _Seen) -> tuple[Array, Array]:
    """Designed places (m, 3) and radii (m,) of the dots seen."""
    marker = markers[seen.marker]
    return marker.xyz[seen.index], _radii(marker)[seen.index]


def _pose(markers: Sequence[Marker], seen: _Seen, camera: Camera) -> tuple[Array, Array, float] | None:
    points, radii = _dots_of(markers, seen)
    normalized = camera.from_pixels(seen.centers)
    found = fit_pose(points, radii, normalized, seen.covariance, camera, ErrorSources(SEARCH_SIGMA))
    return None if found is None else (found.rotation, found.translation, found.chi2)


def _rough_camera(markers: Sequence[Marker], seen: Sequence[_Seen], size: tuple[int, int]) -> Camera:
    """Camera of the focal length that agrees best with the perspective of the views, without distortion."""
    width, height = size
    chosen = [seen[k] for k in np.unique(np.linspace(0, len(seen) - 1, min(SCANNED, len(seen))).astype(int))]
    cameras = [
        Camera(width, height, f * width, f * width, (width - 1) / 2, (height - 1) / 2, UNKNOWN_LENS) for f in FOCALS
    ]
    costs = []
    for camera in cameras:
        found = [_pose(markers, each, camera) for each in chosen]
        each = zip(found, chosen, strict=True)
        costs.append(sum(np.log1p(pose[2] / len(own.index)) if pose else 20.0 for pose, own in each))
    return cameras[int(np.argmin(costs))]


def _adjusted(markers: Sequence[Marker], seen: Sequence[_Seen], camera: Camera) -> Camera:
    """Camera adjusted to all views with the dots as designed; as it was if the views do not determine it."""
    views, _ = _views(markers, seen, camera)
    network = Network(
        np.concatenate([marker.xyz for marker in markers]),
        np.concatenate([_radii(marker) for marker in markers]),
        camera,
        CameraFreedom.of_names(camera, START),
        np.repeat(np.arange(len(markers)), [len(marker) for marker in markers]),
        free=False,
    )
    # The print is off by more than the image's noise: without that, every robust cost would see outliers alone.
    spread = views.covariance + _printed(views, camera)
    try:
        found = adjust_robustly(network, Views(views.pixels, spread, views.seen, views.rotation, views.translation))
        sigma = np.sqrt(np.diag(found.adjustment.camera_covariance))
    except UndeterminedError:
        return camera
    better = found.adjustment.camera
    # Better a rough camera than one that the views hardly determine.
    return better if sigma[0] < 0.2 * better.fx and 0.2 < better.fx / camera.fx < 5 else camera


def _printed(views: Views, camera: Camera) -> Array:
    """Covariance (v, 1, 2, 2) in px^2 of dots that are `SEARCH_SIGMA` off."""
    sigma = SEARCH_SIGMA * camera.fx / views.translation[:, 2]
    return np.asarray(sigma[:, None, None, None] ** 2 * np.eye(2))


def _views(markers: Sequence[Marker], seen: Sequence[_Seen], camera: Camera) -> tuple[Views, list[int]]:
    """Views with start poses, and which of `seen` they are."""
    starts = np.cumsum([0, *(len(marker) for marker in markers)])
    total = int(starts[-1])
    pixels, spread, mask = [], [], []
    poses, kept = [], []
    for k, each in enumerate(seen):
        found = _pose(markers, each, camera)
        if found is None:
            continue
        place, own = np.zeros((total, 2)), np.broadcast_to(np.eye(2), (total, 2, 2)).copy()
        taken = np.zeros(total, dtype=bool)
        columns = starts[each.marker] + each.index
        place[columns], own[columns], taken[columns] = each.centers, each.covariance, True
        pixels.append(place)
        spread.append(own)
        mask.append(taken)
        poses.append(found)
        kept.append(k)
    return Views(
        np.array(pixels).reshape(-1, total, 2),
        np.array(spread).reshape(-1, total, 2, 2),
        np.array(mask, dtype=bool).reshape(-1, total),
        np.array([pose[0] for pose in poses]).reshape(-1, 3, 3),
        np.array([pose[1] for pose in poses]).reshape(-1, 3),
    ), kept
