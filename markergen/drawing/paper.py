"""Paper is data: names and exact sizes in millimeters."""

import re
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal

from markergen.errors import InputError


@dataclass(frozen=True)
class Paper:
    """A sheet size in mm."""

    name: str
    width: float
    height: float

    @property
    def landscape(self) -> "Paper":
        """The same sheet turned."""
        return Paper(f"{self.name}-landscape", self.height, self.width)

    @property
    def turned(self) -> "Paper":
        """The same sheet the other way round, by its usual name."""
        if self.name.endswith("mm"):
            return _custom(self.height, self.width)
        return PAPERS[self.name.removesuffix("-landscape").lower()] if self.width > self.height else self.landscape

    def __str__(self) -> str:
        custom = self.name.endswith("mm")
        return (
            f"{self.width:g} x {self.height:g} mm" if custom else f"{self.name} ({self.width:g} x {self.height:g} mm)"
        )


ISO = (
    Paper("A5", 148, 210),
    Paper("A4", 210, 297),
    Paper("A3", 297, 420),
    Paper("A2", 420, 594),
    Paper("A1", 594, 841),
    Paper("A0", 841, 1189),
)
"""ISO 216 sizes from small to large, upright: what is chosen from when no paper is named."""

AMERICAN = (
    Paper("letter", 215.9, 279.4),
    Paper("legal", 215.9, 355.6),
    Paper("tabloid", 279.4, 431.8),
)

PAPERS = {paper.name.lower(): paper for upright in ISO + AMERICAN for paper in (upright, upright.landscape)}
"""All papers by lower-case name; ``-landscape`` after the name turns a sheet, upright is the default."""


SMALLEST, LARGEST = 100.0, 5000.0
"""Sides in mm of paper of any size: below, no marker fits beside what it is checked by; a PDF ends at 5080 mm."""

_CUSTOM = re.compile(r"([\d.]+)\s*(?:mm)?\s*[xX*]\s*([\d.]+)\s*mm")

Orientation = Literal["", "portrait", "landscape"]
"""Which way round a sheet is used; empty: as its name says."""


def find_paper(name: str, orientation: Orientation = "") -> Paper:
    """Paper of that name in any case, or of a size such as ``300x400mm``.

    An orientation turns it if need be; the ending of a name (``A4-landscape``) must not contradict it.

    Raises
    ------
    InputError
        If there is none of that name (the message lists the known ones and the nearest), a size is beyond all reason,
        or name and orientation disagree.
    """
    stem, _, ending = name.strip().lower().rpartition("-")
    wanted = stem if ending == "portrait" else name.strip().lower()
    ending = ending if ending in ("portrait", "landscape") else ""
    if orientation and ending and orientation != ending:
        raise InputError(f"paper {orientation}, as asked for", repr(name), f"leave out -{ending} or the orientation")
    size = _CUSTOM.fullmatch(wanted.removesuffix("-landscape"))
    if size:
        paper = _custom_from(name, size[1], size[2])
        turn = (orientation or ending) and (paper.width > paper.height) != ((orientation or ending) == "landscape")
        return paper.turned if turn and paper.width != paper.height else paper
    if wanted in PAPERS:
        paper = PAPERS[wanted]
        return paper.landscape if orientation == "landscape" and not ending else paper
    near = get_close_matches(wanted, PAPERS, n=1)
    hint = f"did you mean {PAPERS[near[0]].name!r}? Known: " if near else "known: "
    known = ", ".join(paper.name for paper in ISO + AMERICAN)
    raise InputError(
        "a known paper size", repr(name), f"{hint}{known}, each also with -landscape, or a size such as 300x400mm"
    )


def oriented(name: str) -> bool:
    """Whether the name of a paper says which way round it is."""
    return name.strip().lower().endswith(("-portrait", "-landscape")) or bool(_CUSTOM.fullmatch(name.strip().lower()))


def _custom_from(name: str, width: str, height: str) -> Paper:
    try:
        sides = float(width), float(height)
    except ValueError:
        raise InputError("a paper size", repr(name), "write it as 300x400mm") from None
    if not all(SMALLEST <= side <= LARGEST for side in sides):
        raise InputError(f"paper of {SMALLEST:g} to {LARGEST:g} mm a side", repr(name), "give another size")
    return _custom(*sides)


def _custom(width: float, height: float) -> Paper:
    return Paper(f"{width:.6g}x{height:.6g}mm", width, height)
