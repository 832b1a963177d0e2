import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.board import Board


@pytest.mark.parametrize(("columns", "rows"), [(5, 5), (4, 6), (3, 7), (6, 4)])
@pytest.mark.parametrize(
    ("family", "bits", "number"), [("aruco:DICT_4X4_50", 4, "4X4_50"), ("aruco:DICT_6X6_250", 6, "6X6_250")]
)
def test_ink_and_corners_are_opencv_s(columns, rows, family, bits, number):
    import cv2

    board = Board(family, columns, rows, 0.04)
    s = board.square_cells
    assert s == bits + 4
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{number}"))
    theirs = cv2.aruco.CharucoBoard((columns, rows), float(s), float(s - 2), dictionary)
    # Ten pixels a cell; the middle of each is far from any edge that their drawing may round.
    drawn = theirs.generateImage((columns * s * 10, rows * s * 10), None, 0, 1)
    assert np.array_equal(drawn[5::10, 5::10] == 0, board.ink)
    # Theirs count from the top left with y down.
    corners = theirs.getChessboardCorners()[:, :2] / s * 0.04
    expected = (corners - [columns * 0.02, rows * 0.02]) * [1, -1]
    assert board.corners == pytest.approx(expected, abs=1e-7)  # theirs are of single precision


def test_geometry_of_a_board():
    board = Board("aruco:DICT_4X4_50", 5, 5, 0.04)
    assert board.tags == 12
    assert board.tag_side == pytest.approx(0.03)
    corners = np.concatenate(board.outlines)
    assert np.hypot(*corners.T).max() == pytest.approx(0.1 * 2**0.5)


@pytest.mark.parametrize(
    ("family", "columns", "rows", "square", "said"),
    [
        ("aruco:DICT_4X4_50", 2, 5, 0.04, "3x3 squares or more"),
        ("aruco:DICT_4X4_50", 11, 11, 0.04, "at most 50 tags"),
        ("aruco:DICT_9X9", 5, 5, 0.04, "a known family"),
        ("aruco:DICT_4X4_50", 5, 5, 0.0, "square side above 0"),
    ],
)
def test_boards_that_cannot_be_are_refused(family, columns, rows, square, said):
    with pytest.raises(InputError, match=said):
        Board(family, columns, rows, square)
