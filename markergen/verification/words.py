"""Findings: what is wrong with a file in the user's words, and what to do about it."""

# tests: tests/verification/test_check.py

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from markergen.arrays import Array

MOST_LISTED = 8
"""Maximum number of findings of a kind, or of dots in one, that are listed; the rest is counted or left out."""

FIT_TO_PAGE = "print or save it at 100 %, without fitting it to the page"

LENGTHS = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "inch": 25.4, "foot": 304.8}
UNITS = LENGTHS | {"point": 25.4 / 72, "pixel of 90 dpi": 25.4 / 90, "pixel of 96 dpi": 25.4 / 96}
"""Units in mm, of solids and of sheets, that may be taken for each other."""


def unit_mistakes(*homes: str, units: Mapping[str, float] = UNITS) -> dict[float, tuple[str, str]]:
    """Ratios of wrong to right lengths that mistaken units explain: in words, with the remedy.

    A file may be in any unit of `homes`, which may be taken for another one, or another one for it.
    """
    mistakes = dict[float, tuple[str, str]]()
    for home, (unit, size) in product(homes, units.items()):
        ratio = UNITS[home] / size
        for times, why, remedy in (
            (ratio, f"{unit} taken for {home}", f"export it in {home}"),
            (1 / ratio, f"{home} taken for {unit}", f"open it in {home} where it was saved last"),
        ):
            # Of two explanations the first holds.
            if unit != home:
                mistakes.setdefault(float(f"{times:.12g}"), (why, remedy))
    return mistakes


OF_SHEETS = unit_mistakes("mm", "pixel of 96 dpi")


def nearest_mistake(ratio: float, mistakes: Mapping[float, tuple[str, str]] = OF_SHEETS) -> float:
    """Ratio of mistaken units next to a ratio."""
    return min(mistakes, key=lambda times: abs(np.log(abs(ratio) / times)))


@dataclass(frozen=True)
class Finding:
    """One error in a file.

    Attributes
    ----------
    kind : str
        ``scaled``, ``sheared``, ``mirrored``, ``missing``, ``extra``, ``another marker``, ``shifted``, ``diameter``,
        ``kind``, ``height``, ``twice``, ``marks``, ``tag``, ``no dots``; of lines to cut ``outline``, ``hole``; of what
        shows ``inverted``, ``pale``, ``covered``, ``quiet``, ``hidden``, ``layer``; of solids ``turned``, ``part``,
        ``color`` or ``solid``; of rigs ``relation``; of lists of points ``ids``, of these and models for
        simulators ``frame``.
    sentence : str
        What is wrong.
    remedy : str
        What to do about it: an imperative; empty where nothing is better than to export the file again.
    """

    kind: str
    sentence: str
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.sentence}; {self.remedy}" if self.remedy else self.sentence

    def about(self, subject: str) -> "Finding":
        """The same about one of several plates or copies, which the sentence then begins with."""
        return replace(self, sentence=f"{subject}: {self.sentence}")


REMOVE = "remove what is not the marker's, or export it again"

SHEET = "a plate with a recess for the printed sheet and no dots of its own: verify the sheet"

NO_PLATE = Finding("no dots", "no marker of the rig is in it", "export it again, or verify it against its own rig")


def scale_finding(x: float, y: float, half: Array, tolerance: float, pixels: bool = False) -> Finding:
    """Finding about a scale along x and y, of a layout with half its width and height and a tolerance in mm.

    With `pixels` the scale is that of an image's resolution.
    """
    exact = np.abs(np.array([x, y]) - 1) * half <= tolerance
    both = abs(x - y) * half.max() <= 2 * tolerance
    numbers = [f"{value:.5f}".rstrip("0").rstrip(".") if value < 10 else f"{value:.6g}" for value in (x, y)]
    if both:
        sentence = f"scaled by {numbers[0]} along x and y"
    elif exact[1] or exact[0]:
        sentence = f"scaled by {numbers[0]} along x" if exact[1] else f"scaled by {numbers[1]} along y"
    else:
        sentence = f"scaled by {numbers[0]} along x and by {numbers[1]} along y"
    ratio = (x * y) ** 0.5
    nearest = nearest_mistake(ratio)
    if both and abs(np.log(ratio / nearest)) < 2e-3:
        why, remedy = OF_SHEETS[nearest]
        return Finding("scaled", f"{sentence}: {why}", remedy)
    if pixels:
        return Finding("scaled", sentence, "print it at its full size; export it again if its resolution was changed")
    if both and ratio < 0.99:
        return Finding("scaled", f"{sentence}, perhaps fitted to smaller paper", FIT_TO_PAGE)
    return Finding("scaled", sentence, FIT_TO_PAGE)


def listed_ids(ids: Sequence[int]) -> str:
    """Return dots as the beginning of a sentence: ``dot 3 is`` or ``dots 1, 2 are``."""
    listed = ", ".join(map(str, ids[:MOST_LISTED])) + (" ..." if len(ids) > MOST_LISTED else "")
    return f"dot {listed} is" if len(ids) == 1 else f"dots {listed} are"


def short_length(value: float) -> str:
    """Return a length in mm or, if short, in um."""
    return f"{value:.4g} mm" if value >= 0.01 else f"{1e3 * value:.3g} um"


def somewhere(kind: str, what: str, points: Array, remedy: str) -> list[Finding]:
    """Return a finding about what is at points (k, 3) in mm; none without any."""
    if not len(points):
        return []
    spans = zip("xyz", points.min(axis=0).tolist(), points.max(axis=0).tolist(), strict=True)
    place = ", ".join(f"{axis} {round(low, 2) + 0.0:.4g} to {round(high, 2) + 0.0:.4g}" for axis, low, high in spans)
    return [Finding(kind, f"there is {what}: {place} mm", remedy)]
