import numpy as np

from markergen.detect.outline_pixels import (
    SECTORS,
    OutlinePixels,
    outline_pixels,
    sector_of,
    sector_sums,
    strangeness,
    white_noise,
)

IMAGE = np.arange(60 * 80, dtype=np.uint16).reshape(60, 80)


def distance(x, y, center, semi, angle):
    """Signed px to a dense polygon of the outline."""
    t = np.linspace(0, 2 * np.pi, 2000)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = center + (turn @ (np.array(semi)[:, None] * [np.cos(t), np.sin(t)])).T
    nearest = np.linalg.norm(np.stack([x, y], -1)[:, None] - points, axis=-1).min(axis=-1)
    u, v = turn.T @ (np.stack([x, y]) - np.array(center)[:, None])
    return np.where((u / semi[0]) ** 2 + (v / semi[1]) ** 2 < 1, -nearest, nearest)


def collect(center, semi, angle, band=2.5, filled=False, image=IMAGE):
    one = np.array([center]), np.array([semi], dtype=float), np.array([angle]), np.array([band]), np.array([filled])
    return outline_pixels(image, *one)


def test_the_band_is_whole():
    center, semi, angle = (40.3, 30.7), (20, 12), 0.4
    pixels = collect(center, semi, angle)
    y, x = np.indices(IMAGE.shape).reshape(2, -1)
    off = distance(x.astype(float), y.astype(float), center, semi, angle)
    taken = np.zeros(IMAGE.size, bool)
    taken[(pixels.y * 80 + pixels.x).astype(int)] = True
    # Ellipses with longer axes are not quite at equal distance.
    assert taken[np.abs(off) < 2.2].all()
    assert not taken[np.abs(off) > 2.6].any()
    assert taken.sum() == len(pixels.x)
    np.testing.assert_array_equal(pixels.grey, pixels.y * 80 + pixels.x)


def test_filled_and_small_ones_have_their_inside():
    for semi, filled in (((15, 9), True), ((3, 2), False)):
        pixels = collect((40.0, 30.0), semi, 0.0, filled=filled)
        assert ((pixels.x == 40) & (pixels.y == 30)).sum() == 1


def test_sorted_by_owner_and_cut_at_the_image():
    centers = np.array([[1.0, 1.0], [40, 30], [200, 30], [79, 59]])
    semi, angle = np.tile([6.0, 5.0], (4, 1)), np.full(4, 0.2)
    pixels = outline_pixels(IMAGE, centers, semi, angle, np.full(4, 2.5), np.zeros(4, bool))
    assert (np.diff(pixels.owner) >= 0).all()
    assert pixels.x.min() == 0
    assert pixels.x.max() == 79
    assert pixels.y.min() == 0
    assert pixels.y.max() == 59
    np.testing.assert_array_equal(np.bincount(pixels.owner, minlength=4), np.diff(pixels.start))
    assert np.diff(pixels.start)[2] == 0


def test_huge_ones_are_thinned_out():
    image = np.zeros((3000, 3000), np.uint8)
    pixels = collect((1500.0, 1500.0), (1400, 1300), 0.3, filled=True, image=image)
    # Of 5.7 million.
    assert 10_000 < len(pixels.x) < 200_000


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
    turn = 2 * np.pi * (np.arange(SECTORS) + 0.5) / SECTORS
    np.testing.assert_array_equal(sector_of(np.array([np.cos(turn), np.sin(turn)])), np.arange(SECTORS))
    # Each has the same width.
    turn = 2 * np.pi * (np.arange(160 * SECTORS) + 0.5) / (160 * SECTORS)
    np.testing.assert_array_equal(np.bincount(sector_of(np.array([np.cos(turn), np.sin(turn)]))), 160)


def profile(shift=0.0, height=1.0, noise=1.0):
    """Sector, slope, model and residual of one dot whose edge in sector 3 is elsewhere; contrast 100, blur 1."""
    rng = np.random.default_rng(0)
    sector = np.repeat(np.arange(SECTORS), 60)
    depth = np.tile(np.linspace(-3, 3, 60), SECTORS)
    slope = 100 * np.exp(-(depth**2) / 2) / np.sqrt(2 * np.pi)
    model = 100 / (1 + np.exp(-1.7 * depth))
    off = np.where(sector == 3, -shift * slope + (height - 1) * (model - 50), 0)
    return sector, slope, model, off + rng.normal(0, noise, len(model))


def judge(sector, slope, model, residual, noise=1.0):
    sums = sector_sums(sector, slope, model, residual, np.array([50.0]))
    return strangeness(sums, *(np.array([each]) for each in (100.0, 1.0, 10.0, noise)))[0]


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
        assert (judge(sector, slope, model, residual, 30.0) < 1).all()


def test_a_misfit_all_around_is_not_strange():
    rng = np.random.default_rng(4)
    sector, slope, model, noise = profile()
    # As in photographs that the camera sharpens: edges off by a tenth of a px here and there.
    bent = noise + slope * rng.choice([-0.1, 0.1], SECTORS)[sector]
    assert (judge(sector, slope, model, bent) < 1).all()
    # One that is off by more is strange even then.
    assert np.flatnonzero(judge(sector, slope, model, bent + np.where(sector == 5, 0.3 * slope, 0)) > 1).tolist() == [5]
