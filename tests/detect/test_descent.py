import numpy as np
import pytest

from markergen.detect.descent import BLUR, CENTER, COUNT, SCALE, SHAPE, SLOPE, Descent
from markergen.detect.outline_pixels import OutlinePixels

TRUTH = np.array([[20.3, 18.6, 0.09, 0.02, 0.12, 200, 40, 0.9, 0.002, -0.001, 20.5, 18.5, 0.5]])


def grid(grey=None):
    y, x = np.indices((40, 42)).reshape(2, -1).astype(float)
    grey = np.zeros(x.size) if grey is None else grey
    return OutlinePixels(x, y, grey, np.zeros(x.size, dtype=np.intp), np.array([0, x.size]))


def descent(unknowns, pixels, ring=True, top=200):
    matrix = unknowns[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    light, dark, blur = unknowns[:, 5], unknowns[:, 6], unknowns[:, 7]
    made = Descent(pixels, unknowns[:, CENTER], matrix, light, dark, blur, np.array([ring]), 1.0, top)
    made.unknowns = unknowns.copy()
    # The light's slope is about a place that stands still.
    made.origin = TRUTH[:, CENTER]
    return made


@pytest.mark.parametrize("column", range(COUNT))
def test_derivatives(column):
    step = 1e-5 * np.abs(TRUTH[0]).max(where=np.arange(COUNT) == column, initial=1e-2)
    high, low = TRUTH.copy(), TRUTH.copy()
    high[0, column] += step
    low[0, column] -= step
    by_hand = (descent(high, grid())._model()[0] - descent(low, grid())._model()[0]) / (2 * step)
    jacobian = descent(TRUTH, grid())._model()[1]
    # What changes along the edge's normal is exact; the rest, of the width and curvature of the edge, is left out.
    scale = np.abs(by_hand).max()
    assert np.sqrt(np.mean((jacobian[column] - by_hand) ** 2)) < 0.06 * scale


@pytest.mark.parametrize("ring", [False, True])
def test_finds_what_made_the_image(ring):
    image = descent(TRUTH, grid(), ring)._model()[0]
    start = TRUTH.copy()
    start[0, CENTER] += [0.5, -0.4]
    start[0, SHAPE] *= 0.93
    start[0, BLUR], start[0, SLOPE], start[0, SCALE] = 1.3, 0, 0.45
    fit = descent(start, grid(image), ring)
    fit.run(30)
    used = COUNT if ring else COUNT - 3
    # The last step of a center is below 1e-3 px, and the next would be far below.
    np.testing.assert_allclose(fit.unknowns[0, :used], TRUTH[0, :used], rtol=2e-3, atol=2e-4)
    assert fit.complete().all()
    assert not fit.leave_out().any()


def test_what_runs_away_is_dropped():
    fit = descent(TRUTH, grid(np.random.default_rng(0).uniform(0, 255, 40 * 42)))
    fit.run(30)
    fit.drop_hopeless(0.12)
    assert len(fit.index) == 0
    # And all goes on with none.
    fit.run(5)
    assert fit.leave_out().shape == (0,)
    assert fit.complete().shape == (0,)


def test_the_chosen_move_and_the_others_stay():
    image = descent(TRUTH, grid())._model()[0]
    one = grid(image)
    n = one.x.size
    two = OutlinePixels(
        np.tile(one.x, 2), np.tile(one.y, 2), np.tile(image, 2), np.repeat([0, 1], n), np.array([0, n, 2 * n])
    )
    start = np.concatenate([TRUTH, TRUTH])
    start[:, CENTER] += 0.3
    matrix = start[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    fit = Descent(two, start[:, CENTER], matrix, *start[:, 5:8].T, np.array([True, True]), 1.0, 200)
    fit.run(20, np.array([False, True]))
    np.testing.assert_array_equal(fit.unknowns[0, CENTER], start[0, CENTER])
    np.testing.assert_allclose(fit.unknowns[1, CENTER], TRUTH[0, CENTER], rtol=0, atol=2e-3)
    assert not fit.residual[:n].any()
    assert np.abs(fit.residual[n:]).max() < 1
