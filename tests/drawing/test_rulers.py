import pytest

from markergen.drawing.rulers import BAND, placed, ruler
from markergen.drawing.scene import Disk, Line, bounds


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
    return placed([(strip, 1)], 1, 1.0, 1.0, disks, shapes, "r")


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
