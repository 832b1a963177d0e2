"""Match dots of a file to dots of a marker by the layout and the key ring; labels are ignored.

A page may have been scaled or sheared as a whole: `changes` finds what to undo before.
"""

# tests: tests/verification/test_check.py

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.maths.rotation import rigid_motion
from markergen.model.marker import Marker
from markergen.verification.reading import ALIKE, Page

CONCENTRIC = 0.2
"""Maximum distance between the centers of circles of one dot, as a share of the smaller radius."""

STRETCH = 0.1
"""Maximum relative error of distances in a file; beyond it, it shows another marker."""

MOST_GUESSES, CHECKED, KEPT = 20_000, 12, 60
"""Number of candidate motions, of dots that each is tried on at first, and of candidates then tried on all dots."""

BASE_PAIRS = 8
"""Number of pairs of dots that motions are guessed by. Each is in two at most, so three missing ones leave one."""


@dataclass(frozen=True, eq=False)
class DotSet:
    """Dots of a marker or a page, with lengths in mm.

    Attributes
    ----------
    centers : array (m, 2)
    radii : array (m,)
    inner : array (m,)
        Inner radius of a ring; 0 for a disk.
    spread : array (m,)
        Largest distance between the centers of the circles of one dot.
    rough : array (m,)
        Largest distance of the outlines of a dot from its circles.
    heights : array (m,)
        nan where the file has none.
    names : tuple of int
        Ids of a marker's dots; empty for those of a page.
    ordered : bool
        True if the dots are in the order in which they were written to the file.
    """

    centers: Array
    radii: Array
    inner: Array
    spread: Array
    rough: Array
    heights: Array
    names: tuple[int, ...] = field(default=(), kw_only=True)
    ordered: bool = field(default=True, kw_only=True)

    def __len__(self) -> int:
        return len(self.centers)

    @property
    def columns(self) -> list[Array]:
        """What is known of each dot."""
        return [self.centers, self.radii, self.inner, self.spread, self.rough, self.heights]

    @property
    def rings(self) -> NDArray[np.bool_]:
        """Mask of the rings."""
        return np.asarray(self.inner > 0)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "DotSet":
        """Select dots by mask or index."""
        names = tuple(np.array(self.names)[chosen].tolist()) if self.names else ()
        return DotSet(*(column[chosen] for column in self.columns), names=names, ordered=self.ordered)


def expected_dots(marker: Marker) -> DotSet:
    """Dots of the marker's control points."""
    inner = np.array([500 * point.feature.inner_diameter for point in marker.control_points])
    exact = np.zeros(len(marker))
    places, names = 1e3 * marker.xyz, tuple(marker.ids.tolist())
    return DotSet(places[:, :2], 1e3 * marker.radii, inner, exact, exact, places[:, 2], names=names)


def dots_on_page(page: Page, expected: DotSet) -> DotSet:
    """Circles of a page that may be dots: of about the size of an expected dot, concentric circles merged."""
    circles = page.circles
    radii = np.unique(expected.radii)
    is_dot = np.abs(np.log(np.maximum(circles[:, 2, None], 1e-12) / radii)).min(axis=-1) < np.log(ALIKE)
    free, rows = is_dot.copy(), []
    for index in np.flatnonzero(is_dot):
        if not free[index]:
            continue
        distance = np.linalg.norm(circles[:, :2] - circles[index, :2], axis=-1)
        mine = distance <= CONCENTRIC * np.minimum(circles[:, 2], circles[index, 2])
        same = mine & is_dot
        free &= ~same
        # Of several circles the best fit is the dot, as for a ring's outer circle inside a white one.
        sizes = circles[same]
        fit = np.abs(np.log(sizes[:, 2, None] / radii)).min(axis=-1)
        center = sizes[np.argmin(fit)]
        within = circles[mine & (circles[:, 2] < center[2] / ALIKE)]
        alike = sizes[np.abs(sizes[:, 2] / center[2] - 1) < 0.01]
        parts = np.concatenate([alike, within])
        spread = float(np.linalg.norm(parts[:, :2] - center[:2], axis=-1).max(initial=0.0))
        rows.append((*center[:3], float(within[:, 2].max(initial=0.0)), spread, parts[:, 3].max(), np.nan))
    table = np.array(rows, dtype=float).reshape(-1, 7)
    return DotSet(table[:, :2], *table[:, 2:].T, ordered=not page.measured)


@dataclass(frozen=True, eq=False)
class Match:
    """Assignment of found dots to a marker's dots by a motion of the plane.

    Attributes
    ----------
    indices : array (n,) of int
        Index of the found dot for each of the marker's dots, or -1.
    strange : int
        Number of rings in place of disks and of disks in place of rings.
    rms : float
        Root-mean-square distance in mm after the best rigid motion, mirrored or not.
    angle : float
        Rotation angle of the motion, rad.
    """

    indices: Indices
    mirror: bool
    strange: int
    rms: float
    angle: float

    @property
    def count(self) -> int:
        """Number of matched dots, less those of the wrong kind."""
        return int(np.sum(self.indices >= 0)) - self.strange

    @property
    def ordered(self) -> bool:
        """True if the file lists the dots in the marker's order."""
        return bool(np.all(np.diff(self.indices[self.indices >= 0]) > 0))


def best_match(expected: DotSet, dots: DotSet, upright: Callable[[], bool | None] | None) -> Match | None:
    """Match the dots, mirrored only if no other match fits.

    If a layout maps onto itself by a rotation or a reflection, the reading direction of the page or else the order of
    the dots in the file decides, and then the smallest rotation.
    """
    plain, mirrored = (_matches(expected, dots, mirror) for mirror in (False, True))
    if not plain or not mirrored:
        return min([*plain, *mirrored], key=_rotation, default=None)
    if mirrored[0].count != plain[0].count:
        return min(plain if plain[0].count > mirrored[0].count else mirrored, key=_rotation)
    least = min(match.rms for match in (*plain, *mirrored))
    alike = [match for match in (*plain, *mirrored) if match.rms <= 1.5 * least + 1e-3]
    both = len({match.mirror for match in alike}) == 2
    reads = upright() if both and upright is not None else None
    if reads is not None:
        alike = [match for match in alike if match.mirror != reads]
    elif dots.ordered and any(match.ordered for match in alike):
        alike = [match for match in alike if match.ordered]
    return min(alike, key=lambda match: (match.mirror, _rotation(match)))


def _rotation(match: Match) -> tuple[float, float]:
    return round(abs(match.angle), 3), match.rms


def _matches(expected: DotSet, dots: DotSet, mirror: bool) -> list[Match]:
    """Matches by motions that are all mirrored or all not: those with the most dots that fit about equally well.

    A pair of the marker's dots is laid on every pair of found dots at the same distance, up to `STRETCH`. The resulting
    motion maps the other dots, and each takes the found dot nearest to it.
    """
    if len(dots) < 2:
        return []
    # Up to this distance in mm, a dot can belong to only one expected dot.
    apart = np.linalg.norm(expected.centers[:, None] - expected.centers, axis=-1)
    np.fill_diagonal(apart, np.inf)
    reach = float(min(0.4 * apart.min(), 0.03 * float(np.ptp(expected.centers, axis=0).max())))
    matches: list[Match] = []
    for pair in _base_pairs(expected):
        guesses = _guesses(expected, dots, pair, mirror, reach)
        matches += [_labels(expected, dots, mirror, factor, offset, reach) for factor, offset in guesses]
        if any(match.count == len(expected) for match in matches):
            break
    most = max((match.count for match in matches), default=0)
    matches = [match for match in matches if match.count == most]
    least = min((match.rms for match in matches), default=0.0)
    # Matches that fit equally well are symmetries of a regular layout.
    return [match for match in matches if match.rms <= 1.5 * least + 1e-3]


def _base_pairs(expected: DotSet) -> list[tuple[int, int]]:
    """Pairs of distant dots, those with one ring first; few share a dot, so that some pair has no missing dot."""
    n = len(expected)
    first, second = np.triu_indices(n, 1)
    length = np.linalg.norm(expected.centers[first] - expected.centers[second], axis=-1)
    one_ring = expected.rings[first] != expected.rings[second]
    order = np.lexsort((-length, ~one_ring))
    used = np.zeros(n, dtype=int)
    pairs: list[tuple[int, int]] = []
    for index in order:
        i, j = int(first[index]), int(second[index])
        if max(used[i], used[j]) < 2 and length[index] > 0:
            pairs.append((i, j))
            used[[i, j]] += 1
        if len(pairs) == BASE_PAIRS:
            break
    return pairs


def _guesses(
    expected: DotSet, dots: DotSet, pair: tuple[int, int], mirror: bool, reach: float
) -> list[tuple[complex, complex]]:
    """Motions w = factor z + offset (of conjugate z if mirrored) that best fit a few spread-out dots."""
    source = expected.centers @ np.array([1, -1j if mirror else 1j])
    target = dots.centers @ np.array([1, 1j])
    across = source[pair[1]] - source[pair[0]]
    gaps = target[None, :] - target[:, None]
    stretch = np.abs(np.abs(gaps) / abs(across) - 1)
    kinds = [dots.rings == expected.rings[index] for index in pair]
    for wanted in (kinds[0][:, None] & kinds[1], np.ones_like(stretch, dtype=bool)):
        a, b = np.nonzero((stretch < STRETCH) & wanted & (gaps != 0))
        if len(a):
            break
    else:
        return []
    nearest = np.argsort(stretch[a, b], kind="stable")[:MOST_GUESSES]
    a, b = a[nearest], b[nearest]
    factor = gaps[a, b] / across
    offset = target[a] - factor * source[pair[0]]
    check = _spread(expected.centers)
    distance = _nearest(dots.centers, factor[:, None] * source[check] + offset[:, None])[0]
    reached = np.sum(distance < reach, axis=-1)
    order = np.lexsort((np.minimum(distance, reach).sum(axis=-1), -reached))[:KEPT]
    return list(zip(factor[order].tolist(), offset[order].tolist(), strict=True))


def _spread(points: Array) -> Indices:
    """Select a few points far from each other."""
    chosen = [0]
    gap = np.linalg.norm(points - points[0], axis=-1)
    while len(chosen) < min(CHECKED, len(points)):
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(points - points[chosen[-1]], axis=-1))
    return np.array(chosen)


def _nearest(points: Array, places: NDArray[np.complex128]) -> tuple[Array, Indices]:
    from scipy.spatial import cKDTree

    distance, index = cKDTree(points).query(np.stack([places.real, places.imag], axis=-1))
    return distance, index


def _labels(expected: DotSet, dots: DotSet, mirror: bool, factor: complex, offset: complex, reach: float) -> Match:
    source = expected.centers @ np.array([1, -1j if mirror else 1j])
    distance, index = _nearest(dots.centers, factor * source + offset)
    index = np.where(distance < reach, index, -1)
    # A found dot nearest to several positions goes to the closest of them.
    for dot in np.unique(index[index >= 0]):
        claims = np.flatnonzero(index == dot)
        index[claims[claims != claims[np.argmin(distance[claims])]]] = -1
    # Those of the pair at least, which the motion maps onto found ones.
    used = index >= 0
    rotation, translation = rigid_motion(expected.centers[used], dots.centers[index[used]], mirror)
    off = expected.centers[used] @ rotation.T + translation - dots.centers[index[used]]
    strange = int(np.sum(dots.rings[index[used]] != expected.rings[used]))
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=-1))))
    angle = float(np.arctan2(*(rotation[[1, 0], 0] * (-1 if mirror else 1))))
    return Match(index.astype(np.intp), mirror, strange, rms, angle)


# --- Pages that were changed as a whole ------------------------------------------------------------------------------

FEWEST = 3
"""Minimum number of dots of one size that can be the marker's."""

MOST_TRIED = 8
"""Maximum number of sizes of circles that are tried as those of the dots."""

SAME = 1.02
"""Maximum ratio between circles of one size."""

ROUGH = 0.02
"""Maximum misfit of a shear or stretch, as a share of the marker's size, that is tried."""


def changes(page: Page, expected: DotSet) -> Iterator[tuple[Array, Array]]:
    """Linear maps that a page may have undergone: the map (2, 2) to undo it, and the change in the marker frame.

    The change is upper triangular: scales along x and y on its diagonal, and a shear.
    """
    identity = np.eye(2)
    for ratio in _ratios(page, expected):
        dots = dots_on_page(moved_page(page, identity / ratio), expected)
        change = _stretch(expected, dots) if len(dots) == len(expected) else None
        if change is not None:
            rotation, shape = change
            yield rotation @ np.linalg.inv(ratio * shape) @ rotation.T, ratio * shape
        yield identity / ratio, ratio * identity


def _ratios(page: Page, expected: DotSet) -> list[float]:
    """Ratios of sizes of circles to that of most dots, those that occur as often as the dots first."""
    radii = page.circles[:, 2]
    sizes, often = np.unique(expected.radii, return_counts=True)
    usual = float(sizes[np.argmax(often)])
    ordered = np.sort(radii[radii > 0])
    groups = np.split(ordered, np.flatnonzero(ordered[1:] > SAME * ordered[:-1]) + 1)
    groups = [group for group in groups if len(group) >= FEWEST - 1]
    groups.sort(key=lambda group: (abs(len(group) - int(often.max())), -group[0]))
    return [float(np.median(group)) / usual for group in groups[:MOST_TRIED]]


def _stretch(expected: DotSet, dots: DotSet) -> tuple[Array, Array] | None:
    """Rotation, possibly mirrored, and upper triangular map, whose product maps the layout onto the found dots.

    Both are made equally wide in all directions first, after which a rotation maps one onto the other.
    """
    sides = []
    for layout in (expected, dots):
        offset = layout.centers - layout.centers.mean(axis=0)
        value, vector = np.linalg.eigh(offset.T @ offset / len(offset))
        if value.min() <= 1e-9 * value.max():
            return None
        sides.append(offset @ (vector / np.sqrt(value)) @ vector.T)
    scale = float(np.ptp(expected.centers))
    even, evened = (replace(layout, centers=scale * side) for layout, side in zip((expected, dots), sides, strict=True))
    match = best_match(even, evened, None)
    if match is None or (match.indices < 0).any():
        return None
    source = expected.centers - expected.centers.mean(axis=0)
    target = dots.centers[match.indices] - dots.centers.mean(axis=0)
    matrix = np.linalg.lstsq(source, target, rcond=None)[0].T
    if np.linalg.norm(source @ matrix.T - target, axis=1).max() > ROUGH * scale or np.linalg.det(matrix) == 0:
        return None
    rotation, shape = np.linalg.qr(matrix)
    signs = np.sign(np.diag(shape))
    return rotation * signs, shape * signs[:, None]


def moved_page(page: Page, matrix: Array) -> Page:
    """Page with a linear map (2, 2) applied; circles stay circles of the same area."""
    scale = float(np.sqrt(abs(np.linalg.det(matrix))))
    circles = np.column_stack([page.circles[:, :2] @ matrix.T, scale * page.circles[:, 2:]])
    picture = None
    if page.picture is not None:
        back, seen = np.linalg.inv(matrix), page.picture
        picture = replace(seen, sample=lambda points: seen.sample(points @ back.T), grain=seen.grain * scale)
    lines = None if page.lines is None else page.lines @ matrix.T
    return replace(page, circles=circles, corners=page.corners @ matrix.T, picture=picture, lines=lines)
