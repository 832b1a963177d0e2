"""Paper of a sheet: known sizes, the area inside the margins, and the user's options."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from math import sqrt
from typing import Literal

from markergen.drawing.colors import BLACK_ON_WHITE, Colors
from markergen.errors import InputError

DESCENT = 0.65
"""Depth of letters below their baseline, mm on A4."""

LEAST_ROOM = 70.0
"""Minimum width and height between the margins, mm, to fit text below the marker."""


@dataclass(frozen=True)
class Paper:
    """Sheet size in mm."""

    name: str
    width: float
    height: float

    @property
    def landscape(self) -> "Paper":
        """The same sheet in landscape orientation."""
        return Paper(f"{self.name}-landscape", self.height, self.width)

    @property
    def turned(self) -> "Paper":
        """The same sheet in the other orientation, by its usual name."""
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
"""ISO 216 sizes from small to large, upright: the candidates when no paper is named."""

AMERICAN = (
    Paper("letter", 215.9, 279.4),
    Paper("legal", 215.9, 355.6),
    Paper("tabloid", 279.4, 431.8),
)

PAPERS = {paper.name.lower(): paper for upright in ISO + AMERICAN for paper in (upright, upright.landscape)}
"""All papers by lower-case name; ``-landscape`` after the name turns a sheet, upright is the default."""

NAMES = tuple(paper.name for paper in PAPERS.values())
"""Names of all papers as they are written."""

SMALLEST, LARGEST = 100.0, 5000.0
"""Limits of the sides of custom paper, mm: no marker with its rulers fits on less; a PDF ends at 5080 mm."""

_CUSTOM = re.compile(r"([\d.]+)\s*(?:mm)?\s*[xX*]\s*([\d.]+)\s*mm")

Orientation = Literal["", "portrait", "landscape"]
"""Orientation of a sheet; empty for the one implied by its name."""


@dataclass(frozen=True)
class Frame:
    """Margins of a page and heights of the items at its foot, mm; they grow less than proportionally with the paper.

    Attributes
    ----------
    edge : float or None
        Distance of all ink from the paper's edge, mm; None for about `12 * scale`, more than any printer's margin.

    Raises
    ------
    InputError
        If the margin is negative or leaves no room to print on.
    """

    paper: Paper
    edge: float | None = None

    def __post_init__(self) -> None:
        if (self.edge or 0.0) < 0 or min(self.width, self.paper.height - 2 * self.margin) < LEAST_ROOM:
            raise InputError(
                f"a printer margin from 0 that leaves {LEAST_ROOM:g} x {LEAST_ROOM:g} mm of {self.paper}",
                f"{self.margin if self.edge is None else self.edge:g} mm",
                "give a smaller margin or larger paper",
            )

    @property
    def scale(self) -> float:
        """Size of text and gaps relative to A4."""
        return min(max(sqrt(min(self.paper.width, self.paper.height) / 210), 0.84), 2.0)

    @property
    def margin(self) -> float:
        """Distance of baselines from the paper's edge; letters extend slightly beyond, but not into a given margin."""
        return (12 if self.edge is None else DESCENT) * self.scale + (self.edge or 0.0)

    @property
    def right(self) -> float:
        """Position of the right margin along x."""
        return self.paper.width - self.margin

    @property
    def top(self) -> float:
        """Position of the upper margin along y."""
        return self.paper.height - self.margin

    @property
    def width(self) -> float:
        """Width between the margins."""
        return self.paper.width - 2 * self.margin

    @property
    def block_top(self) -> float:
        """Height of the hairline above the title block."""
        return self.margin + 9 * self.scale

    @property
    def checks_y(self) -> float:
        """Height of the lowest line of the lengths to measure; the remedies are below it."""
        return self.block_top + 10.4 * self.scale

    @property
    def ruler_y(self) -> float:
        """Height of the ruler's base line."""
        return self.block_top + 21.5 * self.scale

    @property
    def footer(self) -> float:
        """Height of the lower edge of the marker's region."""
        return self.ruler_y + 13.5 * self.scale

    @property
    def region(self) -> tuple[float, float, float, float]:
        """Part of the page for the marker and its annotations."""
        return self.margin, self.footer, self.right, self.top


MARKER_FILE = "marker.json"
"""File name of a marker where it has none."""


@dataclass(frozen=True)
class SheetOptions:
    """Options of printed sheets; lengths in m.

    Attributes
    ----------
    paper : str or None
        Name or size (`find_paper`); None for the smallest ISO size from A5 to A0 that holds the marker, or from A4 on
        for several markers.
    orientation : {"", "portrait", "landscape"}
        Empty for that of the paper's name; if the name has none, upright unless only landscape holds the marker.
    margin : float or None
        Distance of all ink from the paper's edge; None for 10 to 24 mm, depending on the paper size.
    tile : bool
        True to put a marker larger than the paper on several sheets; otherwise it is rejected.
    overlap : float
        Width of the strip that neighboring tiles both print.
    compensate : bool
        True to draw a marker that was measured on a print (`print_scale`) so that the same printer prints it true.
    colors : Colors
    records : tuple of str
        File names of the markers in their order, which commands on their sheets give; one alone is that of all, as of a
        rig's; `MARKER_FILE` without any, and where one is empty.

    Raises
    ------
    InputError
        If paper or orientation are unknown, or margin or overlap is not a nonnegative length.
    """

    paper: str | None = None
    orientation: Orientation = ""
    margin: float | None = None
    tile: bool = True
    overlap: float = 0.010
    compensate: bool = False
    colors: Colors = BLACK_ON_WHITE
    records: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.orientation not in ("", "portrait", "landscape"):
            raise InputError("portrait or landscape", repr(self.orientation), "choose one of these")
        if self.paper is not None:
            find_paper(self.paper, self.orientation)
        for name, article, value in (("margin", "a", self.margin), ("overlap", "an", self.overlap)):
            if value is not None and not 0 <= value < float("inf"):
                raise InputError(f"{article} {name} from 0", f"{name}={value}", "give a length such as 10mm")

    def records_of(self, count: int) -> tuple[str, ...]:
        """File names of a number of markers."""
        records = self.records or ("",)
        return records * count if len(records) == 1 else records

    def frame(self, paper: Paper) -> Frame:
        """Frame of a page of the given paper; raises as `Frame` does."""
        return Frame(paper, None if self.margin is None else round(self.margin * 1e3, 9))

    def candidates(self, sizes: Sequence[Paper] | None = None) -> list[Frame]:
        """Pages to try, of which the first that holds the marker is taken.

        That is the named paper, in both orientations unless one is given; without a name each of the sizes (default:
        A5 to A0), the smallest first.
        """
        sizes = ISO if sizes is None else sizes
        if self.paper is not None:
            paper = find_paper(self.paper, self.orientation)
            fixed = self.orientation or oriented(self.paper)
            return [self.frame(candidate) for candidate in ((paper,) if fixed else (paper, paper.turned))]
        if self.orientation:
            return self.frames([find_paper(size.name, self.orientation) for size in sizes])
        return self.frames(both_ways(sizes))

    def frames(self, papers: Sequence[Paper]) -> list[Frame]:
        """Frames of candidate pages, without those that the margin leaves no room on, unless none remain."""
        frames = []
        for paper in papers:
            try:
                frames.append(self.frame(paper))
            except InputError:
                if paper is papers[-1] and not frames:
                    raise
        return frames


LETTER = frozenset(["BZ", "CA", "CL", "CO", "CR", "GT", "MX", "NI", "PA", "PH", "PR", "SV", "US", "VE"])
"""Territories whose printers hold letter paper (Unicode CLDR); those of all others hold A4."""


def paper_of_locale(environment: Mapping[str, str]) -> str:
    """Return the paper that printers hold where the user lives, A4 or letter; A4 if the locale names no territory.

    >>> paper_of_locale({"LANG": "en_US.UTF-8"}), paper_of_locale({"LANG": "C.UTF-8"}), paper_of_locale({})
    ('letter', 'A4', 'A4')
    """
    locale = next(filter(None, map(environment.get, ("LC_ALL", "LC_PAPER", "LANG"))), "")
    territory = re.split(r"[.@]", locale)[0].rpartition("_")[2]
    return "letter" if territory in LETTER else "A4"


def both_ways(sizes: Sequence[Paper]) -> list[Paper]:
    """Each size in portrait and then in landscape orientation."""
    return [paper for size in sizes for paper in (size, size.landscape)]


def find_paper(name: str, orientation: Orientation = "") -> Paper:
    """Find a paper by name, in any case, or by size such as ``300x400mm``.

    An orientation rotates it if necessary; the suffix of a name (``A4-landscape``) must not contradict it.

    Raises
    ------
    InputError
        If the name is unknown (the message lists the known ones and the nearest), a size is out of range, or name and
        orientation disagree.
    """
    stem, _, ending = name.strip().lower().rpartition("-")
    wanted = stem if ending == "portrait" else name.strip().lower()
    ending = ending if ending in ("portrait", "landscape") else ""
    if orientation and ending and orientation != ending:
        raise InputError(f"paper {orientation}, as asked for", repr(name), f"leave out -{ending} or the orientation")
    size = _CUSTOM.fullmatch(wanted.removesuffix("-landscape"))
    if size:
        paper = _custom_from(name, size[1], size[2])
        is_turned = (orientation or ending) and (paper.width > paper.height) != ((orientation or ending) == "landscape")
        return paper.turned if is_turned and paper.width != paper.height else paper
    if wanted in PAPERS:
        paper = PAPERS[wanted]
        return paper.landscape if orientation == "landscape" and not ending else paper
    matches = get_close_matches(wanted, PAPERS, n=1)
    hint = f"did you mean {PAPERS[matches[0]].name!r}? Known: " if matches else "known: "
    names = ", ".join(paper.name for paper in ISO + AMERICAN)
    raise InputError(
        "a known paper size", repr(name), f"{hint}{names}, each also with -landscape, or a size such as 300x400mm"
    )


def oriented(name: str) -> bool:
    """True if the name of a paper specifies its orientation."""
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
