import numpy as np
import pytest

from markergen.geometry.contour import area
from markergen.model.tag import Tag
from markergen.workshop.dot_geometry import cell_of, tag_pieces


@pytest.mark.parametrize("family", ["aruco:DICT_4X4_50", "aruco:DICT_6X6_50", "apriltag:36h11"])
def test_pieces_of_ink_are_those_that_scipy_finds(family):
    from scipy.ndimage import label

    for number in range(20):
        tag = Tag(family, number, 0.04)
        labels, _ = label(tag.ink)
        cells = [
            sum(map(area, (outer, *holes))) / cell_of(tag) ** 2
            for outer, holes in (ink.contours(0.0, 0.0) for ink in tag_pieces(tag))
        ]
        np.testing.assert_allclose(sorted(cells), sorted(np.bincount(labels.ravel())[1:]), atol=1e-6)
