"""The answer in words: what to expect, what limits it, what to improve first."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from markergen.model.marker import Marker
from markergen.presentation import tables
from markergen.units import format_length
from markergen.validation.report.expected import SOURCES, Cell, Expected, middle, rms

REMEDIES = {
    "image": (
        "the noise of the image. Let the dots cover more pixels (a larger marker, a shorter distance, a longer focal "
        "length, more pixels), or get more light and a sharper focus"
    ),
    "print": (
        "the print. Print on a better printer and a stiffer, flatter material, make the marker larger, or measure "
        "where the dots really are"
    ),
    "camera": (
        "the camera's calibration. Calibrate again, with more images that fill the corners, at the focus that you work "
        "with"
    ),
}
"""What each source is called, and how to make it smaller."""
DOMINANT = 0.9
"""Share of the variance from which improving anything else gains next to nothing: less than 5 % of the error."""


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with that many significant digits, and in words that it does not exist or has no bound."""
    if value is None or np.isnan(value):
        return "-"
    return "unbounded" if np.isinf(value) else tables.number(float(value), digits)


def at(distance: float, tilt_deg: float) -> str:
    """Say from where: ``At 1.5 m and 70 deg``."""
    return f"At {distance:.3g} m and {tilt_deg:.3g} deg"


def title(marker: Marker) -> str:
    """One line that names the marker."""
    return f"{len(marker)} dots of {format_length(marker.dot_diameter)} in a {marker.boundary}"


def answer(found: Expected, table: list[Cell]) -> list[str]:
    """What a user can expect, in up to three sentences: far and tilted, the worst, and over all poses."""
    farthest = [cell for cell in table if cell.distance == max((each.distance for each in table), key=middle)]
    steep = max(farthest, key=lambda cell: middle(cell.tilt))
    worst = max(table, key=lambda cell: cell.rotation_deg)
    said = [f"At {_place(steep)} expect {_errors(steep)} RMS."]
    if worst is not steep:
        frontal = " (seen frontally, a small tilt hardly changes the image)" if middle(worst.tilt) < 10 else ""
        said.append(f"Hardest is {_place(worst)}{frontal}: {_errors(worst)}.")
    said.append(
        f"Over all {len(found.poses)} poses: {number(rms(found.rotation_deg), 2)} deg and "
        f"{number(rms(found.translation_mm), 2)} mm ({number(rms(found.translation_pct), 2)} % of the distance), "
        f"with {found.source}."
    )
    return said


def shares(budget: Mapping[str, Any], key: str) -> dict[str, float]:
    """Share of each source in the variance of ``rotation_deg`` or ``translation_pct``; empty where all are 0."""
    parts = budget.get(key) or {}
    squares = {name: (parts.get(name) or 0.0) ** 2 for name in REMEDIES}
    total = sum(squares.values())
    return {name: part / total for name, part in squares.items()} if total else {}


def limits(budget: Mapping[str, Any]) -> list[str]:
    """What limits rotation and translation, and what to improve first."""
    found = {
        what: shares(budget, key) for what, key in (("rotation", "rotation_deg"), ("translation", "translation_pct"))
    }
    first = {what: max(parts, key=lambda name: parts[name]) for what, parts in found.items() if parts}
    said = []
    for name in dict.fromkeys(first.values()):
        limited = [what for what, largest in first.items() if largest == name]
        line = f"What limits the {' and the '.join(limited)} is {REMEDIES[name]}."
        if all(found[what][name] > DOMINANT for what in limited):
            line += " Improving anything else would gain next to nothing."
        said.append(line)
    if first and not any(parts.get("camera") for parts in found.values()):
        said.append("The camera's calibration is taken as exact; --camera-covariance tells how good it is.")
    return said


def in_words(parts: Mapping[str, float]) -> str:
    """Shares of the variance, the largest first."""
    ordered = sorted(parts.items(), key=lambda part: -part[1])
    return ", ".join(f"{SOURCES[name]} {tables.percent(part)}" for name, part in ordered)


def _place(cell: Cell) -> str:
    return f"{cell.distance.replace('..', ' to ')} m and {cell.tilt.replace('..', ' to ')} deg"


def _errors(cell: Cell) -> str:
    return f"{number(cell.rotation_deg, 2)} deg and {number(cell.translation_mm, 2)} mm"
