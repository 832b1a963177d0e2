from dataclasses import replace

import numpy as np
import pytest

from markergen.detect.layout import MAX_PAIRS, layout_of
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker


def test_what_is_read_off_the_marker(ngon):
    layout = layout_of(ngon(5))
    assert layout.flat
    assert len(layout) == 5
    assert layout.rings.tolist() == [True, False, False, False, False]
    np.testing.assert_allclose(layout.radii, 0.018)
    # Neighbors are 8.4 radii apart: half of that is more than the two that are ever needed.
    assert layout.reach == 2.0
    assert not layout_of(ngon(5, heights=[0, 0, 0.01, 0, 0])).flat
    # A marker that lies wholly at another height is flat.
    assert layout_of(ngon(5, heights=[0.01] * 5)).flat


def test_dots_that_nearly_touch_are_kept_apart(make):
    layout = layout_of(make([(0, 0), (0.04, 0), (0.1, 0.1), (-0.1, 0.05)]))
    np.testing.assert_allclose(layout.reach, 0.5 * 0.04 / 0.018)


@pytest.mark.parametrize("n", [4, 5, 12, 30])
def test_pairs_of_every_dot_and_those_with_the_ring_first(ngon, n):
    pairs = layout_of(ngon(n, diameter=0.01)).pairs
    assert len(pairs) <= MAX_PAIRS
    assert set(pairs.ravel()) == set(range(n))
    with_ring = (pairs == 0).any(axis=1)
    assert with_ring[: with_ring.sum()].all()


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], "4 or more"),
        ([(0, 0, 0), (0.05, 0, 0), (0.1, 0, 0), (-0.1, 0, 0)], "on one line"),
    ],
)
def test_markers_that_cannot_be_labeled_are_refused(points, said):
    marker = Marker(
        tuple(ControlPoint(i, *point, Feature(0.02)) for i, point in enumerate(points)), Circle(0.15), 0.002
    )
    with pytest.raises(InputError, match=said):
        layout_of(marker)


def test_bare_points_cannot_be_seen(pentagon):
    bare = replace(pentagon.control_points[2], feature=Feature(0.0))
    marker = replace(pentagon, control_points=(*pentagon.control_points[:2], bare, *pentagon.control_points[3:]))
    with pytest.raises(InputError, match="diameter 0"):
        layout_of(marker)
