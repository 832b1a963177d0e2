"""Left-out photographs and two halves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from sentences import sentence

from benchmarks.calibration_sets import hand_held, in_gauge, layout, nees, photographed, simulate
from markergen.calibration.adjustment import adjust
from markergen.calibration.flexing import flexing
from markergen.calibration.judging import NotJudged, Photographs, compare_halves, cross_validate
from markergen.calibration.network import CameraFreedom, Views
from markergen.calibration.weaknesses import findings
from markergen.maths.rotation import exponential


def test_a_left_out_photograph_is_predicted_as_by_hand():
    """The others adjusted, and scipy's fit of the pose alone."""
    rng = np.random.default_rng(0)
    made = simulate(6, 5, rng)
    whole = adjust(made.network(), made.views)
    result = cross_validate(whole, np.arange(5))
    others = adjust(made.network(), whole.views.take(np.arange(5) != 3))
    for places, part in ((others.places, result.measured), (made.design, result.nominal)):
        start = whole.views.rotation[3], whole.views.translation[3]

        def residual(step, places=places, start=start):
            rotation, translation = exponential(step[:3]) @ start[0], start[1] + step[3:]
            pixels = made.camera.project(places, rotation[None], translation[None])[0]
            return (made.views.pixels[3] - pixels).ravel()

        fit = least_squares(residual, np.zeros(6), x_scale=[1, 1, 1, 0.1, 0.1, 0.1], xtol=1e-14, ftol=1e-14)
        assert part.squares[3] == pytest.approx(2 * fit.cost, rel=1e-5)
        assert part.rms_each[3] == pytest.approx(np.sqrt(2 * fit.cost / 6), rel=1e-5)
        assert part.chi2[3] == pytest.approx(2 * fit.cost / 0.03**2, rel=1e-5)
    assert (result.measured.degrees_of_freedom == 6).all()
    assert result.refitted is None


@pytest.mark.parametrize("unknown", [False, True])
def test_a_bad_print_is_predicted_better_when_measured(unknown):
    made = simulate(12, 12, np.random.default_rng(1))
    whole = adjust(made.unknown_camera() if unknown else made.network(), made.views)
    result = cross_validate(whole, np.arange(12))
    assert result.better
    assert result.gain.low < result.gain.ratio < result.gain.high
    assert "times better" in result.verdict
    assert 1 < result.measured.variance_factor < 2 < result.nominal.variance_factor
    assert (result.refitted is not None) is unknown
    if unknown:
        assert result.measured.rms < result.best_nominal.rms <= result.nominal.rms


def test_an_exact_print_is_not_predicted_better_when_measured():
    """Fewer unknowns predict better; and the same seed gives the same bytes."""
    rng, design = np.random.default_rng(2), layout(8)
    made = photographed(design, design, *hand_held(12, rng, design), rng)
    whole = adjust(made.network(), made.views)
    result = cross_validate(whole, np.arange(12))
    assert not result.better
    assert "times better" not in result.verdict
    level = replace(result, gain=replace(result.gain, low=0.91, high=3.2))
    assert sentence("no better", "the design") in level.verdict
    assert "0.91 to 3.2, includes 1 (12 photographs)" in level.verdict
    again = cross_validate(whole, np.arange(12))
    assert result.measured.squares.tobytes() == again.measured.squares.tobytes()


def test_views_of_one_photograph_stay_together():
    """Copies of a photograph would predict it too well."""
    made = simulate(5, 12, np.random.default_rng(3))
    whole = adjust(made.network(), made.views)
    twice = np.repeat(np.arange(6), 2)
    result = cross_validate(whole, twice)
    assert result.photos.tolist() == list(range(6))
    assert (result.measured.dots == 10).all()
    assert (result.measured.degrees_of_freedom == 8).all()
    apart = adjust(made.network(), whole.views.take(twice != 4))
    held = replace(
        apart.network, design=apart.places, free=False, freedom=CameraFreedom.held(made.camera), cameras=apart.cameras
    )
    fitted = adjust(held, whole.views.take(twice == 4))
    assert result.measured.chi2[4] == pytest.approx(fitted.chi2, rel=1e-9)


def test_dots_seen_once_are_not_counted():
    made = simulate(8, 6, np.random.default_rng(4))
    seen = made.views.seen.copy()
    seen[1:, 7], seen[2:, 6] = False, False
    views, photo = replace(made.views, seen=seen), np.arange(len(seen))
    kept = Photographs(made.network(), views, np.ones(seen.shape), photo).determined()
    assert kept.tolist() == [True] * 7 + [False]
    views = replace(made.views, seen=seen)
    whole = adjust(made.network(), replace(made.views, seen=np.where(np.arange(8) == 7, True, seen)))
    result = cross_validate(replace(whole, views=views, weights=views.seen.astype(float)), np.arange(6))
    assert result.measured.dots.tolist() == [6] * 6


def test_too_few_photographs_are_told():
    made = simulate(5, 4, np.random.default_rng(5))
    whole = adjust(made.network(), made.views)
    assert isinstance(compare_halves(whole, np.arange(4)), NotJudged)
    two = adjust(made.network(), made.views.take(slice(2)))
    assert cross_validate(two, np.arange(2)) == NotJudged(sentence("few photographs", 2))
    held = adjust(replace(made.network(), free=False), made.views.take(slice(1)))
    assert cross_validate(held, np.arange(1)) == NotJudged(sentence("one photograph"))


def test_held_dots_are_not_compared_with_the_design():
    made = simulate(6, 6, np.random.default_rng(9))
    held = adjust(replace(made.unknown_camera(), free=False), made.views)
    result = cross_validate(held, np.arange(6))
    assert result.gain is None
    assert not result.better
    assert "predicted to" in result.verdict
    halves = compare_halves(held, np.arange(6))
    assert halves.rms_um == 0
    assert "camera alone" in halves.verdict
    assert halves.camera_chi2 is not None


def _halves(sets, seed, freedom=None, sigma=None):
    result = []
    for k in range(sets):
        rng = np.random.default_rng([seed, k])
        made = simulate(5, 16, rng)
        network = made.network()
        if freedom is not None:
            # The camera is known with an error, of its own sigma, that both halves share.
            covariance = np.diag(np.array(freedom) ** 2)
            wrong = made.camera
            step = rng.normal(0, 1, 9) * freedom
            wrong = replace(
                wrong, fx=wrong.fx + step[0], fy=wrong.fy + step[1], cx=wrong.cx + step[2], cy=wrong.cy + step[3]
            )
            network = made.network(CameraFreedom.of_covariance(covariance), wrong)
        if sigma is not None:
            # Measured by hand along x and y, with an error that both halves share.
            hand = made.true + rng.normal(0, sigma, made.true.shape) * [1, 1, 0]
            prior = np.broadcast_to(np.diag([sigma**-2, sigma**-2, 0.0]), (5, 3, 3))
            network = replace(network, design=hand, prior=prior)
        result.append(compare_halves(adjust(network, made.views), np.arange(16)))
    return result


@pytest.mark.parametrize(
    ("freedom", "sigma", "rank"),
    [
        (None, None, 8),
        ([4.0, 4.0, 4.0, 4.0, 0, 0, 0, 0, 0], None, 8),
        pytest.param(None, 2e-5, 8, marks=pytest.mark.long),
    ],
)
def test_two_halves_differ_by_their_claimed_errors(freedom, sigma, rank):
    """Mean chi2 per degree of freedom: 8 of them in each of 16 sets, so its standard deviation is 0.13.

    The scale is that of the design, or of the dots measured by hand: both halves have the same.
    """
    results = _halves(16, 6, freedom, sigma)
    assert {item.degrees_of_freedom for item in results} == {rank}
    assert np.mean([item.variance_factor for item in results]) == pytest.approx(1, abs=0.4)
    assert np.mean([item.chance < 0.01 for item in results]) < 0.15
    assert all(set(item.photos[0]).isdisjoint(item.photos[1]) for item in results)
    assert all(len(item.photos[0]) == len(item.photos[1]) == 8 for item in results)
    assert "agree" in results[0].verdict
    assert np.mean([item.camera_chi2 for item in results]) == pytest.approx(1, abs=0.5) if freedom else True


def test_halves_that_disagree_are_told():
    """The print changes after half of the photographs that are alike in pairs."""
    rng = np.random.default_rng(7)
    design = layout(6)
    rotation, translation = hand_held(8, rng, design)
    first = photographed(design, design, rotation, translation, rng)
    result = None
    whole = adjust(first.network(), first.views)
    result = compare_halves(whole, np.arange(8))
    moved = photographed(design, design + rng.normal(0, 5e-4, design.shape), rotation, translation, rng)
    second = np.isin(np.arange(8), result.photos[1])
    mixed = replace(first.views, pixels=np.where(second[:, None, None], moved.views.pixels, first.views.pixels))
    # Taken as they are claimed: the scale of the whole would hide it.
    output = compare_halves(replace(whole, views=replace(whole.views, pixels=mixed.pixels)), np.arange(8))
    assert output.chance < 1e-6
    assert "disagree" in output.verdict
    assert output.rms_um > 5 * result.rms_um
    assert len(output.cameras) == 2
    assert output.camera_chi2 is None


def test_the_true_dots_are_brought_into_the_gauge():
    """Of the simulator: the images stay, and the gauge is met; so the error of the dots is that claimed."""
    made = simulate(7, 12, np.random.default_rng(8))
    network = made.network()
    places, rotation, translation = in_gauge(network, made.true, made.rotation, made.translation)
    gauge = network.gauge(network.design)
    assert np.abs(gauge.T @ (places - made.design).ravel()).max() < 1e-12
    before = made.camera.project(made.true, made.rotation, made.translation)
    assert np.abs(made.camera.project(places, rotation, translation) - before).max() < 1e-9
    adjustment = adjust(network, made.views)
    assert 0.2 < nees((adjustment.places - places).ravel(), adjustment.covariance, 14) < 3


def test_markers_of_one_photograph_are_judged_together():
    """Two markers, and dots that are hidden here and there: every judgment counts dots of both."""
    rng = np.random.default_rng(10)
    parts = [simulate(n, 12, rng) for n in (7, 9)]
    pixels, seen = np.zeros((24, 16, 2)), np.zeros((24, 16), dtype=bool)
    for made, rows, columns in zip(parts, (slice(0, 12), slice(12, 24)), (slice(0, 7), slice(7, 16)), strict=True):
        pixels[rows, columns], seen[rows, columns] = made.views.pixels, True
    seen[rng.random(seen.shape) < 0.05] = False
    views = Views(
        pixels,
        np.broadcast_to(0.03**2 * np.eye(2), (24, 16, 2, 2)),
        seen,
        *(np.concatenate([getattr(made.views, name) for made in parts]) for name in ("rotation", "translation")),
    )
    network = replace(
        parts[0].network(),
        design=np.concatenate([made.design for made in parts]),
        radii=np.zeros(16),
        marker=np.repeat([0, 1], [7, 9]),
    )
    whole, photo = adjust(network, views), np.tile(np.arange(12), 2)
    result = cross_validate(whole, photo)
    assert result.better
    assert result.measured.dots.tolist() == (seen[:12].sum(axis=1) + seen[12:].sum(axis=1)).tolist()
    assert compare_halves(whole, photo).degrees_of_freedom == 3 * 16 - 14
    assert not flexing(whole).bends
    assert findings(whole) == ()
