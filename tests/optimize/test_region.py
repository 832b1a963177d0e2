import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.model.boundary import Circle
from markergen.optimize.region import Region


@given(st.integers(0, 2**32 - 1), st.integers(4, 12), st.floats(0, 0.05))
def test_projected_layouts_are_feasible_by_plain_arithmetic(seed, n, diameter):
    region = Region(Circle(0.15), diameter, diameter / 10)
    points = np.random.default_rng(seed).normal(scale=0.2, size=(3, n, 2))
    points = region.project(points)
    for layout in points:
        if not region.holds(layout[None])[0]:
            # Jams are allowed only where the dots nearly fill the room.
            assert n * diameter**2 > 0.3 * 0.3**2
            continue
        assert np.hypot(*layout.T).max() <= 0.15 - region.inset + 1e-9
        gaps = [np.hypot(*(a - b)) for i, a in enumerate(layout) for b in layout[:i]]
        assert min(gaps) >= region.spacing - 1e-9


def test_what_is_feasible_stays():
    region = Region(Circle(0.15), 0.02, 0.002)
    points = np.array([[[0.1, 0], [-0.1, 0], [0, 0.1], [0, -0.1]]])
    np.testing.assert_array_equal(region.project(points.copy()), points)


def test_coincident_points_are_parted():
    region = Region(Circle(0.15), 0.02, 0.002)
    assert region.holds(region.project(np.zeros((1, 5, 2))))[0]


def test_violation_is_the_largest_breach():
    region = Region(Circle(1.0), 0.2, 0.02)
    points = np.array([[[0.95, 0], [0, 0], [0.1, 0], [0, 0.8]]])
    # 0.95 is 0.07 beyond 1 - 0.1 - 0.02; 0.1 apart is 0.12 short of 0.22.
    assert region.violation(points)[0] == pytest.approx(0.12)


def test_samples_are_seeded():
    region = Region(Circle(0.15), 0.02, 0.002)
    first, second = (region.sample(4, 6, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
