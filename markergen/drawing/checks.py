"""What to measure on a print: which dots lie far apart along x and y, and how far."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from markergen.drawing.furniture import Column
from markergen.model.marker import ControlPoint, Marker

LEAST = 10.0
"""Of a length worth measuring, mm."""

SHOWN = (0.993, 0.9955)
"""Of a ruler: what the example of a command measures."""

USUAL = 200
"""Length of rulers in mm that `markergen rescale` takes for granted."""


def remedy(rulers: tuple[int, int]) -> tuple[str, str]:
    """What to do if a sheet whose rulers are to measure these lengths in mm is not true, in words and as a command."""
    options = ""
    for name, length, share in zip("xy", rulers, SHOWN, strict=True):
        if length:
            nominal = f" --nominal-{name} {length}mm" if length != USUAL else ""
            options += f" --measured-{name} {length * share:.1f}mm{nominal}"
    return (
        "If a length is off: print again at 100 % (actual size, not fitted to the page). Or keep the print, measure "
        "both rulers and run, for instance:",
        f"markergen rescale marker.json{options} -o corrected.json",
    )


@dataclass(frozen=True)
class Pair:
    """Two dots to measure between, mm: from center to center, and over their outer edges, which calipers can hold."""

    first: int
    second: int
    between: float
    over: float

    def __str__(self) -> str:
        return f"dots {self.first} and {self.second}: {self.between:.1f} mm ({self.over:.1f} mm over the outer edges)"


def far_pair(points: Sequence[ControlPoint], axis: int, seam: float | None = None) -> Pair | None:
    """Pair that lies farthest apart along x (axis 0) or y (1) and more along it than across; None if there is none.

    With a seam, a coordinate on that axis in m, the two lie on either side of it.
    """
    if len(points) < 2:
        return None
    xy = np.array([[point.x, point.y] for point in points])
    away = np.abs(xy[:, None] - xy)
    along, across = away[..., axis], away[..., 1 - axis]
    # A pair that lies obliquely says less about one axis. Rounded, so that equal pairs go by their numbers.
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


def columns(marker: Marker, rulers: tuple[int, int], where: str = "") -> list[Column]:
    """Facts to check a sheet by: a pair of dots along either axis, and the rulers."""
    facts: list[Column] = []
    for axis, name in enumerate("xy"):
        pair = far_pair(marker.control_points, axis)
        if pair:
            heading = f"along {name}: dots {pair.first} and {pair.second}{where}"
            lines = (f"{pair.between:.1f} mm between centers", f"{pair.over:.1f} mm over outer edges")
            facts.append((name, heading, lines, "regular"))
    return [*facts, ("rulers", "rulers", (ruler_words(rulers), "to be true to 0.1 mm"), "regular")]


def ruler_words(rulers: tuple[int, int]) -> str:
    """``x 200 mm, y 150 mm``."""
    return ", ".join(f"{name} {length} mm" for name, length in zip("xy", rulers, strict=True) if length) or "none"
