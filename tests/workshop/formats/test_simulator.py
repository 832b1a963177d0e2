import numpy as np
import pytest
from tetrahedra import part

from markergen.solid.primitives import Part, cylinder
from markergen.workshop.formats.simulators import DENSITY, decimal, mass_of, numbers
from markergen.workshop.mesh import Mesh, meshes_of

BOX = np.array([[x, y, z] for x in (0, 20) for y in (0, 30) for z in (-5, 0)], float)
"""mm; bit by bit of their number: x, y, z."""

QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
SIDES = np.array([side for a, b, c, d in QUADS for side in ((a, b, c), (a, c, d))])


def box(corners: np.ndarray) -> Mesh:
    return part("plate", "light", corners, SIDES)


def test_a_box_weighs_what_it_should():
    mass, center, inertia = mass_of([box(BOX)])
    assert mass == pytest.approx(DENSITY * 0.02 * 0.03 * 0.005)
    np.testing.assert_allclose(center, [0.01, 0.015, -0.0025])
    a, b, c = 0.02**2, 0.03**2, 0.005**2
    np.testing.assert_allclose(inertia, mass / 12 * np.diag([b + c, a + c, a + b]), atol=1e-15)


def test_two_halves_weigh_what_the_whole_does():
    half = BOX * [0.5, 1, 1]
    for one, other in zip(mass_of([box(half), box(half + [10, 0, 0])]), mass_of([box(BOX)]), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-15)


def test_a_disc_has_the_moments_of_a_cylinder():
    meshes = meshes_of((Part("dot-0", "dark", (cylinder(40.0, 0.0, 10.0, -2.0, 0.0),)),), 0.005)
    mass, center, inertia = mass_of(meshes)
    np.testing.assert_allclose(center, [0.04, 0, -0.001], atol=1e-9)
    # A polygon of 144 corners has 0.03 % less area, and twice that less of the second moment.
    assert inertia[2, 2] == pytest.approx(mass * 0.01**2 / 2, rel=1e-3)
    assert inertia[0, 0] == pytest.approx(mass * (3 * 0.01**2 + 0.002**2) / 12, rel=1e-3)
    assert np.abs(inertia - np.diag(np.diag(inertia))).max() < 1e-9 * inertia[2, 2]


def test_numbers_have_no_minus_zero():
    assert decimal(-1e-18) == "0"
    assert numbers(np.array([0.1, -0.25, 1e-9])) == "0.1 -0.25 1e-09"
