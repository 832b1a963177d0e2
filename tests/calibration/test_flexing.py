"""Bending between photographs."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration_sets import simulate
from markergen.calibration.adjustment import adjust
from markergen.calibration.flexing import flexing
from markergen.calibration.judging import NotJudged
from markergen.maths.rotation import exponential


def _found(n, photos, seed, flex=0.0, unknown=False):
    made = simulate(n, photos, np.random.default_rng(seed), flex=flex)
    return flexing(adjust(made.unknown_camera() if unknown else made.network(), made.views))


def test_chi2_falls_as_by_a_fit_of_bends():
    """All poses, dots and bends at once, by a dense least squares of differences at the adjusted network."""
    made = simulate(6, 5, np.random.default_rng(0), flex=1e-4)
    whole = adjust(made.network(), made.views)
    result = flexing(whole)
    x, y = made.design[:, :2].T / 0.1
    modes = np.stack([x * x, x * y, y * y])

    def residual(step):
        poses, dots, bends = step[:30].reshape(5, 6), step[30:48].reshape(6, 3), step[48:].reshape(5, 3)
        places = np.repeat((whole.places + 0.1 * dots)[None], 5, axis=0)
        places[..., 2] += 0.1 * bends @ modes
        rotation = exponential(poses[:, :3]) @ whole.views.rotation
        place = places @ rotation.swapaxes(-1, -2) + (whole.views.translation + 0.1 * poses[:, 3:])[:, None]
        pixels = made.camera.to_pixels(place[..., :2] / place[..., 2:])
        return ((made.views.pixels - pixels) / 0.03).ravel()

    jacobian = np.stack([(residual(step) - residual(-step)) / 2e-5 for step in 1e-5 * np.eye(63)], axis=-1)
    left, strength, _ = np.linalg.svd(jacobian, full_matrices=False)
    kept = strength > 1e-7 * strength[0]
    rest = float((residual(np.zeros(63)) ** 2).sum() - ((left[:, kept].T @ residual(np.zeros(63))) ** 2).sum())
    # On a ring x^2 + y^2 is a shift, and the mean bend is the dots' own.
    rank, freedom = 2 * 5 - 2, whole.degrees_of_freedom
    assert kept.sum() == 60 - freedom + rank
    statistic = (whole.chi2 - rest) / rank / (rest / (freedom - rank))
    assert result.statistic == pytest.approx(statistic, rel=1e-4)


@pytest.mark.parametrize("unknown", [False, True])
def test_bends_of_a_fifth_of_a_millimeter_are_noticed(unknown):
    results = [_found(5, 20, k, 2e-4, unknown) for k in range(8)]
    assert sum(item.bends for item in results) >= 7
    # On five dots on the rim a cylinder z = a x^2 / r^2 leaves a RMS of a/sqrt(8), less its shift and tilt.
    assert np.sqrt(np.mean([item.amplitude**2 for item in results])) == pytest.approx(2e-4 / np.sqrt(8), rel=0.3)
    assert "bends" in results[0].verdict


def test_a_rigid_marker_does_not_bend():
    results = [_found(5, 20, 100 + k) for k in range(8)]
    assert not any(item.bends for item in results)
    assert "nothing shows" in results[0].verdict


def test_a_hundredth_of_a_millimeter_is_negligible():
    """Many dots show it, by far more than chance."""
    result = _found(100, 20, 0, 5e-5)
    assert result.chance < 1e-4
    assert not result.bends
    assert "negligible" in result.verdict


def test_too_few_dots_cannot_tell():
    made = simulate(4, 3, np.random.default_rng(1))
    assert isinstance(flexing(adjust(made.network(), made.views)), NotJudged)
    held = adjust(replace(made.unknown_camera(), free=False), made.views)
    assert "as designed" in flexing(held).reason


@pytest.mark.long
@pytest.mark.parametrize(("n", "unknown"), [(5, False), (5, True), (24, False)])
def test_false_alarms_and_power(n, unknown):
    """At 20 photographs and 0.03 px: at most 1 % of 600 rigid sets alarm (binomial 99.9 %: 15), 95 % of 150 bent do."""
    rigid = [_found(n, 20, [2, k], 0.0, unknown).bends for k in range(600)]
    bent = [_found(n, 20, [3, k], 2e-4, unknown).bends for k in range(150)]
    assert sum(rigid) <= 15
    assert sum(bent) >= 0.95 * 150
