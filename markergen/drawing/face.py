"""The face: everything drawn at a marker itself, in its own frame, ready to be laid on a page or cut into tiles."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np
from numpy.typing import NDArray

from markergen.drawing import furniture
from markergen.drawing.colors import Colors
from markergen.drawing.figure import Figure, overlap, union
from markergen.drawing.numbers import place_numbers
from markergen.drawing.outline import axis_reach, boundary_lines
from markergen.drawing.scene import Box, Shape, around_origin, bounds
from markergen.drawing.text import text
from markergen.drawing.transform import rectangle

Array = NDArray[np.float64]

NUMBER_HEIGHT = 2.6
"""Of the dots' numbers in mm on A4."""

GRAY_SHARE, GROUND = 0.647, 5.5
"""Ink in the color of numbers; width in mm on A4 that a printed ground has around everything, so that numbers fit."""

LAYERS = ("ground", "dots", "tag", "cut", "marks", "text")
"""From the bottom up."""


@dataclass(frozen=True)
class Face:
    """Shapes by layer, mm, marker frame, and the dots that have no room for their number."""

    layers: dict[str, tuple[Shape, ...]]
    nameless: tuple[str, ...]


def ground_box(figure: Figure, scale: float) -> Box:
    """Box that a printed ground fills: outline and quiet zones with room for numbers around them."""
    left, bottom, right, top = union(figure.outline, figure.quiet)
    pad = GROUND * scale
    return left - pad, bottom - pad, right + pad, top + pad


def draw_face(
    figure: Figure,
    colors: Colors,
    scale: float,
    room: Box,
    ink: Array | None = None,
    rooms: Sequence[Box] | None = None,
) -> Face:
    """Draw a marker within a room.

    Parameters
    ----------
    figure : Figure
    colors : Colors
    scale : float
        Of numbers and ticks.
    room : box
        That numbers and ticks must stay in, mm, marker frame.
    ink : array (m, 2) or None
        Points that numbers must keep off as well.
    rooms : sequence of box or None
        That the number of each dot must stay in besides.
    """
    marker, dots = figure.marker, figure.dots
    boxes = [figure.tag_zone] if figure.tag_zone else []
    ground = ground_box(figure, scale) if colors.grounded else None
    room = ground or room
    center = np.zeros(2)
    clear = 1e3 * min(abs(float(shape.depth(center))) for shape in (marker.boundary, *marker.blocked))
    cut = boundary_lines(figure, colors)
    on_tag = any(around_origin(box) for box in boxes)
    cross = [] if on_tag or not around_origin(room) else furniture.center_cross(scale, dots, clear, colors)
    reach = axis_reach(figure)
    # Ticks that stand on the boundary come before the numbers; those that a quiet zone pushes out come after them.
    on_boundary = [
        tick
        for tick in furniture.axis_ticks(scale, room, reach, dots)
        if abs(hypot(*tick.points[0]) - reach[tick.name.removeprefix("axis")]) < 1e-6
    ]
    height = NUMBER_HEIGHT * scale
    names = [str(point.id) for point in marker.control_points]
    taken = furniture.ink_points([*cut, *cross, *on_boundary])
    if ink is not None:
        taken = np.concatenate([taken, ink])
    each = [overlap(room, own) for own in rooms] if rooms else [room] * len(dots)
    places = place_numbers(dots, names, height, each, (0.0, 0.0), taken, boxes)
    numbers = tuple(
        text(name, x, y - height / 2, height, "center", color=colors.mix(GRAY_SHARE), name=f"number-{name}")
        for name, place in zip(names, places, strict=True)
        if place is not None
        for x, y in [place]
    )
    ticks = furniture.axis_ticks(scale, room, reach, dots, _boxes(numbers), colors.ink)
    return Face(
        {
            "ground": (rectangle(ground, "ground", colors.paper),) if ground else (),
            "dots": dots,
            "tag": figure.tag,
            "cut": tuple(cut),
            "marks": (*cross, *ticks),
            "text": numbers,
        },
        tuple(name for name, place in zip(names, places, strict=True) if place is None),
    )


def _boxes(shapes: Sequence[Shape]) -> list[Box]:
    return [bounds(shape) for shape in shapes]
