import numpy as np
import pytest

from markergen.drawing.scene import (
    FLATNESS,
    Disk,
    FilledPath,
    Line,
    bounds,
    clipped,
    moved,
    rectangle,
    renamed,
    rotated,
)
from markergen.drawing.text import text


def test_bounds_hold_the_ink():
    assert bounds(Disk(1, 2, 3)) == (-2, -1, 4, 5)
    assert bounds(Line(((0, 0), (10, 0)), 0.5)) == (-0.25, -0.25, 10.25, 0.25)
    assert bounds(FilledPath((("M", ((0, 1),)), ("Q", ((5, 9), (2, 2))), ("Z", ())))) == (0, 1, 5, 9)
    with pytest.raises(ValueError):
        bounds(FilledPath(()))


def test_shapes_move_whole():
    assert moved(Disk(1, 2, 3, 1, "a", "#123456"), 10, -1) == Disk(11, 1, 3, 1, "a", "#123456")
    assert moved(Line(((0, 0), (1, 2)), 0.5, "b"), 1, 1) == Line(((1, 1), (2, 3)), 0.5, "b")
    assert bounds(moved(text("x", 0, 0, 2), 5, 6)) == pytest.approx(np.add(bounds(text("x", 0, 0, 2)), (5, 6, 5, 6)))


def test_a_quarter_turn_is_counterclockwise():
    assert bounds(rotated(rectangle((1, 0, 3, 1), "r", "#000000"), 1, 0)) == (0, 0, 1, 2)


def test_renamed_shapes_keep_all_else():
    assert renamed([Disk(0, 0, 1, 0, "dot-1")], "marker-2-") == (Disk(0, 0, 1, 0, "marker-2-dot-1"),)


def test_what_is_whole_stays_and_what_is_outside_goes():
    inside, outside = Disk(0, 0, 1), Disk(9, 0, 1)
    assert list(clipped([inside, outside], (-2, -2, 2, 2))) == [inside]


def test_a_line_is_cut_where_it_leaves():
    line = Line(((-5, 0), (5, 0), (5, 1), (-5, 1)), 0.2, "l", "#9a9a9a")
    parts = list(clipped([line], (-2, -2, 2, 2)))
    assert [part.name for part in parts] == ["l", "l-part-2"]
    assert {tuple(sorted(part.points)) for part in parts} == {((-2, 0), (2, 0)), ((-2, 1), (2, 1))}
    assert all((part.width, part.color) == (0.2, "#9a9a9a") for part in parts)


@pytest.mark.parametrize("inner", [0.0, 9.0])
def test_a_cut_disk_is_true(inner):
    disk = Disk(3.0, 4.0, 18.0, inner, "dot-7")
    (part,) = clipped([disk], (3.0, -100, 100, 100))
    assert isinstance(part, FilledPath)
    assert part.name == "dot-7"
    points = np.array([points[0] for _, points in part.segments if points])
    away = np.hypot(*(points - (3, 4)).T)
    rim = points[:, 0] > 3.0 + 1e-9
    assert np.all((np.abs(away[rim] - 18) < 1e-9) | (np.abs(away[rim] - inner) < 1e-9))
    # Chords no longer than keep the sagitta below what is promised.
    outer = points[rim & (np.abs(away - 18) < 1e-9)]
    assert np.max(np.hypot(*np.diff(outer, axis=0).T)) ** 2 / (8 * 18) < FLATNESS * 1.01
