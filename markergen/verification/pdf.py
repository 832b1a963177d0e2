"""Read a PDF as others see it, through PDFium in a child process: exact paths, and a picture of each page.

The pages of a marker larger than the paper are assembled by their registration marks: crosses on the seams, printed
whole on both neighbors. Seams are the sides where a page is trimmed. Tiles come row by row from the top left; the first
of a row has no seam on its left.
"""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.geometry.region import Region
from markergen.guard import Content, in_child
from markergen.model.body import Body
from markergen.verification.matching import dots_on_page, expected_dots
from markergen.verification.pdf_parser import FINEST
from markergen.verification.png import pixel_page, tolerance_of
from markergen.verification.reading import (
    ALIKE,
    READERS,
    Page,
    PagePicture,
    Reading,
    Settings,
    circle_diameters,
    findings_of,
    of_painted_again,
    round_shape,
)

PARSER = Path(__file__).with_name("pdf_parser.py")

ROUNDED = 0.6
"""Tolerance in pixels of a page of pixels: half of one, by which dots move if programs round its size, and some."""

TILE_TOLERANCE = 1e-3
"""Maximum distance in mm between the registration marks of neighboring tiles."""

ON_SEAM = 2.0
"""Maximum distance in mm of a cross from its seam: the shift due to a scale error of 1 % on large paper."""

PIECE = 0.25
"""Minimum size of a piece of a circle, as a share of its diameter."""


@dataclass(frozen=True, eq=False)
class TilePage:
    """A page with the data needed to assemble it with others.

    Attributes
    ----------
    crosses : array (k, 2)
        Points in mm where two lines of equal length bisect each other.
    trim : array (4,)
        Seams on the left, below, on the right and above, mm; nan for a side that is not trimmed.
    arcs : tuple of arrays (m, 2)
        Points in mm of outlines that contain arcs of circles.
    """

    page: Page
    crosses: Array
    trim: Array
    arcs: tuple[Array, ...] = ()

    @property
    def is_tile(self) -> bool:
        """True if it has seams, and is to be assembled with others."""
        return bool(np.isfinite(self.trim).any())

    @property
    def kept(self) -> Array:
        """Box (left, bottom, right, top) that remains after trimming."""
        return np.where(np.isfinite(self.trim), self.trim, [-np.inf, -np.inf, np.inf, np.inf])

    def marks(self, side: int) -> Array:
        """Crosses on one seam, sorted along it; empty if there is no seam."""
        axis = side % 2
        chosen = self.crosses[np.abs(self.crosses[:, axis] - self.trim[side]) < ON_SEAM]
        return chosen[np.argsort(chosen[:, 1 - axis])]


@READERS.register(".fab.pdf")
def read_fabrication_sheet(data: bytes, name: str, body: Body, settings: Settings) -> Reading:
    """Refuse a drawing to scale, in which no dot can be measured."""
    del data, body, settings
    raise InputError(
        "a file with the marker at true size",
        f"the fabrication sheet {brief(name)}, a drawing to scale",
        "verify the solid that goes with it: .step, .3mf, .stl or .glb",
    )


@READERS.register(".pdf")
def read_pdf(data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read circles, corners, lines and a picture of all pages of a PDF; tiles are assembled by their marks."""
    reply = in_child(PARSER, "parse_pdf", Content(name, data), "PDF", f"a complete PDF in {name}")
    are_cut = any(reply.arrays[f"cut{index}"].any() for index in range(len(reply.values["pages"])))
    sheets = [_sheet(values, reply.arrays, index, are_cut) for index, values in enumerate(reply.values["pages"])]
    pages = tuple(sheet.page for sheet in sheets)
    if any(sheet.is_tile for sheet in sheets):
        whole = [assembled(sheets, indices, circle_diameters(body)) for indices in markers_of(sheets)]
        gaps = findings_of((gap for _, gaps in whole for gap in gaps), "marks", "", None)
        papers = tuple(page.size for page in pages)
        return Reading("PDF", tuple(page for page, _ in whole), papers=papers, findings=gaps)
    finest = max((values["image"] for values in reply.values["pages"]), default=0.0)
    expected = [expected_dots(plate.marker) for plate in body.plates]
    if finest and not any(len(dots_on_page(page, dots)) for page in pages for dots in expected):
        drawn = []
        for index, values in enumerate(reply.values["pages"]):
            grey = reply.arrays.get(f"picture{index}", np.zeros((0, 0), np.uint8))
            drawn.append(pixel_page(grey, values["shown"], body, name) if grey.size else Page(np.zeros((0, 4))))
        tolerance = tolerance_of(min(finest, FINEST), ROUNDED)
        note = f"pictures of {25.4 * finest:.0f} dpi without paths: places are allowed {1e6 * tolerance:.0f} um"
        return Reading("PDF", tuple(drawn), tolerance, notes=(note,))
    again = [shape for values in reply.values["pages"] for shape in values["again"]]
    return Reading("PDF", pages, findings=of_painted_again(again, body))


def _sheet(values: Mapping[str, Any], arrays: Mapping[str, Any], index: int, are_cut: bool) -> TilePage:
    width, height = values["size"]
    grey = arrays.get(f"picture{index}")
    picture = PagePicture.of_pixels(grey, values["shown"]) if grey is not None and grey.size else None
    lines = arrays[f"lines{index}"]
    page = Page(
        arrays[f"circles{index}"],
        (width, height),
        arrays[f"corners{index}"],
        picture=picture,
        lines=lines[arrays[f"cut{index}"]] if are_cut else lines,
        are_cut=are_cut,
    )
    arcs = np.split(arrays[f"arcs{index}"], arrays[f"arc_ends{index}"][:-1]) if len(arrays[f"arcs{index}"]) else []
    return TilePage(page, arrays[f"crosses{index}"], np.array(values["trim"], dtype=float), tuple(arcs))


def markers_of(sheets: Sequence[TilePage]) -> list[range]:
    """Ranges of pages with the tiles of one marker each: the first one has seams neither on its left nor above."""
    tiles = [index for index, sheet in enumerate(sheets) if sheet.is_tile]
    starts = [index for index in tiles if np.isnan(sheets[index].trim[[0, 3]]).all()]
    starts = sorted({tiles[0], *starts})
    return [range(start, end) for start, end in zip(starts, [*starts[1:], len(sheets)], strict=True)]


def assembled(sheets: Sequence[TilePage], indices: Iterable[int], diameters: Sequence[float]) -> tuple[Page, list[str]]:
    """Tiles of one marker as one page, and the errors that their marks show.

    Each tile is shifted so that its marks lie on those of its neighbors on the left and above, which come before it.
    """
    tiles: dict[tuple[int, int], tuple[int, TilePage, Array]] = {}
    gaps, (row, column) = list[str](), (-1, 0)
    for index in indices:
        sheet = sheets[index]
        if not sheet.is_tile:
            continue
        row, column = (row + 1, 0) if np.isnan(sheet.trim[0]) or row < 0 else (row, column + 1)
        ties = [np.zeros((0, 2))]
        for side, there in ((0, (row, column - 1)), (3, (row - 1, column))):
            if there not in tiles:
                continue
            number, neighbor, offset = tiles[there]
            mine, theirs = sheet.marks(side), neighbor.marks((side + 2) % 4)
            if len(mine) == len(theirs):
                ties.append(theirs + offset - mine)
            else:
                both = f"pages {number + 1} and {index + 1}"
                gaps.append(f"{both} differ in the number of registration marks on their seam")
        offsets = np.concatenate(ties)
        if tiles and not len(offsets):
            gaps.append(f"page {index + 1} has no registration marks that those of its neighbors fit")
        offset = offsets.mean(axis=0) if len(offsets) else np.zeros(2)
        off = float(np.linalg.norm(offsets - offset, axis=1).max(initial=0.0))
        if off > TILE_TOLERANCE:
            gaps.append(f"the registration marks of page {index + 1} and its neighbors are {1e3 * off:.3g} um apart")
        tiles[row, column] = index, sheet, offset
    placed = [(sheet, offset) for _, sheet, offset in tiles.values()]
    page = Page(
        np.concatenate(
            [*(sheet.page.circles + [*offset, 0.0, 0.0] for sheet, offset in placed), _joined(placed, diameters)]
        ),
        None,
        np.concatenate([sheet.page.corners + offset for sheet, offset in placed]),
        picture=PagePicture.of_tiles([(sheet.page.picture, offset, sheet.kept) for sheet, offset in placed]),
        lines=np.concatenate([sheet.page.lines + offset for sheet, offset in placed if sheet.page.lines is not None]),
        are_cut=placed[0][0].page.are_cut,
    )
    return page, gaps


def _joined(placed: Sequence[tuple[TilePage, Array]], diameters: Sequence[float]) -> Array:
    """Circles (m, 4) of about these diameters that pieces on several tiles form, which overlap."""
    tiles = []
    for sheet, offset in placed:
        sizes = [float(np.ptp(arc, axis=0).max()) for arc in sheet.arcs]
        # A sliver of less would be whole on the neighbor; letters are smaller.
        rings = (Region.polygon(arc + offset, mend=True) for arc, size in zip(sheet.arcs, sizes, strict=True)
                 if PIECE * min(diameters) < size < ALIKE * max(diameters))  # fmt: skip
        tiles.append(reduce(xor, rings, Region()))
    circles = [round_shape(ring) for ring in Region.union(tiles).rings]
    return np.array([circle for circle in circles if circle], dtype=float).reshape(-1, 4)
