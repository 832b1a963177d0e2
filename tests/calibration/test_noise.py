"""Noise of photographs, apart from what moves neighboring dots alike; and what that most likely is."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration_sets import CAMERA, hand_held, layout, photographed, printed, simulate
from markergen.calibration.adjustment import adjust
from markergen.calibration.camera_choice import wider_lenses
from markergen.calibration.flexing import flexing
from markergen.calibration.network import CameraFreedom
from markergen.calibration.residuals import likely_cause, noise_of
from markergen.model.camera import Distortion

SIGMA = 0.03


def _stated(views, sigma):
    """Views whose dots claim another standard deviation."""
    return replace(views, covariance=np.broadcast_to(sigma**2 * np.eye(2), views.covariance.shape).copy())


@pytest.mark.parametrize("flex", [0.0, 1e-3])
def test_noise_beyond_that_stated_is_found_in_each_photograph(flex):
    """Twelve photographs of 24 dots with 0.03 px and four with 0.09 px, 0.01 px stated; also of a bent sheet."""
    made = simulate(24, 16, np.random.default_rng(0), sigma=SIGMA, flex=flex)
    more = np.random.default_rng(1).normal(0, np.sqrt(0.09**2 - SIGMA**2), made.views.pixels[:4].shape)
    made.views.pixels[:4] += more
    adjusted = adjust(made.network(), _stated(made.views, 0.01))
    variance = noise_of(adjusted, np.arange(16))
    # An estimate of a photograph has some 25 degrees of freedom.
    assert np.sqrt(variance[:4].mean() + 1e-4) == pytest.approx(0.09, rel=0.3)
    assert np.sqrt(variance[4:].mean() + 1e-4) == pytest.approx(SIGMA, rel=0.2)


def test_photographs_without_more_noise_or_with_few_dots_keep_theirs():
    made = simulate(24, 16, np.random.default_rng(2), sigma=SIGMA)
    assert not noise_of(adjust(made.network(), made.views), np.arange(16)).any()
    few = simulate(6, 16, np.random.default_rng(3), sigma=SIGMA)
    assert not noise_of(adjust(few.network(), _stated(few.views, 0.01)), np.arange(16)).any()


def test_a_coefficient_that_the_lens_lacks_is_no_noise():
    """Seen by an adjustment with all coefficients within wide limits."""
    made, network = _through(Distortion("radtan", (-0.1, 0.05, 0.0, 0.0, -2.0)))
    assert adjust(network, made.views).variance_factor > 10
    flexible = adjust(wider_lenses(network)[-1][1], made.views)
    assert not noise_of(flexible, np.arange(16)).any()


def _through(lens):
    """Photographs through a lens, and a network whose camera lacks its third coefficient."""
    rng, design, camera = np.random.default_rng(4), layout(24), replace(CAMERA, distortion=lens)
    poses = hand_held(16, rng, design, camera)
    made = photographed(design, printed(design, rng), *poses, rng, SIGMA, camera)
    return made, made.network(CameraFreedom.held(CAMERA), CAMERA)


def test_a_cause_is_named_where_residuals_exceed_the_noise():
    made, network = _through(Distortion("radtan", (-0.1, 0.05, 0.0, 0.0, -2.0)))
    adjusted = adjust(network, made.views)
    assert "k1 k2 p1 p2 k3" in likely_cause(adjusted, flexing(adjusted))
    right = adjust(made.network(), made.views)
    assert not likely_cause(right, flexing(right))
    bent = simulate(24, 16, np.random.default_rng(5), sigma=SIGMA, flex=1e-3)
    adjusted = adjust(bent.network(), bent.views)
    assert "bends" in likely_cause(adjusted, flexing(adjusted))
    # Photographs that shake: each row is off by its own.
    rolled = replace(made.views, pixels=made.views.pixels + 3 * np.sin(made.views.pixels[..., 1:] / 30))
    adjusted = adjust(made.network(), rolled)
    assert "processed" in likely_cause(adjusted, flexing(adjusted))
    held = adjust(replace(network, free=False), made.views)
    assert "designed" in likely_cause(held, flexing(held))
