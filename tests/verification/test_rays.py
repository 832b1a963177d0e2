"""What two solids do not have in common, along rays."""

import numpy as np
import pytest
from trimesh.creation import box, icosphere

from markergen.verification.rays import Shell, difference

TOLERANCE = 0.02


def shell(*meshes, dark=None):
    corners = [np.asarray(mesh.triangles, float) for mesh in meshes]
    owner = np.repeat(np.arange(len(meshes)), list(map(len, corners)))
    return Shell(np.concatenate(corners), owner, None if dark is None else np.array(dark)[owner])


def plate():
    return box((40, 40, 4))


def moved(mesh, *translation):
    return mesh.copy().apply_translation(translation)


def test_the_same_solid_divided_otherwise_is_the_same():
    ball = icosphere(subdivisions=5, radius=3).apply_translation((0, 0, 10))
    compared = difference(shell(plate().subdivide(), ball), shell(plate(), ball), TOLERANCE)
    assert not len(compared.extra) + len(compared.missing) + len(compared.twice)
    assert compared.votes.argmax(axis=1).tolist() == [0, 1]


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("block on the face", (5, 5, 2), (7, 7, 4)),
        ("wall across the face", (-15, 0, 2), (15, 0.3, 4)),
        ("void", (1, 1, -1), (3, 3, 1)),
        ("block elsewhere", (60, 0, 0), (63, 3, 3)),
    ],
)
def test_what_is_more_is_extra_where_it_is(name, low, high):
    low, high = np.array(low, float), np.array(high, float)
    more = box(high - low).apply_translation((low + high) / 2)
    if name == "void":
        more.invert()
    compared = difference(shell(plate(), more), shell(plate()), TOLERANCE)
    assert len(compared.extra) > 20
    assert not len(compared.missing)
    assert (compared.extra > low - 0.1).all()
    assert (compared.extra < high + 0.1).all()


@pytest.mark.parametrize("place", [(5.02, 5.03, 2), (1e6, 0, 0)])
def test_what_is_finer_than_the_rays_is_extra_wherever_it_is(place):
    grain = box((0.05, 0.05, 0.1)).apply_translation(place)
    compared = difference(shell(plate(), grain), shell(plate()), TOLERANCE)
    assert len(compared.extra) >= 10
    assert np.linalg.norm(compared.extra - place, axis=1).max() < 0.1
    compared = difference(shell(plate()), shell(plate(), grain), TOLERANCE)
    assert set(compared.missing_owner.tolist()) == {1}


def test_what_is_moved_by_more_than_the_tolerance_differs():
    for offset, differs in ((0.5 * TOLERANCE, False), (2 * TOLERANCE, True)):
        compared = difference(shell(moved(plate(), offset, 0, 0)), shell(plate()), TOLERANCE)
        assert bool(len(compared.extra)) == differs
        assert bool(len(compared.missing)) == differs


def test_what_is_there_twice():
    compared = difference(shell(plate(), plate()), shell(plate()), TOLERANCE)
    assert len(compared.twice)
    assert not len(compared.extra)


def test_other_colors():
    pair = plate(), moved(plate(), 0, 0, 4)
    compared = difference(shell(*pair, dark=[False, False]), shell(*pair, dark=[False, True]), TOLERANCE)
    assert compared.was_dark.all()
    assert (compared.repainted[:, 2] > 1.9).all()
