import numpy as np
import pytest
from markergen_paper.measurements import (
    ESTIMATORS_FLAT,
    ESTIMATORS_RELIEF,
    MEASURES,
    bound_ratios,
    conditions,
    images_of,
    layout_trials,
    written,
)
from markergen_paper.methods import FromPoor, FromTruth
from markergen_paper.options import COORDINATES, REGION, objective_for, poses_of

from markergen.maths.dlt import dlt_matrix
from markergen.model.camera import PAPER_CAMERA
from markergen.objectives.criteria import regular_polygon
from markergen.validation.bounds import pose_bounds
from markergen.validation.trials import Experiment, run_trials

POSE = poses_of([205])


def trials(layouts, noise_px, runs, rng, *estimators):
    """Errors (B,) of layouts (B, n, 2 or 3) under one pose."""
    kept = layout_trials(layouts[None], POSE, PAPER_CAMERA, noise_px, runs, [rng], *estimators)
    return {key: values[0] for key, values in kept.items()}


@pytest.fixture(scope="module")
def layouts():
    return np.concatenate([regular_polygon(5, 0.15)[None], REGION.sample(3, 5, np.random.default_rng(4))])


def test_they_are_the_trials_that_validation_makes(layouts):
    """Of one layout, with the same random numbers, against the other way to the same errors."""
    kept = trials(layouts[:1], 1.0, 200, np.random.default_rng(7))
    seed = np.random.SeedSequence(7)
    bounds = pose_bounds(np.c_[layouts[0], np.zeros(5)], PAPER_CAMERA, POSE, 1.0)
    points = np.c_[layouts[0], np.zeros(5)]
    experiment = Experiment(points, 0.15, PAPER_CAMERA, POSE, bounds, 1.0, 200, 7, ("dlt", "epnp", "ippe", "lm"))
    assert seed.entropy == experiment.seed
    errors = run_trials(experiment, [0])[0]
    for measure, estimators in MEASURES.items():
        for name in estimators:
            values = getattr(errors[name], measure)[~errors[name].failed]
            # Other random numbers: means of 200 agree to some of their standard errors.
            mean, error = kept[f"{name}.{measure}.mean"][0], values.std() / np.sqrt(len(values))
            assert abs(mean - values.mean()) < 6 * error
            assert kept[f"{name}.failed"][0] == errors[name].failed.mean()


def test_layouts_together_are_layouts_alone(layouts):
    """Whatever else is in the batch: without noise there is nothing random about it."""
    together = trials(layouts, 0.0, 2, np.random.default_rng(0))
    for i in range(len(layouts)):
        alone = trials(layouts[i : i + 1], 0.0, 2, np.random.default_rng(0))
        for key, values in together.items():
            np.testing.assert_allclose(values[i], alone[key][0], rtol=1e-3, atol=1e-6)
    # Nothing errs but by rounding, EPnP by its own algorithm's.
    assert max(together[f"{name}.rotation_deg.mean"].max() for name in ("ippe", "lm")) < 1e-4
    assert together["dlt.he_px2.mean"].max() < 1e-12


def test_blocks_change_nothing_but_the_grouping(layouts, monkeypatch):
    whole = trials(layouts, 1.0, 3, np.random.default_rng(1))
    monkeypatch.setattr("markergen_paper.measurements.BLOCK", 3)
    parts = trials(layouts, 1.0, 3, np.random.default_rng(1))
    for key, values in whole.items():
        np.testing.assert_array_equal(values, parts[key])


def test_a_layout_that_determines_nothing_fails_and_disturbs_no_other(layouts):
    line = np.linspace(-0.1, 0.1, 5)[:, None] * np.array([1.0, 0.5])
    kept = trials(np.stack([layouts[0], line]), 0.5, 20, np.random.default_rng(0))
    assert kept["dlt.failed"].tolist() == [0.0, 1.0]
    assert np.isfinite(kept["dlt.he_px2.mean"]).tolist() == [True, False]
    assert kept["lm.failed"][0] == 0
    assert np.isfinite(kept["lm.rotation_deg.mean"][0])


def test_points_in_space_have_estimators_of_their_own():
    layouts = np.c_[regular_polygon(6, 0.15), np.tile([0.0, 0.05], 3)][None]
    kept = trials(layouts, 0.2, 20, np.random.default_rng(0), ESTIMATORS_RELIEF)
    assert {key.split(".")[0] for key in kept} == set(ESTIMATORS_RELIEF)
    assert kept["lm.rotation_deg.mean"][0] < 1


@pytest.mark.parametrize("block", [8, 4000])
def test_poses_together_are_poses_alone(layouts, monkeypatch, block):
    """In blocks of half a pose, and of all of them."""
    monkeypatch.setattr("markergen_paper.measurements.BLOCK", block)
    poses = poses_of([3, 205, 311])
    drawn = np.stack([np.roll(layouts, i, axis=0) for i in range(3)])
    estimators = (*ESTIMATORS_FLAT, FromTruth, FromPoor)
    rngs = [np.random.default_rng(i) for i in range(3)]
    together = layout_trials(drawn, poses, PAPER_CAMERA, 1.0, 4, rngs, estimators)
    for i in range(3):
        one = poses.taken(np.array([i]), 0)
        alone = layout_trials(drawn[i : i + 1], one, PAPER_CAMERA, 1.0, 4, [np.random.default_rng(i)], estimators)
        for key, values in together.items():
            assert values.shape == drawn.shape[:2]
            np.testing.assert_allclose(values[i], alone[key][0], rtol=1e-5)


@pytest.fixture(scope="module")
def drawn():
    return REGION.sample(20, 5, np.random.default_rng(2))[None]


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_c_is_that_of_the_objective(coordinates, drawn):
    ours = conditions(coordinates, drawn, POSE, PAPER_CAMERA)
    other = objective_for(coordinates, POSE).linearize(drawn[0])[0].T
    # A'A squares the condition: of 16 digits 16 - 2 log10(c) are left, and c is up to 1e5 in pixels.
    np.testing.assert_allclose(ours, other, rtol=1e-4)


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_the_homography_is_in_the_null_space(coordinates, drawn):
    pixels = images_of(drawn, POSE, PAPER_CAMERA)
    objects, images = written(coordinates, drawn, pixels[None], POSE, PAPER_CAMERA)
    singular = np.linalg.svd(dlt_matrix(objects, images), compute_uv=False)
    assert np.all(singular[..., 8] < 1e-12 * singular[..., 0])


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_bounds_hold_for_small_noise_to_first_order(coordinates, drawn):
    exact = images_of(drawn, POSE, PAPER_CAMERA)
    noisy = exact + 1e-3 * np.random.default_rng(0).standard_normal(exact.shape)
    upper, lower = bound_ratios(coordinates, drawn, exact, noisy, POSE, PAPER_CAMERA)
    assert np.all((upper > 0) & (upper <= 1))
    assert np.all((lower > 0) & (lower <= 1))


def test_bounds_are_those_of_the_formula():
    """Against the paper's formula written out for one layout of more points than unknowns."""
    layout = REGION.sample(1, 7, np.random.default_rng(3))[None]
    exact = images_of(layout, POSE, PAPER_CAMERA)
    noisy = exact + np.random.default_rng(0).standard_normal(exact.shape)
    upper, lower = bound_ratios("pixel", layout, exact, noisy, POSE, PAPER_CAMERA)
    a, b = dlt_matrix(layout, exact)[0, 0], dlt_matrix(layout, noisy)[0, 0]
    h, g = np.linalg.svd(a)[2][8], np.linalg.svd(b)[2][8]
    g = g if h @ g > 0 else -g
    s = np.linalg.svd(a, compute_uv=False)
    c = s[0] / s[7]
    error = np.linalg.norm(h - g) / np.linalg.norm(g)
    assert upper[0, 0] == pytest.approx(error / (c * np.linalg.norm(a - b, 2) / np.linalg.norm(a, 2)), rel=1e-9)
    assert lower[0, 0] == pytest.approx(np.linalg.norm(b @ (h - g)) / np.linalg.norm(b, 2) / error, rel=1e-9)
