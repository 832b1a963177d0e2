import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.marker_json import to_json
from markergen.model.tag import Tag
from markergen.validation.lineup import DEFAULTS, line_up


@pytest.fixture
def marker(tmp_path, pentagon):
    path = tmp_path / "marker.json"
    path.write_bytes(to_json(pentagon))
    return str(path)


def test_one_alone_meets_one_of_each(marker, pentagon):
    contestants, setting = line_up([marker])
    assert [each.name for each in contestants] == [
        marker, "ngon:5", "square", "random:5", "aruco:DICT_4X4_50", "apriltag:36h11", "charuco:5x5",
    ]  # fmt: skip
    assert len(DEFAULTS) == 6
    assert setting.boundary == pentagon.boundary
    assert len(setting.poses) == 400
    ngon, square, random = (each.marker for each in contestants[1:4])
    assert (len(ngon), len(square), len(random)) == (5, 4, 5)
    for layout in (ngon, square, random):
        assert layout.dot_diameter == pentagon.dot_diameter
        assert layout.control_points[0].feature.kind == "ring"
        reach = np.hypot(*layout.xyz[:, :2].T).max() + layout.dot_diameter / 2 + layout.clearance
        assert reach <= 0.15 + 1e-9
    # The pentagon is as far out as it can be, and so is the n-gon.
    assert np.hypot(*ngon.xyz[:, :2].T) == pytest.approx(0.15 - 0.6 * 0.036)


def test_every_peer_fills_the_circle_with_the_white_it_needs():
    contestants, setting = line_up(["aruco:DICT_6X6_250:17", "apriltag:16h5", "charuco:4x6:DICT_5X5_100"])
    assert setting.boundary.radius == 0.15
    tag, april, board = (each.fiducial for each in contestants)
    assert isinstance(tag, Tag)
    assert (tag.family, tag.id) == ("aruco:DICT_6X6_250", 17)
    for each in (tag, april):
        assert each.outer_side == pytest.approx(0.15 * 2**0.5)
    assert np.hypot(*np.concatenate(board.outlines).T).max() == pytest.approx(0.15)
    assert (board.columns, board.rows, board.family) == (4, 6, "aruco:DICT_5X5_100")
    # All tags of a board have a cell of white around them, inside of their squares.
    assert board.square == pytest.approx(board.tag_side * 9 / 7)


def test_without_a_marker_dots_are_what_design_would_choose():
    contestants, _ = line_up(["ngon:5", "random:4", "aruco:DICT_4X4_50"])
    assert contestants[0].marker.dot_diameter == pytest.approx(0.036)
    assert len(contestants[1].marker) == 4


def test_dots_too_large_for_more_of_them_are_chosen_anew(marker, pentagon):
    many = line_up([marker, "ngon:30"])[0][1].marker
    assert len(many) == 30
    assert 0 < many.dot_diameter < pentagon.dot_diameter
    gaps = np.linalg.norm(np.diff(many.xyz, axis=0), axis=-1)
    assert gaps.min() >= many.dot_diameter + many.clearance - 1e-9


def test_random_layouts_go_by_the_seed(marker):
    first, again, other = (line_up([marker, "random:5"], seed=seed)[0][1].marker.xyz for seed in (0, 0, 1))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_the_same_named_twice_takes_part_once(marker):
    assert len(line_up([marker, "ngon:5", marker, "ngon"])[0]) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("hexagon", "expected a known contestant, found 'hexagon'; known: MARKER.json, ngon:N"),
        ("ngon:x", "ngon:N, N a whole number"),
        ("ngon:-5", "ngon:N, N a whole number"),
        ("ngon:3", "at least 4 control points"),
        ("square:5", "expected square"),
        ("random:", "random:N, N a whole number"),
        ("random:201", "at most 200 control points"),
        ("aruco:DICT_4X4_50:50", "an id of 0 to 49"),
        ("apriltag:36h12", "did you mean 'apriltag:36h11'"),
        ("charuco:5", "charuco:COLUMNSxROWS"),
        ("charuco:5x", "charuco:COLUMNSxROWS"),
        ("charuco:2x5", "3x3 squares or more"),
        ("charuco:50x50", "at most 50 tags"),
        ("charuco:5x5:DICT_9X9", "a known family"),
        ("missing.json", "missing.json"),
    ],
)
def test_what_is_none_is_refused_in_one_line(text, said):
    with pytest.raises(InputError) as error:
        line_up(["aruco:DICT_4X4_50", text])
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_markers_of_two_sizes_are_no_comparison(marker, tmp_path, make_ngon):
    other = tmp_path / "small.json"
    other.write_bytes(to_json(make_ngon(5, 0.1, 0.02)))
    with pytest.raises(InputError, match="circles of one size, here of radius 150 mm"):
        line_up([marker, str(other)])


def test_bare_points_cannot_be_seen(tmp_path, make_ngon):
    bare = tmp_path / "bare.json"
    bare.write_bytes(to_json(make_ngon(5, 0.15, 0.0)))
    with pytest.raises(InputError, match="dots that can be seen"):
        line_up([str(bare)])


def test_poses_by_name(marker):
    assert line_up([marker, "square"], poses="paper-roll")[1].poses.name == "paper-roll"
    assert line_up(["ngon:5", "square"], poses="paper-roll")[1].poses.name == "paper-roll"
    with pytest.raises(InputError, match="known pose distribution"):
        line_up([marker, "square"], poses="none")


def test_nobody_is_no_comparison():
    with pytest.raises(InputError, match="contestants to compare"):
        line_up([])
