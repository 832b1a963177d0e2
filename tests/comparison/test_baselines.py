"""Contestants are found where they are, markers in their own size and all others in that of the first."""

import cv2
import numpy as np
import pytest

from markergen.comparison.baselines import DEFAULTS, USUAL, line_up
from markergen.comparison.contestants import KINDS
from markergen.comparison.contestants.boards import ChArUco
from markergen.comparison.contestants.dots import DotBody
from markergen.comparison.contestants.tags import SquareTag
from markergen.errors import InputError
from markergen.maths.projection import project
from markergen.model.body_json import to_json
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.marker import light_marker
from markergen.model.poses import paper
from markergen.model.tag import Board, Tag
from markergen.render import Optics
from markergen.validation.metrics import rotation_error_deg
from markergen.validation.setting import setting_of

POSES = paper()
OPTICS = Optics(noise_grey=0)
TAG = SquareTag("tag", Tag("apriltag:36h11", 0, 0.16), 0.15)
BOARD = ChArUco("board", Board("aruco:DICT_4X4_50", 5, 5, 0.042), 0.15)
SETTINGS = {
    "tag": {"detector": "APRILTAG", "image": "image x2"},
    "board": {"detector": "SUBPIX", "image": "image x2"},
}


@pytest.fixture(scope="module")
def dots(pentagon):
    return DotBody("dots", pentagon)


def see(contestant, pose, moved=None, camera=PAPER_CAMERA, optics=OPTICS):
    moved = contestant.print_error(0.0, np.random.default_rng(0)) if moved is None else moved
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    return contestant.render(camera, (rotation, translation), optics, np.random.default_rng(pose), moved)


@pytest.mark.parametrize("name", ["dots", "tag", "board"])
@pytest.mark.parametrize(
    "camera", [PAPER_CAMERA, Camera(640, 480, 800, 800, 320, 240, Distortion("radtan", (-0.2, 0.1, 0.001, 0.0)))]
)
def test_the_pose_is_the_one_it_was_seen_from(name, camera, dots):
    contestant = {"dots": dots, "tag": TAG, "board": BOARD}[name]
    result = contestant.sight(see(contestant, 129, camera=camera), camera, SETTINGS.get(name, {}), 0.0)
    assert not result.reason
    # Without noise: what is left is the detectors' own error, 0.001 deg for dots and up to 0.1 deg for corners.
    assert rotation_error_deg(result.rotation, POSES.rotation[129]) < (0.01 if name == "dots" else 0.3)
    assert np.abs(result.translation - POSES.translation[129]).max() < (1e-4 if name == "dots" else 3e-3)


def test_what_is_not_there_has_a_reason(dots):
    nothing = np.full((480, 640), 225, dtype=np.uint8)
    for contestant in (dots, TAG, BOARD):
        result = contestant.sight(nothing, PAPER_CAMERA, SETTINGS.get(contestant.name, {}), 0.0)
        assert result.rotation is None
        assert result.reason


def test_deep_images_are_looked_at_too():
    deep = see(TAG, 129, optics=Optics(noise_grey=0, bits=16))
    assert deep.dtype == np.uint16
    assert TAG.sight(deep, PAPER_CAMERA, SETTINGS["tag"], 0.0).rotation is not None


@pytest.mark.parametrize("contestant", [TAG, BOARD], ids=["tag", "board"])
def test_squares_follow_their_corners(contestant):
    lattice = contestant.lattice
    columns, rows, side = lattice.columns, lattice.rows, lattice.side
    places = np.stack(np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)), axis=-1).reshape(-1, 2)
    corners = side * (places - [columns / 2, rows / 2]) * [1, -1]
    moved = contestant.print_error(1e-3, np.random.default_rng(1))
    assert moved.shape == corners.shape
    # A corner moves as drawn, a middle by the mean of its square's four; rounding alone is allowed.
    assert lattice.displacement(corners, moved) == pytest.approx(moved, abs=1e-15)
    middle = corners[0] + side / 2 * np.array([1, -1])
    four = moved.reshape(rows + 1, columns + 1, 2)[:2, :2].reshape(4, 2)
    assert lattice.displacement(middle[None], moved)[0] == pytest.approx(four.mean(axis=0), abs=1e-15)


def test_a_displaced_print_is_seen_displaced(dots):
    for contestant in (dots, TAG):
        moved = np.zeros_like(contestant.print_error(0.0, np.random.default_rng(0)))
        moved[:, 0] = 2e-3
        result = contestant.sight(see(contestant, 0, moved), PAPER_CAMERA, SETTINGS.get(contestant.name, {}), 2e-3)
        shifted = contestant.points + [2e-3, 0, 0]
        truth = project(shifted, POSES.rotation[:1], POSES.translation[:1], PAPER_CAMERA.matrix)[0]
        # Shifted by 2.7 px; corners are found to 0.1 px.
        assert np.abs(result.pixels - truth[result.ids]).max() < 0.4


def test_print_errors_have_their_size(dots):
    for contestant in (dots, BOARD):
        errors = [contestant.print_error(1e-4, np.random.default_rng(seed)) for seed in range(400)]
        # 2000 and more numbers: their standard deviation is known to 2 %.
        assert np.std(errors) == pytest.approx(1e-4, rel=0.08)


@pytest.fixture
def marker(tmp_path, pentagon):
    path = tmp_path / "marker.json"
    path.write_bytes(to_json(pentagon))
    return str(path)


def test_one_alone_meets_one_of_each(marker, pentagon):
    contestants, setting = line_up([marker])
    assert [contestant.name for contestant in contestants] == [
        marker, "ngon:5", "square", "random:5", "aruco:DICT_4X4_50", "edges:aruco:DICT_4X4_50", "apriltag:36h11",
        "charuco:5x5", "circles:5x5", "checkerboard:9x9",
    ]  # fmt: skip
    assert len(DEFAULTS) == 9
    assert setting.boundary == pentagon.boundary
    assert len(setting.poses) == 400
    ngon, square, random = (contestant.body for contestant in contestants[1:4])
    assert (len(ngon), len(square), len(random)) == (5, 4, 5)
    for layout in (ngon, square, random):
        assert layout.dot_diameter == pentagon.dot_diameter
        assert layout.control_points[0].feature.kind == "ring"
        reach = np.hypot(*layout.xyz[:, :2].T).max() + layout.dot_diameter / 2 + layout.clearance
        assert reach <= 0.15 + 1e-9
    # The pentagon is as far out as it can be, and so is the n-gon.
    assert np.hypot(*ngon.xyz[:, :2].T) == pytest.approx(0.15 - 0.6 * 0.036)


def test_a_kind_alone_is_the_usual_one(marker):
    names = [contestant.name for contestant in line_up([marker, "aruco", "circles", "square"])[0]]
    assert names == [marker, "aruco:DICT_4X4_50", "circles:5x5", "square"]


def test_every_kind_has_a_usual_one(marker):
    assert set(KINDS) == set(USUAL)
    contestants, _ = line_up([marker, *USUAL])
    assert [contestant.name.partition(":")[0] for contestant in contestants[1:]] == list(USUAL)


def test_an_inverted_marker_meets_inverted_layouts(pentagon):
    contestants, _ = line_up(["own", "ngon", "random"], given={"own": light_marker(pentagon)})
    assert all(contestant.body.light for contestant in contestants)
    result = contestants[0].sight(see(contestants[0], 129), PAPER_CAMERA, {}, 0.0)
    assert rotation_error_deg(result.rotation, POSES.rotation[129]) < 0.01


def test_every_peer_fills_the_circle_with_the_white_it_needs():
    contestants, setting = line_up(["aruco:DICT_6X6_250:17", "apriltag:16h5", "charuco:4x6:DICT_5X5_100"])
    assert setting.boundary.radius == 0.15
    tag, april, board = contestants[0].tag, contestants[1].tag, contestants[2].board
    assert isinstance(tag, Tag)
    assert (tag.family, tag.id) == ("aruco:DICT_6X6_250", 17)
    for item in (tag, april):
        assert item.outer_side == pytest.approx(0.15 * 2**0.5)
    assert np.linalg.norm(np.concatenate(board.outlines), axis=-1).max() == pytest.approx(0.15)
    assert (board.columns, board.rows, board.family) == (4, 6, "aruco:DICT_5X5_100")
    # All tags of a board have a cell of white around them, inside of their squares.
    assert board.tag_side < board.square * 7 / 9


def test_without_a_marker_dots_are_what_design_would_choose():
    contestants, _ = line_up(["ngon:5", "random:4", "aruco:DICT_4X4_50"])
    assert contestants[0].body.dot_diameter == pytest.approx(0.036)
    assert len(contestants[1].body) == 4


def test_dots_too_large_for_more_of_them_are_chosen_anew(marker, pentagon):
    many = line_up([marker, "ngon:30"])[0][1].body
    assert len(many) == 30
    assert 0 < many.dot_diameter < pentagon.dot_diameter
    gaps = np.linalg.norm(np.diff(many.xyz, axis=0), axis=-1)
    assert gaps.min() >= many.dot_diameter + many.clearance - 1e-9


def test_random_layouts_go_by_the_seed(marker):
    first, again, other = (line_up([marker, "random:5"], seed=seed)[0][1].body.xyz for seed in (0, 0, 1))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_the_same_named_twice_takes_part_once(marker):
    assert len(line_up([marker, "ngon:5", marker, "ngon"])[0]) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hexagon", "expected a known contestant, found 'hexagon'; known: MARKER.json, ngon:N"),
        ("arcuo", "did you mean 'aruco'? Known: MARKER.json, ngon:N"),
        ("edges:aruco:DICT_9X9", "a known family"),
        ("pupil:36h12", "16h5, 25h9, 36h11"),
        ("pupil:", "16h5, 25h9, 36h11"),
        ("stag:HD11:0", "stag:HD21[:ID]"),
        ("stag:HD21:12", "an id of 0 to 11"),
        ("ringgrid:2x5", "3x3 to 20x40 rings"),
        ("circles:5", "circles:COLUMNSxROWS[:SHARE]"),
        ("circles:5x5:0.95", "of 0.1 to 0.9"),
        ("acircles:2x5", "3x3 circles or more"),
        ("checkerboard:9x9:3", "checkerboard:COLUMNSxROWS"),
        ("checkerboard:3x9", "4x4 squares or more"),
        ("charuco:5x5:0.9", "of 0.3 to 0.8"),
        ("charuco:5x5:DICT_4X4_50:0.6:1", "charuco:COLUMNSxROWS[:DICT][:SHARE]"),
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
        ("charuco:50x50", "at most 1000 tags"),
        ("charuco:11x11:DICT_4X4_50", "at most 50 tags"),
        ("charuco:5x5:DICT_9X9", "a known family"),
        ("missing.json", "missing.json"),
    ],
)
def test_what_is_none_is_refused_in_one_line(text, message):
    with pytest.raises(InputError) as error:
        line_up(["aruco:DICT_4X4_50", text])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_markers_of_two_sizes_keep_them_where_the_largest_is_wholly_seen(make_ngon):
    stated = {"small": make_ngon(5, 0.1, 0.02), "large": make_ngon(5, 0.15, 0.036)}
    contestants, setting = line_up(["small", "large", "aruco:DICT_4X4_50"], given=stated)
    assert [contestant.room(setting.boundary).radius for contestant in contestants] == [0.1, 0.15, 0.1]
    assert contestants[2].tag.outer_side == pytest.approx(0.1 * 2**0.5)
    large = setting_of(stated["large"], None)
    assert np.array_equal(
        setting.poses.translation,
        setting_of(stated["small"], None).poses.seen_whole(Circle(0.15), large.camera).translation,
    )
    inks = [contestant.ink(0.1) / contestant.area(0.1) for contestant in contestants[:2]]
    # Five rings 0.1 and 0.12 radii wide: as shares of their own circles, their ink goes as the squares of these.
    assert inks[1] / inks[0] == pytest.approx((0.036 / 0.15 / (0.02 / 0.1)) ** 2, rel=0.02)


def test_bare_points_cannot_be_seen(tmp_path, make_ngon):
    bare = tmp_path / "bare.json"
    bare.write_bytes(to_json(make_ngon(5, 0.15, 0.0)))
    with pytest.raises(InputError, match="can be seen"):
        line_up([str(bare)])


def test_poses_by_name(marker):
    assert line_up([marker, "square"], poses="paper-roll")[1].poses.name == "paper-roll"
    assert line_up(["ngon:5", "square"], poses="paper-roll")[1].poses.name == "paper-roll"
    with pytest.raises(InputError, match="known pose distribution"):
        line_up([marker, "square"], poses="none")


def test_nobody_is_no_comparison():
    with pytest.raises(InputError, match="contestants to compare"):
        line_up([])


def test_a_checkerboard_is_found_alike_whatever_has_drawn_from_opencv_before():
    (board, *_), _ = line_up(["checkerboard:5x5", "ngon"])
    image, left = see(board, 129), []
    for seed in (1, 2):
        cv2.setRNGSeed(seed)
        assert board.find(image, PAPER_CAMERA, ()).ids.size == 16
        # What the generator gives next follows from the image alone.
        left.append(cv2.randu(np.zeros((1, 4), np.uint8), 0, 255).tolist())
    assert left[0] == left[1]
