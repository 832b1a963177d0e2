import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.optimize.layouts import count_that_fit, fitting, largest_diameter, lattice, pack
from markergen.optimize.problem import FeasibleRegion

# Densest packings of n equal disks in a unit disk (Graham et al. 1998; proved for these n but 12): radius of a disk.
BEST = {
    4: 0.414214,
    5: 0.370192,
    6: 1 / 3,
    7: 1 / 3,
    8: 0.302593,
    9: 0.276769,
    10: 0.262259,
    11: 0.254855,
    12: 0.248163,
}


@pytest.mark.parametrize("n", [n if n in (4, 7, 9, 12) else pytest.param(n, marks=pytest.mark.long) for n in BEST])
def test_packings_are_the_known_best(n):
    result = largest_diameter(Circle(1.0), n, 0.0) / 2
    # Never above the proved optimum; n = 9 has many local optima, and a miss costs at most 2 %.
    assert 0.98 * BEST[n] <= result <= BEST[n] + 1e-6


@pytest.mark.parametrize("n", [4, 7, 12, 30, 60])
@pytest.mark.parametrize("clearance", [None, 0.001])
def test_packed_dots_really_fit(n, clearance):
    boundary = Circle(0.15)
    points, diameter = pack(boundary, n, clearance)
    region = FeasibleRegion(boundary, diameter, diameter / 10 if clearance is None else clearance)
    assert region.violation(points[None])[0] <= 1e-9


def test_dots_fit_or_do_not(shapes):
    # Seven disks in a disk three times as large leave no room at all.
    assert fitting(FeasibleRegion(Circle(0.15), 0.1, 0.0), 7) is not None
    assert fitting(FeasibleRegion(Circle(0.15), 0.1 * (1 + 1e-7), 0.0), 7) is None
    for n in (6, 30):
        region = FeasibleRegion(shapes["L"], 0.99 * largest_diameter(shapes["L"], n, 0.001), 0.001)
        assert region.holds(fitting(region, n)[None])[0]
    assert fitting(FeasibleRegion(shapes["L"], 0.05, 0.001), 30) is None


def test_counting_agrees_with_packing():
    boundary = Circle(0.15)
    assert count_that_fit(boundary, 0.08, 0.008, 12) == 8
    assert count_that_fit(boundary, 0.299, 0.0, 12) == 1
    assert count_that_fit(boundary, 0.31, 0.0, 12) == 0
    assert count_that_fit(boundary, 0.02, 0.002, 40) == 40


def test_lattice_counts_are_sane():
    # No packing covers more than 90.7 % of the disk.
    for n in (30, 100, 200):
        diameter = largest_diameter(Circle(0.15), n, 0.0)
        assert 0.5 < n * (diameter / 0.3) ** 2 < 0.907
        assert np.isfinite(diameter)


@pytest.mark.parametrize("n", [5, *(pytest.param(n, marks=pytest.mark.long) for n in (1, 12, 40))])
def test_packed_dots_fit_in_every_shape(shape, n):
    points, diameter = pack(shape, n)
    assert diameter > 0
    assert FeasibleRegion(shape, diameter, diameter / 10).violation(points[None])[0] <= 1e-9


@pytest.mark.parametrize(
    ("n", "best"),
    [(4, 0.585786), *(pytest.param(*case, marks=pytest.mark.long) for case in ((8, 0.5), (10, 0.414214)))],
)
def test_known_packings_in_squares(shapes, n, best):
    # Densest packings of 2, 4 and 5 disks in the unit square (diameters, Graham and Lubachevsky 1996), two squares of
    # 100 mm having twice as many.
    largest = largest_diameter(shapes["two squares"], n, 0.0) / 0.1
    assert 0.99 * best <= largest <= best + 1e-6


def test_counting_in_squares_agrees_with_known_packings(shapes):
    assert count_that_fit(shapes["two squares"], 0.049, 0.0, 12) == 8
    assert count_that_fit(shapes["two squares"], 0.051, 0.0, 12) == 4


def test_a_lattice_is_turned_to_fit(shapes):
    # Rows along the sides of the rectangle hold more than rows across.
    flat = len(lattice(shapes["rectangle"], 0.01, 0.001))
    assert flat >= len(lattice(shapes["plate"], 0.01, 0.001)) / 2.5
    assert FeasibleRegion(shapes["L"], 0.01, 0.001).holds(lattice(shapes["L"], 0.01, 0.001)[None])[0]


@pytest.mark.parametrize("clearance", [None, 0.0016])
def test_a_gap_is_kept_between_dots_but_not_from_walls(clearance):
    points, diameter = pack(Circle(0.03), 4, clearance, 0.0092)
    region = FeasibleRegion(Circle(0.03), diameter - 1e-9, diameter / 10 if clearance is None else clearance, 0.0092)
    assert region.holds(points[None])[0]
    # A square: its side is d + 9.2 mm, and its half diagonal 30 mm less d / 2 and the clearance.
    wall = 0.6 if clearance is None else 0.5
    assert diameter == pytest.approx((0.03 - (clearance or 0) - 0.0092 / np.sqrt(2)) / (wall + np.sqrt(0.5)), rel=1e-6)
    assert fitting(FeasibleRegion(Circle(0.03), 0.016, 0.0016, 0.0092), 4) is not None
    assert count_that_fit(Circle(0.03), 0.016, 0.0016, 12, 0.0092) == 4
