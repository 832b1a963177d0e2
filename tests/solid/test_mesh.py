from math import pi, tan

import numpy as np
import pytest

from markergen.errors import OutputError
from markergen.geometry.contour import Contour, circle
from markergen.solid.bodies import Part, Prism, Revolved, cylinder
from markergen.solid.kernel import build
from markergen.solid.mesh import Mesh, is_closed, kept_apart, mesh_of

QUARTER = tan(pi / 8)
"""Bulge of a quarter turn."""

SQUARE = Contour(((-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)))
HALF_BALL = Contour(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), (0.0, QUARTER, 0.0))

PARTS = {
    part.name: part
    for part in (
        Part("disc", "dark", (cylinder(101.0, -32.0, 18.0, -0.6, 0.0),)),
        Part("small disc", "dark", (cylinder(101.0, -32.0, 0.3, -0.6, 0.0),)),
        Part("ring", "dark", (cylinder(10.0, 20.0, 1.0, -0.6, 0.0, 0.5),)),
        Part("half-ball", "dark", (Revolved(20.0, -30.0, HALF_BALL),)),
        Part("ball", "dark", (Revolved(20.0, -30.0, Contour(((0.0, -6.0), (0.0, 6.0)), (1.0, 0.0))),)),
        Part(
            "pillar on a plate",
            "light",
            (
                Prism(Contour(((-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0))), (), -3.0, 0.0),
                Revolved(
                    0.0,
                    0.0,
                    Contour(
                        ((0.0, 0.0), (6.0, 0.0), (5.0, 1.0), (4.5, 12.0), (0.0, 12.0)), (0.0, -QUARTER, 0.0, 0.0, 0.0)
                    ),
                ),
            ),
        ),
        Part(
            "plate with a hole, a pocket and a mark",
            "light",
            (Prism(SQUARE, (circle(1.0, -2.0, 2.0, hole=True),), -3.0, 0.0),),
            (cylinder(2.0, 2.0, 1.5, -0.6, 0.0),),
            (cylinder(-1.0, -2.0, 0.8, -0.1, 0.0),),
        ),
    )
}


@pytest.fixture(scope="module", params=PARTS)
def part(request) -> Part:
    return PARTS[request.param]


def test_is_closed_and_as_large_as_the_part(part):
    mesh = mesh_of(build(part), 0.005)
    assert is_closed(mesh.triangles)
    # Asked of STL; a ball, curved both ways, is the worst, with 0.08 %.
    assert mesh.volume == pytest.approx(part.volume, rel=1e-3)
    assert len(np.unique(mesh.points, axis=0)) == len(mesh.points)


@pytest.mark.parametrize("tolerance", [0.05, 0.005])
def test_no_triangle_is_further_off_than_the_tolerance(tolerance):
    center, radius = np.array([20.0, -30.0, 0.0]), 6.0
    mesh = mesh_of(build(PARTS["ball"]), tolerance)
    corners = mesh.points[mesh.triangles]
    # A flat triangle with its corners on a sphere is furthest off in the middle or, if obtuse, at its longest edge.
    places = np.concatenate([corners.mean(axis=1), *(0.5 * (corners[:, i] + corners[:, i - 1]) for i in range(3))])
    depth = radius - np.linalg.norm(places - center, axis=1)
    # The grid adds 0.03 um.
    assert depth.min() > -1e-4
    assert depth.max() <= tolerance + 1e-4


def test_a_tighter_tolerance_takes_more_triangles():
    solid = build(PARTS["disc"])
    few, many = (len(mesh_of(solid, tolerance).triangles) for tolerance in (0.005, 0.0005))
    assert many > 2 * few


def test_points_are_the_floats_that_they_are_written_as(part):
    points = mesh_of(build(part), 0.005).points
    assert np.array_equal(points, points.astype(np.float32))
    meters = (points / 1e3).astype(np.float32)
    assert len(np.unique(meters, axis=0)) == len(points)


def test_marked_faces_are_the_floors_of_what_is_engraved():
    mesh = mesh_of(build(PARTS["plate with a hole, a pocket and a mark"]), 0.005)
    corners = mesh.points[mesh.triangles[mesh.marked]]
    np.testing.assert_allclose(corners[..., 2], -0.1, atol=1e-4)
    middle = (corners[..., :2].min(axis=(0, 1)) + corners[..., :2].max(axis=(0, 1))) / 2
    np.testing.assert_allclose(middle, [-1.0, -2.0], atol=1e-3)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(pi * 0.8**2, rel=1e-3)


def test_meshing_leaves_the_solid_as_it_was():
    from OCP.BRep import BRep_Tool
    from OCP.TopLoc import TopLoc_Location

    solid = build(PARTS["disc"])
    first = mesh_of(solid, 0.05)
    assert all(BRep_Tool.Triangulation_s(face.wrapped, TopLoc_Location()) is None for face in solid.shape.Faces())
    finer, again = mesh_of(solid, 0.0005), mesh_of(solid, 0.05)
    assert len(finer.triangles) > len(first.triangles)
    assert np.array_equal(again.points, first.points)
    assert np.array_equal(again.triangles, first.triangles)


def test_an_inlay_and_its_pocket_have_the_same_points_until_they_are_kept_apart():
    plate = mesh_of(
        build(Part("plate", "light", (Prism(SQUARE, (), -3.0, 0.0),), (cylinder(1.0, 1.0, 2.0, -0.6, 0.0),))), 0.005
    )
    dot = mesh_of(build(Part("dot-0", "dark", (cylinder(1.0, 1.0, 2.0, -0.6, 0.0, 1.0),))), 0.005)
    core = mesh_of(build(Part("dot-0-core", "light", (cylinder(1.0, 1.0, 1.0, -0.6, 0.0),))), 0.005)

    def shared(one: Mesh, other: Mesh) -> int:
        return len({tuple(p) for p in one.points} & {tuple(p) for p in other.points})

    assert shared(plate, dot) > 100
    assert shared(dot, core) > 100
    apart = kept_apart([plate, dot, core])
    assert shared(apart[0], apart[1]) == shared(apart[1], apart[2]) == shared(apart[0], apart[2]) == 0
    assert np.array_equal(apart[0].points, plate.points)
    for before, after in zip((dot, core), apart[1:], strict=True):
        moved = after.points - before.points
        assert np.array_equal(moved[:, 2], np.zeros(len(moved)))
        # Two steps of the grid of 0.06 um; the ring, which it moves at both of its walls, is 1 mm wide.
        assert np.abs(moved).max() < 2e-4
        assert 0 < before.volume - after.volume < 1e-3 * before.volume


def test_what_is_open_or_inside_out_is_not_closed():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert is_closed(tetrahedron)
    assert not is_closed(tetrahedron[:3])
    assert not is_closed(np.concatenate([tetrahedron[:3], tetrahedron[3:, ::-1]]))
    assert not is_closed(np.concatenate([tetrahedron, tetrahedron]))


def test_a_solid_without_a_mesh_is_refused_by_name(monkeypatch):
    monkeypatch.setattr("markergen.solid.mesh.is_closed", lambda _: False)
    with pytest.raises(OutputError, match="'disc', found gaps"):
        mesh_of(build(PARTS["disc"]), 0.005)
