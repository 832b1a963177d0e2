"""ChArUco boards: a chessboard with a tag in every white square."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.tag import cell_outlines, family_bits, family_size, tag_ink, to_plane

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Board:
    """A ChArUco board, upright in the middle of the marker frame, its top left square black.

    A tag and its quiet zone, one cell wide, fill a white square. So the board needs no margin, and every edge of it
    lies on one grid of cells.

    Attributes
    ----------
    family : str
        Of the tags, a key of `markergen.model.tag.FAMILIES`; ids count from 0, row by row.
    columns, rows : int
        Squares.
    square : float
        Side of a square, m.

    Raises
    ------
    InputError
        If there are fewer than 3 by 3 squares (the inner corners are what is measured), the family is unknown or has
        too few tags, or the side is not a positive finite number.
    """

    family: str
    columns: int
    rows: int
    square: float

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

    @property
    def tags(self) -> int:
        """Number of tags: white squares."""
        return self.columns * self.rows // 2

    @property
    def square_cells(self) -> int:
        """Cells along the side of a square: the tag's bits, its black border, and its quiet zone."""
        return family_bits(self.family) + 4

    @property
    def tag_side(self) -> float:
        """Side in m of a tag's black square."""
        return self.square * (self.square_cells - 2) / self.square_cells

    @property
    def corners(self) -> Array:
        """Inner chessboard corners ((columns - 1)(rows - 1), 2) in m, row by row from the top left, as OpenCV ids."""
        x, y = np.meshgrid(np.arange(1.0, self.columns), np.arange(1.0, self.rows))
        return to_plane(np.stack([x.ravel(), y.ravel()], axis=-1), self.columns, self.rows, self.square)

    @property
    def ink(self) -> Mask:
        """Which cells (rows s, columns s) are black, s = `square_cells`; row 0 is the top one."""
        s = self.square_cells
        ink = np.zeros((self.rows * s, self.columns * s), dtype=bool)
        tag = 0
        for row in range(self.rows):
            for column in range(self.columns):
                square = ink[row * s : (row + 1) * s, column * s : (column + 1) * s]
                if (row + column) % 2 == 0:
                    square[:] = True
                else:
                    square[1:-1, 1:-1] = tag_ink(self.family, tag)
                    tag += 1
        return ink

    @property
    def outlines(self) -> tuple[Array, ...]:
        """Outlines (m, 2) of all ink, m, to be filled even-odd; neighboring black cells are one."""
        ink = self.ink
        rows, columns = ink.shape
        scale = self.square / self.square_cells
        return tuple(to_plane(outline, columns, rows, scale) for outline in cell_outlines(ink))
