"""Checkerboards, detected by cv2.findChessboardCornersSB."""
# tests: tests/contracts/test_contestants.py

from dataclasses import dataclass
from math import hypot

import numpy as np

from markergen.arrays import Array
from markergen.comparison.contestants import KINDS, Arena, ContestantKind, Sighting
from markergen.comparison.contestants.printed import Grey, Lattice, Squares, grid_size
from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.tag import cell_outlines, to_plane

FORM = "checkerboard:COLUMNSxROWS"


FLAGS: dict[str, tuple[str, ...]] = {
    "no flags": (),
    "ACCURACY": ("ACCURACY",),
    "EXHAUSTIVE": ("EXHAUSTIVE",),
}
"""Flags of cv2.findChessboardCornersSB. Over the paper's poses, NORMALIZE_IMAGE misses half of the boards."""


@dataclass(frozen=True, eq=False)
class Checkerboard(Squares):
    """A checkerboard; its detector tells the inner corners apart up to rotations that turn them into themselves."""

    name: str
    squares: Lattice
    radius: float
    detectors = FLAGS
    detector = "cv2.findChessboardCornersSB"

    @property
    def lattice(self) -> Lattice:
        """See `Squares.lattice`."""
        return self.squares

    @property
    def turns(self) -> int:  # type: ignore[override]
        """See `Contestant.turns`."""
        return self.lattice.turns

    @property
    def plane_points(self) -> Array:
        """See `Printed.plane_points`: the inner corners, row by row from the top left."""
        return self.lattice.inner

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        return f"{len(self.points)} inner corners, squares of {1e3 * self.lattice.side:.4g} mm"

    @property
    def exact_outlines(self) -> tuple[Array, ...]:
        """See `Squares.exact_outlines`: the top left square is black."""
        columns, rows, side = self.lattice.columns, self.lattice.rows, self.lattice.side
        black = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
        return tuple(to_plane(outline, columns, rows, side) for outline in cell_outlines(black))

    def find(self, image: Grey, camera: Camera, options: tuple[str, ...]) -> Sighting:
        """See `Printed.find`."""
        import cv2

        del camera
        flags = sum(getattr(cv2, f"CALIB_CB_{name}") for name in options)
        size = (self.lattice.columns - 1, self.lattice.rows - 1)
        cv2.setRNGSeed(0)  # It draws from OpenCV's own generator, so that the same image had different answers.
        is_found, corners = cv2.findChessboardCornersSB(image, size, flags=flags)
        if not is_found:
            return Sighting(reason="no checkerboard")
        return Sighting(np.arange(len(self.points)), corners.reshape(-1, 2).astype(float))


def _board(text: str, arena: Arena) -> Checkerboard:
    columns, rows, rest = grid_size(text, FORM, "checkerboard:9x9")
    if rest or min(columns, rows) < 4:
        raise InputError(f"{FORM}, 4x4 squares or more", repr(text), "write for example checkerboard:9x9")
    side = arena.scale(columns, rows)
    return Checkerboard(text, Lattice(columns, rows, side), side * hypot(columns, rows) / 2)


KINDS.register("checkerboard")(ContestantKind(_board, "checkerboard:CxR", "checkerboard of C x R squares", "OpenCV"))
