import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.optimize.layouts import polygons, regular_layouts
from markergen.optimize.problem import FeasibleRegion


@pytest.mark.parametrize(
    ("names", "n"),
    [(("L", "two squares", "ring"), 4), *(pytest.param(None, n, marks=pytest.mark.long) for n in (4, 7, 30))],
)
def test_every_layout_is_feasible(rooms, names, n):
    for name in names or rooms:
        region = FeasibleRegion(rooms[name], 0.01, 0.001)
        layouts, count = regular_layouts(region, n)
        assert layouts.shape[1:] == (n, 2)
        assert region.holds(layouts).all()
        assert count <= len(layouts)
        np.testing.assert_array_equal(layouts[:count], (every := polygons(region, n))[region.holds(every)])


def test_in_a_disk_they_are_rings_and_lattices():
    layouts, count = regular_layouts(FeasibleRegion(Circle(0.15), 0.01, 0.001), 7)
    radius = np.sort(np.hypot(*np.moveaxis(layouts, -1, 0)), axis=-1)
    np.testing.assert_allclose(radius[:count], 0.15 - 0.006)
    # Six dots around one, and a hexagonal lattice of seven sites, which is the same.
    around = (radius[:, 0] < 0.01) & (np.ptp(radius[:, 1:], axis=-1) < 1e-6)
    assert around[count:].any()
    # A square lattice: many equal distances along two directions at right angles.
    nearest = np.sort(np.linalg.norm(layouts[:, :, None] - layouts[:, None], axis=-1), axis=-1)
    assert np.any(np.ptp(nearest[count:, :, 1], axis=-1) < 1e-9)


def test_where_one_ring_does_not_hold_all_dots_full_ones_are_inside_one_another():
    region = FeasibleRegion(Circle(0.15), 0.04, 0.004)
    outer, pitch = 0.15 - 0.024, 0.044
    most = int(np.pi / np.arcsin(pitch / 2 / outer))
    layouts, count = regular_layouts(region, most + 14)
    assert count == 0
    radius = np.sort(np.hypot(*np.moveaxis(layouts, -1, 0)), axis=-1)
    full = np.ptp(radius[:, -most:], axis=-1) < 1e-9
    assert full.any()
    # The next ring is a pitch further in, and the third holds the rest.
    inside = radius[full][:, :-most]
    assert np.any(np.abs(inside[:, -1] - (outer - pitch)) < 1e-9)
    assert np.any(inside[:, 0] < outer - 1.5 * pitch)


def test_dots_that_nearly_fill_the_room_have_a_packing(rooms):
    # Nothing regular fits in two squares that hold nine dots.
    region = FeasibleRegion(rooms["two squares"], 0.03, 0.003)
    layouts, count = regular_layouts(region, 9)
    assert count == 0
    assert region.holds(layouts).all()
