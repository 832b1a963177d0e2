"""Photographs of a calibration: the dots of the markers found in them, and a start for an unknown camera.

One photograph of a symmetric grid does not show which dot is which. But no print is symmetric: its dots are off by
tens of micrometers and its paper is bent, so two photographs agree on one print only if their labels correspond. The
photographs are joined one by one, each with the labels for which the network fits best, dots being free.
"""

# tests: tests/calibration/test_photos.py tests/calibration/test_labels.py

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any, TypeVar

import markergen_detect
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import attempt
from markergen.calibration.camera_choice import wider_lenses
from markergen.calibration.network import LEAST_DOTS, CameraFreedom, Network, Pose, Views
from markergen.calibration.pictures import contradicted_diameters, copies
from markergen.calibration.residuals import adjust_robustly
from markergen.detect import Detector, Found
from markergen.detect.batch import detect_files
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.estimators.weighted_pose import fit_pose
from markergen.maths.conics import outlines, refine_poses
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import rigid_motion
from markergen.model.camera import Camera, Distortion
from markergen.model.marker import Marker
from markergen.options import Progress, as_list
from markergen.read.images import check_frame, find_images, grey_frame, read_image, size_in_file

SEARCH_SIGMA, SEARCH_SHARE = 5e-4, 0.006
"""Standard deviation in m of a printed dot while the print is unknown, and the least as a share of the marker's radius,
since a camera that is nominal puts outer dots elsewhere: no dot is to be taken for an outlier. Without the share, a
camera with f 4 % off lost three of 100 dots in a corner of a grid of 0.3 m."""

FOCALS = np.geomspace(0.35, 5, 25)
"""Focal lengths tried for an unknown camera, in image widths."""

FISHEYE_FOCALS = np.geomspace(0.2, 1.2, 12)
"""Likewise with a fisheye, of which a circle of 180 degrees as wide as the image has 0.32."""

SCOUTS, ENOUGH = 8, 4
"""Number of photographs that are searched for an unknown camera, which takes much longer than with one, and number of
these that must show a marker; otherwise all are."""

SCANNED = 12
"""Maximum number of views that choose among them."""

MAJORITY = 2 / 3
"""Least share of the photographs that must have one size, for those of other sizes to be left out."""

OTHER_LENSES = (-0.2, -0.4, 0.0)
"""k1 of lenses through which dropped photographs are searched once more: a thermal camera has -0.45."""

START = ("fx", "cx", "cy", "k1", "k2")
"""Parameters estimated before an unknown camera's photographs are searched again with it."""


@dataclass(frozen=True, eq=False)
class PhotographedDots:
    """Labeled dots of all markers in all photographs; the dots of the markers are numbered one after the other.

    Attributes
    ----------
    photos : tuple of str
        Names of all photographs, used or not.
    size : (width, height), px
    views : Views
        One for each marker seen in a photograph; dots of other markers are not seen.
    photo, marker : arrays (v,) of int
        Photograph and marker of each view.
    unused : mapping of photograph to reason
        Photographs without a view, by index.
    doubts : tuple of str
        What is uncertain about labels, or contradicted by the widths of dots, as sentences.
    notes : tuple of str
        Remarks on the files, as sentences: what is not read, or not as it is stored.
    moments : array of int
        Moment of each photograph: those of several cameras may share one; each its own if not given.
    """

    photos: tuple[str, ...]
    size: tuple[int, int]
    views: Views
    photo: Indices
    marker: Indices
    unused: dict[int, str] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    moments: Indices = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.moments is None:
            object.__setattr__(self, "moments", np.arange(len(self.photos)))


@dataclass(frozen=True, eq=False)
class Labeled:
    """Dots of one marker in one photograph with labels, one of several that fit if they are `open`.

    Control point `index` (m,), centers (m, 2) in px with their covariance, an approximate pose by these labels, and the
    logarithms `area` (m,) of the squared radii that the dots have in the image, up to a common constant.
    """

    index: Indices
    centers: Array
    covariance: Array
    pose: Pose | None = None
    area: Array | None = None
    photo: int = 0
    marker: int = 0
    open: bool = False

    def misfit_of_sizes(self, radii: Array) -> float:
        """Sum of squares, in sigma, of the logarithms of the dots' areas relative to those designed; 0 if unknown.

        Ink spreads and markers are scaled, so only differences among the dots count. sigma is estimated from
        the median.
        """
        if self.area is None:
            return 0.0
        off = self.area - 2 * np.log(radii[self.index])
        off -= np.median(off)
        sigma = max(SIZE_SIGMA, 1.4826 * float(np.median(np.abs(off))))
        return float(np.minimum((off / sigma) ** 2, SIZE_LIMIT).sum())


def views_of(total: int, photos: Sequence[tuple[Indices, Labeled, Pose]]) -> Views:
    """Views of `total` dots: the columns of the labeled dots of each photograph, and its pose."""
    v = len(photos)
    pixels, spread = np.zeros((v, total, 2)), np.broadcast_to(np.eye(2), (v, total, 2, 2)).copy()
    seen, rotation, translation = np.zeros((v, total), dtype=bool), np.zeros((v, 3, 3)), np.zeros((v, 3))
    for row, (columns, dots, pose) in enumerate(photos):
        pixels[row, columns], spread[row, columns], seen[row, columns] = dots.centers, dots.covariance, True
        rotation[row], translation[row] = pose
    return Views(pixels, spread, seen, rotation, translation)


def find_dots(
    markers: Sequence[Marker],
    photos: Any,
    camera: Camera | None,
    *,
    camera_covariance: Array | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> tuple[PhotographedDots, Camera]:
    """Find the labeled dots of all markers in photographs.

    Parameters
    ----------
    photos : path, folder, pattern, array (h, w[, 3]), or several of these
    camera : Camera or None
        None: some photographs are searched without a camera, a camera is estimated from what was found, and all are
        searched with it, so that a strong lens costs neither photographs nor dots.

    The camera that is returned is the one given, or an estimate.

    Raises
    ------
    InputError
        If there are no photographs, no size is that of most of them or none is the camera's, or a marker cannot be
        looked for.
    """
    raised = next((marker for marker in markers if np.ptp(marker.as_designed.xyz[:, 2])), None)
    if camera is None and raised is not None:
        raise InputError("a camera for a marker with relief", "none", "give a rough one with --camera-covariance")
    is_given = camera is not None
    notes: dict[str, None] = {}
    every = _sources(photos, notes)
    names = [f"photo {k}" if isinstance(source, np.ndarray) else str(source) for k, source in enumerate(every)]
    size, odd = _one_size(every, names, camera)
    fitting = [k for k in range(len(every)) if k not in odd]
    sources = [every[k] for k in fitting]
    scouts = np.linspace(0, len(sources) - 1, min(SCOUTS, len(sources))).astype(int)
    chosen = sources if is_given else [sources[k] for k in scouts]
    seen, reasons = _searched(markers, chosen, camera, camera_covariance, progress, workers, notes)
    if camera is None:
        if len({dots.photo for dots in seen}) < ENOUGH and len(chosen) < len(sources):
            seen, reasons = _searched(markers, sources, None, None, progress, workers, notes)
        camera = _started(markers, seen, size)
        before, joined = -1, 0
        while seen and before < joined < len(sources):
            if joined:
                camera = _adjusted(markers, seen, camera)[0]
            seen, reasons = _searched(markers, sources, camera, None, progress, workers, notes)
            before, joined = joined, len({dots.photo for dots in seen})
    reasons |= _bent(markers, sources, camera, reasons)
    if not is_given and seen:
        camera = _adjusted(markers, seen, camera)[0]
    showing = {dots.photo for dots in seen}
    seen, doubts = _distinguished(markers, seen, camera, sources)
    if not is_given and seen:
        camera = _adjusted(markers, seen, camera)[0]
    views, kept = _views(markers, seen, camera)
    for lost in sorted(showing - {seen[k].photo for k in kept}):
        reasons[lost] = "no pose sees four dots or more from the front"
    photo = np.array([fitting[seen[k].photo] for k in kept], dtype=np.intp)
    marker = np.array([seen[k].marker for k in kept], dtype=np.intp)
    unused = odd | {fitting[k]: reason for k, reason in reasons.items()}
    copied = copies(views, photo, lambda number: _grey(every[number]))
    unused |= {number: f"a copy of {names[first]}, which counts once" for number, first in copied.items()}
    single = ~np.isin(photo, list(copied))
    views, photo, marker = views.take(single), photo[single], marker[single]
    doubts += contradicted_diameters(markers, views, photo, camera, lambda number: _grey(every[number]))
    return PhotographedDots(tuple(names), size, views, photo, marker, unused, doubts, tuple(notes)), camera


def joined_photographs(parts: Sequence[PhotographedDots], names: Sequence[str]) -> PhotographedDots:
    """Photographs of several cameras: of one moment if their names are one, but for folder, ending and camera's name.

    Of photographs that have no file names, each camera's first are of one moment, and so on.
    """
    firsts = np.cumsum([0, *(len(part.photos) for part in parts)])
    numbered = list(zip(names, firsts[:-1].tolist(), parts, strict=True))
    keys = [Path(photo).stem.replace(name, "") for name, _, part in numbered for photo in part.photos]
    views = [replace(part.views, camera=np.full(len(part.views), k)) for k, part in enumerate(parts)]
    return PhotographedDots(
        tuple(photo if Path(photo).suffix else f"{name}: {photo}" for name, _, p in numbered for photo in p.photos),
        parts[0].size,
        reduce(Views.joined, views),
        np.concatenate([first + part.photo for _, first, part in numbered]),
        np.concatenate([part.marker for part in parts]),
        {first + k: reason for _, first, part in numbered for k, reason in part.unused.items()},
        tuple(f"camera {name}: {doubt}" for name, _, part in numbered for doubt in part.doubts),
        tuple(note for part in parts for note in part.notes),
        np.unique(keys, return_inverse=True)[1],
    )


def _sources(photos: Any, notes: dict[str, None]) -> list[Any]:
    """Arrays, or paths of image files; notes what was left out."""
    sources: list[Any] = [photos] if isinstance(photos, np.ndarray) else list(as_list(photos))
    if sources and isinstance(sources[0], np.ndarray):
        return sources
    return list(find_images(sources, lambda note: notes.update({note: None})))


def _one_size(
    sources: Sequence[Any], names: Sequence[str], camera: Camera | None
) -> tuple[tuple[int, int], dict[int, str]]:
    """Size in px that counts, the camera's or else that of most photographs, and why those of others are left out."""
    sizes = [
        check_frame(source).shape[1::-1] if isinstance(source, np.ndarray) else size_in_file(source)
        for source in sources
    ]
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
        firsts = (
            f"{count} of {_px(size_px)} ({names[sizes.index(size_px)]}{'...' * (count > 1)})"
            for size_px, count in common
        )
        raise InputError(
            "photographs of one size" if camera is None else f"photographs of the camera's {_px(size)}",
            ", ".join(firsts),
            "give all as the camera stored them: not rotated, cropped, zoomed or shrunk",
        )
    odd = {k: f"{_px(size_px)}, {whose} {_px(size)}" for k, size_px in enumerate(sizes) if size_px not in (None, size)}
    return size, odd


def _px(size: tuple[int, int] | None) -> str:
    return "" if size is None else f"{size[0]}x{size[1]} px"


def _searched(
    markers: Sequence[Marker],
    sources: Sequence[Any],
    camera: Camera | None,
    camera_covariance: Array | None,
    progress: Progress | None,
    workers: int | None,
    notes: dict[str, None],
) -> tuple[list[Labeled], dict[int, str]]:
    """Dots of the markers in each photograph, and why some have none; notes remarks of the reader, each once."""
    sigma = max(SEARCH_SIGMA, SEARCH_SHARE * max(marker.boundary.radius for marker in markers))
    if isinstance(sources[0], np.ndarray):
        detector = Detector(markers, camera, camera_covariance=camera_covariance, print_sigma=sigma)
        results: list[tuple[Found, ...]] = []
        for image in sources:
            results.append(tuple(detector(image)))
            if progress:
                progress("detecting", len(results), len(sources))
        return _labeled(markers, results, {})
    detections = detect_files(
        sources, markers, camera,
        camera_covariance=camera_covariance, print_sigma=sigma, workers=workers, progress=progress,
    )  # fmt: skip
    notes.update(dict.fromkeys(note for detected in detections for note in detected.notes))
    reasons = {k: detected.error for k, detected in enumerate(detections) if detected.error}
    return _labeled(markers, [detected.markers for detected in detections], reasons)


def _labeled(
    markers: Sequence[Marker], results: Sequence[tuple[Found, ...]], reasons: dict[int, str]
) -> tuple[list[Labeled], dict[int, str]]:
    """Dots of the markers found in each photograph; fills in why a photograph has none.

    Labels of a symmetric layout are left open. So are doubtful ones of a marker with rings if others are certain: else
    its rings contradict them in every photograph, as where all are mirrored.
    """
    seen = []
    sure = {result.index for detections in results for result in detections if result.ok}
    sure |= {k for k, marker in enumerate(markers) if len({point.feature.kind for point in marker.control_points}) == 1}
    for photo, detections in enumerate(results):
        dots_of_markers: list[Labeled] = []
        for number, marker in enumerate(markers):
            of_marker = [result for result in detections if result.index == number]
            copies = [result for result in of_marker if result.ok]
            if len(copies) > 1:
                reasons[photo] = f"{len(copies)} copies of a marker: each print is calibrated alone"
                dots_of_markers = []
                break
            guessed = [
                result for result in of_marker[:1] if len(result.guess) and result.rival is None and number in sure
            ]
            place = {point.id: k for k, point in enumerate(marker.control_points)}
            for dots in copies or guessed:
                index = np.array([place[int(name)] for name in (dots.ids if copies else dots.guess)], dtype=np.intp)
                measured = index, dots.ellipse_centers, dots.pixel_covariance
                dots_of_markers.append(Labeled(*measured, photo=photo, marker=number, open=not copies))
        if not dots_of_markers and detections:
            reasons.setdefault(photo, "; ".join(dict.fromkeys(result.reason for result in detections if result.reason)))
        seen += dots_of_markers
    return seen, reasons


def _bent(markers: Sequence[Marker], sources: Sequence[Any], camera: Camera, reasons: dict[int, str]) -> dict[int, str]:
    """Reasons of the dropped photographs that show a marker through another lens than the camera's."""
    because, left = dict[int, str](), sorted(reasons)
    for k1 in OTHER_LENSES:
        lens = replace(camera, distortion=Distortion("radtan", (k1, 0.0, 0.0, 0.0)))
        for dots in _searched(markers, [sources[k] for k in left], lens, None, None, None, {})[0] if left else []:
            why = f"its lens is not the camera's, but bends by about k1 {k1:g}: found with that distortion only"
            because.setdefault(left[dots.photo], why)
    return because


def _distinguished(
    markers: Sequence[Marker], seen: list[Labeled], camera: Camera, sources: Sequence[Any]
) -> tuple[list[Labeled], tuple[str, ...]]:
    """Labels of symmetric layouts, distinguished by all photographs together; and what remains in doubt."""
    labeled, doubts = dict(enumerate(seen)), list[str]()
    for number, marker in enumerate(markers):
        views = [k for k, dots in enumerate(seen) if dots.marker == number]
        if not any(seen[k].open for k in views):
            continue
        points, radii = marker.search_xyz, marker.radii
        rings = np.array([point.feature.kind == "ring" for point in marker.control_points])
        group, options, kept = relabelings(points, rings), [], []
        for k in views:
            pose = _pose(markers, seen[k], camera)
            if pose is None:
                continue
            labelings = [replace(seen[k], pose=pose[:2])]
            if seen[k].open:
                blobs = markergen_detect.find_dots(_grey(sources[seen[k].photo]), marker.light)
                dots = blobs.center, blobs.covariance, np.pi * blobs.semi.prod(axis=1)
                labelings = alternatives(labelings[0], group, points, radii, camera, dots)
            if labelings:
                kept.append(k)
                options.append(labelings)
            else:
                del labeled[k]
        if not kept:
            continue
        settled = settle_labels(options, points, radii, camera)
        if all(seen[k].open for k in kept):
            settled, by_sizes = aligned_to_design(settled, group, points, radii, camera)
            if not by_sizes:
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
            labeled[k] = guess
    return list(labeled.values()), tuple(doubts)


def _grey(source: Any) -> NDArray[Any]:
    return grey_frame(source) if isinstance(source, np.ndarray) else read_image(source).grey


def _pose(markers: Sequence[Marker], seen: Labeled, camera: Camera) -> tuple[Array, Array, float] | None:
    points, radii = (getattr(markers[seen.marker], name)[seen.index] for name in ("xyz", "radii"))
    normalized = camera.from_pixels(seen.centers)
    fitted = fit_pose(points, radii, normalized, seen.covariance, camera, ErrorSources(SEARCH_SIGMA))
    return None if fitted is None else (fitted.rotation, fitted.translation, fitted.chi2)


def _started(markers: Sequence[Marker], seen: Sequence[Labeled], size: tuple[int, int]) -> Camera:
    """Camera that agrees with the views: with a fisheye's lens where that fits them clearly better."""
    camera, misfit = _adjusted(markers, seen, _rough_camera(markers, seen, size, UNKNOWN_LENS))
    if not seen:
        return camera
    fisheye, other = _adjusted(markers, seen, _rough_camera(markers, seen, size, FISHEYE))
    if other < CLEARLY_BETTER * misfit:
        # From a rough focal length, views of exact prints were left 1000 times the misfit that this start leaves.
        camera, misfit = _adjusted(markers, seen, replace(fisheye, distortion=UNKNOWN_LENS))
    return fisheye if other < CLEARLY_BETTER * misfit else camera


def _rough_camera(
    markers: Sequence[Marker], seen: Sequence[Labeled], size: tuple[int, int], lens: Distortion
) -> Camera:
    """Camera with a lens, of the focal length that agrees best with the perspective of the views."""
    width, height = size
    chosen = [seen[k] for k in np.unique(np.linspace(0, len(seen) - 1, min(SCANNED, len(seen))).astype(int))]
    focals = FOCALS if lens == UNKNOWN_LENS else FISHEYE_FOCALS
    cameras = [Camera(width, height, f * width, f * width, (width - 1) / 2, (height - 1) / 2, lens) for f in focals]
    costs = []
    for camera in cameras:
        poses = [_pose(markers, dots, camera) for dots in chosen]
        pairs = zip(poses, chosen, strict=True)
        costs.append(sum(np.log1p(pose[2] / len(dots.index)) if pose else 20.0 for pose, dots in pairs))
    return cameras[int(np.argmin(costs))]


def _adjusted(markers: Sequence[Marker], seen: Sequence[Labeled], camera: Camera) -> tuple[Camera, float]:
    """Camera adjusted to all views with the dots as designed, and the mean over the dots of the squares that it leaves.

    As it was, and inf, if the views do not determine it. Dots that do not fit count `OUTLIER`.
    """
    views, _ = _views(markers, seen, camera)
    network = Network.of_markers(markers, camera, CameraFreedom.of_names(camera, START), free=False)
    # The print is off by more than the image's noise: without that, every robust cost would see outliers alone.
    sigma_px = SEARCH_SIGMA * camera.fx / views.translation[:, 2]
    spread = views.covariance + sigma_px[:, None, None, None] ** 2 * np.eye(2)
    try:
        adjusted = adjust_robustly(network, replace(views, covariance=spread)).adjustment
        sigma = np.sqrt(np.diag(adjusted.camera_covariance)) if adjusted.degrees_of_freedom > 0 else [np.inf]
    except np.linalg.LinAlgError:
        return camera, np.inf
    better, count = adjusted.camera, sum(len(dots.index) for dots in seen)
    # Better a rough camera than one that the views hardly determine.
    if sigma[0] < 0.2 * better.fx and 0.2 < better.fx / camera.fx < 5:
        return better, (adjusted.chi2 + OUTLIER * (count - float(adjusted.weights.sum()))) / count
    return camera, np.inf


def _views(markers: Sequence[Marker], seen: Sequence[Labeled], camera: Camera) -> tuple[Views, list[int]]:
    """Views with start poses, and which of `seen` they are."""
    starts = np.cumsum([0, *(len(marker) for marker in markers)])
    posed = [(k, dots, _pose(markers, dots, camera)) for k, dots in enumerate(seen)]
    photos = [(k, starts[dots.marker] + dots.index, dots, pose[:2]) for k, dots, pose in posed if pose]
    return views_of(int(starts[-1]), [photo[1:] for photo in photos]), [k for k, *_ in photos]


T = TypeVar("T")

MATCH = 0.2
"""Distance, as a share of the smallest between two dots, within which a dot that was moved is another one."""

OVERLAP = 0.6
"""Minimum share of the dots that a rotation or translation takes to dots, for it to be an alternative labeling."""

MOST_DOTS = 60
"""Number of dots that decide about labels; more decide no better, and take longer."""

WIDTH, HOPELESS = 6, 100.0
"""Number of sets of labels that are kept while photographs join, and difference of chi2 to the best one's, in units of
its variance factor, beyond which none is kept."""

ROUGHLY = 1e-3
"""Relative decrease of the cost at which an adjustment ends that only compares labels."""

CLEARLY = 15.0
"""Difference of chi2, in units of the variance factor, beyond which labels are sure."""

UNKNOWN_LENS, FISHEYE = Distortion("radtan", (0.0,) * 5), Distortion("equidistant", (0.0,) * 4)
CLEARLY_BETTER, OUTLIER = 0.5, 25.0
"""Ratio of mean squares below which a camera fits clearly better, and the square of a dot that does not fit."""

SIZE_SIGMA, SIZE_LIMIT = 0.04, 16.0
"""Least standard deviation of the logarithm of a dot's area, and the most, in squares of it, that one dot counts."""

SURELY = 20.0
"""Difference of the sums of squares that settles labels by the dots' sizes alone: it takes two dots."""


@dataclass(frozen=True, eq=False)
class Relabeling:
    """A motion X -> R X + t of the marker plane that takes most dots of a layout to dots: `image` (n,), -1 for none."""

    rotation: Array
    translation: Array
    image: Indices

    def pose(self, rotation: Array, translation: Array) -> Pose:
        """Return the pose with which the moved layout looks as the layout does with the given pose."""
        flip = np.eye(3)
        flip[:2, :2] = self.rotation
        flipped = rotation @ flip.T
        return flipped, translation - flipped @ np.append(self.translation, 0.0)


def relabelings(points: Array, rings: NDArray[np.bool_]) -> list[Relabeling]:
    """Return the motions that take at least `OVERLAP` of flat points (n, 3) to points of the same kind, identity first.

    Every motion takes a certain pair of neighbors to a pair as far apart.
    """
    flat = points[:, :2]
    tree = cKDTree(flat)
    apart = tree.query(flat, k=2)[0][:, 1]
    within = MATCH * float(apart.min())
    middle = int(np.argmin(np.sum((flat - flat.mean(axis=0)) ** 2, axis=1)))
    neighbor = int(tree.query(flat[middle], k=2)[1][1])
    length = float(np.linalg.norm(flat[neighbor] - flat[middle]))
    relabeled: dict[bytes, Relabeling] = {}
    for first, others in enumerate(tree.query_ball_point(flat, length + within)):
        for second in others:
            if second == first or abs(np.linalg.norm(flat[second] - flat[first]) - length) > within:
                continue
            rotation, translation = rigid_motion(flat[[middle, neighbor]], flat[[first, second]])
            for _ in range(2):
                distance, image = tree.query(flat @ rotation.T + translation)
                kept = (distance < within) & (rings == rings[image])
                if kept.mean() < OVERLAP:
                    break
                rotation, translation = rigid_motion(flat[kept], flat[image[kept]])
            else:
                labels = np.where(kept, image, -1)
                relabeled.setdefault(labels.tobytes(), Relabeling(rotation, translation, labels))
    identity = np.arange(len(points)).tobytes()
    return [relabeled[identity], *(relabeling for key, relabeling in relabeled.items() if key != identity)]


def labeled_pose(dots: Labeled) -> Pose:
    """Return the pose of dots that have one."""
    assert dots.pose is not None
    return dots.pose


def alternatives(
    guess: Labeled,
    group: Sequence[Relabeling],
    points: Array,
    radii: Array,
    camera: Camera,
    dots: tuple[Array, Array, Array],
) -> list[Labeled]:
    """Return the labelings of a photograph that label the most of all its dots, and fit the sizes of the dots best.

    Fewer dots than `LEAST_DOTS`, as where blur leaves few, are no labeling: it could not join other photographs.
    `dots` are all of the photograph, labeled or not: centers (b, 2), covariance (b, 2, 2) and areas (b,), px.
    """
    tree, guesses = cKDTree(dots[0]), list[Labeled]()
    apart = cKDTree(guess.centers).query(guess.centers, k=2)[0][:, 1]
    for relabeling in group:
        rotation, translation = relabeling.pose(*labeled_pose(guess))
        place = to_camera(points, rotation[None], translation[None])
        predicted = camera.to_pixels(perspective(place))[0]
        good = np.isfinite(predicted).all(axis=1) & (place[0, :, 2] > 0)
        distance, nearest = tree.query(np.where(good[:, None], predicted, -1e9))
        labeled = np.flatnonzero(good & (distance < 0.3 * np.median(apart)))
        _, once = np.unique(nearest[labeled], return_index=True)
        labeled = labeled[np.sort(once)]
        dot_of_blob = nearest[labeled]
        drawn = outlines(points[labeled], radii[labeled], rotation[None], translation[None])
        area = np.log(dots[2][dot_of_blob]) - np.log(np.linalg.det(drawn.shape[0])) / 2 + 2 * np.log(radii[labeled])
        fields = {"centers": dots[0][dot_of_blob], "covariance": dots[1][dot_of_blob], "area": area}
        guesses.append(replace(guess, index=labeled, pose=(rotation, translation), **fields))
    most = max(LEAST_DOTS, *(len(labeling.index) for labeling in guesses))
    guesses = [labeling for labeling in guesses if len(labeling.index) == most]
    return _of_right_sizes(guesses, [labeling.misfit_of_sizes(radii) for labeling in guesses])


def _of_right_sizes(candidates: Sequence[T], misfit: Sequence[float]) -> list[T]:
    """Return what the dots' sizes do not rule out."""
    limit = min(misfit, default=0.0) + SURELY
    return [candidate for candidate, square in zip(candidates, misfit, strict=True) if square <= limit]


@dataclass(frozen=True, eq=False)
class Settled:
    """Photographs joined with certain labels: the option chosen for each, and the network adjusted to them.

    `chi2` and `runner_up` are variance factors with these labels and with the best others, inf if there are none; the
    labels of all photographs are `guesses` when they are settled.
    """

    chosen: dict[int, int]
    chi2: float = np.inf
    degrees_of_freedom: int = 0
    places: Array | None = None
    poses: dict[int, Pose] = field(default_factory=dict)
    runner_up: float = np.inf
    guesses: tuple[Labeled, ...] = ()

    @property
    def sure(self) -> bool:
        """Whether the other labels fit worse by more than chance, in units of the variance factor."""
        return (self.runner_up - self.chi2) * max(1, self.degrees_of_freedom) > CLEARLY * max(1.0, self.chi2)


def settle_labels(options: Sequence[Sequence[Labeled]], points: Array, radii: Array, camera: Camera) -> Settled:
    """Choose one labeling for each photograph so that all agree on one print.

    Photographs join one after another, the most different views first, each with every labeling; the best few sets of
    labels are kept, and the best one in the end changes as long as one change improves the whole. Dots are free, and
    so is the approximate camera within wide limits: an error of it would cost more than wrong labels.
    """
    held, is_first = CameraFreedom.held(camera), np.zeros(len(points), dtype=np.intp)
    network = wider_lenses(Network(points, radii, (camera,), held, is_first))[0][1]
    order = _order(options)
    # All may be turned together: the first keeps its labels.
    beam = [Settled({order[0]: 0}, 0.0)]
    for k in order[1:]:
        longer = [_joined(joined, k, c, options, network) for joined in beam for c in range(len(options[k]))]
        longer.sort(key=lambda joined: joined.chi2)
        best = longer[0]
        limit = best.chi2 + HOPELESS * max(1.0, best.chi2) / max(1, best.degrees_of_freedom)
        beam = [best, *(joined for joined in longer[1:WIDTH] if joined.chi2 <= limit)]
    best, *others = beam
    changed: list[Settled] = []
    while len(order) > 1:
        pairs = [(k, c) for k in order[1:] for c in range(len(options[k])) if c != best.chosen[k]]
        changed = [_joined(best, k, c, options, network) for k, c in pairs]
        better = min(changed, key=lambda joined: joined.chi2, default=best)
        if better.chi2 >= best.chi2:
            break
        others.append(best)
        best = better
    runner_up = min((joined.chi2 for joined in (*others, *changed) if joined.chosen != best.chosen), default=np.inf)
    guesses = tuple(options[k][best.chosen[k]] for k in range(len(options)))
    return replace(best, runner_up=float(runner_up), guesses=guesses)


def _order(options: Sequence[Sequence[Labeled]]) -> list[int]:
    """Photographs in the order to join: first one of few labelings and many dots, then the one tilted most unlike."""
    first = min(range(len(options)), key=lambda k: (len(options[k]), -len(options[k][0].index)))
    normals = np.array([labeled_pose(guesses[0])[0][:, 2] for guesses in options])
    order, nearest = [first], normals @ normals[first]
    while len(order) < len(options):
        nearest[order] = np.inf
        order.append(int(np.argmin(nearest)))
        nearest = np.maximum(nearest, normals @ normals[order[-1]])
    return order


def _joined(before: Settled, k: int, c: int, options: Sequence[Sequence[Labeled]], network: Network) -> Settled:
    """Return the photographs joined before with photograph k added, or changed, to its labeling c."""
    chosen = {**before.chosen, k: c}
    photos = sorted(chosen)
    guesses = [options[photo][chosen[photo]] for photo in photos]
    old = {photo: pose for photo, pose in before.poses.items() if photo != k}
    rows = [
        (guess.index, guess, old.get(photo, labeled_pose(guess))) for photo, guess in zip(photos, guesses, strict=True)
    ]
    n = len(network.design)
    views = views_of(n, rows)
    shared = np.flatnonzero(views.seen.sum(axis=0) > 1)
    kept = np.zeros(n, dtype=bool)
    kept[shared[np.unique(np.linspace(0, len(shared) - 1, min(len(shared), MOST_DOTS)).astype(int))]] = True
    if kept.sum() < LEAST_DOTS or (views.seen[:, kept].sum(axis=1) < LEAST_DOTS).any():
        return Settled(chosen)
    start = network.design if before.places is None else before.places
    adjusted = attempt(network.of_dots(kept), views.of_dots(kept), places=start[kept], tolerance=ROUGHLY)
    if adjusted is None:
        return Settled(chosen)
    places = start.copy()
    places[kept] = adjusted.places
    moved = zip(adjusted.views.rotation, adjusted.views.translation, strict=True)
    factor = adjusted.chi2 / max(1, adjusted.degrees_of_freedom)
    return Settled(chosen, factor, adjusted.degrees_of_freedom, places, dict(zip(photos, moved, strict=True)))


def aligned_to_design(
    settled: Settled, group: Sequence[Relabeling], points: Array, radii: Array, camera: Camera
) -> tuple[Settled, bool]:
    """Turn all labels together, so that the design fits best, and tell whether the dots' sizes settle it.

    Otherwise what is left is the print's own symmetry.
    """
    labelings = [
        tuple(
            replace(guess, index=guesses.image[guess.index], pose=guesses.pose(*labeled_pose(guess)))
            for guess in settled.guesses
        )
        for guesses in group
        if (guesses.image >= 0).all()
    ]
    likely = _of_right_sizes(
        labelings, [sum(guess.misfit_of_sizes(radii) for guess in guesses) for guesses in labelings]
    )
    best = min(likely, key=lambda guesses: _misfit(guesses, points, radii, camera))
    return replace(settled, guesses=best), len(likely) == 1


def _misfit(guesses: Sequence[Labeled], points: Array, radii: Array, camera: Camera) -> float:
    """Sum of squares in px^2 of what the design leaves in all photographs."""
    total = 0.0
    for guess in guesses:
        seen = camera.from_pixels(guess.centers)
        weight = np.broadcast_to(camera.fx**2 * np.eye(2), (1, len(seen), 2, 2))
        rotation, translation = labeled_pose(guess)
        refined = refine_poses(
            points[guess.index], radii[guess.index], seen[None], weight, rotation[None], translation[None]
        )
        total += float(refined[2][0])
    return total
