"""Outliers are left out, and what is right stays in."""

from dataclasses import replace

import numpy as np
from simulated_photos import in_gauge, scene

from markergen.calibration.adjustment import adjust
from markergen.calibration.residuals import adjust_robustly


def spoiled(views, share, rng):
    """Displace a share of the dots by 0.5 to 20 px, and say which."""
    false = rng.random(views.seen.shape) < share
    angle, far = rng.uniform(0, 2 * np.pi, false.shape), np.exp(rng.uniform(np.log(0.5), np.log(20), false.shape))
    moved = np.stack([far * np.cos(angle), far * np.sin(angle)], axis=-1)
    return replace(views, pixels=views.pixels + np.where(false[..., None], moved, 0)), false


def test_a_clean_set_stays_as_it_is():
    made = scene(8, 10, np.random.default_rng(0))
    cleaned = adjust_robustly(made.network, made.views)
    assert cleaned.used.all()
    assert not cleaned.dropped.any()
    np.testing.assert_allclose(cleaned.adjustment.places, adjust(made.network, made.views).places, atol=1e-12)


def test_one_false_dot_in_twenty_costs_less_than_a_quarter():
    rng, errors = np.random.default_rng(4), []
    for _ in range(4):
        simulated = scene(5, 16, rng)
        true, (views, false) = in_gauge(simulated.places, simulated.network), spoiled(simulated.views, 0.05, rng)
        cleaned = adjust_robustly(simulated.network, views)
        adjustments = adjust(simulated.network, simulated.views), cleaned.adjustment
        errors.append([np.mean((adjustment.places - true) ** 2) for adjustment in adjustments])
        # What stays within two sigma of its place is no outlier that could be told.
        assert (false & ~cleaned.dropped & cleaned.used[:, None]).sum() <= 1
    clean, robust = np.sqrt(np.mean(errors, axis=0))
    assert robust < 1.25 * clean


def test_a_view_with_swapped_labels_is_left_out():
    made = scene(8, 12, np.random.default_rng(6))
    pixels = made.views.pixels.copy()
    pixels[3] = pixels[3, [1, 0, 3, 2, 5, 4, 7, 6]]
    cleaned = adjust_robustly(made.network, replace(made.views, pixels=pixels))
    assert not cleaned.used[3]
    assert cleaned.used.sum() == 11
    assert cleaned.adjustment.variance_factor < 1.3


def test_a_marker_that_bends_is_no_set_of_outliers():
    made = scene(12, 15, np.random.default_rng(8))
    design = made.network.design
    bent = made.views.pixels.copy()
    rng = np.random.default_rng(1)
    for k in range(len(bent)):
        places = made.places + np.column_stack([0 * design[:, :2], rng.normal(0, 1e-3) * design[:, 0] ** 2 / 0.11**2])
        bent[k] += made.network.camera.project(places, made.rotation[k : k + 1], made.translation[k : k + 1])[0]
        bent[k] -= made.network.camera.project(made.places, made.rotation[k : k + 1], made.translation[k : k + 1])[0]
    cleaned = adjust_robustly(made.network, replace(made.views, pixels=bent))
    assert cleaned.used.all()
    assert cleaned.dropped.mean() < 0.05
    assert cleaned.adjustment.scale > 1.5
