"""Measurements for checking a print: rulers, where a sheet has room for them, and pairs of distant dots."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from shlex import quote

import numpy as np

from markergen.drawing.annotations import (
    Column,
    Drawn,
    axis_arrows,
    facts,
    paragraph,
    title_block,
)
from markergen.drawing.figure import Figure, quiet_radius
from markergen.drawing.paper import MARKER_FILE, Frame
from markergen.drawing.scene import (
    FINE,
    Box,
    Disk,
    Line,
    Point,
    Shape,
    bounds,
    ink_points,
    moved,
    rotated,
)
from markergen.drawing.text import text, written
from markergen.model.marker import ControlPoint, Marker
from markergen.model.planned_error import planned_error_of
from markergen.model.rescale import RULERS_MM

BAND = 3.8
"""Width of a ruler with numbers beside its ticks, mm on A4."""

AIR = 0.8
"""Gap between a ruler and its neighbors, mm on A4."""

LONG, SHORT, DIGITS = 3.2, 1.8, 1.5
"""Heights of ticks and numbers, mm on A4."""

Span = tuple[float, float]

LEAST = 10.0
"""Minimum length worth measuring, mm."""

PROVING = 100
"""Length of a ruler in mm from which it proves the scale by itself."""

READING = 0.3
"""Error in mm of a length read on paper, at both of its ends together."""

SHOWN = (0.993, 0.9955)
"""Measured shares of the rulers' lengths along x and y in the example command."""


def ruler(
    start: Point, length: int, axis: int, scale: float, factor: float = 1.0, inward: int = 1, name: str = "ruler"
) -> Drawn:
    """Ruler from `start` along x (axis 0) or y (1), with a tick every 10 mm and a number every 50 (20 on short ones).

    Parameters
    ----------
    start : (x, y)
    length : int
        Nominal length, mm; drawn `factor` times as long.
    scale : float
        Scale of ticks and numbers.
    inward : int
        Side of the base line with the ticks: 1 up or right, -1 down or left.
    """

    def at(along: float, aside: float) -> Point:
        along, aside = along * factor, aside * inward * scale
        return (start[0] + along, start[1] + aside) if axis == 0 else (start[0] + aside, start[1] + along)

    marks: list[Shape] = [Line((at(0, 0), at(length, 0)), FINE, name)]
    texts: list[Shape] = []
    step, height = (50 if length >= 50 else length), DIGITS * scale
    for mm in range(0, length + 1, 10):
        marks.append(Line((at(mm, 0), at(mm, LONG if mm % step == 0 else SHORT)), FINE, f"{name}-{mm}"))
        if mm == 0 or mm % step:
            continue
        # In front of its tick and above the short ones, which keeps the ruler narrow.
        number = f"{mm} mm" if mm == length else str(mm)
        low = (SHORT + 0.4) * scale
        offset = low if inward > 0 else -low - height
        x, y = start[0] + (mm * factor if axis == 0 else 0), start[1] + (mm * factor if axis == 1 else 0)
        if axis == 0:
            texts.append(text(number, x - 0.7 * scale, y + offset, height, "right", name=f"{name}-number-{mm}"))
        else:
            upright = text(number, x - 0.7 * scale, y, height, "right", name=f"{name}-number-{mm}")
            texts.append(moved(rotated(upright, x, y), offset + height, 0.0))
    return marks, texts


def place_ruler(
    strips: Sequence[tuple[Box, int]],
    axis: int,
    scale: float,
    factor: float,
    disks: Iterable[Disk],
    shapes: Iterable[Shape],
    name: str,
) -> tuple[int, Drawn]:
    """Find the longest ruler of `RULERS_MM` that fits in a strip of a page, and its length; 0 if none fits.

    Parameters
    ----------
    strips : sequence of (box, inward)
        Candidate strips in order of preference, each `BAND * scale` wide, from the base line inward (1 up or right).
    axis : int
        0 along x, 1 along y.
    scale, factor : float
        See `ruler`.
    disks : iterable of Disk
        Dots, whose quiet zones the ruler avoids.
    shapes : iterable of Shape
        Other shapes that it must not touch.
    """
    dots, others = list(disks), list(shapes)
    free = [(strip, inward, _free_spans(strip, axis, dots, others, AIR * scale)) for strip, inward in strips]
    for length in RULERS_MM:
        for strip, inward, spans in free:
            for low, high in spans:
                if high - low >= length * factor + FINE:
                    base = strip[1 - axis] if inward > 0 else strip[3 - axis]
                    begin = low + FINE / 2
                    start = (begin, base) if axis == 0 else (base, begin)
                    return length, ruler(start, length, axis, scale, factor, inward, name)
    return 0, ([], [])


def _free_spans(strip: Box, axis: int, disks: Sequence[Disk], shapes: Sequence[Shape], air: float) -> list[Span]:
    """Unobstructed spans along a strip."""
    low, high = strip[1 - axis], strip[3 - axis]
    blocked: list[Span] = []
    for disk in disks:
        along, aside = (disk.x, disk.y) if axis == 0 else (disk.y, disk.x)
        gap, reach = max(low - aside, aside - high, 0.0), quiet_radius(disk)
        if gap < reach:
            half = sqrt(reach**2 - gap**2)
            blocked.append((along - half, along + half))
    for shape in shapes:
        if isinstance(shape, Line) and len(shape.points) > 2:
            points = ink_points([shape])
            places = points[(points[:, 1 - axis] > low - air) & (points[:, 1 - axis] < high + air), axis]
            blocked += [(float(place) - 1 - air, float(place) + 1 + air) for place in places]
        else:
            box = bounds(shape)
            if box[1 - axis] < high + air and box[3 - axis] > low - air:
                blocked.append((box[axis] - air, box[axis + 2] + air))
    spans, place = [], strip[axis]
    for begin, end in [*sorted(blocked), (strip[axis + 2], strip[axis + 2])]:
        if begin > place:
            spans.append((place, min(begin, strip[axis + 2])))
        place = max(place, end)
    return spans


def draw_remedy(frame: Frame, lengths: tuple[float, float], record: str, top: float, height: float) -> list[Shape]:
    """Sentence and command, below `top` and smaller where they do not fit, for lengths in mm that measure otherwise."""
    lines = (
        "If a length is off: print again at 100 % (actual size, not fitted to the page). Or keep the print, measure "
        "both lengths and run, for instance:",
        rescale_command(record, lengths),
    )
    texts: list[Shape] = []
    for index, line in enumerate(lines):
        texts += paragraph(line, frame.margin, top - 1.94 * height * index, frame.width, height, 1, f"remedy-{index}")
    return texts


def rescale_command(record: str, lengths: tuple[float, float] | None = None) -> str:
    """Command for lengths in mm, or for a table of the dots, with a file's name if the sheet has letters for it."""
    options = "" if lengths else " --measured-points dots.csv"
    for name, length, share in zip("xy", lengths or (0.0, 0.0), SHOWN, strict=True):
        if length:
            options += f" --measured-{name} {length * share:.1f}mm --nominal-{name} {length:.4g}mm"
    return f"markergen rescale {quote(record) if written(record) == record else MARKER_FILE}{options} -o printed.json"


@dataclass(frozen=True)
class Pair:
    """Two dots to measure between, mm: center to center, and over the outer edges, where calipers can be applied."""

    first: int
    second: int
    between: float
    over: float

    def __str__(self) -> str:
        return f"dots {self.first} and {self.second}: {self.between:.1f} mm ({self.over:.1f} mm over the outer edges)"


def far_pair(points: Sequence[ControlPoint], axis: int, seam: float | None = None) -> Pair | None:
    """Pair that lies farthest apart along x (axis 0) or y (1), and farther along it than across; None if there is none.

    With a seam, a coordinate on that axis in m, the two dots lie on opposite sides of it.
    """
    if len(points) < 2:
        return None
    xy = np.array([[point.x, point.y] for point in points])
    away = np.abs(xy[:, None] - xy)
    along, across = away[..., axis], away[..., 1 - axis]
    # An oblique pair says less about one axis. Rounded, so that ties are resolved by the dots' numbers.
    score = np.where((along >= across) & (along * 1e3 >= LEAST), np.round(along - 0.5 * across, 9), -np.inf)
    if seam is not None:
        side = xy[:, axis] > seam
        score[side[:, None] == side] = -np.inf
    i, j = divmod(int(np.argmax(score)), len(points))
    if not np.isfinite(score[i, j]):
        return None
    first, second = points[i], points[j]
    between = 1e3 * hypot(first.x - second.x, first.y - second.y)
    over = between + 500 * (first.feature.diameter + second.feature.diameter)
    return Pair(first.id, second.id, between, over)


def measured_columns(marker: Marker, rulers: tuple[int, int], where: str = "") -> list[Column]:
    """Facts for checking a sheet: a pair of dots along each axis, and the rulers."""
    facts: list[Column] = []
    for axis, name in enumerate("xy"):
        pair = far_pair(marker.control_points, axis)
        if pair:
            heading = f"along {name}: dots {pair.first} and {pair.second}{where}"
            lines = (f"{pair.between:.1f} mm between centers", f"{pair.over:.1f} mm over outer edges")
            facts.append((name, heading, lines, "regular"))
    if plan := planned_error_of(marker.provenance):
        heading = ", ".join(filter(None, ("error to plan with", plan.assumed)))
        facts.append(("plan", heading, (plan.amounts, plan.reach), "regular"))
    proof = "; ".join(short_rulers(marker, rulers).values()) or "to be true to 0.1 mm"
    return [*facts, ("rulers", "rulers", (ruler_words(rulers), proof), "regular")]


def short_rulers(marker: Marker, rulers: tuple[int, int]) -> dict[str, str]:
    """What rulers too short to prove the scale are worth, by axis, and the longest distance between dots instead."""
    proofs = {}
    for axis, (name, length) in enumerate(zip("xy", rulers, strict=True)):
        pair = far_pair(marker.control_points, axis)
        if length < PROVING and pair and pair.between > length:
            proves = f"{name} proves its scale to {100 * READING / length:.2g} %" if length else f"none along {name}"
            proofs[name] = f"{proves}: measure dots {pair.first} and {pair.second}"
    return proofs


def _along(marker: Marker, axis: int) -> Pair | None:
    """Pair as of `far_pair` whose distance is along the axis, to 0.5 %."""
    pair = far_pair(marker.control_points, axis)
    if pair is None:
        return None
    ids = [point.id for point in marker.control_points]
    first, second = (marker.xyz[ids.index(dot), axis] for dot in (pair.first, pair.second))
    return pair if abs(first - second) * 1e3 > 0.995 * pair.between else None


def ruler_words(rulers: tuple[int, int]) -> str:
    """Ruler lengths in words, such as ``x 200 mm, y 150 mm``."""
    return ", ".join(f"{name} {length} mm" for name, length in zip("xy", rulers, strict=True) if length) or "none"


def draw_footer(
    frame: Frame,
    figures: Sequence[Figure],
    taken: Mapping[str, Sequence[Shape]],
    page: tuple[int, int],
    where: str = "",
) -> tuple[dict[str, tuple[Shape, ...]], tuple[int, int]]:
    """Draw everything below and beside the markers; also return the lengths of the rulers.

    Parameters
    ----------
    figures : sequence of Figure
        Those on the page, drawn at one scale.
    taken : mapping of str to shapes
        Layers of what is on the page already.
    page : (number, total)
    where : str
        Words that say which of the markers the lengths to measure are in.
    """
    scale, left, base = frame.scale, frame.margin, frame.ruler_y
    markers, factor = [figure.marker for figure in figures], figures[0].factor
    axes_marks, axes_text = axis_arrows(frame)
    room = frame.width - 24 * scale
    x_length = next((length for length in RULERS_MM if length * factor[0] <= room), RULERS_MM[-1])
    x_marks, x_text = ruler((left, base), x_length, 0, scale, factor[0])
    band = BAND * scale
    others = [shape for name, shapes in taken.items() if name != "dots" for shape in shapes]
    dots = [shape for shape in taken["dots"] if isinstance(shape, Disk)]
    y_length, (y_marks, y_text) = place_ruler(
        [
            ((left, base - FINE / 2, left + band, frame.top), 1),
            ((frame.right - band, frame.footer, frame.right, frame.top), -1),
        ],
        1,
        scale,
        factor[1],
        dots,
        others,
        "ruler-y",
    )
    lengths = (x_length, y_length)
    straight = [
        pair.between if name in short_rulers(markers[0], lengths) and (pair := _along(markers[0], axis)) else length
        for axis, (name, length) in enumerate(zip("xy", lengths, strict=True))
    ]
    measured, top = (straight[0], straight[1]), frame.block_top + 7.6 * scale
    remedy = draw_remedy(frame, measured, figures[0].record, top, 1.6 * scale)
    lines = facts(frame, measured_columns(markers[0], lengths, where), frame.checks_y, "check")
    block_marks, block_text = title_block(frame, markers, factor, page)
    layers: dict[str, tuple[Shape, ...]] = {
        "marks": (*x_marks, *y_marks, *axes_marks, *block_marks),
        "text": (*x_text, *y_text, *axes_text, *lines, *remedy, *block_text),
    }
    return layers, lengths
