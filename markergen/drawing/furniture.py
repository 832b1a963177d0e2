"""What stands around the dots on a sheet: axes, center cross, columns of facts, and the measures of the page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, pi, sqrt

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.drawing.colors import Colors
from markergen.drawing.figure import is_disk, size_words
from markergen.drawing.numbers import quiet_radius
from markergen.drawing.outline import AIR, HAIRLINE, HEADINGS
from markergen.drawing.paper import Paper
from markergen.drawing.scene import BLACK, Box, Disk, Line, Point, Shape
from markergen.drawing.text import text, text_width, wrap
from markergen.drawing.transform import polygon
from markergen.errors import InputError
from markergen.model.marker import Marker, marker_name

Array = NDArray[np.float64]
Drawn = tuple[list[Shape], list[Shape]]
"""Marks and texts."""
Column = tuple[str, str, tuple[str, ...], str]
"""Slug, heading, lines and face of a column of facts."""

GRAY, LIGHT = "#5a5a5a", "#9a9a9a"
FINE = 0.25
"""Width in mm of the lines that are to be seen from afar."""

TICK = 4.0
"""Length of an axis tick in mm on A4."""

CENTROID_PULL = 2e-3
"""How far in mm the center cross may move the center of gravity of a dot it does not sit in the middle of."""

SHORTEST_ARM = 0.5
"""Of the center cross, mm; a shorter one would be taken for a speck."""

DESCENT = 0.65
"""How far letters reach below their line, mm on A4."""

LEAST_ROOM = 70.0
"""Between the margins, mm: below it no words fit under the marker."""


@dataclass(frozen=True)
class Frame:
    """Measures of the page's furniture in mm: they grow with the paper, but less than it does.

    Attributes
    ----------
    paper : Paper
    edge : float or None
        Distance from the paper's edge that all ink keeps, mm; None for about `12 * scale`, more than printers cannot
        reach.

    Raises
    ------
    InputError
        If the margin is negative or leaves nothing to print on.
    """

    paper: Paper
    edge: float | None = None

    def __post_init__(self) -> None:
        if (self.edge or 0.0) < 0 or min(self.width, self.paper.height - 2 * self.margin) < LEAST_ROOM:
            raise InputError(
                f"a printer margin from 0 that leaves {LEAST_ROOM:g} x {LEAST_ROOM:g} mm of {self.paper}",
                f"{self.margin if self.edge is None else self.edge:g} mm",
                "give a smaller margin or larger paper",
            )

    @property
    def scale(self) -> float:
        """Size of text and gaps relative to those on A4."""
        return min(max(sqrt(min(self.paper.width, self.paper.height) / 210), 0.84), 2.0)

    @property
    def margin(self) -> float:
        """Where baselines and base lines are: letters and strokes reach a little beyond, but not to the edge given."""
        return (12 if self.edge is None else DESCENT) * self.scale + (self.edge or 0.0)

    @property
    def right(self) -> float:
        """Right margin's x."""
        return self.paper.width - self.margin

    @property
    def top(self) -> float:
        """Upper margin's y."""
        return self.paper.height - self.margin

    @property
    def width(self) -> float:
        """Between the margins."""
        return self.paper.width - 2 * self.margin

    @property
    def block_top(self) -> float:
        """Height of the hairline over the title block."""
        return self.margin + 9 * self.scale

    @property
    def checks_y(self) -> float:
        """Height of the lowest line of the lengths to measure; the words on what to do are below."""
        return self.block_top + 10.4 * self.scale

    @property
    def ruler_y(self) -> float:
        """Height of the ruler's base line."""
        return self.block_top + 21.5 * self.scale

    @property
    def footer(self) -> float:
        """Height above which the marker's region begins."""
        return self.ruler_y + 13.5 * self.scale

    @property
    def region(self) -> Box:
        """Part of the page for the marker and what belongs to it."""
        return self.margin, self.footer, self.right, self.top


def axis_ticks(
    scale: float,
    room: Box,
    reach: Mapping[str, float],
    dots: tuple[Disk, ...],
    boxes: Sequence[Box] = (),
    color: str = BLACK,
) -> list[Line]:
    """Short lines where the axes leave the boundary, or farther out where a quiet zone or a box is in the way.

    A tick that would leave the `room` (mm, marker frame), or whose axis has the whole boundary behind it, is left out.
    `reach` is what `axis_reach` tells.
    """
    length = TICK * scale
    centers = np.array([[dot.x, dot.y] for dot in dots])
    blocked = np.array([quiet_radius(dot) + FINE for dot in dots])
    ticks = []
    for name, heading in HEADINGS.items():
        along, across = centers @ heading, centers @ heading[::-1]
        half = np.sqrt(np.maximum(blocked**2 - across**2, 0))
        zones = list(zip(along - half, along + half, strict=True))
        zones += [_shadow(box, heading, 2 * scale) for box in boxes]
        start = reach[name]
        # Sorted by where they begin, so one pass over the zones jumps over all that the tick would touch.
        for near, far in sorted(zones):
            if near < far and near < start + length and far > start:
                start = float(far)
        foot, tip = ((far * heading[0], far * heading[1]) for far in (start, start + length))
        left, bottom, right, top = room
        if start > 0 and left <= tip[0] <= right and bottom <= tip[1] <= top:
            ticks.append(Line((foot, tip), FINE, f"axis{name}", color))
    return ticks


def _shadow(box: Box, heading: tuple[int, int], air: float) -> tuple[float, float]:
    """Where the ray from the origin enters and leaves a box with some air around it; (0, 0) if it misses."""
    low, high = np.array(box[:2]) - air, np.array(box[2:]) + air
    side = 1 - int(np.argmax(np.abs(heading)))
    if not low[side] < 0 < high[side]:
        return 0.0, 0.0
    ends = sorted((float(low @ heading), float(high @ heading)))
    return ends[0], ends[1]


def center_cross(scale: float, dots: tuple[Disk, ...], room: float, colors: Colors) -> list[Line]:
    """Fine cross at the origin: ink on paper, paper on a dot, none where it would disturb a dot.

    A cross on a dot but e mm off its middle moves the dot's center of gravity by area(cross) e / area(dot); there its
    arms are shortened until that is below `CENTROID_PULL`. Too short to see, or beside a dot in its quiet zone, it is
    left out: the axis ticks still give the center. So it is where an outline is near, which is `room` mm away.
    """
    arm, width, color = min(3.0 * scale, room - AIR), HAIRLINE, colors.ink
    for dot in dots:
        offset = hypot(dot.x, dot.y)
        if offset >= quiet_radius(dot) + arm:
            continue
        width, in_hole = 0.1, offset < dot.inner_radius
        color = colors.ink if in_hole else colors.paper
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
    return [
        Line(((-arm, 0.0), (arm, 0.0)), width, "center-x", color),
        Line(((0.0, -arm), (0.0, arm)), width, "center-y", color),
    ]


def ink_points(shapes: Sequence[Shape]) -> Array:
    """Points (m, 2) at most 1 mm apart along lines."""
    runs = [np.array(shape.points) for shape in shapes if isinstance(shape, Line)]
    if not runs:
        return np.zeros((0, 2))
    start, way = np.concatenate([run[:-1] for run in runs]), np.concatenate([np.diff(run, axis=0) for run in runs])
    steps = np.maximum(np.ceil(np.hypot(*way.T)), 1).astype(int)
    of = np.repeat(np.arange(len(steps)), steps + 1)
    number = np.arange(len(of)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    return np.asarray(start[of] + (number / steps[of])[:, None] * way[of])


def axes(frame: Frame) -> Drawn:
    """Two labeled arrows that show which way the marker frame's x and y point."""
    scale = frame.scale
    length, x, y = 9 * scale, frame.right - 12 * scale, frame.ruler_y
    head, half = 2.2 * scale, 0.7 * scale
    tip_x, tip_y = x + length, y + length
    marks: list[Shape] = [
        Line(((x, y), (tip_x - head, y)), FINE, "axes-x"),
        Line(((x, y - FINE / 2), (x, tip_y - head)), FINE, "axes-y"),
        polygon([(tip_x, y), (tip_x - head, y + half), (tip_x - head, y - half)], "axes-x-head", BLACK),
        polygon([(x, tip_y), (x - half, tip_y - head), (x + half, tip_y - head)], "axes-y-head", BLACK),
    ]
    texts: list[Shape] = [
        text("x", frame.right, y - 0.8 * scale, 1.9 * scale, "right", name="axes-x-label"),
        text("y", x, tip_y + 1.5 * scale, 1.9 * scale, "center", name="axes-y-label"),
    ]
    return marks, texts


def title_block(frame: Frame, markers: Sequence[Marker], factor: Point = (1.0, 1.0)) -> Drawn:
    """Caption along the foot of the sheet: small gray headings over their values, from margin to margin."""
    first = markers[0]
    same = all(other.boundary == first.boundary and other.dot_diameter == first.dot_diameter for other in markers)
    meaning = "size: diameter of the outline" if is_disk(first.boundary) else "size: width x height of the outline"
    name = marker_name(first).removeprefix("markergen-")
    if any(marker_name(marker) != marker_name(first) for marker in markers):
        name = "see captions"
    columns: list[Column] = [
        ("spec", "spec", (name,), "bold"),
        ("dots", "dots", (" + ".join(dict.fromkeys(str(len(marker)) for marker in markers)),), "regular"),
    ]
    if len(markers) > 1:
        columns.insert(1, ("markers", "markers", (str(len(markers)),), "regular"))
    if same:
        columns += [
            ("dot-diameter", "dot diameter", (f"{first.dot_diameter * 1e3:.6g} mm",), "regular"),
            ("size", meaning, (size_words(first.boundary),), "regular"),
        ]
    columns += [
        scale_column(factor),
        ("made-with", "made with", (f"markergen {markergen.__version__}",), "regular"),
    ]
    rule = Line(((frame.margin, frame.block_top), (frame.right, frame.block_top)), HAIRLINE, "rule", LIGHT)
    return [rule], facts(frame, columns, frame.margin, "block")


def scale_column(factor: Point) -> Column:
    """How large the drawing is, and for which printer if it is not for every one."""
    if factor == (1.0, 1.0):
        return "scale", "scale", ("1 : 1, print at 100 %",), "regular"
    printer, drawn = (", ".join(f"{name} {value:.6g}" for name, value in zip("xy", pair, strict=True)) for pair in (
        [1 / value for value in factor], factor
    ))  # fmt: skip
    return "scale", f"compensated for a printer that makes {printer} of 1", (f"drawn {drawn}; print at 100 %",), "bold"


def facts(frame: Frame, columns: Sequence[Column], y: float, name: str) -> list[Shape]:
    """Columns from margin to margin, a small gray heading over lines of which the last stands at height y."""
    scale, left = frame.scale, frame.margin
    small, large, step = 1.35 * scale, 1.9 * scale, 3.2 * scale
    widths = [
        max(text_width(heading, small), *(text_width(line, large, face) for line in lines))
        for _, heading, lines, face in columns
    ]
    # Columns that would run into each other on narrow paper shrink together.
    between = max(len(columns) - 1, 1)
    shrink = min(1.0, frame.width / (sum(widths) + 3 * scale * between))
    gap = (frame.width - shrink * sum(widths)) / between
    texts: list[Shape] = []
    for (slug, heading, lines, face), width in zip(columns, widths, strict=True):
        height = y + 4.4 * scale + step * (len(lines) - 1)
        texts.append(text(heading, left, height, small * shrink, color=GRAY, name=f"{name}-{slug}-heading"))
        for index, line in enumerate(reversed(lines)):
            suffix = f"-{len(lines) - 1 - index}" if len(lines) > 1 else ""
            texts.append(text(line, left, y + index * step, large * shrink, face=face, name=f"{name}-{slug}{suffix}"))
        left += shrink * width + gap
    return texts


def paragraph(
    words: str, left: float, top: float, width: float, height: float, lines: int, name: str, color: str = GRAY
) -> list[Shape]:
    """Words in at most `lines` lines below `top`, smaller than `height` (of a capital, mm) if they need it."""
    step, rows = 1.94 * height, wrap(words, width, height)
    while len(rows) > lines or max(text_width(row, height) for row in rows) > width:
        height *= 0.96
        rows = wrap(words, width, height)
    return [
        text(row, left, top - height - index * step, height, color=color, name=f"{name}-{index}")
        for index, row in enumerate(rows)
    ]


def remedy(frame: Frame, words: Sequence[str], top: float, height: float) -> list[Shape]:
    """One line per sentence below `top`, each as small as it must be."""
    texts: list[Shape] = []
    for index, line in enumerate(words):
        texts += paragraph(line, frame.margin, top - 1.94 * height * index, frame.width, height, 1, f"remedy-{index}")
    return texts
