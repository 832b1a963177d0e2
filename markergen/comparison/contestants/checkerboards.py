"""Checkerboards, detected by cv2.findChessboardCornersSB."""
# tests: tests/contracts/test_contestants.py

from dataclasses import dataclass
from math import hypot

import numpy as np

from markergen.arrays import Array
from markergen.comparison.contestants.base import KINDS, Arena, ContestantKind
from markergen.comparison.contestants.printed import Grey, Lattice, Squares, grid_size, ours
from markergen.comparison.fiducials import FiducialDetection, enlarged
from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.tag import cell_outlines, to_plane

FORM = "checkerboard:COLUMNSxROWS"


@dataclass(frozen=True)
class CheckerboardSettings:
    """Settings of cv2.findChessboardCornersSB: its flags by name, and a factor of enlargement before it."""

    flags: tuple[str, ...] = ()
    enlarge: int = 1

    def describe(self) -> str:
        """Describe in a few words the differences from a plain call."""
        return ", ".join([*self.flags, *([f"image x{self.enlarge}"] if self.enlarge > 1 else [])]) or "no flags"


SETTINGS = (
    CheckerboardSettings(),
    CheckerboardSettings(("ACCURACY",)),
    CheckerboardSettings(("EXHAUSTIVE",)),
    CheckerboardSettings(enlarge=2),
    CheckerboardSettings(("EXHAUSTIVE",), 2),
)
"""Over the paper's poses, NORMALIZE_IMAGE misses half of the boards; ACCURACY in an enlarged image takes 0.8 s for
errors a tenth smaller."""


@dataclass(frozen=True, eq=False)
class Checkerboard(Squares):
    """A checkerboard; its detector tells the inner corners apart up to rotations that turn them into themselves."""

    name: str
    squares: Lattice
    radius: float
    settings = SETTINGS
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

    def find(self, image: Grey, camera: Camera, setting: CheckerboardSettings) -> FiducialDetection:
        """See `Printed.find`."""
        import cv2

        del camera
        flags = sum(getattr(cv2, f"CALIB_CB_{name}") for name in setting.flags)
        size = (self.lattice.columns - 1, self.lattice.rows - 1)
        cv2.setRNGSeed(0)  # It draws from OpenCV's own generator, so that the same image had different answers.
        is_found, corners = cv2.findChessboardCornersSB(enlarged(image, setting.enlarge), size, flags=flags)
        if not is_found:
            return FiducialDetection(reason="no checkerboard")
        return FiducialDetection(np.arange(len(self.points)), ours(corners.reshape(-1, 2), setting.enlarge))


def _board(text: str, arena: Arena) -> Checkerboard:
    columns, rows, rest = grid_size(text, FORM, "checkerboard:9x9")
    if rest or min(columns, rows) < 4:
        raise InputError(f"{FORM}, 4x4 squares or more", repr(text), "write for example checkerboard:9x9")
    side = arena.scale(columns, rows)
    return Checkerboard(text, Lattice(columns, rows, side), side * hypot(columns, rows) / 2)


KINDS.register("checkerboard")(ContestantKind(_board, "checkerboard:CxR", "checkerboard of C x R squares", "OpenCV"))
