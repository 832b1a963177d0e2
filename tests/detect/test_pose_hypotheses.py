from dataclasses import replace

import numpy as np
import pytest

from markergen.detect.blobs import undo_lens
from markergen.detect.conic_projection import outlines
from markergen.detect.pose_hypotheses import (
    MANY_DOTS,
    PAIRED_DOTS,
    PoseHypotheses,
    circle_poses,
    guess_poses,
    layout_of,
)
from markergen.errors import InputError
from markergen.maths.rotation import angle_between
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper_roll

POSES = paper_roll()


def guesses(ellipses, layout, **options):
    """All guesses of all rounds."""
    rounds = list(guess_poses(ellipses, layout, 800.0, **options))
    parts = (
        np.concatenate([getattr(each, name) for each in rounds])
        for name in ("rotation", "translation", "start", "votes")
    )
    return PoseHypotheses(*parts)


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
        seeds = guesses(undo_lens(view.blobs, PAPER_CAMERA), layout)
        # All dots within a radius of where they are: what the search for blobs near predicted dots starts from.
        drawn = outlines(layout.points, layout.radii, seeds.rotation, seeds.translation).point
        truth = outlines(layout.points, layout.radii, view.rotation[None], view.translation[None])
        radius = np.sqrt(np.linalg.eigvalsh(truth.shape)[..., 1])
        assert (np.linalg.norm(drawn - truth.point, axis=-1) < radius).all(axis=1).any()


def test_guesses_from_exact_blobs_are_exact(ngon, sight):
    marker = ngon(6, heights=[0, 0.03, 0.01, 0.02, 0, 0.01])
    view = sight(marker, 77, noise=0, semi_noise=0)
    seeds = guesses(undo_lens(view.blobs, PAPER_CAMERA), layout_of(marker))
    # The center of the second ellipse stands for that of its dot.
    assert angle_between(seeds.rotation, view.rotation).min() < 0.01
    assert np.linalg.norm(seeds.translation - view.translation, axis=-1).min() < 0.01


def test_rings_tell(pentagon, sight):
    ellipses, layout = undo_lens(sight(pentagon, 130).blobs, PAPER_CAMERA), layout_of(pentagon)
    assert len(guesses(ellipses, layout)) < len(guesses(ellipses, layout, rings_tell=False))
    assert 0 < len(guesses(ellipses, layout, ringed=True)) < len(guesses(ellipses, layout))


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
    assert len(pairs) <= n * (n - 1) if n <= MANY_DOTS else n * (2 + PAIRED_DOTS)
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
