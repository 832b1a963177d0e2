"""Square tags and ChArUco boards: bit patterns of ArUco and AprilTag as black cells in the marker frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import isfinite
from typing import Any

import numpy as np

from markergen.arrays import Array, Mask
from markergen.errors import InputError, among
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, Polygon
from markergen.units import format_length

_ARUCO = [f"{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)]
FAMILIES: dict[str, str] = {
    **{f"aruco:DICT_{name}": f"DICT_{name}" for name in [*_ARUCO, "ARUCO_ORIGINAL", "ARUCO_MIP_36H12"]},
    **{f"apriltag:{name}": f"DICT_APRILTAG_{name.upper()}" for name in ("16h5", "25h9", "36h10", "36h11")},
}
"""Names of tag families, and OpenCV's names of their dictionaries.

Its AprilTags are the official ones turned by 180 degrees, every tag of every family.
"""

_IN_SHORT = (
    "aruco:DICT_4X4_50 to aruco:DICT_7X7_1000", "aruco:DICT_ARUCO_ORIGINAL", "aruco:DICT_ARUCO_MIP_36H12",
    "apriltag:16h5", "apriltag:25h9", "apriltag:36h10", "apriltag:36h11",
)  # fmt: skip
"""`FAMILIES` for those who have named none of them."""

_BITS_AND_COUNT: dict[str, tuple[int, int]] = {
    **{f"aruco:DICT_{name}": (int(name[0]), int(name.rpartition("_")[2])) for name in _ARUCO},
    "aruco:DICT_ARUCO_ORIGINAL": (5, 1024),
    "aruco:DICT_ARUCO_MIP_36H12": (6, 250),
    "apriltag:16h5": (4, 30),
    "apriltag:25h9": (5, 35),
    "apriltag:36h10": (6, 2320),
    "apriltag:36h11": (6, 587),
}
"""Bits along a side of each family's tags, and number of tags, without loading OpenCV."""

UNITS = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
"""Corners of a square of side 1 in OpenCV's order for tags: top left, top right, bottom right, bottom left."""

# Right, down, left and up in the grid, whose rows count downward.
_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
_STARTS = ((0, 0), (1, 0), (1, 1), (0, 1))
"""Borders of a cell, clockwise from the top: steps along them (column, row), and starting points."""


@dataclass(frozen=True)
class Tag:
    """A square tag, upright in the marker frame.

    Attributes
    ----------
    family : str
        A key of `FAMILIES`, such as ``aruco:DICT_4X4_50`` or ``apriltag:36h11``.
    side : float
        Side of the black square, m; the white quiet zone, one cell wide, lies outside it.
    center : (x, y)
        Center of the square, m; the origin unless the marker's middle is elsewhere.

    Raises
    ------
    InputError
        If the family is unknown, the family has no such id, or the side is not a positive finite number.
    """

    family: str
    id: int
    side: float
    center: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        most = family_size(self.family)
        if not 0 <= self.id < most:
            raise InputError(f"an id of 0 to {most - 1} in {self.family}", f"id={self.id}", "choose one of these")
        if not (isfinite(self.side) and self.side > 0):
            raise InputError("a tag side above 0", f"side={self.side} m", "give a length such as 50mm")
        if not all(map(isfinite, self.center)):
            raise InputError("a finite center", f"center={self.center} m", "give two lengths")

    def __str__(self) -> str:
        return f"{self.family}:{self.id}"

    @property
    def cells(self) -> int:
        """Number of cells along one side of the black square: the bits and a border of one cell on both sides."""
        return family_bits(self.family) + 2

    @property
    def outer_side(self) -> float:
        """Side in m of the square with its quiet zone, one cell all around."""
        return self.side * (self.cells + 2) / self.cells

    @property
    def quiet(self) -> float:
        """Width in m of the quiet zone, one cell."""
        return self.side / self.cells

    @property
    def ink(self) -> Mask:
        """Mask (cells, cells) of the black cells; row 0 is the top one, column 0 the left one."""
        return tag_ink(self.family, self.id)

    @property
    def corners(self) -> Array:
        """Corners (4, 2) of the black square in m: top left, top right, bottom right, bottom left."""
        return self.side * UNITS + self.center

    @property
    def quiet_zone(self) -> Polygon:
        """Square with its quiet zone, a region without dots."""
        return Polygon((tuple(map(tuple, (self.outer_side * UNITS + self.center).tolist())),))

    @property
    def outlines(self) -> tuple[Array, ...]:
        """Outlines (m, 2) of all black areas, m, to be filled even-odd; neighboring black cells are merged."""
        scale = self.side / self.cells
        outlines = cell_outlines(self.ink)
        return tuple(to_plane(outline, self.cells, self.cells, scale) + self.center for outline in outlines)


def parse_tag(text: str, side: float) -> Tag:
    """Parse ``FAMILY[:ID]``, such as ``aruco:DICT_4X4_50:7`` or ``apriltag:36h11``; the id is 0 by default.

    Raises
    ------
    InputError
        If the family or the id does not exist.
    """
    return Tag(*_split_tag(text), side)


def _split_tag(text: str) -> tuple[str, int]:
    family, colon, number = text, "", "0"
    if text not in FAMILIES and text.count(":") > 1:
        family, colon, number = text.rpartition(":")
    if colon and not (number.isdecimal() and len(number) < 10):
        raise InputError("a tag FAMILY:ID", repr(text), "write the id as a number, as in apriltag:36h11:7")
    return family, int(number)


def parse_ids(text: str, family: str) -> tuple[int, ...]:
    """Parse ids of a family, such as ``0-9`` or ``0,3,7-12``, in the order given.

    Raises
    ------
    InputError
        If it is not such a list, the family has no such id, or an id is repeated.
    """
    most = family_size(family)
    ids: list[int] = []
    for part in text.split(","):
        first, dash, last = (piece.strip() for piece in part.partition("-"))
        # Parsing more digits than any id has would only take time.
        if not all(piece.isdecimal() and len(piece) < 10 for piece in ([first, last] if dash else [first])):
            raise InputError("ids such as 0-9 or 0,3,7", repr(text[:40]), "write numbers, and ranges with a hyphen")
        low, high = int(first), int(last if dash else first)
        if high < low:
            raise InputError("ranges that count upward", repr(part.strip()), f"write {high}-{low}")
        if high >= most:
            raise InputError(f"ids of 0 to {most - 1} in {family}", f"id={high}", "choose among these")
        ids += range(low, high + 1)
    twice = [number for number in ids if ids.count(number) > 1]
    if twice:
        raise InputError("each id once", f"id {twice[0]} twice in {text[:40]!r}", "leave one of them out")
    return tuple(ids)


SHARE, ROOM_SHARE = 1 / 3, 1 / 2
"""Default side of a tag: this share of the marker's radius, which hardly costs any accuracy since good dots are near
the rim, and at most this share of the largest side that fits."""

FORGIVEN = 1e-9
"""Tolerance for rounding: distance in m of a tag's corner over the boundary, and share of the tag's area outside."""


def place_tag(text: str, side: float | None, boundary: Boundary, keep_outs: Sequence[Boundary] = ()) -> Tag:
    """Place a tag in the middle of a boundary: at the center of its smallest enclosing circle.

    Parameters
    ----------
    text : str
        See `parse_tag`.
    side : float or None
        Side of the black square, m; None for the default (see `SHARE`).

    Raises
    ------
    InputError
        If there is no such tag, or the square with its quiet zone does not lie in the boundary, clear of keep-outs.
    """
    # Whole picometers: neither a center off the origin by rounding, nor digits that are lost in a file.
    x, y = (round(value, 12) + 0.0 for value in boundary.center)
    largest, tag = None, Tag(*_split_tag(text), boundary.radius if side is None else side, (x, y))
    if side is None:
        largest = _largest_side(tag, boundary, keep_outs)
        chosen = min(SHARE * boundary.radius, ROOM_SHARE * largest)
        # Three digits, so that the size can be measured.
        tag = replace(tag, side=float(f"{chosen:.3g}")) if chosen else tag
    if _fits(tag, boundary, keep_outs):
        return tag
    largest = _largest_side(tag, boundary, keep_outs) if largest is None else largest
    # Rounded down, so that it fits.
    most = format_length(float(np.floor(largest * 1e4) / 1e4)).replace(" ", "")
    raise InputError(
        "a tag that lies in the boundary with its quiet zone, clear of keep-outs",
        f"a tag of {format_length(tag.side)}, {format_length(float(f'{tag.outer_side:.4g}'))} with its quiet zone, "
        f"in the middle of a {boundary}",
        f"use --tag-size {most} or less" if largest >= 1e-4 else "there is no room in the middle: leave out --tag",
    )


def _fits(tag: Tag, boundary: Boundary, keep_outs: Sequence[Boundary]) -> bool:
    corners = tag.outer_side * UNITS + tag.center
    if boundary.depth(corners).min() < -FORGIVEN:
        return False
    square = Region.polygon(corners)
    over = (square - boundary.region).area + sum((square & keep_out.region).area for keep_out in keep_outs)
    # Circles are approximated by polygons, so a corner on the rim may lie slightly outside.
    return bool(over <= FORGIVEN * square.area)


def _largest_side(tag: Tag, boundary: Boundary, keep_outs: Sequence[Boundary]) -> float:
    """Return the largest side in m of such a tag that fits there, short of it by a thousandth; 0 if none fits."""
    low, high = 0.0, 2 * boundary.radius
    while high - low > 1e-3 * max(low, 1e-3 * boundary.radius):
        middle = (low + high) / 2
        low, high = (middle, high) if _fits(replace(tag, side=middle), boundary, keep_outs) else (low, middle)
    return low


def family_size(family: str) -> int:
    """Return the number of tags in a family.

    Raises
    ------
    InputError
        If there is no such family; the message lists the known ones and the nearest.
    """
    return _known(family)[1]


def family_bits(family: str) -> int:
    """Return the number of bits along one side of a family's tags."""
    return _known(family)[0]


@cache
def tag_ink(family: str, number: int) -> Mask:
    """Return the mask (b + 2, b + 2) of black cells of one tag with its border; row 0 is the top one."""
    import cv2

    cells = family_bits(family) + 2
    return np.asarray(cv2.aruco.generateImageMarker(dictionary_of(family), number, cells)) == 0


def cell_outlines(ink: Mask) -> list[Array]:
    """Trace the outlines (m, 2) of black cells (h, w), as (column, row) of cell corners, to be filled even-odd.

    Every border between a black cell and a white one is traversed once with black to its right, so cells that share a
    side leave no seam. An outline may touch itself or another where black cells meet at a corner, but never crosses.
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
            # Where two black cells meet at a corner, stay with the current one: the right turn comes first.
            turns = ((x, y, (direction + quarter) % 4) for quarter in (1, 0, 3))
            edge = next(step for step in turns if step in edges)
        walk = np.array(loop)
        outlines.append(walk[walk[:, 2] != np.roll(walk[:, 2], 1), :2].astype(float))
    return outlines


def to_plane(corners: Array, columns: int, rows: int, scale: float) -> Array:
    """Convert cell corners (column, row) of a grid around the origin to the marker plane: (m, 2) in m, y up."""
    return scale * (corners - [columns / 2, rows / 2]) * [1, -1]


def _known(family: str) -> tuple[int, int]:
    """Return bits along a side and number of tags of a family; raises InputError if it is unknown."""
    if family not in FAMILIES:
        raise InputError(
            "a known family of tags such as aruco:DICT_4X4_50", repr(family), among(family, FAMILIES, _IN_SHORT, 0.5)
        )
    return _BITS_AND_COUNT[family]


@cache
def dictionary_of(family: str) -> Any:
    """Return OpenCV's dictionary of a family."""
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[family]))


@dataclass(frozen=True)
class Board:
    """A ChArUco board, upright in the middle of the marker frame, with a black top left square.

    Every white square has a tag in its middle and needs no margin beyond it.

    Attributes
    ----------
    family : str
        Family of the tags, a key of `FAMILIES`; ids count from 0, row by row.
    columns, rows : int
        Number of squares.
    square : float
        Side of a square, m.
    share : float or None
        Side of a tag's black square over that of a square; None leaves it a quiet zone of one cell.

    Raises
    ------
    InputError
        If there are fewer than 3 by 3 squares (only inner corners are measured), the family is unknown or has too few
        tags, the side is not a positive finite number, or the share is not between 0 and 1.
    """

    family: str
    columns: int
    rows: int
    square: float
    share: float | None = None

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3:
            raise InputError(
                "3x3 squares or more", f"{self.columns}x{self.rows}", "use a larger board: its inner corners count"
            )
        have = family_size(self.family)
        if self.tags > have:
            raise InputError(
                f"a board of at most {have} tags, as many as {self.family} has",
                f"{self.columns}x{self.rows} squares with {self.tags} tags",
                "use fewer squares or a larger family",
            )
        if not (isfinite(self.square) and self.square > 0):
            raise InputError("a square side above 0", f"square={self.square} m", "give a length such as 20mm")
        if self.share is not None and not 0 < self.share < 1:
            raise InputError("a tag's share of its square, 0 to 1", f"share={self.share}", "give a share such as 0.75")

    @property
    def tags(self) -> int:
        """Number of tags, which is the number of white squares."""
        return self.columns * self.rows // 2

    @property
    def tag_side(self) -> float:
        """Side in m of a tag's black square."""
        cells = family_bits(self.family) + 4
        return self.square * ((cells - 2) / cells if self.share is None else self.share)

    @property
    def corners(self) -> Array:
        """Inner chessboard corners ((columns - 1)(rows - 1), 2) in m, row by row from the top left, as in OpenCV."""
        x, y = np.meshgrid(np.arange(1.0, self.columns), np.arange(1.0, self.rows))
        return to_plane(np.stack([x.ravel(), y.ravel()], axis=-1), self.columns, self.rows, self.square)

    @property
    def outlines(self) -> tuple[Array, ...]:
        """Outlines (m, 2) of all black areas, m, to be filled even-odd; neighboring black cells are merged."""
        black = (np.arange(self.rows)[:, None] + np.arange(self.columns)) % 2 == 0
        squares = [to_plane(outline, self.columns, self.rows, self.square) for outline in cell_outlines(black)]
        centers = to_plane(
            np.argwhere(~black)[:, ::-1].astype(float) + 0.5, self.columns, self.rows, self.square
        ).tolist()
        tags = (Tag(self.family, k, self.tag_side, (x, y)) for k, (x, y) in enumerate(centers))
        return (*squares, *(outline for tag in tags for outline in tag.outlines))
