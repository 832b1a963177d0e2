import numpy as np
import pytest

from markergen.maths.dlt import dlt_matrix
from markergen.model.camera import PAPER_CAMERA
from markergen.studies.paper.coordinates import bound_ratios, conditions, written
from markergen.studies.paper.options import COORDINATES, REGION, objective_for, poses_of

POSE = poses_of([205])


@pytest.fixture(scope="module")
def layouts():
    return REGION.sample(20, 5, np.random.default_rng(2))


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_c_is_that_of_the_objective(coordinates, layouts):
    own = conditions(coordinates, layouts, POSE, PAPER_CAMERA)
    other = objective_for(coordinates, POSE).linearize(layouts)[0][:, 0]
    # A'A squares the condition: of 16 digits 16 - 2 log10(c) are left, and c is up to 1e5 in pixels.
    np.testing.assert_allclose(own, other, rtol=1e-4)


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_the_homography_is_in_the_null_space(coordinates, layouts):
    pixels = PAPER_CAMERA.project(layouts, POSE.rotation, POSE.translation)[:, 0]
    objects, images = written(coordinates, layouts, pixels[None], POSE, PAPER_CAMERA)
    singular = np.linalg.svd(dlt_matrix(objects, images), compute_uv=False)
    assert np.all(singular[:, 8] < 1e-12 * singular[:, 0])


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_bounds_hold_for_small_noise_to_first_order(coordinates, layouts):
    exact = PAPER_CAMERA.project(layouts, POSE.rotation, POSE.translation)[:, 0]
    noisy = exact + 1e-3 * np.random.default_rng(0).standard_normal(exact.shape)
    upper, lower = bound_ratios(coordinates, layouts, exact, noisy, POSE, PAPER_CAMERA)
    assert np.all((upper > 0) & (upper <= 1))
    assert np.all((lower > 0) & (lower <= 1))


def test_bounds_are_those_of_the_formula():
    """Against the paper's formula written out for one layout of more points than unknowns."""
    layout = REGION.sample(1, 7, np.random.default_rng(3))
    exact = PAPER_CAMERA.project(layout, POSE.rotation, POSE.translation)[:, 0]
    noisy = exact + np.random.default_rng(0).standard_normal(exact.shape)
    upper, lower = bound_ratios("pixel", layout, exact, noisy, POSE, PAPER_CAMERA)
    a, b = dlt_matrix(layout, exact)[0], dlt_matrix(layout, noisy)[0]
    h, g = np.linalg.svd(a)[2][8], np.linalg.svd(b)[2][8]
    g = g if h @ g > 0 else -g
    s = np.linalg.svd(a, compute_uv=False)
    c = s[0] / s[7]
    error = np.linalg.norm(h - g) / np.linalg.norm(g)
    assert upper[0] == pytest.approx(error / (c * np.linalg.norm(a - b, 2) / np.linalg.norm(a, 2)), rel=1e-9)
    assert lower[0] == pytest.approx(np.linalg.norm(b @ (h - g)) / np.linalg.norm(b, 2) / error, rel=1e-9)
