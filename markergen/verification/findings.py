"""Classify the errors of the dots and the tag in a file."""

# tests: tests/verification/test_check.py tests/verification/test_solids.py

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.geometry.contour import rings_and_circles
from markergen.maths.rotation import rigid_motion, scaled_motion
from markergen.model.marker import Marker
from markergen.model.openings import openings
from markergen.model.tag import Tag
from markergen.verification.matching import DotSet, best_match
from markergen.verification.reading import Page
from markergen.verification.result import MOST_LISTED, Finding, along_axes, listed_ids, scale_finding, short_length

MOST_SUBSETS = 300
"""Maximum number of pairs or triples of dots tried as a basis for consensus."""

MOST_COPIES = 500
"""Maximum number of copies of a marker that are looked for on a page: each takes a search among all dots left."""

MIRRORED = "print or cut it without mirroring: looked at from the printed side it must read normally"
AGAIN = "export it again, and do not edit its dots"
ROUND = "export it with circles that are circles, or with a finer tolerance"

UNTAGGED = {"scaled", "sheared", "mirrored", "another marker"}
"""Findings that imply a wrong tag, so that it is not reported."""

FAR = 2.0
"""Reach of a marker, in radii of what its dots fill, within which others disturb it."""

STRANGER = 0.25
"""Share of a dot's diameter: dots farther off than that, where no scale explains it, belong to another marker."""

BENT = 3e-4
"""Share of a radius by which four Bezier curves, which many programs have for a circle, may be off it: 2.7e-4."""

DIAMETER = {False: 2.0, True: 4.0}
"""Ratio of the tolerance of a diameter to that of a center, by whether the file is made of pixels."""


class PlaneMotion(NamedTuple):
    """Motion of the plane from the marker's frame to the page, mm: rotation (2, 2), perhaps mirrored, and translation.

    Of a marker that is drawn for a printer, `factor` is the ratio of drawn to true lengths along x and y.
    """

    rotation: Array
    translation: Array
    factor: tuple[float, float] = (1.0, 1.0)

    def to_page(self, points: Array) -> Array:
        """Map points (..., 2) in the marker frame."""
        return np.asarray(points * self.factor @ self.rotation.T + self.translation)

    def to_marker(self, points: Array) -> Array:
        """Map points (..., 2) on the page."""
        return np.asarray((points - self.translation) @ self.rotation / self.factor)


@dataclass(frozen=True, eq=False)
class Verdict:
    """Result for the dots of one copy of a marker.

    Attributes
    ----------
    largest : float
        Largest distance in m between a dot and its position in marker.json; nan if the dots could not be matched.
    worst : int or None
        Its id.
    scale : (x, y)
        Ratio of distances between dots in the file to those in marker.json, along the marker's axes; nan if unknown.
    motion : PlaneMotion or None
    used : array of int
        Indices of the found dots that belong to this copy.
    expected : DotSet
        The marker's dots that these are.
    """

    largest: float
    worst: int | None
    scale: tuple[float, float]
    findings: tuple[Finding, ...]
    motion: PlaneMotion | None
    used: NDArray[np.intp]
    expected: DotSet

    @property
    def kinds(self) -> set[str]:
        """Kinds of the findings."""
        return {finding.kind for finding in self.findings}


NOTHING = np.zeros(0, dtype=np.intp)


def judge(
    expected: DotSet, dots: DotSet, tolerance: float, *,
    upright: Callable[[], bool | None] | None = None, pixels: bool = False,
) -> Verdict:  # fmt: skip
    """Compare found dots with expected ones, aligned by the best rigid motion of the plane (no scale).

    The tolerance is in m, of diameters wider if the dots were measured in pixels. For `upright` see `best_match`.
    """
    tol = 1e3 * tolerance
    labels = best_match(expected, dots, upright)
    n = len(expected)
    if labels is None or labels.count < 3 or 2 * labels.count < n:
        seen = 0 if labels is None else labels.count
        finding = Finding("no dots", "no dots of the marker's sizes")
        if len(dots):
            layout = f"{len(dots)} dots of about its sizes, of which {seen} are in its layout of {n}"
            finding = Finding("another marker", f"another marker: found {layout}")
        return Verdict(np.nan, None, (np.nan, np.nan), (finding,), None, NOTHING, expected.take(NOTHING))
    here = expected.take(labels.indices >= 0)
    used = labels.indices[labels.indices >= 0]
    source, matched = here.centers, dots.take(used)
    agreed, scale, is_scaled = _explain(source, matched.centers, labels.mirror, tol)
    trusted = bool(agreed.any())
    agreed = agreed if trusted else np.ones_like(agreed)
    aligned = agreed | is_scaled
    motion = PlaneMotion(*rigid_motion(source[aligned], matched.centers[aligned], labels.mirror))
    off = motion.to_marker(matched.centers) - source
    distance = np.linalg.norm(off, axis=-1)
    worst = int(np.argmax(distance))
    findings = [Finding("mirrored", "mirrored", MIRRORED)] if labels.mirror else []
    factor, bent = 1.0, BENT
    if is_scaled:
        turned, by, moved = scaled_motion(source[agreed], matched.centers[agreed], labels.mirror)
        factor, bent = float(np.sqrt(by[0] * by[1])), BENT + float(np.ptp(by)) / 2
        findings.append(scale_finding(float(by[0]), float(by[1]), np.ptp(source, axis=0) / 2, tol, pixels))
        off = ((matched.centers - moved) @ turned) / by - source
    apart = np.linalg.norm(off, axis=-1)
    diameter = 2 * float(expected.radii.min())
    if not trusted and (apart.max() > STRANGER * diameter or len(here) < n):
        sentence = f"another marker: no motion brings its dots nearer than {short_length(apart.max())} to this one's"
        strange = (Finding("another marker", sentence),)
        return Verdict(distance[worst] / 1e3, here.names[worst], scale, strange, None, NOTHING, expected.take(NOTHING))
    # Dots that keep their size while the distances between them are scaled.
    grown = float(np.median(matched.radii / here.radii))
    if abs(np.log(factor)) > max(0.002, 4 * abs(np.log(grown))):
        times = f"{factor:.4f}".rstrip("0")
        sentence = f"another marker: its dots are as large as this one's, but {times} times as far apart"
        findings.append(Finding("another marker", sentence))
    findings += _off(here.names, off, apart, tol)
    if missing := expected.take(labels.indices < 0).names:
        findings.append(Finding("missing", f"{listed_ids(missing)} missing", AGAIN))
    findings += _features(matched, here, factor, bent, tol, DIAMETER[pixels])
    return Verdict(distance[worst] / 1e3, here.names[worst], scale, tuple(findings), motion, used, here)


def judge_copies(expected: DotSet, dots: DotSet, tolerance: float, **traits: Any) -> list[Verdict]:
    """Verdicts on all copies of the marker among dots, see `judge`; one at least."""
    verdicts: list[Verdict] = []
    left = np.arange(len(dots))
    while len(verdicts) < MOST_COPIES:
        verdict = judge(expected, dots.take(left), tolerance, **traits)
        if not len(verdict.used):
            break
        verdict = replace(verdict, used=left[verdict.used])
        verdicts.append(verdict)
        left = np.setdiff1d(left, verdict.used)
        if 2 * len(left) < len(expected) or len(left) < 3:
            break
    return verdicts or [verdict]


def change_findings(change: Array, expected: DotSet, tolerance: float, pixels: bool) -> list[Finding]:
    """Findings about a change, upper triangular, in the marker frame."""
    half = np.ptp(expected.centers, axis=0) / 2
    x, y = float(change[0, 0]), float(change[1, 1])
    slant = float(change[0, 1] / change[1, 1])
    findings = []
    if abs(slant) * half.max() > tolerance:
        sentence = f"sheared by {abs(np.degrees(np.arctan(slant))):.3g} degrees: its axes are not at right angles"
        findings.append(Finding("sheared", sentence, "undo the skew, or export it again"))
    if max(abs(x - 1), abs(y - 1)) * half.max() > tolerance:
        findings.append(scale_finding(x, y, half, tolerance, pixels))
    return findings


def round_holes(marker: Marker) -> Array:
    """Middles (k, 2) in mm of a marker's round openings."""
    return 1e3 * rings_and_circles(opening.contour for opening in openings(marker))[1][:, :2]


def at_holes(dots: DotSet, motion: PlaneMotion | None, holes: Array) -> Mask:
    """Tell which dots lie at holes (k, 2), mm, of a marker that is placed by a motion."""
    if motion is None or not len(holes):
        return np.zeros(len(dots), dtype=bool)
    places = motion.to_marker(dots.centers)
    return np.asarray(np.linalg.norm(places[:, None] - holes, axis=-1).min(axis=1) <= dots.radii / 2)


def extras(dots: DotSet, used: NDArray[np.intp], motion: PlaneMotion | None, holes: Array) -> list[Finding]:
    """Dots that belong to no copy, by position in the marker frame; dots at `holes` (k, 2), mm, are skipped.

    So are those far from a small marker on a large sheet: at the size of its dots, letters are round.
    """
    left = np.setdiff1d(np.flatnonzero(~at_holes(dots, motion, holes)), used)
    if not len(left) or motion is None:
        return []
    places = motion.to_marker(dots.centers[left])
    inner = motion.to_marker(dots.centers[used])
    middle = inner.mean(axis=0)
    reach = FAR * (np.linalg.norm(inner - middle, axis=-1).max() + 10 * dots.radii[used].max())
    places = places[np.linalg.norm(places - middle, axis=-1) <= reach]
    if not len(places):
        return []
    listed = "; ".join(f"x {x:.6g}, y {y:.6g} mm" for x, y in places[:MOST_LISTED])
    more = f" and {len(places) - MOST_LISTED} more" if len(places) > MOST_LISTED else ""
    count = "an extra dot" if len(places) == 1 else f"{len(places)} extra dots"
    return [Finding("extra", f"{count} at {listed}{more}, marker frame", "remove what is not the marker's")]


def _explain(source: Array, target: Array, mirror: bool, tol: float) -> tuple[Mask, tuple[float, float], bool]:
    """Find the dots that agree with one motion, their scales, and whether the agreement requires scaling."""
    rigid = _consensus(source, target, mirror, tol, False)
    scaled = rigid if rigid.all() else _consensus(source, target, mirror, tol, True)
    is_rigid = rigid.sum() >= 3 and 2 * rigid.sum() > len(source)
    is_scaled = scaled.sum() >= 4 and 2 * scaled.sum() > len(source) and scaled.sum() > rigid.sum()
    if is_rigid and is_scaled and scaled.all():
        # A scale that explains a single dot leaves the others farther off than they are without it.
        off = _away(source, target, rigid, mirror, False)[rigid].max()
        is_scaled = off >= _away(source, target, scaled, mirror, True).max() / 4
    agreed = measured = scaled if is_scaled else rigid
    if not (is_rigid or is_scaled):
        # No consensus: call it scaled if that explains most of the error, and otherwise trust no dot.
        measured = np.ones(len(source), dtype=bool)
        rigid_off, scaled_off = (_away(source, target, measured, mirror, scale).max() for scale in (False, True))
        is_scaled = len(source) >= 4 and scaled_off < rigid_off / 4
        agreed = measured & is_scaled
    x, y = scaled_motion(source[measured], target[measured], mirror)[1].tolist()
    return agreed, (x, y), bool(is_scaled)


def _away(source: Array, target: Array, chosen: Mask, mirror: bool, is_scaled: bool) -> Array:
    """Distances (m,) of dots from where the motion puts them that brings some nearest, with a scale or without."""
    by: Array | float = 1.0
    if is_scaled:
        rotation, by, translation = scaled_motion(source[chosen], target[chosen], mirror)
    else:
        rotation, translation = rigid_motion(source[chosen], target[chosen], mirror)
    return np.nan_to_num(np.linalg.norm(source * by @ rotation.T + translation - target, axis=-1), nan=np.inf)


def _consensus(source: Array, target: Array, mirror: bool, tol: float, is_scaled: bool) -> Mask:
    """The most dots that agree with one motion: all, or those that a pair or triple of them leads to."""
    m, size, rng = len(source), 3 if is_scaled else 2, np.random.default_rng(0)
    if (_away(source, target, np.ones(m, dtype=bool), mirror, is_scaled) <= tol).all():
        return np.ones(m, dtype=bool)
    subsets = (rng.choice(m, size, replace=False) for _ in range(MOST_SUBSETS))
    best = np.zeros(m, dtype=bool)
    for subset in combinations(range(m), size) if m <= 14 else subsets:
        chosen = np.zeros(m, dtype=bool)
        chosen[list(subset)] = True
        # A small subset predicts the other dots less accurately than the full consensus.
        agreed = _away(source, target, chosen, mirror, is_scaled) <= 3 * tol
        if agreed.sum() <= max(best.sum(), size):
            continue
        agreed = _away(source, target, agreed, mirror, is_scaled) <= tol
        if agreed.sum() > best.sum():
            best = agreed
        if best.all():
            break
    return best


def _off(names: Sequence[int], off: Array, apart: Array, tol: float) -> list[Finding]:
    wrong = [k for k in np.argsort(-apart, kind="stable") if apart[k] > tol]
    sentences = [f"dot {names[k]} is {short_length(apart[k])} off {along_axes(*off[k])}" for k in wrong[:MOST_LISTED]]
    if len(wrong) > MOST_LISTED:
        sentences.append(f"{len(wrong) - MOST_LISTED} more dots are off by less")
    return [Finding("shifted", sentence, AGAIN) for sentence in sentences]


def _features(dots: DotSet, expected: DotSet, factor: float, bent: float, tol: float, share: float) -> list[Finding]:
    """Findings about diameters, kinds, shapes, heights, and off-center circles of a dot."""
    names, findings = expected.names, []
    for k in np.flatnonzero(dots.rings != expected.rings)[:MOST_LISTED]:
        is_, not_ = ("a ring", "a dot") if dots.rings[k] else ("a dot", "a ring")
        findings.append(Finding("kind", f"dot {names[k]} is {is_}, not {not_}"))
    for what, have, want in (
        ("a diameter", dots.radii, expected.radii),
        ("an inner diameter", dots.inner, expected.inner),
    ):
        both = (have > 0) & (want > 0)
        wrong = np.flatnonzero(both & (np.abs(have - factor * want) > share * tol / 2))
        together = len(wrong) == len(names) > 1
        for k in wrong[: 1 if together else MOST_LISTED]:
            who = "all dots have" if together else f"dot {names[k]} has"
            span = f"{2 * have.min():.6g} to {2 * have.max():.6g}"
            size = span if together and np.ptp(have) > tol else f"{2 * have[k]:.6g}"
            findings.append(Finding("diameter", f"{who} {what} of {size} mm, not {2 * want[k]:.6g} mm"))
    for k in np.flatnonzero(dots.rough > share * tol / 2 + bent * dots.radii)[:MOST_LISTED]:
        sentence = f"dot {names[k]} is not round: its edge is up to {short_length(dots.rough[k])} off its circle"
        findings.append(Finding("diameter", sentence, ROUND))
    for k in np.flatnonzero(dots.spread > tol)[:MOST_LISTED]:
        findings.append(Finding("twice", f"the circles of dot {names[k]} are {short_length(dots.spread[k])} apart"))
    # In every format with heights they are measured from the marker's plane.
    rise = dots.heights / factor - expected.heights
    wrong = np.flatnonzero(np.abs(rise) > tol)
    together = len(wrong) == len(names) > 1 and bool(np.ptp(rise) <= 2 * tol)
    for k in wrong[: 1 if together else MOST_LISTED]:
        who = "all dots are" if together else f"dot {names[k]} is"
        findings.append(Finding("height", f"{who} {short_length(abs(rise[k]))} too {'high' if rise[k] > 0 else 'low'}"))
    return findings


# --- Tags -------------------------------------------------------------------------------------------------------------

Sample = Callable[[Array], Array]

NAMES = ("top left", "top right", "bottom right", "bottom left")

ABSENT = "is not in its place"

BILEVEL = 0.75
"""Pixels by which a corner may be off in black and white: two edges by half a pixel each are 0.71."""

NEAR_CELL = 0.25
"""Maximum distance at which a corner counts as one of the tag's, as a share of a cell."""


def tag_findings(tag: Tag, page: Page, motion: PlaneMotion, tolerance: float) -> list[Finding]:
    """List the errors of a tag, with a tolerance in mm."""
    measured = page.picture is not None and page.picture.measured
    # A seam between tiles adds corners of its own.
    tiled = page.picture is not None and not page.picture.whole
    errors = [] if measured or tiled else _in_outlines(tag, page.corners, motion, tolerance)
    if page.picture is None or errors:
        return errors
    # In black and white, an edge along the rows of pixels may be off by half of one.
    allowed = max(tolerance, BILEVEL * page.picture.grain) if page.picture.bilevel else tolerance
    errors = _in_pixels(tag, page.picture.sample, motion, allowed if measured else None)
    if not errors or measured or tiled:
        return errors
    remedy = "show all layers, remove what covers it, and print the whole page"
    return [Finding("tag", f"the tag {tag} does not show as it should", remedy)]


def _in_outlines(tag: Tag, corners_seen: Array, motion: PlaneMotion, tolerance: float) -> list[Finding]:
    from scipy.spatial import cKDTree

    cell = float(np.linalg.norm(np.diff(motion.to_page(1e3 * tag.corners[:2]), axis=0))) / tag.cells
    wanted = motion.to_page(1e3 * np.concatenate(tag.outlines))
    if not len(corners_seen):
        return [not_there(tag)]
    tree = cKDTree(corners_seen)
    strange = tree.query(wanted)[0] > NEAR_CELL * cell
    # A corner inside the black square that is not one of the tag's belongs to another tag.
    corners = motion.to_page(1e3 * tag.corners)
    sides = [corners[1] - corners[0], corners[3] - corners[0]]
    place = np.stack([(corners_seen - corners[0]) @ side / (side @ side) for side in sides], axis=-1)
    inside = corners_seen[((place > 0) & (place < 1)).all(axis=-1)]
    more = len(inside) > 0 and bool((cKDTree(wanted).query(inside)[0] > NEAR_CELL * cell).any())
    if strange.any() or more:
        return [not_there(tag)]
    nearest = corners_seen[tree.query(corners)[1]]
    return corners_off(corners, nearest, tolerance)


def _in_pixels(tag: Tag, seen_at: Sample, motion: PlaneMotion, tolerance: float | None) -> list[Finding]:
    def sample(points: Array) -> Array:
        return np.nan_to_num(seen_at(points), nan=255.0)

    cells = tag.cells
    grid = (np.arange(-1, cells + 1) + 0.5) / cells - 0.5
    x, y = np.meshgrid(grid, -grid)
    middles = motion.to_page(1e3 * (tag.side * np.stack([x.ravel(), y.ravel()], axis=-1) + tag.center))
    seen = sample(middles).reshape(x.shape)
    level = (seen.min() + seen.max()) / 2
    ink = np.pad(tag.ink, 1)
    dark = seen < level
    if np.ptp(seen) < 32 or not (np.array_equal(dark, ink) or np.array_equal(~dark, ink)):
        return [not_there(tag)]
    if tolerance is None:
        return []
    corners = motion.to_page(1e3 * tag.corners)
    return corners_off(corners, _edges(corners, sample, cells), tolerance)


def _edges(corners: Array, sample: Sample, cells: int) -> Array:
    """Corners (4, 2) where the fitted edges of the border's ink intersect."""
    lines = []
    for k in range(4):
        start, end = corners[k], corners[(k + 1) % 4]
        along = (end - start) / np.linalg.norm(end - start)
        # They run clockwise.
        outward = np.array([-along[1], along[0]])
        half = 0.5 * float(np.linalg.norm(end - start)) / cells
        steps = (np.arange(200) + 0.5) / 200 * 2 * half - half
        feet = start + np.linspace(0.15, 0.85, 15)[:, None] * (end - start)
        values = sample((feet[:, None] + steps[:, None] * outward).reshape(-1, 2)).reshape(15, 200)
        inner, outer = values[:, :20].mean(axis=1), values[:, -20:].mean(axis=1)
        share = (values.mean(axis=1) - outer) / (inner - outer)
        points = feet + (2 * half * share - half)[:, None] * outward
        middle = points.mean(axis=0)
        direction = np.linalg.svd(points - middle)[2][0]
        lines.append((middle, direction))
    # Where each edge meets the previous one.
    crossings = []
    for (a, u), (b, v) in zip([lines[-1], *lines], lines, strict=False):
        step = np.linalg.solve(np.stack([u, -v], axis=-1), b - a)
        crossings.append(a + step[0] * u)
    return np.array(crossings)


def corners_off(wanted: Array, corners: Array, tolerance: float) -> list[Finding]:
    """Findings about corners (4, 2) of a tag in mm that are elsewhere."""
    off = np.linalg.norm(corners - wanted, axis=-1)
    return [
        Finding("tag", f"the {NAMES[k]} corner of the tag is {1e3 * off[k]:.4g} um off")
        for k in np.flatnonzero(off > tolerance)
    ]


def not_there(tag: Tag) -> Finding:
    """Finding about a tag of which another or nothing is in its place."""
    return Finding("tag", f"the tag {tag} {ABSENT}")
