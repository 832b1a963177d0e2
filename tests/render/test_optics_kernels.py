import numpy as np
import pytest

from markergen.render.optics import airy_kernel, disk_kernel, line_kernel

DISKS = [disk_kernel(radius) for radius in (0.2, 1.0, 4.6, 13.0)]
LINES = [line_kernel(length, angle) for length in (0.3, 1.0, 6.4, 25.0) for angle in (0.0, 30.0, 90.0, 135.0, -77.0)]


def moments(kernel):
    half = len(kernel) // 2
    y, x = np.indices(kernel.shape) - half
    return np.array(
        [[(kernel * x * x).sum(), (kernel * x * y).sum()], [(kernel * x * y).sum(), (kernel * y * y).sum()]]
    )


AIRY = [airy_kernel(radius) for radius in (0.2, 1.0, 4.0)]


@pytest.mark.parametrize("kernel", DISKS + LINES + AIRY)
def test_kernels_keep_the_light_and_its_place(kernel):
    assert kernel.shape[0] == kernel.shape[1]
    assert kernel.shape[0] % 2 == 1
    assert kernel.min() >= 0
    assert kernel.sum() == pytest.approx(1, abs=1e-12)
    np.testing.assert_array_equal(kernel, kernel[::-1, ::-1])


@pytest.mark.parametrize("radius", [1.0, 4.6, 13.0])
def test_disk_is_spread_as_a_disk(radius):
    # A disk's variance is r^2/4; the cells in which it is counted add a twelfth in the mean, up to a sixth.
    result = moments(disk_kernel(radius))
    np.testing.assert_allclose(result, (radius**2 / 4 + 1 / 12) * np.eye(2), rtol=0, atol=1 / 12)


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, 135.0])
def test_line_is_spread_along_its_direction_alone(angle):
    length = 25.0
    direction = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    spread = moments(line_kernel(length, angle)) - length**2 / 12 * np.outer(direction, direction)
    # Cells are up to sqrt 2 long: a sixth for counting in them, and as much again for those that the ends cut.
    assert np.linalg.norm(spread, 2) < 1 / 3


def test_large_disk_is_even_inside():
    kernel = disk_kernel(10.0)
    np.testing.assert_allclose(kernel[5:-5, 5:-5], 1 / (np.pi * 100), rtol=1e-4)


def test_airy_pattern_has_its_light_where_theory_has_it():
    from scipy.special import j0, j1, jn_zeros

    kernel = airy_kernel(10.0)
    y, x = np.indices(kernel.shape) - len(kernel) // 2
    end = 1 - j0(6 * jn_zeros(1, 1)[0]) ** 2 - j1(6 * jn_zeros(1, 1)[0]) ** 2
    for radius in (5, 10, 20):
        rings = radius / 10 * jn_zeros(1, 1)[0]
        # Rayleigh: of all light, 1 - J0^2 - J1^2 is within; cells are counted as a whole.
        inside = kernel[np.hypot(x, y) <= radius].sum()
        assert inside == pytest.approx((1 - j0(rings) ** 2 - j1(rings) ** 2) / end, abs=0.01)
