import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sentences import sentence

from markergen.drawing.print_measurements import BAND, far_pair, place_ruler, rescale_command, ruler, short_rulers
from markergen.drawing.scene import Disk, Line, bounds
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
    assert str(pair) == sentence("distance", 0, 3, "300.0 mm", "310.0 mm")


def test_no_pair_no_length():
    assert far_pair([], 0) is None
    assert far_pair(points_at([(0, 0)]), 0) is None
    assert far_pair(points_at([(0, 0), (0, 0.1)]), 0) is None


def test_the_command_states_the_length_of_every_ruler():
    assert rescale_command("plate.json", (200, 150)) == (
        "markergen rescale plate.json --measured-x 198.6mm --nominal-x 200mm --measured-y 149.3mm --nominal-y 150mm "
        "-o printed.json"
    )
    assert "measured-y" not in rescale_command("plate.json", (150, 0))
    assert "--measured-points" in rescale_command("plate.json")


def test_the_command_has_a_name_that_a_shell_reads_and_the_sheet_has_letters_for():
    assert "rescale 'my plate.json' -" in rescale_command("my plate.json", (200, 150))
    assert "rescale marker.json -" in rescale_command("\u677f.json", (200, 150))


def test_a_short_ruler_names_the_scale_it_proves_and_longer_distances(make_ngon):
    square = make_ngon(4, 0.1, 0.02)
    assert short_rulers(square, (150, 100)) == {}
    assert short_rulers(square, (150, 20)) == {"y": "y proves its scale to 1.5 %: measure dots 0 and 2"}
    assert short_rulers(square, (0, 100)) == {"x": "none along x: measure dots 1 and 3"}


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("inward", [1, -1])
@pytest.mark.parametrize("length", [20, 50, 100, 150, 200])
@pytest.mark.parametrize("factor", [1.0, 1.007])
def test_rulers_are_true_and_keep_to_their_band(axis, inward, length, factor):
    marks, texts = ruler((10.0, 20.0), length, axis, 1.3, factor, inward)
    ticks = {int(mark.name.removeprefix("ruler-")): mark.points[0] for mark in marks if mark.name != "ruler"}
    assert sorted(ticks) == list(range(0, length + 1, 10))
    for mm, foot in ticks.items():
        assert foot[axis] == pytest.approx((10.0, 20.0)[axis] + mm * factor, abs=1e-9)
    for shape in (*marks, *texts):
        box = bounds(shape)
        low, high = box[1 - axis] - (10.0, 20.0)[1 - axis], box[3 - axis] - (10.0, 20.0)[1 - axis]
        assert max(abs(low), abs(high)) <= BAND * 1.3
        assert (high if inward > 0 else -low) > 0
        assert box[axis] >= (10.0, 20.0)[axis] - 0.2
    assert any(text.name == f"ruler-number-{length}" for text in texts)


def place(disks=(), shapes=(), length=220.0):
    strip = (0.0, 0.0, BAND, length)
    return place_ruler([(strip, 1)], 1, 1.0, 1.0, disks, shapes, "r")


def test_the_longest_that_has_room():
    assert place()[0] == 200
    assert place(length=199)[0] == 150
    assert place(length=15) == (0, ([], []))
    # A quiet zone of 10 mm around a dot 8 mm beside the strip takes 12 mm of it.
    assert place([Disk(BAND + 8, 110, 5)])[0] == 100
    assert place([Disk(BAND + 10.1, 110, 5)])[0] == 200
    assert place(shapes=[Line(((BAND / 2, 60), (BAND / 2, 61)), 0.2)])[0] == 150
    assert place(shapes=[Line(((40, 60), (41, 61)), 0.2)])[0] == 200


def test_it_stands_clear_of_what_blocks_it():
    disk = Disk(BAND + 8, 60, 5)
    length, (marks, texts) = place([disk])
    assert length == 150
    for shape in (*marks, *texts):
        assert bounds(shape)[1] >= 60 + 6 - 0.2
