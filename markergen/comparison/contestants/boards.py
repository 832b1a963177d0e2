"""ChArUco boards, detected by cv2.aruco."""
# tests: tests/comparison/test_baselines.py tests/comparison/test_compare.py

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot

from markergen.arrays import Array
from markergen.comparison.contestants import KINDS, Arena, ContestantKind, Sighting
from markergen.comparison.contestants.printed import Grey, Lattice, Squares, grid_size, share_of
from markergen.comparison.fiducials import BOARD_SETTINGS, FiducialSettings, detect_fiducial
from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.tag import FAMILIES, Board

FORM = "charuco:COLUMNSxROWS[:DICT][:SHARE]"
SHARES = (0.6, 0.75)
"""Sides of a tag over that of its square to choose from. Smaller tags leave the corners more room, and are missed more
often: in the paper's poses, tags of 0.45 in a quarter of the views that those of 0.75 are found in. Those of 0.85 have
less white around them than OpenCV advises, and errors twice as large."""


@dataclass(frozen=True, eq=False)
class ChArUco(Squares):
    """A ChArUco board, which needs no white beyond its squares."""

    name: str
    board: Board
    radius: float
    tuned: bool = False
    detector = "cv2.aruco"
    detectors = BOARD_SETTINGS

    @property
    def variants(self) -> Sequence["ChArUco"]:
        """See `Contestant.variants`: without a given share, boards with tags of each of `SHARES`."""
        if not self.tuned:
            return (self,)
        return [replace(self, board=replace(self.board, share=share), tuned=False) for share in SHARES]

    @property
    def plane_points(self) -> Array:
        """See `Printed.plane_points`: the inner corners."""
        return self.board.corners

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        board = self.board
        return (
            f"{len(self.points)} inner corners, squares of {1e3 * board.square:.4g} mm, "
            f"tags of {100 * board.tag_side / board.square:.3g} % of that"
        )

    @property
    def lattice(self) -> Lattice:
        """See `Squares.lattice`."""
        return Lattice(self.board.columns, self.board.rows, self.board.square)

    @property
    def exact_outlines(self) -> tuple[Array, ...]:
        """See `Squares.exact_outlines`."""
        return self.board.outlines

    def find(self, image: Grey, camera: Camera, options: FiducialSettings) -> Sighting:
        """See `Printed.find`."""
        return detect_fiducial(image, self.board, options, camera)


def _board(text: str, arena: Arena) -> ChArUco:
    columns, rows, rest = grid_size(text, FORM, "charuco:5x5:DICT_4X4_50:0.75")
    parts = [part for part in rest.split(":") if part]
    if len(parts) > 2:
        raise InputError(FORM, repr(text), "write for example charuco:5x5:DICT_4X4_50:0.75")
    named = [part for part in parts if not part.replace(".", "", 1).isdecimal()]
    shares = [part for part in parts if part not in named]
    family = f"aruco:{named[0]}" if named else _family(columns * rows // 2)
    square = arena.scale(columns, rows)
    share = share_of(shares[0] if shares else "", "a tag's share of its square", SHARES[-1], 0.3, 0.8)
    board = Board(family, columns, rows, square, share)
    return ChArUco(text, board, square * hypot(columns, rows) / 2, tuned=not shares)


def _family(tags: int) -> str:
    """Smallest dictionary of 4 x 4 bits that has enough tags."""
    sizes = [count for count in (50, 100, 250, 1000) if f"aruco:DICT_4X4_{count}" in FAMILIES]
    return f"aruco:DICT_4X4_{next((count for count in sizes if count >= tags), sizes[-1])}"


KINDS.register("charuco")(ContestantKind(_board, "charuco:CxR[:DICT][:SHARE]", "ChArUco board", "OpenCV"))
