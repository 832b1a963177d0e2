import numpy as np

from markergen.detect.outline_check import SECTORS, sector_of, strangeness, white_noise
from markergen.detect.outline_pixels import OutlinePixels


def pixels(count=4000, dots=2):
    rng = np.random.default_rng(0)
    owner = np.repeat(np.arange(dots), count)
    x = np.tile(np.arange(count, dtype=float), dots)
    start = np.arange(dots + 1) * count
    return OutlinePixels(x, np.zeros_like(x), rng.normal(0, 1, len(x)), owner, start)


def test_white_noise_is_blind_to_what_is_smooth_or_rare():
    rng = np.random.default_rng(1)
    some = pixels()
    residual = rng.normal(0, np.repeat([2, 5], 4000))
    residual += 10 * np.sin(some.x / 100)
    residual[rng.random(8000) < 0.1] += 100
    # A tenth of strange pixels spoils a fifth of the differences.
    np.testing.assert_allclose(white_noise(some, residual), [2, 5], rtol=0.35)


def test_white_noise_is_at_least_that_of_rounding():
    some = pixels()
    np.testing.assert_allclose(white_noise(some, np.zeros(8000)), np.sqrt(1 / 12))
    lonely = OutlinePixels(some.x[:2] * 3, some.y[:2], some.grey[:2], some.owner[[0, -1]], np.array([0, 1, 2]))
    np.testing.assert_allclose(white_noise(lonely, np.zeros(2)), np.sqrt(1 / 12))


def test_sectors_go_around_each_dot():
    some = pixels(count=SECTORS)
    turn = 2 * np.pi * (np.arange(SECTORS) + 0.5) / SECTORS - np.pi
    direction = np.tile([np.cos(turn), np.sin(turn)], 2)
    np.testing.assert_array_equal(sector_of(some, direction), np.arange(2 * SECTORS))


def profile(shift=0.0, height=1.0, noise=1.0):
    """Sector, slope, model and residual of one dot whose edge in sector 3 is elsewhere; contrast 100, blur 1."""
    rng = np.random.default_rng(0)
    sector = np.repeat(np.arange(SECTORS), 60)
    depth = np.tile(np.linspace(-3, 3, 60), SECTORS)
    slope = 100 * np.exp(-(depth**2) / 2) / np.sqrt(2 * np.pi)
    model = 100 / (1 + np.exp(-1.7 * depth))
    off = np.where(sector == 3, -shift * slope + (height - 1) * (model - 50), 0)
    return sector, slope, model, off + rng.normal(0, noise, len(model))


def judge(*profile_):
    numbers = (np.array([each]) for each in (100.0, 1.0, 10.0, 1.0))
    return strangeness(*profile_, *numbers)[0]


def test_a_shifted_edge_is_strange():
    assert (judge(*profile()) < 1).all()
    for shift in (-0.3, 0.3):
        assert np.flatnonzero(judge(*profile(shift)) > 1).tolist() == [3]
    # Less than a printed edge is off by.
    assert (judge(*profile(0.05)) < 1).all()


def test_a_missing_or_higher_edge_is_strange():
    for height in (0.0, 0.5, 1.6):
        assert np.flatnonzero(judge(*profile(height=height)) > 1).tolist() == [3]
    assert (judge(*profile(height=0.85)) < 1).all()


def test_noise_is_not_strange():
    rng = np.random.default_rng(3)
    sector, slope, model, _ = profile()
    for _ in range(30):
        residual = rng.normal(0, 30, len(model))
        numbers = (np.array([each]) for each in (100.0, 1.0, 10.0, 30.0))
        assert (strangeness(sector, slope, model, residual, *numbers) < 1).all()
