"""What every lens model of the table keeps to."""

import numpy as np
import pytest

from markergen.maths.distortion import (
    LARGEST_RADIUS,
    coefficient_jacobian,
    distort,
    distortion_hessian,
    distortion_jacobian,
    domain_radius,
    undistort,
)
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera, Distortion

SIZES = {"radtan": (-0.28, 0.07, 2e-4, 2e-5, 0.01), "rational": (0.5, -0.3, 1e-3, 2e-4, 0.01, 0.8, -0.2, 0.03)}
"""Coefficients that a lens might have; of a model that is not here, each is 0.2."""

CASES = [
    pytest.param(name, (SIZES.get(name, ()) + (0.2,) * 8)[: len(names)], id=f"{name}-{len(names)}")
    for name in LENSES
    for names in LENSES[name].coefficients
]


def inside(model, coefficients, share=0.9):
    rng = np.random.default_rng(0)
    radius = min(domain_radius(model, coefficients), 1.2) * share * np.sqrt(rng.random(300))
    angle = rng.uniform(0, 2 * np.pi, 300)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@pytest.mark.parametrize(("model", "coefficients"), CASES)
def test_names_are_given_and_lead_to_one_model(model, coefficients):
    every = [word for name in LENSES for word in (name, *LENSES[name].aliases)]
    assert len(every) == len(set(every))
    assert all(word == word.lower() for word in every)
    distortion = Distortion(model, coefficients)
    assert len(set(distortion.names)) == len(coefficients)
    assert Camera(640, 480, 500.0, 500.0, 320.0, 240.0, distortion).from_pixels(np.array([[320.0, 240.0]])).shape == (
        1,
        2,
    )


@pytest.mark.parametrize(("model", "coefficients"), CASES)
def test_the_domain_is_a_disk_on_which_it_is_one_to_one(model, coefficients):
    limit = domain_radius(model, coefficients)
    assert 0.1 < limit <= LARGEST_RADIUS
    points = inside(model, coefficients)
    after = distort(model, points, coefficients)
    assert np.isfinite(after).all()
    forward = np.sum((points[:, None] - points) * (after[:, None] - after), axis=-1)
    assert (forward[np.linalg.norm(points[:, None] - points, axis=-1) > 1e-3] > 0).all()
    far = np.array([[1.001 * LARGEST_RADIUS, 0.0]])
    if model != "none":
        for function in (distort, distortion_jacobian, distortion_hessian):
            assert np.isnan(function(model, far, coefficients)).all()


@pytest.mark.parametrize(("model", "coefficients"), CASES)
def test_the_inverse_undoes_it(model, coefficients):
    points = inside(model, coefficients)
    np.testing.assert_allclose(undistort(model, distort(model, points, coefficients), coefficients), points, atol=1e-11)


@pytest.mark.parametrize(("model", "coefficients"), CASES)
def test_derivatives_agree_with_differences(model, coefficients):
    points, step = inside(model, coefficients), 1e-5

    def slope(function, h):
        return np.stack(
            [
                (function(model, points + h * e, coefficients) - function(model, points - h * e, coefficients))
                / (2 * h)
                for e in np.eye(2)
            ],
            axis=-1,
        )

    # Central differences: 1e-10 of the third derivative, and 1e-16/1e-5 of rounding; a model without closed forms has
    # differences of its own, and those of differences for the second derivatives.
    np.testing.assert_allclose(distortion_jacobian(model, points, coefficients), slope(distort, step), atol=1e-8)
    hessian = distortion_hessian(model, points, coefficients)
    np.testing.assert_allclose(hessian, slope(distortion_jacobian, 1e-4), atol=1e-5)
    by_coefficient = coefficient_jacobian(model, points, coefficients)
    assert by_coefficient.shape == (300, 2, len(coefficients))
    for i in range(len(coefficients)):
        ahead, behind = (tuple(c + h * (j == i) for j, c in enumerate(coefficients)) for h in (step, -step))
        numeric = (distort(model, points, ahead) - distort(model, points, behind)) / (2 * step)
        np.testing.assert_allclose(by_coefficient[..., i], numeric, atol=1e-8)


@pytest.mark.parametrize(("model", "coefficients"), CASES)
def test_any_batch(model, coefficients):
    points = inside(model, coefficients)[:24].reshape(2, 3, 4, 2)
    after = distort(model, points, coefficients)
    assert after.shape == undistort(model, after, coefficients).shape == points.shape
    assert distortion_jacobian(model, points, coefficients).shape == (2, 3, 4, 2, 2)
    assert distortion_hessian(model, points, coefficients).shape == (2, 3, 4, 2, 2, 2)
    for function in (distort, undistort):
        assert function(model, np.zeros((0, 2)), coefficients).shape == (0, 2)
    np.testing.assert_allclose(distort(model, np.zeros((1, 2)), coefficients), 0, atol=1e-15)
