"""The first page of a tiled marker: a picture of all tiles, how to put them together, what to measure then."""

from collections.abc import Sequence
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from markergen.drawing import checks, furniture
from markergen.drawing.colors import BLACK_ON_WHITE
from markergen.drawing.figure import Figure, size_words
from markergen.drawing.furniture import FINE, GRAY, LIGHT
from markergen.drawing.outline import HAIRLINE, boundary_lines
from markergen.drawing.page import Sheet, scene_of
from markergen.drawing.scene import BLACK, Box, Line, Outline, Point, Shape
from markergen.drawing.text import text, text_width, wrap
from markergen.drawing.tiling import Tiling
from markergen.drawing.transform import polygon
from markergen.model.marker import marker_name

PALE = "#c8c8c8"
"""Color of the dots in the picture: nobody takes it for the marker."""

CORNERS = 48
"""Of a dot in the picture: no circle, so that no program takes it for the marker either."""

LARGEST = 0.6
"""Scale of the picture at most: at 1 or nearly so its dots would be taken for those of the marker, print or file."""

MOST_LENGTHS = 4
"""Across seams on each axis that are listed."""


def plan(figure: Figure, tiles: Tiling, notes: tuple[str, ...]) -> Sheet:
    """Sheet that tells how to put the tiles together: it is neither cut nor measured."""
    frame, scale, paper = tiles.frame, tiles.frame.scale, tiles.frame.paper
    left, width, top = frame.margin, frame.width, frame.top
    count = len(tiles.tiles)
    size = size_words(figure.marker.boundary)
    texts: list[Shape] = [text("Assembly plan", left, top - 3.8 * scale, 3.8 * scale, face="bold", name="plan-title")]
    what = f"{count} tiles in {tiles.layout_words}, for" if count > 1 else "the other has"
    subtitle = f"Page 1 of {count + 1}: {what} a marker of {size}"
    texts += furniture.paragraph(subtitle, left, top - 6.5 * scale, width, 1.9 * scale, 2, "plan-subtitle")
    block_marks, block_text = furniture.title_block(frame, [figure.marker], figure.factor)
    low = frame.block_top + 4 * scale
    steps, high = _steps(figure, tiles, low)
    marks, numbers = _picture(figure, tiles, (left, high + 5 * scale, frame.right, top - 13 * scale))
    return Sheet(
        paper,
        scene_of([{"marks": (*marks, *block_marks), "text": (*texts, *numbers, *steps, *block_text)}]),
        (),
        (0, 0),
        marker_name(figure.marker),
        f"Assembly plan for {count} tiles of a fiducial marker with {len(figure.marker)} dots, {size}, on {paper}.",
        notes,
        (0.0, 0.0, paper.width, paper.height),
    )


def _picture(figure: Figure, tiles: Tiling, room: Box) -> tuple[list[Shape], list[Shape]]:
    """All tiles small in a part of the page, with their numbers; dashed along edges that are cut."""
    scale = tiles.frame.scale
    left, bottom, right, top = tiles.extent
    small = min((room[2] - room[0]) / (right - left), (room[3] - room[1]) / (top - bottom), LARGEST)
    dx, dy = (room[0] + room[2]) / 2, (room[1] + room[3]) / 2

    def at(x: float, y: float) -> Point:
        return dx + small * (x - (left + right) / 2), dy + small * (y - (bottom + top) / 2)

    marks: list[Shape] = []
    for dot in figure.dots:
        segments = polygon(_circle(at(dot.x, dot.y), small * dot.radius), "", PALE).segments
        if dot.inner_radius:
            hole = _circle(at(dot.x, dot.y), small * dot.inner_radius)[::-1]
            segments += polygon(hole, "", PALE).segments
        marks.append(Outline(segments, f"plan-{dot.name}", PALE))
    edges = [
        Line(tuple(at(*point) for point in line.points), HAIRLINE, f"plan-{line.name}", LIGHT)
        for line in boundary_lines(figure, BLACK_ON_WHITE)
    ]
    marks += edges
    corners = (at(left, bottom), at(right, bottom), at(right, top), at(left, top), at(left, bottom))
    marks.append(Line(corners, FINE, "plan-edge", GRAY))
    for index, x in enumerate(tiles.across.places):
        marks += _dashed(at(x, bottom), at(x, top), f"plan-across-{index}")
    for index, y in enumerate(tiles.upward.places):
        marks += _dashed(at(left, y), at(right, y), f"plan-upward-{index}")
    texts: list[Shape] = []
    # Labels keep off dots and outline.
    near = furniture.ink_points(edges)
    disks = np.array([(*at(dot.x, dot.y), small * dot.radius) for dot in figure.dots])
    disks = np.concatenate([disks, np.column_stack([near, np.ones(len(near))])])
    for number, tile in enumerate(tiles.tiles, 1):
        (x0, y0), (x1, y1) = at(*tile.box[:2]), at(*tile.box[2:])
        label = f"row {tile.row + 1}, column {tile.column + 1}"
        height = min(5 * scale, (y1 - y0) / 4, (x1 - x0) / 4)
        fine = min(0.34 * height, 0.34 * height * 0.9 * (x1 - x0) / text_width(label, 0.34 * height))
        wide, high, pad = text_width(label, fine), height + 2.2 * fine, 0.4 * height
        # The upper left corner, or where it hides less.
        xs, ys = (x0 + pad, (x0 + x1 - wide) / 2, x1 - pad - wide), (y1 - pad - high, (y0 + y1 - high) / 2, y0 + pad)
        places = [(x, y) for y in ys for x in xs]
        x, y = max(places, key=lambda place: min(_gap(place, (wide, high), disks), 0.0))
        texts.append(text(str(number), x, y + 2.2 * fine, height, face="bold", name=f"plan-tile-{number}"))
        texts.append(text(label, x, y, fine, color=GRAY, name=f"plan-tile-{number}-label"))
    return marks, texts


def _gap(place: Point, size: Point, disks: NDArray[np.float64]) -> float:
    """Between a box at its lower left corner and the nearest disk (x, y, radius); below 0 if they overlap."""
    low = np.array(place)
    beyond = np.maximum(np.maximum(low - disks[:, :2], disks[:, :2] - low - size), 0)
    return float(np.min(np.hypot(*beyond.T) - disks[:, 2]))


def _circle(center: Point, radius: float) -> list[Point]:
    angles = (2 * pi * index / CORNERS for index in range(CORNERS))
    return [(center[0] + radius * cos(angle), center[1] + radius * sin(angle)) for angle in angles]


def _dashed(start: Point, end: Point, name: str) -> list[Line]:
    """Dashes of 3 mm with gaps of 2 along a horizontal or vertical line."""
    axis = 0 if end[0] > start[0] else 1
    dashes, place, number = [], start[axis], 0
    while place < end[axis]:
        stop = min(place + 3.0, end[axis])
        points = [(place, start[1]), (stop, start[1])] if axis == 0 else [(start[0], place), (start[0], stop)]
        dashes.append(Line(tuple(points), FINE, f"{name}-{number}", BLACK))
        place, number = place + 5.0, number + 1
    return dashes


def _steps(figure: Figure, tiles: Tiling, low: float) -> tuple[list[Shape], float]:
    """Numbered paragraphs that end at height `low`, and where they begin."""
    frame, scale = tiles.frame, tiles.frame.scale
    height, indent = 1.75 * scale, 5 * scale
    rows: list[tuple[str, str]] = []
    for number, step in enumerate(_words(figure, tiles), 1):
        for index, line in enumerate(wrap(step, frame.width - indent, height)):
            rows.append((f"{number}" if index == 0 else "", line))
    step_up, y = 1.85 * height, low
    texts: list[Shape] = []
    for index, (number_text, line) in reversed(list(enumerate(rows))):
        texts.append(text(line, frame.margin + indent, y, height, name=f"step-{index}"))
        if number_text:
            texts.append(text(number_text, frame.margin, y, height, face="bold", name=f"step-number-{number_text}"))
            y += 0.6 * height
        y += step_up
    return texts, y


def _words(figure: Figure, tiles: Tiling) -> list[str]:
    count = len(tiles.tiles)
    half = f"{tiles.overlap / 2:g}"
    if count == 1:
        return [
            "Print page 2 at 100 % (actual size, not fitted to the page). Its rulers must be true to 0.1 mm; it says "
            "what to do if they are not. Nothing is to be cut or glued."
        ]
    steps = [
        f"Print pages 2 to {count + 1} at 100 % (actual size, not fitted to the page), all on the same printer. The "
        "rulers on every page must be true to 0.1 mm; each page says what to do if they are not.",
        "Cut tiles along the crop marks on their left and upper edges where another tile joins (dashed lines); "
        f"each page says which. Leave right and lower edges: {half} mm and the margin beyond lie under the next tile.",
        "Begin with tile 1. Lay each next tile onto the edge of its neighbor so that every cross on the seam is whole: "
        "the cut edge along one arm, the two halves of the other in line. Glue row by row, then row to row, on a flat, "
        "stiff board.",
    ]
    lengths = _across(figure, tiles)
    if lengths:
        steps.append(
            f"Measure across the seams, before the glue is dry: {'; '.join(lengths)}. Move the tiles until this is so "
            "within 0.2 mm. Or measure the dots as they are and use them: markergen rescale marker.json "
            "--measured-points dots.csv -o corrected.json"
        )
    return steps


def _across(figure: Figure, tiles: Tiling) -> Sequence[str]:
    """Lengths between dots on either side of seams."""
    found: list[str] = []
    for axis, cuts in enumerate((tiles.across, tiles.upward)):
        for place in cuts.places[:MOST_LENGTHS]:
            pair = checks.far_pair(figure.marker.control_points, axis, place / figure.factor[axis] / 1e3)
            if pair and str(pair) not in found:
                found.append(str(pair))
    return found
