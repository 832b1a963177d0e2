"""Parts that are no more than four triangles each."""

import numpy as np

from markergen.workshop.mesh import Mesh

SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
"""Counterclockwise seen from outside, where the corners are the origin and one on each axis."""


def part(name, material, corners, sides=SIDES, marked=()):
    """A part with corners (n, 3) in mm, of which some sides are engraved."""
    return Mesh(name, material, np.array(corners, float), sides, np.isin(np.arange(len(sides)), marked))


def mesh_volume(mesh):
    """Enclosed volume in mm^3: signed volumes of the tetrahedra from the origin."""
    return np.linalg.det(mesh.points[mesh.triangles]).sum() / 6


def plate_and_dot(corners):
    """A light one with a dark side, and a dark one that is 1 mm further along each axis."""
    return [part("plate", "light", corners, marked=[1]), part("dot-0", "dark", np.array(corners) + 1)]
