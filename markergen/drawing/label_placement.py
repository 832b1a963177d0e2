"""Where the number of a dot goes on a sheet: outside every quiet zone, clear of other numbers and of all other ink."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.figure import quiet_radius
from markergen.drawing.scene import Box, Disk
from markergen.drawing.text import text_width

Array = NDArray[np.float64]

ANGLES = np.deg2rad([0, *(sign * step for step in range(10, 180, 10) for sign in (1, -1)), 180])
"""Directions from a dot that are tried for its number, the outward one first."""


def place_numbers(
    dots: Sequence[Disk],
    labels: Sequence[str],
    height: float,
    rooms: Sequence[Box],
    center: tuple[float, float],
    ink: Array,
    boxes: Sequence[Box] = (),
) -> list[tuple[float, float] | None]:
    """Middles (x, y) in mm of the dots' numbers, or None where a dot has no free place of its own.

    A number stands as near to its dot as the quiet zone lets it, outward if it can, and nearer to its dot than to any
    other, so that nobody takes it for the neighbor's.

    Parameters
    ----------
    dots : sequence of Disk
    labels : sequence of str
        One per dot.
    height : float
        Of the digits, mm.
    rooms : sequence of box
        That the numbers must stay in, one per dot.
    center : (x, y)
        What "outward" means.
    ink : array (m, 2)
        Points of everything else that is drawn, close enough that no number fits between two.
    boxes : sequence of box
        Where no number may be.
    """
    centers = np.array([[dot.x, dot.y] for dot in dots])
    quiet = np.array([quiet_radius(dot) for dot in dots])
    taken: list[Box] = list(boxes)
    places: list[tuple[float, float] | None] = []
    for index, label in enumerate(labels):
        half = np.array([text_width(label, height) / 2, height / 2]) + 0.5 * height
        outward = centers[index] - center
        # A dot in the middle has no outward; its number goes where a reader looks for a footnote mark.
        heading = np.arctan2(outward[1], outward[0]) if np.hypot(*outward) > dots[index].radius else np.pi / 4
        direction = np.stack([np.cos(heading + ANGLES), np.sin(heading + ANGLES)], axis=-1)
        # The support of the box in that direction: a box that far out cannot reach into the circle.
        reach = quiet[index] + np.abs(direction) @ half
        candidates = np.concatenate(
            [centers[index] + (reach + extra * height)[:, None] * direction for extra in (0.2, 1, 2)]
        )
        place = next(
            (
                (float(middle[0]), float(middle[1]))
                for lead in (2 * height, 0.0)  # clearly the nearest if that can be, else just the nearest
                for middle in candidates
                if _free(middle, half, index, lead, centers, quiet, rooms[index], ink, taken)
            ),
            None,
        )
        places.append(place)
        if place is not None:
            taken.append(_box(np.array(place), half))
    return places


def _free(
    middle: Array,
    half: Array,
    own: int,
    lead: float,
    centers: Array,
    quiet: Array,
    page: Box,
    ink: Array,
    taken: Sequence[Box],
) -> bool:
    left, bottom, right, top = _box(middle, half)
    if left < page[0] or bottom < page[1] or right > page[2] or top > page[3]:
        return False
    gap = np.hypot(*np.maximum(np.abs(centers - middle) - half, 0).T) - quiet
    if np.any(gap < 0) or np.any(np.delete(gap, own) <= gap[own] + lead):
        return False
    if len(ink) and np.any(np.all(np.abs(ink - middle) < half, axis=-1)):
        return False
    return not any(left < box[2] and right > box[0] and bottom < box[3] and top > box[1] for box in taken)


def _box(middle: Array, half: Array) -> Box:
    return (
        float(middle[0] - half[0]),
        float(middle[1] - half[1]),
        float(middle[0] + half[0]),
        float(middle[1] + half[1]),
    )
