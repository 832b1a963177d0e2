import numpy as np

from markergen.detect.outline_pixels import outline_pixels

IMAGE = np.arange(60 * 80, dtype=np.uint16).reshape(60, 80)


def spread(semi, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return turn @ np.diag(np.square(semi)) @ turn.T


def distance(x, y, center, semi, angle):
    """Signed px to a dense polygon of the outline."""
    t = np.linspace(0, 2 * np.pi, 2000)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = center + (turn @ (np.array(semi)[:, None] * [np.cos(t), np.sin(t)])).T
    nearest = np.linalg.norm(np.stack([x, y], -1)[:, None] - points, axis=-1).min(axis=-1)
    u, v = turn.T @ (np.stack([x, y]) - np.array(center)[:, None])
    return np.where((u / semi[0]) ** 2 + (v / semi[1]) ** 2 < 1, -nearest, nearest)


def collect(center, semi, angle, band=2.5, filled=False, image=IMAGE):
    return outline_pixels(image, np.array([center]), spread(semi, angle)[None], np.array([band]), np.array([filled]))


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
    spreads = np.stack([spread((6, 5), 0.2)] * 4)
    pixels = outline_pixels(IMAGE, centers, spreads, np.full(4, 2.5), np.zeros(4, bool))
    assert (np.diff(pixels.owner) >= 0).all()
    assert pixels.x.min() == 0
    assert pixels.x.max() == 79
    assert pixels.y.min() == 0
    assert pixels.y.max() == 59
    np.testing.assert_array_equal(np.bincount(pixels.owner, minlength=4), np.diff(pixels.start))
    assert np.diff(pixels.start)[2] == 0
    some = pixels.of(np.array([False, True, False, True]))
    np.testing.assert_array_equal(some.x, np.concatenate([pixels.x[pixels.owner == 1], pixels.x[pixels.owner == 3]]))
    np.testing.assert_array_equal(np.unique(some.owner), [0, 1])


def test_huge_ones_are_thinned_out():
    image = np.zeros((3000, 3000), np.uint8)
    pixels = collect((1500.0, 1500.0), (1400, 1300), 0.3, filled=True, image=image)
    # Of 5.7 million.
    assert 10_000 < len(pixels.x) < 200_000
