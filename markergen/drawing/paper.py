"""Paper is data: names and exact sizes in millimeters."""

from dataclasses import dataclass
from difflib import get_close_matches

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

    def __str__(self) -> str:
        return f"{self.name} ({self.width:g} x {self.height:g} mm)"


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


def find_paper(name: str) -> Paper:
    """Paper of that name, in any case.

    Raises
    ------
    InputError
        If there is none; the message lists the known ones and the nearest.
    """
    wanted = name.strip().lower().removesuffix("-portrait")
    if wanted in PAPERS:
        return PAPERS[wanted]
    near = get_close_matches(wanted, PAPERS, n=1)
    hint = f"did you mean {PAPERS[near[0]].name!r}? Known: " if near else "known: "
    known = ", ".join(paper.name for paper in ISO + AMERICAN)
    raise InputError("a known paper size", repr(name), f"{hint}{known}, each also with -landscape")
