"""Results of a verification: findings, what is wrong with a file in the user's words and what to do about it.

The check of each file has them, and all checks are there to print, save and iterate over.
"""

# tests: tests/verification/test_check.py tests/api/test_verify.py

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from markergen.arrays import Array
from markergen.files import Written
from markergen.presentation.results import SavableResult, json_bytes
from markergen.presentation.tables import Table, data_frame

if TYPE_CHECKING:
    from pandas import DataFrame

MOST_LISTED = 8
"""Maximum number of findings of a kind, or of dots in one, that are listed; the rest is counted or left out."""

FIT_TO_PAGE = "print or save it at 100 %, without fitting it to the page"
SMALLER_PAPER = ", perhaps fitted to smaller paper"

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


THROUGH_PLANE = "mirrored through its plane: all heights have the opposite sign"

PLATE_FLAGS = {"outline": "--outline", "holes": "--mount or --dowel"}
"""Options of an export that make a plate another one, by what differs; of others the name is that of the option."""


def other_plate(keys: Sequence[str]) -> Finding:
    """Finding about a file that is made for another plate than marker.json's, by what differs of it."""
    what = ", ".join(key.replace("_", " ") for key in keys)
    flags = ", ".join(PLATE_FLAGS.get(key, f"--{key.replace('_', '-')}") for key in keys)
    remedy = f"verify it with the options of its export: {flags}" if keys else "give the options of its export"
    return Finding("outline", f"made for another plate than marker.json's: {what or 'of another marker'}", remedy)


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
        return Finding("scaled", f"{sentence}{SMALLER_PAPER}", FIT_TO_PAGE)
    return Finding("scaled", sentence, FIT_TO_PAGE)


def listed_ids(ids: Sequence[int]) -> str:
    """Return dots as the beginning of a sentence: ``dot 3 is`` or ``dots 1, 2 are``."""
    listed = ", ".join(map(str, ids[:MOST_LISTED])) + (" ..." if len(ids) > MOST_LISTED else "")
    return f"dot {listed} is" if len(ids) == 1 else f"dots {listed} are"


def short_length(value: float) -> str:
    """Return a length in mm or, if short, in um; what is less than a nm is the rounding of numbers."""
    return f"{value:.4g} mm" if value >= 0.01 else f"{round(1e3 * value, 3):.3g} um"


def along_axes(x: float, y: float) -> str:
    """What something is off along x and y, of mm, to the nm: ``(x +200 um, y +0 um)``."""
    return "(" + ", ".join(f"{axis} {round(1e3 * off, 3) + 0.0:+.4g} um" for axis, off in (("x", x), ("y", y))) + ")"


def somewhere(kind: str, what: str, points: Array, remedy: str) -> list[Finding]:
    """Return a finding about what is at points (k, 3) in mm; none without any."""
    if not len(points):
        return []
    spans = zip("xyz", points.min(axis=0).tolist(), points.max(axis=0).tolist(), strict=True)
    place = ", ".join(f"{axis} {round(low, 2) + 0.0:.4g} to {round(high, 2) + 0.0:.4g}" for axis, low, high in spans)
    return [Finding(kind, f"there is {what}: {place} mm", remedy)]


_CAPTION = (
    "The largest distance of a dot from its place in the design, by the best rotation and translation; what was "
    "measured on a print does not count. Along x and y: what 1 mm of the marker is in the file; at 99.9 % a ruler of "
    "100 mm measures 99.9 mm."
)

_HEADER = ("file", "dots", "largest error", "along x", "along y", "page", "")

STRANGE = {"another marker", "no dots", "part"}
"""Kinds of findings about a file that does not have the marker's dots, or no plate."""

_SHOWN = 8
"""Maximum number of files that a repr lists."""


@dataclass(frozen=True)
class Check:
    """Result of verifying one file.

    Attributes
    ----------
    kind : str
        File format, such as ``PDF``.
    dots : int
        Number of dots found with sizes of the marker's dots.
    copies : int
        Number of times that the marker is in the file.
    largest : float
        Largest distance in m between a dot and its position in marker.json, after the best rigid motion (no scale); nan
        if the dots are not the marker's.
    worst : int, str or None
        Id of that dot; of a rig with the name of its marker, ``+x/3``.
    scale : (x, y)
        Ratio of the distances between dots in the file to those in marker.json, along the marker's axes.
    pages : tuple of (width, height) or None
        Paper sizes in mm.
    tolerance : float
        Tolerance in m that was applied.
    findings : tuple of Finding
        What is wrong; empty if the file passes.
    notes : tuple of str
        Remarks for the user that are not errors.
    error : str
        Why the file could not be used; empty otherwise.
    """

    path: str
    kind: str = ""
    dots: int = 0
    copies: int = 0
    largest: float = np.nan
    worst: int | str | None = None
    scale: tuple[float, float] = (np.nan, np.nan)
    pages: tuple[tuple[float, float] | None, ...] = ()
    tolerance: float = np.nan
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    error: str = ""

    @property
    def passed(self) -> bool:
        """True if the file could be used and has no findings."""
        return not self.error and not self.findings

    @property
    def kinds(self) -> set[str]:
        """Kinds of the findings."""
        return {finding.kind for finding in self.findings}

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values; missing values are null."""
        return {
            "file": self.path,
            "format": self.kind or None,
            "passed": self.passed,
            "error": self.error or None,
            "largest_m": _number(self.largest),
            "worst_dot": self.worst,
            "tolerance_m": _number(self.tolerance),
            "scale_x": _number(self.scale[0]),
            "scale_y": _number(self.scale[1]),
            "dots": self.dots,
            "copies": self.copies,
            "pages_mm": [[_number(side) for side in page] if page else None for page in self.pages],
            "findings": [
                {"kind": finding.kind, "sentence": finding.sentence, "remedy": finding.remedy}
                for finding in self.findings
            ],
            "notes": list(self.notes),
        }


def is_strange(check: Check) -> bool:
    """Tell whether a file does not have the marker's dots, or no plate."""
    return bool(check.kinds & STRANGE)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


class Verification(SavableResult, Sequence[Check]):
    """Result of `markergen.verify`: a sequence with one `Check` per file, in order.

    ``print(verification)`` shows what the command prints. `passed` is true if all files are right; like any sequence,
    a verification is true unless it is empty.

    Parameters
    ----------
    checks : sequence of Check
    written : sequence of Written
        Files that were written together with the results.

    Examples
    --------
    >>> import markergen as mg
    >>> marker = mg.design(n=4, radius="50mm", dot="12mm", restarts=2).marker
    >>> written = marker.save("marker.svg", "marker.csv")
    >>> verification = mg.verify(marker, "marker.svg", "marker.csv")
    >>> verification.passed, [check.kind for check in verification]
    (True, ['SVG', 'CSV'])
    """

    def __init__(self, checks: Sequence[Check], written: Sequence[Written] = ()) -> None:
        self._checks, self.written = tuple(checks), tuple(written)

    @property
    def passed(self) -> bool:
        """True if every file could be used and has no findings."""
        return all(check.passed for check in self._checks)

    @property
    def usable(self) -> bool:
        """True if every file could be read; otherwise the `error` of its check says why."""
        return not any(check.error for check in self._checks)

    def __len__(self) -> int:
        return len(self._checks)

    def __iter__(self) -> Iterator[Check]:
        return iter(self._checks)

    @overload
    def __getitem__(self, index: int) -> Check: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Check, ...]: ...
    def __getitem__(self, index: int | slice) -> Check | tuple[Check, ...]:
        return self._checks[index]

    def to_json(self) -> bytes:
        """Return the results as JSON text: one array for all files."""
        return json_bytes([check.as_dict() for check in self._checks])

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with one row per file.

        Its columns are named as in the JSON: ``file``, ``format``, ``passed``, ``error``, ``largest_m``, ``worst_dot``,
        ``tolerance_m``, ``scale_x``, ``scale_y``, ``dots``, ``copies``, and, as text, ``findings`` and ``notes``.

        Raises
        ------
        MissingLibraryError
            If pandas is not installed.
        """
        rows = []
        for check in self._checks:
            row = check.as_dict()
            del row["pages_mm"]
            row["findings"] = "; ".join(map(str, check.findings))
            row["notes"] = "; ".join(check.notes)
            rows.append(row)
        return data_frame(rows)

    def parts(self) -> list[str | Table]:
        """Return a table and sentences about the usable files, and the errors of the others."""
        errors = [f"error: {check.error}" for check in self._checks if check.error]
        return [*self.findings(), *errors]

    def findings(self) -> list[str | Table]:
        """Return a table and sentences about the usable files."""
        checks = [check for check in self._checks if not check.error]
        sentences = [f"{check.path}: {line}" for check in checks for line in (*map(str, check.findings), *check.notes)]
        return [Table("", _HEADER, [_row(check) for check in checks], _CAPTION), *sentences] if checks else []

    def __repr__(self) -> str:
        verdicts = [
            f"{check.path[-80:]} {'unusable' if check.error else 'ok' if check.passed else 'WRONG'}"
            for check in self._checks[:_SHOWN]
        ]
        more = [f"and {len(self) - _SHOWN} more"] if len(self) > _SHOWN else []
        return f"<Verification: {', '.join([*verdicts, *more])}>"


def _row(check: Check) -> list[str]:
    papers = {(round(page[0], 2), round(page[1], 2)) for page in check.pages if page}
    paper = " ".join(f"{width:g} x {height:g} mm" for width, height in sorted(papers))
    pages = f"{len(check.pages)} x {paper}" if len(check.pages) > 1 else paper
    return [
        check.path,
        str(check.dots),
        f"{short_length(1e3 * check.largest)} (dot {check.worst})" if check.worst is not None else "-",
        *(f"{100 * scale:.4f} %" if np.isfinite(scale) else "-" for scale in check.scale),
        pages or "-",
        "ok" if check.passed else "WRONG",
    ]
