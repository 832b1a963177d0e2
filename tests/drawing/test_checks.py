import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.drawing.checks import far_pair, remedy
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint


def points_at(places) -> list[ControlPoint]:
    return [ControlPoint(i, float(x), float(y), 0.0, Feature(0.01)) for i, (x, y) in enumerate(places)]


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=9), st.sampled_from([0, 1]))
def test_lengths_are_those_of_the_dots_and_lie_along_the_axis(places, axis):
    pair = far_pair(points_at(places), axis)
    away = np.abs(np.subtract.outer(np.array(places)[:, axis], np.array(places)[:, axis]))
    across = np.abs(np.subtract.outer(np.array(places)[:, 1 - axis], np.array(places)[:, 1 - axis]))
    if pair is None:
        assert not np.any((away >= across) & (away > 0.0101))
        return
    assert away[pair.first, pair.second] >= across[pair.first, pair.second]
    # No other that lies along the axis is longer by more than its slant may cost.
    assert away[away >= across].max() <= 2 * away[pair.first, pair.second] + 1e-6
    assert pair.between == pytest.approx(
        1e3 * np.hypot(*np.subtract(places[pair.first], places[pair.second])), rel=1e-12
    )
    assert pair.over == pytest.approx(pair.between + 10, rel=1e-12)


def test_across_a_seam_one_dot_is_on_either_side():
    points = points_at([(0, 0), (0.1, 0), (0.2, 0.01), (0.3, 0)])
    assert far_pair(points, 0, 0.15) == far_pair(points, 0)
    assert far_pair(points[:3], 0, 0.25) is None
    pair = far_pair(points, 0, 0.05)
    assert (pair.first, pair.second) == (0, 3)
    assert str(pair) == "dots 0 and 3: 300.0 mm (310.0 mm over the outer edges)"


def test_no_pair_no_length():
    assert far_pair([], 0) is None
    assert far_pair(points_at([(0, 0)]), 0) is None
    assert far_pair(points_at([(0, 0), (0, 0.1)]), 0) is None


def test_the_command_names_rulers_of_another_length():
    assert remedy((200, 200))[1] == (
        "markergen rescale marker.json --measured-x 198.6mm --measured-y 199.1mm -o corrected.json"
    )
    assert "--measured-x 148.9mm --nominal-x 150mm --measured-y 199.1mm" in remedy((150, 200))[1]
    assert "measured-y" not in remedy((150, 0))[1]
