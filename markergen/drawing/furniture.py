"""What stands around the dots on a sheet: ruler, axes, boundary, center cross and title block."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, hypot, pi, sqrt

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.drawing.numbers import quiet_radius
from markergen.drawing.paper import Paper
from markergen.drawing.scene import BLACK, WHITE, Box, Disk, Line, Outline, Point, Shape, marker_name
from markergen.drawing.text import text, text_width, wrap
from markergen.model.boundary import Boundary, Circle
from markergen.model.marker import Marker
from markergen.model.outlines import walked

Array = NDArray[np.float64]
Drawn = tuple[list[Shape], list[Shape]]
"""Marks and texts."""

GRAY, LIGHT = "#5a5a5a", "#9a9a9a"
HAIRLINE, FINE = 0.15, 0.25
"""Widths in mm that a 600 dpi printer still draws whole."""

TICK = 4.0
"""Length of an axis tick in mm on A4."""

CENTROID_PULL = 2e-3
"""How far in mm the center cross may move the center of gravity of a dot it does not sit in the middle of."""

SHORTEST_ARM = 0.5
"""Of the center cross, mm; a shorter one would be taken for a speck."""


HEADINGS = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}
"""The axes' four directions."""

AIR = 1.0
"""Between an outline and a tick or the center cross, mm."""


@dataclass(frozen=True)
class Frame:
    """Measures of the page's furniture in mm: they grow with the paper, but less than it does."""

    paper: Paper

    @property
    def scale(self) -> float:
        """Size of text and gaps relative to those on A4."""
        return min(max(sqrt(min(self.paper.width, self.paper.height) / 210), 0.84), 2.0)

    @property
    def margin(self) -> float:
        """White edge that everything but quiet zones keeps; at least 10 mm, more than printers cannot reach."""
        return 12 * self.scale

    @property
    def right(self) -> float:
        """Right margin's x."""
        return self.paper.width - self.margin

    @property
    def width(self) -> float:
        """Between the margins."""
        return self.paper.width - 2 * self.margin

    @property
    def block_top(self) -> float:
        """Height of the hairline over the title block."""
        return self.margin + 9 * self.scale

    @property
    def ruler_y(self) -> float:
        """Height of the ruler's base line."""
        return self.block_top + 11.5 * self.scale

    @property
    def footer(self) -> float:
        """Height above which the marker's region begins."""
        return self.ruler_y + 15 * self.scale

    @property
    def region(self) -> Box:
        """Part of the page for the marker and what belongs to it."""
        return self.margin, self.footer, self.right, self.paper.height - self.margin


def boundary_lines(marker: Marker, origin: Point, dots: tuple[Disk, ...]) -> list[Shape]:
    """Hairlines along the boundary and along the keep-outs in it, interrupted where they would cross a quiet zone."""
    lines = _outline_lines(marker.boundary, "boundary", origin, dots)
    for index, keep_out in enumerate(marker.keep_outs):
        lines += _outline_lines(keep_out, f"keep-out-{index}", origin, dots, marker.boundary)
    return lines


def _outline_lines(
    shape: Boundary, name: str, origin: Point, dots: tuple[Disk, ...], within: Boundary | None = None
) -> list[Shape]:
    rings, circles = shape.curves()
    paths = [walked(ring * 1e3, 1.0) for ring in rings]
    for x, y, radius, _ in circles:
        count = max(ceil(2 * pi * radius * 1e3), 360)
        paths.append((Circle(radius, (x, y)).rim(count) * 1e3, np.ones(count, dtype=bool)))
    runs: list[Array] = []
    for points, corner in paths:
        rim = points + origin
        step = float(np.max(np.hypot(*(np.roll(rim, -1, axis=0) - rim).T)))
        # A segment between two points that are half a step clear of a circle cannot cross it.
        free = _clear(rim, dots, step / 2 + HAIRLINE)
        if within is not None:
            free &= within.depth(points / 1e3) > 0
        runs += _runs(rim, free, corner)
    return [_polyline(run, f"{name}-{index}") for index, run in enumerate(runs)]


def _runs(rim: Array, free: NDArray[np.bool_], corner: NDArray[np.bool_]) -> list[Array]:
    """Parts of a closed line whose points are free, of each the ends and the corners between them."""
    if free.all():
        corners = rim[corner]
        return [np.concatenate([corners, corners[:1]])]
    start = int(np.argmin(free))
    rim, free, corner = np.roll(rim, -start, axis=0), np.roll(free, -start), np.roll(corner, -start)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    runs = []
    for begin, end in edges.reshape(-1, 2):
        kept = corner[begin:end].copy()
        kept[[0, -1]] = True
        if end - begin > 1:
            runs.append(rim[begin:end][kept])
    return runs


def axis_reach(boundary: Boundary) -> dict[str, float]:
    """How far from the origin in mm the outline reaches along each axis: where ticks may begin.

    What counts is the outline within `AIR` of the axis; where there is none on that side, all of it.
    """
    reach = {}
    for name, heading in HEADINGS.items():
        along, aside = (
            [np.asarray(ring @ np.array(axis) * 1e3) for ring in boundary.outlines()]
            for axis in (heading, heading[::-1])
        )
        near = max(_farthest(a, b) for a, b in zip(along, aside, strict=True))
        reach[name] = near if near > 0 else max(float(a.max()) for a in along)
    return reach


def _farthest(along: Array, aside: Array) -> float:
    """Largest `along` of a closed polygon in the strip where `aside` is at most `AIR`; -inf if it misses the strip."""
    start, step = aside, np.roll(aside, -1) - aside
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = np.sort(np.stack([(-AIR - start) / step, (AIR - start) / step]), axis=0)
    level = step == 0
    low = np.where(level, 0.0, np.maximum(crossings[0], 0.0))
    high = np.where(level, 1.0, np.minimum(crossings[1], 1.0))
    hits = (low <= high) & ~(level & (np.abs(start) > AIR))
    ends = along + np.stack([low, high]) * (np.roll(along, -1) - along)
    return float(np.max(ends[:, hits], initial=-np.inf))


def axis_ticks(
    frame: Frame, origin: Point, reach: Mapping[str, float], dots: tuple[Disk, ...], boxes: Sequence[Box] = ()
) -> list[Line]:
    """Short lines where the axes leave the boundary, or farther out where a quiet zone or a box is in the way.

    A tick that would leave the marker's part of the page, or whose axis has the whole boundary behind it, is left out.
    `reach` is what `axis_reach` tells.
    """
    length = TICK * frame.scale
    centers = np.array([[dot.x, dot.y] for dot in dots]) - origin
    blocked = np.array([quiet_radius(dot) + FINE for dot in dots])
    ticks = []
    for name, heading in HEADINGS.items():
        along, across = centers @ heading, centers @ heading[::-1]
        half = np.sqrt(np.maximum(blocked**2 - across**2, 0))
        zones = list(zip(along - half, along + half, strict=True))
        zones += [_shadow(box, origin, heading, 2 * frame.scale) for box in boxes]
        start = reach[name]
        # Sorted by where they begin, so one pass over the zones jumps over all that the tick would touch.
        for near, far in sorted(zones):
            if near < far and near < start + length and far > start:
                start = float(far)
        foot, tip = (
            (origin[0] + reach * heading[0], origin[1] + reach * heading[1]) for reach in (start, start + length)
        )
        left, bottom, right, top = frame.region
        if start > 0 and left <= tip[0] <= right and bottom <= tip[1] <= top:
            ticks.append(Line((foot, tip), FINE, f"axis{name}"))
    return ticks


def _shadow(box: Box, origin: Point, heading: tuple[int, int], air: float) -> tuple[float, float]:
    """Where the ray from the origin enters and leaves a box with some air around it; (0, 0) if it misses."""
    low, high = np.array(box[:2]) - origin - air, np.array(box[2:]) - origin + air
    side = 1 - int(np.argmax(np.abs(heading)))
    if not low[side] < 0 < high[side]:
        return 0.0, 0.0
    ends = sorted((float(low @ heading), float(high @ heading)))
    return ends[0], ends[1]


def center_cross(frame: Frame, origin: Point, dots: tuple[Disk, ...], room: float) -> list[Shape]:
    """Fine cross at the origin: black on paper, white on a dot, none where it would disturb a dot.

    A cross on a dot but e mm off its middle moves the dot's center of gravity by area(cross) e / area(dot); there its
    arms are shortened until that is below `CENTROID_PULL`. Too short to see, or beside a dot in its quiet zone, it is
    left out: the axis ticks still give the center. So it is where an outline is near, which is `room` mm away.
    """
    arm, width, color = min(3.0 * frame.scale, room - AIR), HAIRLINE, BLACK
    for dot in dots:
        offset = hypot(dot.x - origin[0], dot.y - origin[1])
        if offset >= quiet_radius(dot) + arm:
            continue
        width, in_hole = 0.1, offset < dot.inner_radius
        color = BLACK if in_hole else WHITE
        if in_hole:
            inside = dot.inner_radius - offset
        else:
            inside = min(dot.radius - offset, offset - dot.inner_radius if dot.inner_radius else dot.radius)
        arm = min(arm, inside / 2)
        if offset:
            ink = pi * (dot.radius**2 - dot.inner_radius**2)
            arm = min(arm, CENTROID_PULL * ink / (4 * width * offset))
    if arm < SHORTEST_ARM:
        return []
    x, y = origin
    return [
        Line(((x - arm, y), (x + arm, y)), width, "center-x", color),
        Line(((x, y - arm), (x, y + arm)), width, "center-y", color),
    ]


def ink_points(shapes: list[Shape]) -> Array:
    """Points (m, 2) at most 1 mm apart along lines."""
    pieces = [
        np.linspace(start, end, ceil(hypot(end[0] - start[0], end[1] - start[1])) + 1)
        for shape in shapes
        if isinstance(shape, Line)
        for start, end in zip(shape.points, shape.points[1:], strict=False)
    ]
    return np.concatenate(pieces) if pieces else np.zeros((0, 2))


def ruler_length(frame: Frame) -> float:
    """Longest multiple of 50 mm, at most 200, that leaves room for the axes beside it."""
    return float(min(200, (frame.width - 24 * frame.scale) // 50 * 50))


def ruler(frame: Frame, length: float) -> Drawn:
    """Ruler with a tick every 10 mm and a number every 50, and the words to check it by."""
    scale, left, base = frame.scale, frame.margin, frame.ruler_y
    marks: list[Shape] = [Line(((left, base), (left + length, base)), FINE, "ruler")]
    texts: list[Shape] = []
    for mm in range(0, int(length) + 1, 10):
        high = (3.2 if mm % 50 == 0 else 1.8) * scale
        marks.append(Line(((left + mm, base), (left + mm, base + high)), FINE, f"ruler-{mm}"))
        if mm % 50 == 0:
            align = {0: "left", int(length): "right"}.get(mm, "center")
            label = f"{mm} mm" if mm == length else str(mm)
            texts.append(text(label, left + mm, base + 4.4 * scale, 1.7 * scale, align, name=f"ruler-number-{mm}"))
    words = (
        f"This ruler must measure {length:g} mm. If it does not, print again at 100 % (actual size), "
        "without fitting to the page."
    )
    for index, line in enumerate(wrap(words, frame.width, 1.6 * scale)):
        y = base - (3.9 + 3.1 * index) * scale
        texts.append(text(line, left, y, 1.6 * scale, color=GRAY, name=f"ruler-words-{index}"))
    return marks, texts


def axes(frame: Frame) -> Drawn:
    """Two labeled arrows that show which way the marker frame's x and y point."""
    scale = frame.scale
    length, x, y = 9 * scale, frame.right - 12 * scale, frame.ruler_y
    head, half = 2.2 * scale, 0.7 * scale
    tip_x, tip_y = x + length, y + length
    marks: list[Shape] = [
        Line(((x, y), (tip_x - head, y)), FINE, "axes-x"),
        Line(((x, y - FINE / 2), (x, tip_y - head)), FINE, "axes-y"),
        _polygon("axes-x-head", (tip_x, y), (tip_x - head, y + half), (tip_x - head, y - half)),
        _polygon("axes-y-head", (x, tip_y), (x - half, tip_y - head), (x + half, tip_y - head)),
    ]
    texts: list[Shape] = [
        text("x", frame.right, y - 0.8 * scale, 1.9 * scale, "right", name="axes-x-label"),
        text("y", x, tip_y + 1.5 * scale, 1.9 * scale, "center", name="axes-y-label"),
    ]
    return marks, texts


def size_words(boundary: Boundary) -> str:
    """``300 mm across`` for a disk, else width and height as in ``200 x 100 mm``."""
    width, height = box_mm(boundary)[2:] - box_mm(boundary)[:2]
    across = 2e3 * boundary.radius
    if max(abs(width - across), abs(height - across)) < 1e-6 * across:
        return f"{across:.6g} mm across"
    return f"{width:.6g} x {height:.6g} mm"


def box_mm(boundary: Boundary) -> Array:
    """Left, lower, right and upper end (4,) of the outline in mm, marker frame."""
    points = np.concatenate(boundary.outlines()) * 1e3
    return np.concatenate([points.min(axis=0), points.max(axis=0)])


def title_block(frame: Frame, marker: Marker) -> Drawn:
    """Caption along the foot of the sheet: small gray headings over their values, from margin to margin."""
    scale, left = frame.scale, frame.margin
    columns = [
        ("spec", marker_name(marker).removeprefix("markergen-"), "bold"),
        ("dots", str(len(marker)), "regular"),
        ("dot diameter", f"{marker.dot_diameter * 1e3:.6g} mm", "regular"),
        ("size", size_words(marker.boundary), "regular"),
        ("scale", "1 : 1, print at 100 %", "regular"),
        ("made with", f"markergen {markergen.__version__}", "regular"),
    ]
    small, large = 1.35 * scale, 1.9 * scale
    widths = [max(text_width(head, small), text_width(value, large, face)) for head, value, face in columns]
    # Columns that would run into each other on narrow paper shrink together.
    shrink = min(1.0, frame.width / (sum(widths) + 3 * scale * (len(columns) - 1)))
    gap = (frame.width - shrink * sum(widths)) / (len(columns) - 1)
    marks: list[Shape] = [Line(((left, frame.block_top), (frame.right, frame.block_top)), HAIRLINE, "rule", LIGHT)]
    texts: list[Shape] = []
    for (head, value, face), width in zip(columns, widths, strict=True):
        slug = head.replace(" ", "-")
        texts.append(
            text(head, left, frame.margin + 4.4 * scale, small * shrink, color=GRAY, name=f"block-{slug}-heading")
        )
        texts.append(text(value, left, frame.margin, large * shrink, face=face, name=f"block-{slug}"))
        left += shrink * width + gap
    return marks, texts


def _clear(points: Array, dots: tuple[Disk, ...], spare: float) -> NDArray[np.bool_]:
    centers = np.array([[dot.x, dot.y] for dot in dots])
    quiet = np.array([quiet_radius(dot) for dot in dots])
    return np.all(np.linalg.norm(points[:, None] - centers, axis=-1) > quiet + spare, axis=-1)


def _polyline(points: Array, name: str) -> Line:
    return Line(tuple((float(x), float(y)) for x, y in points), HAIRLINE, name, LIGHT)


def _polygon(name: str, first: Point, *others: Point) -> Outline:
    return Outline((("M", (first,)), *(("L", (point,)) for point in others), ("Z", ())), name)
