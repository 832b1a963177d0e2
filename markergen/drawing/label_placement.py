"""Placement of dot numbers on a sheet: outside all quiet zones, clear of other numbers and of all other ink."""
# tests: tests/drawing/test_sheet_layout.py tests/workshop/drafting/test_views.py

from collections.abc import Sequence

import numpy as np

from markergen.arrays import Array
from markergen.drawing.figure import quiet_radius
from markergen.drawing.scene import Box, Disk, overlaps
from markergen.drawing.text import text_width

ANGLES = np.deg2rad([0, *(sign * step for step in range(10, 180, 10) for sign in (1, -1)), 180])
"""Candidate directions from a dot to its number, the outward one first."""


def place_numbers(
    dots: Sequence[Disk],
    labels: Sequence[str],
    height: float,
    rooms: Sequence[Box],
    center: tuple[float, float],
    ink: Array,
    boxes: Sequence[Box] = (),
) -> list[tuple[float, float] | None]:
    """Find centers (x, y) in mm for the numbers of the first dots; None for a dot without a free position.

    A number stands as close to its dot as the quiet zone permits, outward if possible, and closer to its dot than to
    any other, so that it is not mistaken for the neighbor's.

    Parameters
    ----------
    labels : sequence of str
        One for each dot that needs one.
    height : float
        Digit height, mm.
    rooms : sequence of box
        Bounds of each number.
    center : (x, y)
        Point from which "outward" is measured.
    ink : array (m, 2)
        Points of everything else that is drawn, dense enough that no number fits between two.
    boxes : sequence of box
        Areas without numbers.
    """
    centers = np.array([[dot.x, dot.y] for dot in dots])
    quiet = np.array([quiet_radius(dot) for dot in dots])
    taken: list[Box] = list(boxes)
    places: list[tuple[float, float] | None] = []
    for index, label in enumerate(labels):
        half = np.array([text_width(label, height) / 2, height / 2]) + 0.5 * height
        outward = centers[index] - center
        # A central dot has no outward direction; its number goes where a footnote mark would be.
        heading = np.arctan2(outward[1], outward[0]) if np.hypot(*outward) > dots[index].radius else np.pi / 4
        direction = np.stack([np.cos(heading + ANGLES), np.sin(heading + ANGLES)], axis=-1)
        # The support of the box in that direction: at that distance the box cannot overlap the circle.
        reach = quiet[index] + np.abs(direction) @ half
        candidates = np.concatenate(
            [centers[index] + (reach + extra * height)[:, None] * direction for extra in (0.2, 1, 2)]
        )
        place = next(
            (
                (float(middle[0]), float(middle[1]))
                for lead in (2 * height, 0.0)  # clearly the closest if possible, otherwise just the closest
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
    dot: int,
    lead: float,
    centers: Array,
    quiet: Array,
    page: Box,
    ink: Array,
    taken: Sequence[Box],
) -> bool:
    left, bottom, right, top = box = _box(middle, half)
    if left < page[0] or bottom < page[1] or right > page[2] or top > page[3]:
        return False
    gap = np.hypot(*np.maximum(np.abs(centers - middle) - half, 0).T) - quiet
    if np.any(gap < 0) or np.any(np.delete(gap, dot) <= gap[dot] + lead):
        return False
    if len(ink) and np.any(np.all(np.abs(ink - middle) < half, axis=-1)):
        return False
    return not any(overlaps(box, other) for other in taken)


def _box(middle: Array, half: Array) -> Box:
    (left, bottom), (right, top) = (middle - half).tolist(), (middle + half).tolist()
    return left, bottom, right, top
