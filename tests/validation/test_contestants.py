import numpy as np
import pytest

from markergen.detect.fiducials import FiducialSettings
from markergen.maths.projection import project
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import paper
from markergen.model.tag import Board, Tag
from markergen.render import Optics
from markergen.validation.contestants import DotMarker, Peer
from markergen.validation.metrics import rotation_error_deg

POSES = paper()
OPTICS = Optics(noise_grey=0)
TAG = Peer("tag", Tag("apriltag:36h11", 0, 0.16), 0.15)
BOARD = Peer("board", Board("aruco:DICT_4X4_50", 5, 5, 0.042), 0.15)
SETTINGS = {"tag": FiducialSettings("apriltag", 2), "board": FiducialSettings("subpix", 2, calibrated=True)}


@pytest.fixture(scope="module")
def dots(pentagon):
    return DotMarker("dots", pentagon)


def see(contestant, pose, moved=None, camera=PAPER_CAMERA, optics=OPTICS):
    moved = contestant.print_error(0.0, np.random.default_rng(0)) if moved is None else moved
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    return contestant.render(camera, rotation, translation, optics, np.random.default_rng(pose), moved)


@pytest.mark.parametrize("name", ["dots", "tag", "board"])
@pytest.mark.parametrize(
    "camera", [PAPER_CAMERA, Camera(640, 480, 800, 800, 320, 240, Distortion("radtan", (-0.2, 0.1, 0.001, 0.0)))]
)
def test_the_pose_is_the_one_it_was_seen_from(name, camera, dots):
    contestant = {"dots": dots, "tag": TAG, "board": BOARD}[name]
    found = contestant.sight(see(contestant, 129, camera=camera), camera, SETTINGS.get(name), 0.0)
    assert not found.reason
    # Without noise: what is left is the detectors' own error, 0.001 deg for dots and up to 0.1 deg for corners.
    assert rotation_error_deg(found.rotation, POSES.rotation[129]) < (0.01 if name == "dots" else 0.3)
    assert np.abs(found.translation - POSES.translation[129]).max() < (1e-4 if name == "dots" else 3e-3)


def test_what_is_not_there_has_a_reason(dots):
    nothing = np.full((480, 640), 225, dtype=np.uint8)
    for contestant in (dots, TAG, BOARD):
        found = contestant.sight(nothing, PAPER_CAMERA, SETTINGS.get(contestant.name), 0.0)
        assert found.rotation is None
        assert found.reason


def test_deep_images_are_looked_at_too():
    deep = see(TAG, 129, optics=Optics(noise_grey=0, bits=16))
    assert deep.dtype == np.uint16
    assert TAG.sight(deep, PAPER_CAMERA, SETTINGS["tag"], 0.0).rotation is not None


@pytest.mark.parametrize("contestant", [TAG, BOARD], ids=["tag", "board"])
def test_squares_follow_their_corners(contestant):
    columns, rows, side = contestant._squares
    lattice = np.stack(np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)), axis=-1).reshape(-1, 2)
    corners = side * (lattice - [columns / 2, rows / 2]) * [1, -1]
    moved = contestant.print_error(1e-3, np.random.default_rng(1))
    assert moved.shape == corners.shape
    # A corner moves as drawn, a middle by the mean of its square's four; rounding alone is allowed.
    assert contestant._displacement(corners, moved) == pytest.approx(moved, abs=1e-15)
    middle = corners[0] + side / 2 * np.array([1, -1])
    four = moved.reshape(rows + 1, columns + 1, 2)[:2, :2].reshape(4, 2)
    assert contestant._displacement(middle[None], moved)[0] == pytest.approx(four.mean(axis=0), abs=1e-15)


def test_a_displaced_print_is_seen_displaced(dots):
    for contestant in (dots, TAG):
        moved = np.zeros_like(contestant.print_error(0.0, np.random.default_rng(0)))
        moved[:, 0] = 2e-3
        found = contestant.sight(see(contestant, 0, moved), PAPER_CAMERA, SETTINGS.get(contestant.name), 2e-3)
        shifted = contestant.points + [2e-3, 0, 0]
        truth = project(shifted, POSES.rotation[:1], POSES.translation[:1], PAPER_CAMERA.matrix)[0]
        # Shifted by 2.7 px; corners are found to 0.1 px.
        assert np.abs(found.pixels - truth[found.ids]).max() < 0.4


def test_print_errors_have_their_size(dots):
    for contestant in (dots, BOARD):
        errors = [contestant.print_error(1e-4, np.random.default_rng(seed)) for seed in range(400)]
        # 2000 and more numbers: their standard deviation is known to 2 %.
        assert np.std(errors) == pytest.approx(1e-4, rel=0.08)
