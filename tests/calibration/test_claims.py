"""Claimed covariances are true: normalized errors of dots and fresh poses in simulated calibrations."""

import numpy as np
import pytest

from benchmarks import lens_claims
from benchmarks.calibration_sets import claims, simulate, wrong_camera
from markergen.calibration.adjustment import adjust
from markergen.calibration.flexing import flexing

SIGMA = np.array([2.0, 2.0, 2.0, 2.0, 2e-3, 5e-3, 2e-4, 2e-4, 0.0])
"""Standard deviations of a known camera's parameters."""


def _claims(case, n, photos, sets, flex=0.0):
    """NEES per degree of freedom (sets, 2), and the variance factors and tests for bending."""
    result, output = [], []
    for k in range(sets):
        rng = np.random.default_rng([k, n, photos])
        made = simulate(n, photos, rng, flex=flex)
        network = {
            "known": made.network,
            "unknown": made.unknown_camera,
            "wrong": lambda made=made, rng=rng: made.network(*wrong_camera(rng, SIGMA)[::-1]),
        }[case]()
        whole = adjust(network, made.views)
        result.append([*claims(made, whole, rng), whole.scale])
        output.append(flexing(whole).bends)
    return np.array(result), np.array(output)


@pytest.mark.parametrize("case", ["known", "unknown", "wrong"])
def test_errors_are_as_large_as_claimed(case):
    """Over 25 sets of 12 photographs; the means have standard deviations of 0.12 at most."""
    results, _ = _claims(case, 6, 12, 25)
    assert (abs(results[:, :2].mean(axis=0) - 1) < 0.36).all()


def test_an_error_of_the_camera_that_is_ignored_is_not_covered():
    """What the camera's covariance is for."""
    nees = []
    for k in range(10):
        rng = np.random.default_rng(k)
        made = simulate(6, 12, rng)
        whole = adjust(made.network(camera=wrong_camera(rng, SIGMA)[0]), made.views)
        nees.append(claims(made, whole, rng)[0] * whole.scale)
    assert np.mean(nees) > 3


@pytest.mark.long
@pytest.mark.parametrize("case", ["known", "unknown", "wrong"])
@pytest.mark.parametrize("n", [5, 24])
@pytest.mark.parametrize("photos", [10, 20])
def test_errors_over_many_sets_are_as_large_as_claimed(case, n, photos):
    """Dots within 0.85 to 1.15 over 200 sets; standard deviations are 0.035 for dots and 0.05 for the pose."""
    results, _ = _claims(case, n, photos, 200)
    dots, pose = results[:, :2].mean(axis=0)
    assert 0.85 < dots < 1.15
    assert 0.85 < pose < 1.15


@pytest.mark.long
def test_bending_is_carried_by_the_scale_and_told():
    """Bent by 0.2 mm between photographs: 1.3 with the scale, and more than 2.5 without."""
    results, output = _claims("known", 5, 20, 100, 2e-4)
    scaled, unscaled = results[:, 0].mean(), (results[:, 0] * results[:, 2]).mean()
    assert output.mean() > 0.95
    assert 0.7 < scaled < 1.6
    assert unscaled > 2.5


@pytest.mark.parametrize("lens", ["radtan, strong", "equidistant"])
def test_large_dots_are_claimed_as_well_as_they_are_known_behind_a_strong_lens(lens, make_marker):
    """Rendered; each mean has a standard deviation of the root of two over its degrees of freedom, as chi2 has."""
    around = np.pi / 6 * np.array([0, 1, 2, 3, 4, 6, 7, 9, 10])
    places = [[0.0, 0.0], *(0.072 * np.stack([np.cos(around), np.sin(around)], axis=-1))]
    layout = make_marker(np.array(places), 0.09, 0.03)
    sums = lens_claims.one_set(layout, lens, 70.0, 4, np.random.default_rng(0))
    for column in ("centers", "poses", "dots", "camera"):
        total, freedom = sums[column]
        assert abs(total / freedom - 1) < 4 * np.sqrt(2 / freedom)
    assert sums["as by a pinhole"][0] > 20 * sums["as by a pinhole"][1]
