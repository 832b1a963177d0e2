import numpy as np
import pytest

from markergen.detect.fit import outlines
from markergen.detect.ideal import undo_lens
from markergen.detect.layout import layout_of
from markergen.detect.seeds import MAX_SEEDS, circle_poses, guess_poses
from markergen.maths.rotation import angle_between
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper_roll

POSES = paper_roll()


def test_a_circle_has_two_poses_and_one_is_true():
    point = np.array([[0.05, -0.08, 0.01]])
    drawn = outlines(point, np.array([0.02]), POSES.rotation, POSES.translation)
    position, normal = circle_poses(drawn.center[:, 0], drawn.shape[:, 0])
    truth = (POSES.rotation @ point[0] + POSES.translation) / 0.02
    apart = np.linalg.norm(normal - POSES.rotation[:, None, :, 2], axis=-1)
    best = apart.argmin(axis=1)
    # From the front the normal is the square root of what rounding leaves of the ellipse's elongation.
    assert apart.min(axis=1).max() < 1e-5
    np.testing.assert_allclose(position[np.arange(len(POSES)), best], truth, rtol=0, atol=1e-4)
    # Both poses look the same.
    for side in (0, 1):
        turn = np.stack([_any_rotation(n) for n in normal[:, side]])
        again = outlines(np.zeros((1, 3)), np.ones(1), turn, position[:, side])
        np.testing.assert_allclose(again.center, drawn.center, rtol=0, atol=1e-9)
        np.testing.assert_allclose(again.shape, drawn.shape, rtol=1e-6, atol=1e-12)


def _any_rotation(normal):
    along = np.cross(normal, [1.0, 0, 0])
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along), normal], axis=-1)


@pytest.mark.parametrize("heights", [None, [0, 0.02, 0.01, 0.02, 0]])
@pytest.mark.parametrize("strangers", [0, 30])
def test_the_true_pose_is_among_the_guesses(ngon, sight, heights, strangers):
    marker = ngon(5, heights=heights)
    layout = layout_of(marker)
    for pose in range(0, 400, 41):
        view = sight(marker, pose, strangers=strangers)
        seeds = guess_poses(undo_lens(view.blobs, PAPER_CAMERA), layout, 800.0)
        assert 0 < len(seeds) <= MAX_SEEDS
        # All dots within a radius of where they are: what the search for blobs near predicted dots starts from.
        drawn = outlines(layout.points, layout.radii, seeds.rotation, seeds.translation).point
        truth = outlines(layout.points, layout.radii, view.rotation[None], view.translation[None])
        radius = np.sqrt(np.linalg.eigvalsh(truth.shape)[..., 1])
        assert (np.linalg.norm(drawn - truth.point, axis=-1) < radius).all(axis=1).any()


def test_guesses_from_exact_blobs_are_exact(ngon, sight):
    marker = ngon(6, heights=[0, 0.03, 0.01, 0.02, 0, 0.01])
    view = sight(marker, 77, noise=0, semi_noise=0)
    seeds = guess_poses(undo_lens(view.blobs, PAPER_CAMERA), layout_of(marker), 800.0)
    # The center of the second ellipse stands for that of its dot.
    assert angle_between(seeds.rotation, view.rotation).min() < 0.01
    assert np.linalg.norm(seeds.translation - view.translation, axis=-1).min() < 0.01


def test_rings_tell(pentagon, sight):
    ellipses, layout = undo_lens(sight(pentagon, 130).blobs, PAPER_CAMERA), layout_of(pentagon)
    assert len(guess_poses(ellipses, layout, 800.0)) < len(guess_poses(ellipses, layout, 800.0, rings_tell=False))
