import numpy as np
import pytest

from markergen.detect import kernel
from markergen.maths.conics import _turn, correct_centers, outlines, plane_outlines, pose_rows, refine_poses
from markergen.maths.information import pose_jacobian
from markergen.maths.projection import apply_homography, circle_image, plane_homography, project
from markergen.maths.rotation import angle_between, exponential
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper_roll

POSES = paper_roll()
POINTS = np.random.default_rng(0).uniform(-0.1, 0.1, (7, 3)) * [1, 1, 0.3]
RADII = np.linspace(0, 0.02, 7)


@pytest.mark.parametrize("index", range(1, 7))
def test_outlines_are_images_of_the_circles_at_their_height(index):
    drawn = outlines(POINTS, RADII, POSES.rotation, POSES.translation)
    origin = POSES.translation + POINTS[index, 2] * POSES.rotation[:, :, 2]
    homography = plane_homography(POSES.rotation, origin, np.eye(3))
    center, semi, _ = circle_image(POINTS[index, :2], RADII[index], homography)
    np.testing.assert_allclose(drawn.center[:, index], center, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(drawn.shape[:, index])[:, ::-1], semi**2, rtol=1e-6, atol=1e-14)
    assert drawn.seen.all()
    flat = plane_outlines(POINTS[:, :2], RADII, homography * np.where(np.arange(400) % 2, -2.0, 1.0)[:, None, None])
    np.testing.assert_allclose(flat.center[:, index], center, rtol=0, atol=1e-12)
    np.testing.assert_allclose(flat.shape[:, index], drawn.shape[:, index], rtol=1e-6, atol=1e-14)
    assert flat.seen.all()


def test_bare_points_have_no_offset():
    drawn = outlines(POINTS, RADII, POSES.rotation, POSES.translation)
    np.testing.assert_allclose(drawn.center[:, 0], drawn.point[:, 0], rtol=0, atol=1e-15)
    assert (np.linalg.norm(drawn.center - drawn.point, axis=-1)[:, 1:] > 0).any(axis=0).all()


def test_what_turns_away_or_is_behind_is_not_seen():
    rotation, translation = POSES.rotation[:1], POSES.translation[:1]
    assert not outlines(POINTS, RADII, rotation @ np.diag([1, -1, -1.0]), translation).seen.any()
    assert not outlines(POINTS, RADII, rotation, -translation).seen.any()
    assert not plane_outlines(POINTS[:, :2], RADII, np.diag([1.0, 1.0, 1.0])[None]).seen.any()
    # A rim that reaches the plane of the camera's center has no ellipse.
    edge_on = exponential(np.array([[np.pi / 2 + 0.01, 0, 0]]))
    assert not outlines(np.zeros((1, 3)), np.array([0.5]), edge_on, np.array([[0, 0, 0.4]])).seen.any()


def test_rows_are_the_jacobian_of_the_pose():
    rows = pose_rows(POINTS, POSES.rotation, POSES.translation)
    expected = pose_jacobian(POINTS, POSES.rotation, POSES.translation, np.ones(2))
    np.testing.assert_allclose(rows.reshape(expected.shape), expected, rtol=0, atol=1e-12)


def test_turn_is_the_exponential():
    vectors = np.concatenate([np.random.default_rng(1).normal(size=(20, 3)), np.zeros((1, 3)), [[1e-9, 0, 0]]])
    np.testing.assert_allclose(_turn(vectors), exponential(vectors), rtol=0, atol=1e-14)


@pytest.mark.usefixtures("path")
def test_refinement_comes_back_from_a_few_degrees_and_percent():
    rng = np.random.default_rng(2)
    rotation, translation = POSES.rotation[::5], POSES.translation[::5]
    seen = outlines(POINTS, RADII, rotation, translation).center
    weight = np.broadcast_to(1e8 * np.eye(2), (*seen.shape, 2)).copy()
    # Two dots that are not there do not count, whatever stands in their place.
    weight[:, 2:4] = 0
    seen = seen.copy()
    seen[:, 2:4] = 7.0
    start = exponential(0.05 * rng.normal(size=(80, 3))) @ rotation
    near = translation * (1 + 0.03 * rng.normal(size=(80, 1)))
    found, place, chi2 = refine_poses(POINTS, RADII, seen, weight, start, near)
    # Steps end at 1e-10 rad.
    assert angle_between(found, rotation).max() < 1e-8
    np.testing.assert_allclose(place, translation, rtol=0, atol=1e-8)
    assert chi2.max() < 1e-10


@pytest.mark.usefixtures("path")
def test_hopeless_starts_end_without_a_warning():
    rotation = np.stack([np.eye(3), POSES.rotation[0]])
    seen = np.zeros((2, 7, 2))
    weight = np.broadcast_to(np.eye(2), (2, 7, 2, 2))
    _, _, chi2 = refine_poses(POINTS, RADII, seen, weight, rotation, np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert np.isinf(chi2[0])
    assert np.isfinite(chi2[1])


def test_compiled_outlines_are_those_of_the_twin(monkeypatch):
    if kernel.library() is None:
        pytest.skip(kernel.missing())
    rng = np.random.default_rng(5)
    # Behind the camera, seen from behind, and through its plane, too.
    rotation, translation = exponential(3 * rng.normal(size=(50, 3))), rng.normal(0, 0.3, (50, 3))
    compiled = outlines(POINTS, RADII, rotation, translation)
    monkeypatch.setattr(kernel, "library", lambda: None)
    plain = outlines(POINTS, RADII, rotation, translation)
    np.testing.assert_array_equal(compiled.seen, plain.seen)
    assert 0 < plain.seen.sum() < plain.seen.size / 2
    for name in ("center", "point", "shape"):
        # Near the plane of the camera's center, differences of nearly equal numbers are divided by small ones.
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), rtol=1e-7, atol=1e-9)


def test_compiled_refinement_takes_the_same_steps(monkeypatch):
    if kernel.library() is None:
        pytest.skip(kernel.missing())
    rng = np.random.default_rng(3)
    rotation, translation = POSES.rotation[::10], POSES.translation[::10]
    seen = outlines(POINTS, RADII, rotation, translation).center + 1e-3 * rng.normal(size=(40, 7, 2))
    factor = rng.normal(size=(40, 7, 2, 2))
    weight = 1e6 * (factor @ factor.swapaxes(-1, -2) + 0.1 * np.eye(2)) * (rng.random((40, 7)) < 0.8)[..., None, None]
    start = exponential(0.3 * rng.normal(size=(40, 3))) @ rotation, translation * (1 + 0.1 * rng.normal(size=(40, 1)))
    for steps, tolerance in ((1, 1e-10), (3, 1e-10), (20, 1e-3)):
        compiled = refine_poses(POINTS, RADII, seen, weight, *start, steps, tolerance)
        with monkeypatch.context() as without:
            without.setattr(kernel, "library", lambda: None)
            plain = refine_poses(POINTS, RADII, seen, weight, *start, steps, tolerance)
        assert np.isfinite(plain[2]).sum() > 30
        for one, other in zip(compiled, plain, strict=True):
            # Rounding grows with the condition of the normal equations, some 1e6.
            np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-9)


HOMOGRAPHY = plane_homography(POSES.rotation, POSES.translation, PAPER_CAMERA.matrix)


@pytest.mark.parametrize("n", [4, 5, 8])
def test_exact_over_all_poses_without_noise(ngon, n):
    marker = ngon(n)
    points, radii = marker.xyz[:, :2], np.full(n, 0.018)
    truth = project(marker.xyz, POSES.rotation, POSES.translation, PAPER_CAMERA.matrix)
    ellipses = circle_image(points, radii, HOMOGRAPHY[:, None])[0]
    corrected, homography = correct_centers(ellipses, points, radii)
    assert np.abs(ellipses - truth).max() > 0.5
    # What two rounds leave is at most 4e-5 px, a hundredth of the best center's standard deviation.
    np.testing.assert_allclose(corrected, truth, rtol=0, atol=1e-4)
    np.testing.assert_allclose(apply_homography(homography, points), truth, rtol=0, atol=1e-4)


def test_points_without_size_stay(ngon):
    marker = ngon(6)
    truth = project(marker.xyz, POSES.rotation[:5], POSES.translation[:5], PAPER_CAMERA.matrix)
    corrected, _ = correct_centers(truth, marker.xyz[:, :2], np.full(6, 1e-9))
    np.testing.assert_allclose(corrected, truth, rtol=0, atol=1e-9)


def test_three_points_on_a_line_end_without_a_warning():
    points = np.array([[0, 0], [0.1, 0], [0.2, 0], [0, 0.1]])
    correct_centers(apply_homography(HOMOGRAPHY[:1], points), points, np.full(4, 0.01))
