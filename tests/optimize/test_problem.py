import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.model.boundary import Circle, polygon_from
from markergen.model.spec import Spec
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.design import design
from markergen.optimize.problem import FeasibleRegion, breach, check


@given(st.integers(0, 2**32 - 1), st.integers(4, 12), st.floats(0, 0.05))
def test_projected_layouts_are_feasible_by_plain_arithmetic(seed, n, diameter):
    region = FeasibleRegion(Circle(0.15), diameter, diameter / 10)
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
    region = FeasibleRegion(Circle(0.15), 0.02, 0.002)
    points = np.array([[[0.1, 0], [-0.1, 0], [0, 0.1], [0, -0.1]]])
    np.testing.assert_array_equal(region.project(points.copy()), points)


def test_coincident_points_are_parted():
    region = FeasibleRegion(Circle(0.15), 0.02, 0.002)
    assert region.holds(region.project(np.zeros((1, 5, 2))))[0]


def test_violation_is_the_largest_breach():
    region = FeasibleRegion(Circle(1.0), 0.2, 0.02)
    points = np.array([[[0.95, 0], [0, 0], [0.1, 0], [0, 0.8]]])
    # 0.95 is 0.07 beyond 1 - 0.1 - 0.02; 0.1 apart is 0.12 short of 0.22.
    assert region.violation(points)[0] == pytest.approx(0.12)


def test_samples_are_seeded():
    region = FeasibleRegion(Circle(0.15), 0.02, 0.002)
    first, second = (region.sample(4, 6, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


SQUARE = polygon_from([np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])])


def test_a_layout_that_touches_everything_breaks_nothing():
    points = np.array([[0.038, 0.038], [-0.038, 0.038], [-0.038, -0.038], [0.038, -0.038], [0.016, 0.038]])
    # Dots of 20 mm, 2 mm from the edge, the last one 2 mm from the first.
    assert breach(points, SQUARE, (), 0.02, 0.002) == pytest.approx(0, abs=1e-15)
    check(breach(points, SQUARE, (), 0.02, 0.002))


@pytest.mark.parametrize(
    ("point", "keep_outs", "expected"),
    [
        ([0.039, 0.0], (), 1e-3),
        ([0.06, 0.0], (), 22e-3),
        ([0.0, 0.0], (Circle(0.003, (0.01, 0.0)),), 5e-3),
        ([0.0, 0.0], (polygon_from([np.array([[0, 0], [0.03, 0], [0.03, 0.01], [0, 0.01]])]),), 17e-3),
        ([-0.03, 0.038], (), 14e-3),
    ],
    ids=["outline", "outside", "round keep-out", "within a keep-out", "another dot"],
)
def test_every_kind_of_breach_is_measured(point, keep_outs, expected):
    points = np.array([point, [-0.038, 0.038], [-0.038, -0.038]])
    assert breach(points, SQUARE, keep_outs, 0.02, 0.002) == pytest.approx(expected, abs=1e-12)
    with pytest.raises(RuntimeError, match="breaks its constraints"):
        check(breach(points, SQUARE, keep_outs, 0.02, 0.002))


def test_a_hole_is_no_part_of_the_region(shapes):
    assert breach(np.zeros((1, 2)), shapes["annulus"], (), 0.01, 0.0) > 0.07
    assert breach(np.array([[0.11, 0.0]]), shapes["annulus"], (), 0.01, 0.0) <= 0
    assert breach(np.zeros((1, 2)), shapes["two squares"], (), 0.01, 0.0) > 0.03


def test_a_disk_is_measured_by_itself():
    points = regular_polygon(6, 0.128)
    assert breach(points, Circle(0.15), (), 0.04, 0.002) == pytest.approx(0, abs=1e-15)
    assert breach(points * 1.01, Circle(0.15), (), 0.04, 0.002) == pytest.approx(0.00128, abs=1e-15)
    with pytest.raises(RuntimeError):
        check(breach(points * np.nan, Circle(0.15), (), 0.04, 0.002))


def test_it_agrees_with_the_region_of_the_search(rooms):
    for name, room in rooms.items():
        points = room.sample(40, 0.0, np.random.default_rng(5)).reshape(8, 5, 2)
        region = FeasibleRegion(room, 0.03, 0.003)
        boundary, keep_outs = (room.boundary, room.keep_outs) if name in ("ring", "drilled") else (room, ())
        for layout in points:
            expected = region.violation(layout[None])[0]
            assert breach(layout, boundary, keep_outs, 0.03, 0.003) == pytest.approx(max(expected, 0), abs=1e-9) or (
                expected < 0
            )


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"noise_model": "image", "objective": "condition"}, "an objective that depends on the noise"),
        ({"dot": "auto", "objective": "condition"}, "an objective that depends on the noise"),
        ({"relief": 0.02, "objective": "condition"}, "use --objective blunder, pose, rotation or translation"),
        ({"relief": 0.02, "objective": "homography"}, "an objective for points in space with a relief"),
        ({"objective": "beauty"}, "a known objective"),
    ],
)
def test_an_objective_is_refused_what_it_does_not_know(values, phrase):
    with pytest.raises(InputError, match=phrase):
        design(Spec(**values))
