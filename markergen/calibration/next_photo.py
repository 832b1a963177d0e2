"""Which photograph to take next: the one after which poses in the working volume err least; also from a video.

A photograph tells of dots and camera what its 2 n coordinates tell beyond its pose. With the covariance C of dots and
camera so far, A and J the derivatives of the coordinates by dots and camera and by the pose, and s their noise,

    C' = C - C A' S A C,    S = T^-1 - T^-1 J (J'T^-1 J)^-1 J'T^-1,    T = A C A' + s^2 I,

so that the mean square trace(M C) of the pose error (see `working_error`) falls by trace(S A C M C A').

A video gives its still views that add something, until the next one hardly helps.
"""

# tests: tests/calibration/test_next_photo.py tests/calibration/test_live.py

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment
from markergen.calibration.coverage import SIDES, coverage_of, posed
from markergen.calibration.weaknesses import bounded_covariance
from markergen.calibration.working_error import ExpectedError, Sensitivity, sensitivity
from markergen.detect.detector import Detector
from markergen.errors import InputError
from markergen.maths.batched import Batched
from markergen.maths.conics import outlines, pose_rows
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import Camera
from markergen.presentation.plots import FAINT, INK, MUTED, SERIES, axes_of
from markergen.read.videos import open_video, silent_opencv
from markergen.units import two_digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from markergen.calibration.calibration import Calibration


TILTS_DEG, TURNS_DEG = (20.0, 40.0, 60.0), (0.0, 90.0, 180.0, 270.0)
"""Tilts of candidates to each of eight sides, and turns of the camera, deg."""

FILLS = {1 / 3: "a third of", 2 / 3: "two thirds of", 1.0: ""}
PLACES = {(0, 0): "", (-1, -1): "upper left", (1, -1): "upper right", (-1, 1): "lower left", (1, 1): "lower right"}
"""Places of the marker in the picture, as signs of x and y from its middle."""

MARGIN = 0.04
"""Share of the picture, on each side, that stays free."""

LEAST_DIAMETER = 8.0
"""Smallest diameter in px, along the short axis, of a dot in a photograph that is asked for."""

HARDLY = 0.03
"""Fraction that the next photograph lowers the expected error by, below which none is asked for."""

GUESS_M, GUESS_PX = 0.02, 30.0
"""What is taken to be known of a dot and of the image of a dot by the camera where the photographs tell nothing."""

OPEN_DEG = 1.0
"""Expected rotation error from which on it is called open."""

_ALIKE = 1.01
"""Ratio of rotation errors within which the translation decides."""

_MOST_DOTS, _BATCH, _KEPT = 48, 64, 200
"""Dots by which candidates are ranked, candidates ranked at a time, and kept after the first round."""

_ROUNDS = 25
"""Repetitions in which the dots of a candidate come to their size and place in the picture."""


@dataclass(frozen=True, eq=False)
class Candidates(Batched):
    """Photographs that could be taken: k poses T_camera_marker and what describes them to a photographer.

    Angles (k,) are those of `coverage.view_angles`. The dots extend over the share `fill` (k,) of the picture's width
    or height, less the margin, at the sides `place` (k, 2) of `PLACES`.
    """

    rotation: Array
    translation: Array
    tilt_deg: Array
    toward_deg: Array
    roll_deg: Array
    fill: Array
    place: Array


@dataclass(frozen=True, eq=False)
class NextPhoto:
    """A photograph to take after those before it, a candidate alone: what to do, and the error without and with it."""

    candidate: Candidates
    request: str
    before: ExpectedError
    after: ExpectedError

    @property
    def gain(self) -> float:
        """Fraction by which it lowers the expected rotation error."""
        return 1 - self.after.rotation_deg / self.before.rotation_deg

    def __str__(self) -> str:
        return self.request


@dataclass(frozen=True, eq=False)
class NextPhotos:
    """Photographs to take, one after the other: at least one if any photograph can show the marker.

    Each is chosen after those before it. `points` (n, 3) and `radii` (n,) in m are the dots of the marker, `earlier`
    the poses (v, 3, 3) and (v, 3) of the photographs taken.
    """

    photos: tuple[NextPhoto, ...]
    points: Array
    radii: Array
    names: tuple[str, ...]
    camera: Camera
    earlier: tuple[Array, Array]

    @property
    def helps(self) -> bool:
        """True if the first one lowers the expected rotation error by more than `HARDLY`."""
        return bool(self.photos) and self.photos[0].gain > HARDLY

    @property
    def sentence(self) -> str:
        """Which photograph to take next, or that more hardly help."""
        if not self.photos:
            return "No photograph can show the whole marker with dots large enough."
        first = self.photos[0]
        was = first.before.rotation_deg
        if not self.helps:
            return (
                "More photographs hardly help: the best one would lower the expected rotation error of "
                f"{two_digits(was)} deg by {100 * max(first.gain, 0):.0f} %."
            )
        expected = two_digits(was) if was < OPEN_DEG else f"{OPEN_DEG:.0f} deg or more"
        return (
            f"Next photograph: {first.request}. It lowers the expected rotation error from {expected} to "
            f"{two_digits(first.after.rotation_deg)} deg."
        )

    def draw(self, ax: "Axes | None" = None, which: int = 0) -> "Axes":
        """Draw the picture that one of the photographs would show, with outlines of those taken."""
        from matplotlib.patches import Rectangle

        ax = axes_of(ax)
        camera, photo = self.camera, self.photos[which].candidate
        for rotation, translation in zip(*self.earlier, strict=True):
            pixels = camera.project(self.points, rotation[None], translation[None])[0]
            pixels = pixels[np.isfinite(pixels).all(axis=1)]
            outline = pixels[_corners(pixels)]
            ax.plot(*np.vstack([outline, outline[:1]]).T, color=FAINT, linewidth=0.6, zorder=1)
        extent = float(np.ptp(self.points, axis=0).max())
        radii = np.where(self.radii > 0, self.radii, 0.03 * extent)
        angle = np.linspace(0, 2 * np.pi, 33)
        ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        pose = photo.rotation, photo.translation
        for point, radius, name in zip(self.points, radii, self.names, strict=True):
            rim = camera.project(point + radius * ring, *pose)[0]
            ax.fill(*rim.T, color=SERIES[0]["color"], zorder=2)
            if len(self.points) <= 30:
                # Beside the dot, at its upper right: y is down.
                corner = rim[np.argmax(rim[:, 0] - rim[:, 1])]
                ax.annotate(
                    name.removeprefix("dot "), corner, (2, 2), textcoords="offset points", fontsize=7, color=INK
                )
        size = np.array([camera.width, camera.height])
        if photo.tilt_deg[0]:
            # Beside the frame, at the edge or corner that is away from the camera, and opposite.
            toward = np.deg2rad(photo.toward_deg[0])
            ahead = np.round(np.array([np.cos(toward), np.sin(toward)]))
            for text, side in (("farther", ahead), ("nearer", -ahead)):
                at = (size - 1) / 2 + side * (0.5 * size + 0.04 * size[1])
                text_angle = 90 if abs(side[0]) > 0 else 0
                ax.annotate(text, at, ha="center", va="center", rotation=text_angle, fontsize=8, color=MUTED)
        ax.add_patch(Rectangle((-0.5, -0.5), *size, fill=False, edgecolor=INK, linewidth=1, zorder=4))
        low, high = -0.1 * size[1], size + 0.1 * size[1]
        ax.set(xlim=(low, high[0]), ylim=(high[1], low), aspect="equal")
        ax.set_axis_off()
        return ax


def next_photos(
    adjustment: Adjustment, poses: tuple[Array, Array], names: Sequence[str] | None = None, count: int = 4
) -> NextPhotos:
    """Return photographs of the first camera that lower the expected error of the first marker's pose most, in turn.

    Each is the best of some hundred candidates: tilted by 0 to 60 deg to eight sides, with the camera turned by
    quarters, from three distances, in the middle of the picture and in its corners, the dots wholly in view. A
    photograph is as precise as those taken. Rotation counts; among equals, translation. The list ends before a
    photograph that lowers the error by less than `HARDLY`; the first is always there.

    Parameters
    ----------
    adjustment : Adjustment
        Of the photographs taken; they may leave unknowns open.
    poses : arrays (P, 3, 3) and (P, 3), m
        Working volume; those outside the domain of the camera's lens model do not count.
    names : sequence of str, optional
        Names of the adjusted dots, "dot 0", "dot 1" and so on if not given.
    count : int
        Maximum number of photographs.
    """
    network = adjustment.network
    dots = np.flatnonzero(network.marker == network.marker[0])
    points, radii, camera = adjustment.places[dots], network.radii[dots], adjustment.camera
    names = [f"dot {k}" for k in range(len(network.design))] if names is None else names
    noise = float(np.sqrt(adjustment.image_variance))
    taken = adjustment.views.seen[:, dots].any(axis=1)
    earlier = adjustment.views.rotation[taken], adjustment.views.translation[taken]
    is_projected = np.isfinite(camera.project(points, *poses)).all(axis=(1, 2))
    working = (poses[0][is_projected], poses[1][is_projected]) if is_projected.any() else earlier
    problem = _CandidateWorth(adjustment, points, camera, dots, noise, working)
    covariance = bounded_covariance(adjustment, GUESS_M, GUESS_PX)
    covariance = covariance[np.ix_(problem.columns, problem.columns)]
    candidates = candidate_photos(points, radii, camera)
    photos: list[NextPhoto] = []
    working_sensitivity = problem.sensitivity(covariance)
    before = problem.expected(working_sensitivity, covariance)
    while len(photos) < count and len(candidates):
        gains = problem.gains(working_sensitivity, covariance, candidates)
        squares = np.array([np.deg2rad(before.rotation_deg), before.translation]) ** 2 / problem.scale
        turns, moves = squares[:, None] - gains.T
        good = np.flatnonzero(turns <= _ALIKE**2 * turns.min())
        best = int(good[np.argmin(moves[good])])
        covariance = problem.updated(covariance, candidates.take(np.array([best])))
        working_sensitivity = problem.sensitivity(covariance)
        after = problem.expected(working_sensitivity, covariance)
        photo = _photo(candidates, best, points, [names[k] for k in dots.tolist()], camera, before, after)
        if photos and photo.gain < HARDLY:
            break
        photos.append(photo)
        before = after
        candidates = candidates.take(np.sort(np.argsort(turns, kind="stable")[:_KEPT]))
    return NextPhotos(tuple(photos), points, radii, tuple(names[k] for k in dots.tolist()), camera, earlier)


def candidate_photos(points: Array, radii: Array, camera: Camera) -> Candidates:
    """Photographs of dots (n, 3) with radii (n,), wholly in view, none smaller than `LEAST_DIAMETER`."""
    leaning = [(0.0, 0.0), *((tilt, 45.0 * k) for tilt in TILTS_DEG for k in range(8))]
    placed = [(fill, place) for fill in FILLS for place in PLACES if fill < 1 or place == (0, 0)]
    rows = [(*lean, roll, fill, *place) for roll in TURNS_DEG for fill, place in placed for lean in leaning]
    tilt, toward, roll, fill, x, y = np.array(rows).T
    rotation, place = posed(tilt, toward, roll), np.stack([x, y], axis=-1)
    translation = _translations(points, radii, rotation, camera, fill, place)
    candidates = Candidates(rotation, translation, tilt, toward, roll, fill, place)
    pixels = _rims(points, radii, rotation, translation, camera)
    room = 0.5 * MARGIN * np.array([camera.width, camera.height])
    inside = (pixels >= room) & (pixels <= [camera.width, camera.height] - room)
    seen = inside.all(axis=(1, 2)) & (to_camera(points, rotation, translation)[..., 2] > 0).all(axis=1)
    seen &= (rotation[:, :, 2] * translation).sum(axis=1) < 0
    if (radii > 0).any():
        images = outlines(points, radii, rotation, translation)
        shape = camera.pixel_jacobian(images.center)
        shape = shape @ images.shape @ shape.swapaxes(-1, -2)
        with np.errstate(invalid="ignore"):
            smallest = 2 * np.sqrt(np.linalg.eigvalsh(np.nan_to_num(shape))[..., 0].min(axis=1))
        seen &= images.seen.all(axis=1) & (smallest >= LEAST_DIAMETER)
    return candidates.take(seen)


def _rims(points: Array, radii: Array, rotation: Array, translation: Array, camera: Camera) -> Array:
    """Images (k, m, 2) of the dots' rims; nan where the camera sees nothing."""
    angle = np.arange(4) * np.pi / 2
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(4)], axis=-1)
    rims = (points[:, None] + radii[:, None, None] * ring).reshape(-1, 3) if radii.any() else points
    rims = rims[_corners(rims[:, :2])]
    return camera.project(rims, rotation, translation)


def _translations(points: Array, radii: Array, rotation: Array, camera: Camera, fill: Array, place: Array) -> Array:
    """Translations (k, 3) at which the dots extend over a share of the picture, at some place of it.

    Found by repetition, from afar: the box around the dots is brought to its size and to its place.
    """
    size = np.array([camera.width, camera.height])
    room = (1 - 2 * MARGIN) * size
    middle = points.mean(axis=0)
    extent = float(np.linalg.norm(points - middle, axis=1).max() + radii.max(initial=0.0))
    target = np.array([0.0, 0.0, 1.0]) * (8 * extent * camera.fx / min(size) / fill)[:, None]
    for _ in range(_ROUNDS):
        pixels = _rims(points - middle, radii, rotation, target, camera)
        # Those that leave the domain of the lens model step back, toward the middle.
        lost = np.asarray(~np.isfinite(pixels).all(axis=(1, 2)))
        pixels[lost] = 0.0
        low, high = pixels.min(axis=1), pixels.max(axis=1)
        share = ((high - low) / room).max(axis=1) / fill
        depth = target[:, 2] * np.where(lost, 2.0, np.clip(share, 0.7, 2.0))
        goal = (size - 1) / 2 + place * (room - (high - low)) / 2
        displacement = (goal - (low + high) / 2) / camera.focal
        aside = target[:, :2] / target[:, 2:]
        aside = np.where(lost[:, None], 0.5 * aside, aside + 0.8 * displacement)
        target = np.column_stack([aside * depth[:, None], depth])
    return target - rotation @ middle


@dataclass(frozen=True, eq=False)
class _CandidateWorth:
    """What candidates are judged by; unknowns are the own dots (if free) and the camera's u."""

    adjustment: Adjustment
    points: Array
    camera: Camera
    dots: NDArray[np.intp]
    noise: float
    poses: tuple[Array, Array]

    @property
    def free(self) -> bool:
        return self.adjustment.network.free

    @property
    def scale(self) -> float:
        """Factor on covariances; 1 where photographs are too few to tell."""
        return self.adjustment.scale if self.adjustment.degrees_of_freedom > 0 else 1.0

    @property
    def columns(self) -> NDArray[np.intp]:
        """Indices of the own unknowns among all."""
        size = self.adjustment.normal.dots
        dots = (3 * self.dots[:, None] + np.arange(3)).ravel() if self.free else np.zeros(0, dtype=np.intp)
        return np.concatenate([dots, size + np.arange(len(self.adjustment.network.freedom))]).astype(np.intp)

    def lift(self, transfer: Array) -> Array:
        """Change the columns of a transfer, of dots and all camera parameters, to the unknowns."""
        size = 3 * len(self.points)
        network = self.adjustment.network
        camera = transfer[..., size:] @ network.freedom.directions[network.parameters(0)]
        return np.concatenate([transfer[..., : size if self.free else 0], camera], axis=-1)

    def sensitivity(self, covariance: Array) -> Sensitivity:
        """Sensitivity of working poses whose weights go with the covariance (q, q), unscaled."""
        n, scale = len(self.points), self.scale
        blocks = np.zeros((n, 3, 3))
        if self.free:
            index = np.arange(n)
            blocks = scale * covariance[: 3 * n, : 3 * n].reshape(n, 3, n, 3)[index, :, index, :]
        noise = np.sqrt(scale) * self.noise
        working_sensitivity = sensitivity(self.points, self.camera, *self.poses, float(noise), blocks)
        return replace(
            working_sensitivity, transfer=self.lift(working_sensitivity.transfer), dots=3 * n if self.free else 0
        )

    def expected(self, working_sensitivity: Sensitivity, covariance: Array) -> ExpectedError:
        return working_sensitivity.expected(self.scale * covariance)

    def rows(self, candidates: Candidates, dots: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Derivatives of candidates' coordinates by pose (k, n, 2, 6), own dot (k, n, 2, 3 or 0) and u (k, n, 2, r)."""
        points = self.points[dots]
        normalized = perspective(to_camera(points, candidates.rotation, candidates.translation))
        pose = self.camera.pixel_jacobian(normalized) @ pose_rows(points, candidates.rotation, candidates.translation)
        place = pose[..., 3:] @ candidates.rotation[:, None]
        network = self.adjustment.network
        moved = self.camera.parameter_jacobian(normalized) @ network.freedom.directions[network.parameters(0)]
        return pose, place if self.free else place[..., :0], moved

    def gains(self, working_sensitivity: Sensitivity, covariance: Array, candidates: Candidates) -> Array:
        """Decrease (k, 2) of the mean squares of rotation and translation, unscaled, by each candidate."""
        n = len(self.points)
        dots = np.unique(np.linspace(0, n - 1, min(n, _MOST_DOTS)).round().astype(np.intp))
        # As many coordinates tell more, fewer have to be the more precise.
        noise = self.noise**2 * len(dots) / n
        worth = [covariance @ matrix @ covariance for matrix in working_sensitivity.matrices]
        gains = []
        for start in range(0, len(candidates), _BATCH):
            part = candidates.take(np.arange(start, min(start + _BATCH, len(candidates))))
            pose, place, moved = self.rows(part, dots)
            inside = [_through(place, moved, dots, n, matrix) for matrix in (covariance, *worth)]
            gain = _gain(inside[0] + noise * np.eye(2 * len(dots)), pose.reshape(len(part), -1, 6))
            gains.append(np.stack([np.einsum("kab,kab->k", gain, lowered) for lowered in inside[1:]], axis=-1))
        return np.concatenate(gains)

    def updated(self, covariance: Array, candidate: Candidates) -> Array:
        """Covariance (q, q), unscaled, after one candidate."""
        n = len(self.points)
        pose, place, moved = self.rows(candidate, np.arange(n))
        whole = np.zeros((n, 2, len(covariance)))
        if self.free:
            whole[..., : 3 * n].reshape(n, 2, n, 3)[np.arange(n), :, np.arange(n)] = place[0]
        whole[..., len(covariance) - moved.shape[-1] :] = moved[0]
        rows = whole.reshape(2 * n, -1)
        through = rows @ covariance
        gain = _gain((through @ rows.T + self.noise**2 * np.eye(2 * n))[None], pose.reshape(1, -1, 6))[0]
        lower = covariance - through.T @ gain @ through
        return np.asarray((lower + lower.T) / 2, dtype=float)


def _through(place: Array, moved: Array, dots: NDArray[np.intp], n: int, matrix: Array) -> Array:
    """A X A' (k, 2 m, 2 m) for symmetric X (q, q), of rows by the m dots themselves, of n, and by the camera."""
    k, m, r = *place.shape[:2], moved.shape[-1]
    size = len(matrix) - r
    camera = np.broadcast_to(matrix[size:, size:], (k, 1, r, r))
    product = (moved @ camera).reshape(k, 2 * m, r) @ moved.reshape(k, 2 * m, r).swapaxes(-1, -2)
    if not size:
        return np.asarray(product)
    dotted = matrix[:size, :size].reshape(n, 3, n, 3)[dots][:, :, dots]
    half = place @ dotted.reshape(m, 3, 3 * m)
    whole = half.reshape(k, 2 * m, m, 3).swapaxes(1, 2) @ place.swapaxes(-1, -2)
    product = product + whole.swapaxes(1, 2).reshape(k, 2 * m, 2 * m)
    aside = (place @ matrix[:size, size:].reshape(n, 3, r)[dots]).reshape(k, 2 * m, r)
    both = aside @ moved.reshape(k, 2 * m, r).swapaxes(-1, -2)
    return np.asarray(product + both + both.swapaxes(-1, -2))


def _gain(spread: Array, pose: Array) -> Array:
    """S (k, 2 m, 2 m) of the module's docstring, for T and J."""
    inverse = np.linalg.inv(spread)
    weighted = inverse @ pose
    return np.asarray(inverse - weighted @ np.linalg.inv(pose.swapaxes(-1, -2) @ weighted) @ weighted.swapaxes(-1, -2))


def _photo(
    candidates: Candidates,
    best: int,
    points: Array,
    names: Sequence[str],
    camera: Camera,
    before: ExpectedError,
    after: ExpectedError,
) -> NextPhoto:
    """Return a candidate with its request."""
    candidate = candidates.take(np.array([best]))
    tilt, toward, roll = (float(angle[0]) for angle in (candidate.tilt_deg, candidate.toward_deg, candidate.roll_deg))
    pixels = camera.project(points, candidate.rotation, candidate.translation)[0]
    top = names[int(np.argmin(pixels[:, 1]))]
    parts = ["hold the camera square to the marker"]
    if tilt:
        side = SIDES[round(toward / 45) % 8]
        parts = [f"tilt the marker {tilt:.0f} deg, its {side} away from the camera"]
    orientation = {
        0.0: "hold the camera upright",
        90.0: "turn the camera by 90 deg to the right",
        180.0: "hold the camera upside down",
        270.0: "turn the camera by 90 deg to the left",
    }
    parts.append(f"{orientation[roll]} ({top} at the top of the picture)")
    place = PLACES[int(candidate.place[0, 0]), int(candidate.place[0, 1])]
    filled = f"fill {FILLS[float(candidate.fill[0])]} the picture".replace("  ", " ")
    parts.append(f"{filled}, in its {place} corner" if place else filled)
    request = f"{', '.join(parts[:-1])}, and {parts[-1]}"
    return NextPhoto(candidate, request, before, after)


def _corners(points: Array) -> NDArray[np.intp]:
    """Indices of the corners of the convex hull of points (n, 2), in order; of the ends of a line."""
    import cv2

    return np.asarray(cv2.convexHull(points.astype(np.float32), returnPoints=False)[:, 0], dtype=np.intp)


STILL = 5e-4
"""RMS motion of the dots since the frame before, over the picture's diagonal, below which a view is still: 0.4 px
of 640 x 480, which smears a dot by 0.2 px at 30 frames a second and an exposure of 15 ms."""

APART = 0.03
"""RMS distance of the dots from those of every photograph taken, over the diagonal, that makes a view another one:
24 px in 640 x 480, as far as a tilt by 25 deg moves dots that are 250 px from the middle."""

FEWEST_PHOTOS, MOST_PHOTOS = 8, 40
"""Number of photographs from which on it is asked whether more help, and at which it ends in any case."""

FIRST_REQUEST = "tilt it by 20 to 60 deg, to another side, in another part of the picture"
"""What is asked for before that number."""

Judge = Callable[[Sequence[NDArray[np.uint8]]], "Calibration"]


def photographs_of(
    source: str, detector: Detector, judge: Judge, tell: Callable[[str], None]
) -> list[NDArray[np.uint8]]:
    """Take photographs from a video, a camera or a stream, until more hardly help or it ends.

    Parameters
    ----------
    detector : Detector
        Of the markers to measure.
    judge : callable
        Calibrates with the photographs so far; what it raises as `InputError` asks for more.
    tell : callable
        Takes a line for each photograph: what all of them cover, and which is wanted next, where that changes.

    Raises
    ------
    InputError
        If the source cannot be opened, or shows no still view.
    """
    taken: list[NDArray[np.uint8]] = []
    views: list[dict[tuple[int, int], Array]] = []
    before: dict[tuple[int, int], Array] = {}
    asked, least = "", np.inf
    with open_video(source) as video, silent_opencv():
        for frame in video:
            diagonal = float(np.hypot(*frame.image.shape[:2]))
            dots = _dots(detector(frame.image))
            motion = _motion(dots, before) / diagonal
            is_still, least, before = motion < STILL, min(least, motion), dots
            if not is_still or any(_motion(dots, view) < APART * diagonal for view in views):
                continue
            taken.append(frame.image.copy())
            views.append(dots)
            request, line = _wanted(taken, judge)
            tell(f"photograph {len(taken)}: {line if request != asked else 'next as before'}")
            if not request or len(taken) == MOST_PHOTOS:
                break
            asked = request
    if not taken:
        closest = f"{100 * least:.2g} % at least" if np.isfinite(least) else "the marker in no two frames in a row"
        raise InputError(
            "a still view of the marker: from one frame to the next its dots move by less than "
            f"{100 * STILL:g} % of the picture's diagonal",
            f"{closest} in {video.name}",
            "hold the camera and the marker still for half a second, then move on, twenty times",
        )
    return taken


def _dots(results: Sequence[Any]) -> dict[tuple[int, int], Array]:
    """Pixels of dots by the numbers of the marker and the dot."""
    return {
        (number, int(identity)): pixel
        for number, finding in enumerate(results)
        if finding.ok
        for identity, pixel in zip(finding.ids, finding.pixels, strict=True)
    }


def _motion(dots: dict[tuple[int, int], Array], others: dict[tuple[int, int], Array]) -> float:
    """RMS distance in px of the dots that are in both; inf for fewer than four."""
    both = dots.keys() & others.keys()
    if len(both) < 4:
        return float("inf")
    return float(np.sqrt(np.mean([np.sum((dots[key] - others[key]) ** 2) for key in both])))


def _wanted(taken: Sequence[NDArray[np.uint8]], judge: Judge) -> tuple[str, str]:
    """The next photograph to take, empty if more hardly help, and a line that also says what all of them cover."""
    if len(taken) < FEWEST_PHOTOS:
        return (FIRST_REQUEST,) * 2
    try:
        calibration = judge(taken)
    except InputError as error:
        return (str(error),) * 2
    wanted = calibration.next_photos
    if wanted is None or not wanted.helps:
        return "", "enough, more hardly help"
    return wanted.photos[0].request, f"{coverage_of(calibration.adjustment).sentence} {wanted.sentence}"
