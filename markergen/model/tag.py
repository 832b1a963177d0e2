"""Square tags: the bit patterns of ArUco and AprilTag as cells of ink in the marker frame."""

from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ARUCO = [f"{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)]
FAMILIES: dict[str, str] = {
    **{f"aruco:DICT_{name}": f"DICT_{name}" for name in [*_ARUCO, "ARUCO_ORIGINAL", "ARUCO_MIP_36H12"]},
    **{f"apriltag:{name}": f"DICT_APRILTAG_{name.upper()}" for name in ("16h5", "25h9", "36h10", "36h11")},
}
"""What users call a family of tags, and what OpenCV calls its dictionary."""

UNITS = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
"""Corners of a square of side 1: top left, top right, bottom right, bottom left, as OpenCV orders a tag's corners."""


_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
_STARTS = ((0, 0), (1, 0), (1, 1), (0, 1))
"""The four borders of a cell, clockwise from the top: steps along them (column, row), and where each begins."""


@dataclass(frozen=True)
class Tag:
    """A square tag, upright in the middle of the marker frame.

    Attributes
    ----------
    family : str
        A key of `FAMILIES`, such as ``aruco:DICT_4X4_50`` or ``apriltag:36h11``.
    id : int
    side : float
        Of the black square, m; the white quiet zone, one cell wide, lies outside of it.

    Raises
    ------
    InputError
        If the family is unknown, the family has no such id, or the side is not a positive finite number.
    """

    family: str
    id: int
    side: float

    def __post_init__(self) -> None:
        most = family_size(self.family)
        if not 0 <= self.id < most:
            raise InputError(f"an id of 0 to {most - 1} in {self.family}", f"id={self.id}", "choose one of these")
        if not (isfinite(self.side) and self.side > 0):
            raise InputError("a tag side above 0", f"side={self.side} m", "give a length such as 50mm")

    def __str__(self) -> str:
        return f"{self.family}:{self.id}"

    @property
    def cells(self) -> int:
        """Cells along one side of the black square: the bits and a border of one cell on both sides."""
        return family_bits(self.family) + 2

    @property
    def outer_side(self) -> float:
        """Side in m of the square with its quiet zone, one cell all around."""
        return self.side * (self.cells + 2) / self.cells

    @property
    def ink(self) -> Mask:
        """Which cells (cells, cells) are black; row 0 is the top one, column 0 the left one."""
        return tag_ink(self.family, self.id)

    @property
    def corners(self) -> Array:
        """Corners (4, 2) of the black square in m: top left, top right, bottom right, bottom left."""
        return self.side * UNITS

    @property
    def outlines(self) -> tuple[Array, ...]:
        """Outlines (m, 2) of all ink, m, to be filled even-odd; neighboring black cells are one."""
        scale = self.side / self.cells
        return tuple(to_plane(outline, self.cells, self.cells, scale) for outline in cell_outlines(self.ink))


def parse_tag(text: str, side: float) -> Tag:
    """Read ``FAMILY[:ID]``, such as ``aruco:DICT_4X4_50:7`` or ``apriltag:36h11``; the id is 0 unless given.

    Raises
    ------
    InputError
        If the family or the id is not one there is.
    """
    family, colon, number = text, "", "0"
    if text not in FAMILIES and text.count(":") > 1:
        family, colon, number = text.rpartition(":")
    if colon and not number.isdecimal():
        raise InputError("a tag FAMILY:ID", repr(text), "write the id as a number, as in apriltag:36h11:7")
    return Tag(family, int(number), side)


def family_size(family: str) -> int:
    """Number of tags in a family.

    Raises
    ------
    InputError
        If there is no such family; the message lists the known ones and the nearest.
    """
    return len(_dictionary(family).bytesList)


def family_bits(family: str) -> int:
    """Bits along one side of the tags of a family."""
    return int(_dictionary(family).markerSize)


@cache
def tag_ink(family: str, number: int) -> Mask:
    """Black cells (b + 2, b + 2) of one tag with its border; row 0 is the top one."""
    import cv2

    cells = family_bits(family) + 2
    return np.asarray(cv2.aruco.generateImageMarker(_dictionary(family), number, cells)) == 0


def cell_outlines(ink: Mask) -> list[Array]:
    """Closed outlines (m, 2) of the black cells (h, w), as (column, row) of cell corners, to be filled even-odd.

    Every border between a black cell and a white one is walked once with the ink to its right, so cells that share
    a side leave no seam. An outline may touch itself or another where black cells meet in a corner, but never crosses.
    """
    padded = np.pad(ink, 1)
    edges = set()
    for direction, (right, down) in enumerate(_STEPS):
        outside = ~np.roll(padded, (right, -down), axis=(0, 1))
        start_x, start_y = _STARTS[direction]
        edges |= {(x - 1 + start_x, y - 1 + start_y, direction) for y, x in np.argwhere(padded & outside).tolist()}
    left, outlines = set(edges), []
    while left:
        edge = min(left)
        loop = []
        while edge in left:
            left.remove(edge)
            loop.append(edge)
            x, y, direction = edge
            x, y = x + _STEPS[direction][0], y + _STEPS[direction][1]
            # Where two black cells meet in a corner, stay with the one at hand: the turn to the right comes first.
            turns = ((x, y, (direction + turn) % 4) for turn in (1, 0, 3))
            edge = next(turn for turn in turns if turn in edges)
        walk = np.array(loop)
        outlines.append(walk[walk[:, 2] != np.roll(walk[:, 2], 1), :2].astype(float))
    return outlines


def to_plane(corners: Array, columns: int, rows: int, scale: float) -> Array:
    """Marker plane coordinates (m, 2) in m, y up, of cell corners (column, row) of a grid around the origin."""
    return scale * (corners - [columns / 2, rows / 2]) * [1, -1]


@cache
def _dictionary(family: str):  # type: ignore[no-untyped-def]  # cv2 has no types
    import cv2

    if family not in FAMILIES:
        near = get_close_matches(family, FAMILIES, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? Known: " if near else "known: "
        raise InputError("a known family of tags", repr(family), hint + ", ".join(FAMILIES))
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[family]))
