import numpy as np

from markergen.workshop.dot_geometry import _labels


def test_pieces_of_ink_are_those_that_scipy_finds():
    from scipy.ndimage import label

    def pieces(labels):
        return {frozenset(map(tuple, np.argwhere(labels == k))) for k in np.unique(labels[labels > 0])}

    rng = np.random.default_rng(1)
    for share in np.linspace(0.0, 1.0, 21):
        ink = rng.random((8, 9)) < share
        assert pieces(_labels(ink)) == pieces(label(ink)[0])
        np.testing.assert_array_equal(_labels(ink) > 0, ink)
