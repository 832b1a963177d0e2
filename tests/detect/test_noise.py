import numpy as np
import pytest

from markergen.detect.noise import grey_noise


@pytest.mark.parametrize("sigma", [1, 4, 20])
def test_is_that_of_the_plain_part(sigma):
    rng = np.random.default_rng(0)
    image = 128 + sigma * rng.standard_normal((480, 640))
    image[:, :320] = rng.integers(0, 256, (480, 320))
    noise = grey_noise(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    # The quietest fifth of all pieces, two fifths of the plain ones, is below the mean by about a standard deviation
    # of pieces of 31 differences, 11 %.
    assert 0.8 * sigma < noise < 1.05 * sigma


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (5, 20), (480, 640)])
def test_none_where_nothing_changes(shape):
    assert grey_noise(np.full(shape, 255, np.uint8)) == 0.0


def test_saturated_parts_do_not_count():
    image = 100 + 3 * np.random.default_rng(0).standard_normal((480, 640))
    image[:, 64:] = 255
    assert grey_noise(np.rint(image).astype(np.uint8)) > 2
