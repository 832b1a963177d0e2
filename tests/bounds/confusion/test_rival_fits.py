"""What the fits of rival labelings promise: true poses, a proof that displaced images bear out, front sides only."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markergen.bounds.confusion.rival_fits import EDGE_ON, RivalFit, fit_poses, seen_layout
from markergen.maths.rotation import exponential
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import named_poses

POSES = named_poses("cone:distance=0.8..1.2,tilt=20..60,count=6,seed=1")
FISHY = Camera(640, 480, 800.0, 800.0, 320.0, 240.0, Distortion("radtan", (-0.2, 0.05, 0.001, -0.002)))
POINTS = np.array([[0.12, 0.02], [0.03, 0.1], [-0.09, 0.08], [-0.1, -0.07], [0.05, -0.11]])


def scene(points=POINTS, camera=PAPER_CAMERA, poses=POSES):
    return seen_layout(points, np.zeros(len(points), dtype=np.intp), camera, poses)


@pytest.mark.parametrize("camera", [PAPER_CAMERA, FISHY])
@pytest.mark.parametrize("heights", [0.0, 0.03])
def test_the_true_labeling_fits_from_the_true_pose(camera, heights):
    points = np.column_stack([POINTS, heights * np.array([0, 1, 0, 1, 0.5])])
    seen = scene(points, camera)
    result = seen.fit(np.tile(seen.truth, (len(POSES), 1)), np.arange(len(POSES)))
    # The fit ends where the sum of squares falls by less than a billionth, or is nothing.
    np.testing.assert_allclose(result.distance, 0, atol=1e-5)
    np.testing.assert_allclose(result.rotation, POSES.rotation, atol=1e-5)


def test_the_jacobian_is_the_derivative_on_both_sides_of_the_limit():
    fit = RivalFit(np.pad(POINTS, ((0, 0), (0, 1))), np.zeros((5, 5, 2)), FISHY, 0.8)
    # 37 degrees is at a cosine of 0.8: of these tilts two are beyond.
    poses = named_poses("cone:distance=1,tilt=20..60,count=5,seed=1")
    here = poses.rotation, poses.translation
    jacobian = fit.jacobian(here, fit.residuals(here))
    assert 0 < np.count_nonzero(jacobian[:, -1].any(axis=-1)) < 5
    step = 1e-6
    for k, change in enumerate(step * np.eye(6)):
        ends = [
            fit.residuals((exponential(s * change[:3]) @ poses.rotation, poses.translation + s * change[3:]))[1]
            for s in (1, -1)
        ]
        # Central differences are good to about 1e-5 of some 1000 px per rad or m.
        np.testing.assert_allclose((ends[1] - ends[0]) / (2 * step), jacobian[:, :, k], atol=1e-2)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_images_displaced_by_less_than_half_the_distance_are_fitted_better_by_the_true_labeling(seed):
    rng = np.random.default_rng(seed)
    seen = scene()
    pose, labeling = int(rng.integers(len(POSES))), rng.permutation(5)
    rival = seen.fit(labeling[None], np.array([pose]))
    if not rival.moved.any():
        return
    direction = rng.normal(size=(5, 2))
    images = seen.images[pose] + 0.49 * rival.distance[0] * direction / np.linalg.norm(direction)
    true_residual = np.linalg.norm(images - seen.images[pose])
    again = fit_poses(seen.points, images[labeling][None], PAPER_CAMERA, rival.rotation, rival.translation)[2][0]
    assert true_residual < again


def test_half_way_to_the_rival_both_fit_equally():
    seen = scene()
    rival = seen.fit(np.array([[1, 0, 2, 3, 4]]), np.array([2]))
    drawn = PAPER_CAMERA.project(seen.points, rival.rotation, rival.translation)[0]
    back = np.empty_like(drawn)
    back[rival.labeling[0]] = drawn
    middle = (seen.images[2] + back) / 2
    displacement = np.linalg.norm(middle - seen.images[2])
    assert np.sqrt(np.mean(np.sum((middle - seen.images[2]) ** 2, axis=-1))) == pytest.approx(rival.px[0])
    assert np.linalg.norm(middle[rival.labeling[0]] - drawn) == pytest.approx(displacement)


def test_a_mirror_image_is_not_seen_from_the_front():
    # Symmetric about the y axis, and about nothing else: exchanged left and right it fits only from behind.
    trapezoid = np.array([[0.1, -0.05], [-0.1, -0.05], [0.05, 0.08], [-0.05, 0.08]])
    seen = scene(trapezoid)
    mirrored = seen.fit(np.tile([1, 0, 3, 2], (len(POSES), 1)), np.arange(len(POSES)))
    assert mirrored.px.min() > 5
    facing = -np.sum(mirrored.rotation[:, :, 2] * mirrored.translation, axis=-1)
    facing /= np.linalg.norm(mirrored.translation, axis=-1)
    # The limit gives way a little under what pulls at it: by as many px as the fit is off, of 300.
    assert np.all(facing > EDGE_ON * (1 - mirrored.distance / 300) - 1e-9)


def test_a_turned_square_fits_exactly():
    square = 0.1 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    seen = scene(square)
    result = seen.fit(np.tile([1, 2, 3, 0], (len(POSES), 1)), np.arange(len(POSES)))
    np.testing.assert_allclose(result.px, 0, atol=1e-5)
