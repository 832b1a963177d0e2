"""Compare the lines of a file, outline and holes, with those that a marker should have; mm, marker frame."""

# tests: tests/verification/test_flat.py

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.geometry.contour import Contour, area, backward, box, fitted_sphere, flattened, placed
from markergen.model.marker import Marker
from markergen.model.openings import Opening, openings
from markergen.model.substrate import Hole
from markergen.solid.plate import plate_of
from markergen.verification.rays import counted
from markergen.verification.result import MOST_LISTED, Finding, short_length

Seek = Callable[[Array, Array], Array]
"""Places (m, 2) of the file's lines nearest to points (m, 2) of a wanted line with normals (m, 2); nan for none."""

EXACT = 5e-4
"""Maximum distance in mm of sampled points from the wanted line."""

NEAREST, FARTHEST = 1.5, 6.0
"""Range in mm of the distance beyond which a line is missing rather than misplaced: half the radius of a hole."""

SPACING, MOST_SAMPLES = 0.25, 2000
"""Distance in mm of points along a wanted line, which shows gaps of as much, and their maximum number."""

STEP, CANDIDATES = 0.5, 6
"""Distance in mm of points along a file's lines by which near lines are found, and how many near points are tried."""

GAP = 0.02
"""Share of a line that may be missing without a word: ends of its pieces."""

CLAIMED = 1.0
"""Distance in mm from what is wanted up to which lines to cut or to engrave are its own: more than what is allowed."""

DRAW_AGAIN = "export it again, or correct the line in the drawing"


@dataclass(frozen=True)
class CutLine:
    """A closed line that a marker should have; mm, marker frame.

    Attributes
    ----------
    name : str
        Such as ``the outline`` or ``the hole M3 at x 40, y 0 mm``.
    """

    name: str
    contour: Contour
    hole: bool = False


def sheet_lines(marker: Marker) -> list[CutLine]:
    """Lines to cut out of a printed sheet: the boundary and all holes."""
    outer = [placed(contour, 1e3, digits=9) for contour in marker.boundary.contours() if area(contour) > 0]
    return [*_outlines(outer), *map(_line_of, openings(marker))]


def plate_lines(marker: Marker) -> list[CutLine]:
    """Lines to cut for a plate: its outline, which is larger than a boundary with an edge, and all holes.

    Raises InputError if the plate cannot be made.
    """
    contours = [contour for outline in plate_of(marker).outlines for contour in outline]
    holes = [_line_of(opening) for opening in openings(marker) if opening.hole]
    for inner in (contour for contour in contours if area(contour) < 0):
        holes.append(CutLine(str(Opening(placed(backward(inner), 1e-3))), inner, hole=True))
    return [*_outlines([contour for contour in contours if area(contour) > 0]), *holes]


def hole_name(hole: Hole) -> str:
    """Name of a hole in findings."""
    return f"the hole {hole.name}".rstrip() + f" at x {1e3 * hole.x:.6g}, y {1e3 * hole.y:.6g} mm"


def _line_of(opening: Opening) -> CutLine:
    name = hole_name(opening.hole) if opening.hole else str(opening)
    return CutLine(name, placed(opening.contour, 1e3, digits=9), hole=True)


def _outlines(contours: Sequence[Contour]) -> list[CutLine]:
    if len(contours) == 1:
        return [CutLine("the outline", contours[0])]
    lines = []
    for contour in contours:
        left, bottom, right, top = box(contour)
        place = f"x {_short((left + right) / 2)}, y {_short((bottom + top) / 2)} mm"
        lines.append(CutLine(f"the outline around {place}", contour))
    return lines


def _short(value: float) -> str:
    return f"{round(value, 3) + 0.0:.6g}"


def pieces_of(contours: Sequence[Contour]) -> Array:
    """Straight pieces (k, 2, 2) of closed contours, within `EXACT` of them."""
    rings = [np.array(flattened(contour, EXACT)) for contour in contours]
    pieces = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings if len(ring)]
    return np.concatenate(pieces) if pieces else np.zeros((0, 2, 2))


def seek_among(segments: Array) -> Seek:
    """Seek among straight pieces (k, 2, 2), by near points along them.

    A search by shapely takes twice as long as all else for what is missing in a solid.
    """
    from scipy.spatial import cKDTree

    segments = segments[np.isfinite(segments).all(axis=(1, 2))]
    if not len(segments):
        return lambda points, normals: np.full_like(points, np.nan)  # noqa: ARG005
    places, of = _along(segments, STEP)
    tree, count = cKDTree(places), min(CANDIDATES, len(of))

    def seek(points: Array, normals: Array) -> Array:
        del normals
        candidates = of[tree.query(points, k=count)[1].reshape(len(points), count)]
        start, way = segments[candidates, 0], segments[candidates, 1] - segments[candidates, 0]
        square = np.maximum(np.sum(way**2, axis=-1), np.finfo(float).tiny)
        place = np.clip(np.sum((points[:, None] - start) * way, axis=-1) / square, 0.0, 1.0)
        feet = start + place[..., None] * way
        best = np.argmin(np.linalg.norm(feet - points[:, None], axis=-1), axis=1)
        return np.asarray(feet[np.arange(len(points)), best])

    return seek


def in_picture(sample: Callable[[Array], Array], grain: float) -> Seek:
    """Seek thin lines of ink across the wanted one in a picture: points (k, 2) to grey levels, `grain` mm a pixel."""
    steps = np.arange(-NEAREST, NEAREST + grain / 4, grain / 2)

    def seek(points: Array, normals: Array) -> Array:
        seen = sample((points[:, None] + steps[:, None] * normals[:, None]).reshape(-1, 2)).reshape(len(points), -1)
        seen = np.where(np.isfinite(seen).any(axis=1, keepdims=True), seen, 0.0)
        ink = np.abs(np.nan_to_num(np.nanmedian(seen, axis=1, keepdims=True) - seen))
        strength = ink.max(axis=1)
        # The nearest line, as there may be others beside it, and of its pixels the darkest.
        nearest = np.argmin(np.where(ink >= strength[:, None] / 2, np.abs(steps), np.inf), axis=1)
        peak = np.argmax(np.where(np.abs(steps - steps[nearest, None]) <= 2 * grain, ink, -1.0), axis=1)
        # The centroid of the peak alone: ticks and digits may be near.
        ink[np.abs(steps - steps[peak, None]) > 2 * grain] = 0.0
        off = ink @ steps / np.maximum(ink.sum(axis=1), 1e-9)
        return np.where((strength > FAINT)[:, None], points + off[:, None] * normals, np.nan)

    return seek


FAINT = 24.0
"""Minimum difference of grey levels between a line and its surroundings."""


def line_findings(
    wanted: Sequence[CutLine],
    seek: Seek,
    tolerance: float,
    free: Callable[[Array], Mask] | None = None,
    outliers: float = 0.0,
) -> list[Finding]:
    """Lines that are missing, misplaced by more than a tolerance in mm, of another size, or polygons for circles.

    `free` tells at which points (m, 2) outlines have gaps by design: in the quiet zones of a printed sheet. A share
    `outliers` of each line may be off without a word.
    """
    findings = []
    for line in wanted:
        # A hole's line has no gaps; in pixels, other lines beside it would be taken for it.
        sentences = _compared(line, seek, tolerance, free if outliers or not line.hole else None, outliers)
        findings += [
            Finding("hole" if line.hole else "outline", f"{line.name} {sentence}", DRAW_AGAIN) for sentence in sentences
        ]
    if len(findings) > MOST_LISTED:
        rest = len(findings) - MOST_LISTED
        findings = [*findings[:MOST_LISTED], Finding("outline", f"{rest} more lines are wrong", DRAW_AGAIN)]
    return findings


def _compared(
    line: CutLine, seek: Seek, tolerance: float, free: Callable[[Array], Mask] | None, outliers: float
) -> list[str]:
    points, normals = sampled(line.contour)
    if free is not None:
        kept = ~free(points)
        points, normals = points[kept], normals[kept]
    if not len(points):
        return []
    left, bottom, right, top = box(line.contour)
    reach = float(np.clip(min(right - left, top - bottom) / 4, NEAREST, FARTHEST))
    feet = seek(points, normals)
    away = np.nan_to_num(np.linalg.norm(feet - points, axis=1), nan=np.inf)
    there = away <= reach
    if there.mean() < 0.5:
        # A drawing without any line there, or with one that has nothing to do with this.
        return ["is missing"]
    sentences = []
    if (~there).mean() > GAP + outliers:
        sentences.append(_nothing_at(points[~there][np.argmax(away[~there])]))
    there &= away <= np.quantile(away[there], 1 - outliers)
    points, feet, away = points[there], feet[there], away[there]
    if away.max() <= tolerance:
        return sentences
    if not (whole := line.contour.as_circle):
        return [*sentences, *_of_shape(line.contour, points, feet, away)]
    # What is on the circle, but away from some of its points, ends beside them.
    return [*sentences, *(_of_circle(whole, feet, tolerance) or [_nothing_at(points[np.argmax(away)])])]


def _nothing_at(place: Array) -> str:
    return f"is not complete: nothing at x {_short(place[0])}, y {_short(place[1])} mm"


def _of_circle(whole: tuple[float, float, float], feet: Array, tolerance: float) -> list[str]:
    x, y, radius = whole
    offset = feet - [x, y]
    (a, b), fitted = fitted_sphere(offset)
    apart = float(np.hypot(a, b))
    rough = float(np.abs(np.hypot(*(offset - [a, b]).T) - fitted).max())
    if rough > tolerance:
        worst = float(np.abs(np.hypot(*offset.T) - radius).max())
        return [f"is not round: its sides are up to {short_length(worst)} off the circle of {2 * radius:.6g} mm"]
    sentences = []
    if apart > tolerance:
        sentences.append(f"is {short_length(apart)} off (x {round(a, 6) + 0.0:+.4g} mm, y {round(b, 6) + 0.0:+.4g} mm)")
    if abs(fitted - radius) > tolerance:
        sentences.append(f"has a diameter of {2 * fitted:.6g} mm, not {2 * radius:.6g} mm")
    return sentences


def _of_shape(contour: Contour, points: Array, feet: Array, away: Array) -> list[str]:
    left, bottom, right, top = box(contour)
    (x0, y0), (x1, y1) = feet.min(axis=0), feet.max(axis=0)
    worst = int(np.argmax(away))
    place = f"at x {_short(points[worst, 0])}, y {_short(points[worst, 1])} mm"
    width, height = right - left, top - bottom
    size = ""
    if abs(x1 - x0 - width) > away[worst] / 2 or abs(y1 - y0 - height) > away[worst] / 2:
        size = f": it is {x1 - x0:.5g} x {y1 - y0:.5g} mm, not {width:.6g} x {height:.6g} mm"
    return [f"is up to {short_length(float(away[worst]))} off, {place}{size}"]


def _along(segments: Array, spacing: float) -> tuple[Array, Indices]:
    """Points (m, 2) along straight pieces (k, 2, 2), their ends among them, and the index of the piece of each."""
    way = segments[:, 1] - segments[:, 0]
    count = np.clip(np.ceil(np.linalg.norm(way, axis=1) / spacing), 1, MOST_SAMPLES).astype(int) + 1
    of, number = counted(count)
    return segments[of, 0] + (number / (count - 1)[of])[:, None] * way[of], of


def strays(segments: Array, wanted: Array, misplaced: bool = False) -> Mask:
    """Tell which straight pieces (m, 2, 2) of lines leave all wanted ones (k, 2, 2), which may be misplaced."""
    points, of = _along(segments, CLAIMED)
    away = np.linalg.norm(seek_among(wanted)(points, points) - points, axis=1)
    return np.bincount(of[~(away < (FARTHEST if misplaced else CLAIMED))], minlength=len(segments)) > 0


def sampled(contour: Contour) -> tuple[Array, Array]:
    """Points (m, 2) along a closed contour, its corners among them, and unit normals (m, 2)."""
    ring = np.array(flattened(contour, EXACT))
    way = np.roll(ring, -1, axis=0) - ring
    length = np.linalg.norm(way, axis=1)
    spacing = max(min(SPACING, length.sum() / 100), length.sum() / MOST_SAMPLES)
    normal = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(length, 1e-12)[:, None]
    # Ends of the chords of an arc are on it; these are shorter than the spacing.
    count = np.maximum(np.ceil(length / spacing), 1).astype(int)
    of, number = (values[:: len(ring) // MOST_SAMPLES + 1] for values in counted(count))
    return ring[of] + (number / count[of])[:, None] * way[of], normal[of]
