from math import pi, sqrt, tan

import numpy as np
import pytest
from cad import build
from tetrahedra import mesh_volume

from markergen.errors import OutputError
from markergen.geometry.contour import Contour, circle
from markergen.solid.primitives import Part, Prism, Revolved, cylinder
from markergen.workshop.mesh import LEAST, Mesh, is_closed, kept_apart, meshes_of

QUARTER = tan(pi / 8)
"""Bulge of a quarter turn."""


def mesh_of(part, tolerance):
    return meshes_of((part,), tolerance)[0]


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
    mesh = mesh_of(part, 0.005)
    assert is_closed(mesh.triangles)
    # Asked of STL; a ball, curved both ways, is the worst, with 0.08 %.
    assert mesh_volume(mesh) == pytest.approx(part.volume, rel=1e-3)
    assert len(np.unique(mesh.points, axis=0)) == len(mesh.points)


@pytest.mark.parametrize("tolerance", [0.05, 0.005])
def test_no_triangle_is_further_off_than_the_tolerance(tolerance):
    center, radius = np.array([20.0, -30.0, 0.0]), 6.0
    mesh = mesh_of(PARTS["ball"], tolerance)
    corners = mesh.points[mesh.triangles]
    # A flat triangle with its corners on a sphere is furthest off in the middle or, if obtuse, at its longest edge.
    places = np.concatenate([corners.mean(axis=1), *(0.5 * (corners[:, i] + corners[:, i - 1]) for i in range(3))])
    depth = radius - np.linalg.norm(places - center, axis=1)
    # The grid adds 0.03 um.
    assert depth.min() > -1e-4
    assert depth.max() <= tolerance + 1e-4


def test_a_tighter_tolerance_takes_more_triangles():
    few, many = (len(mesh_of(PARTS["disc"], tolerance).triangles) for tolerance in (0.005, 0.0005))
    assert many > 2 * few


def test_points_are_the_floats_that_they_are_written_as(part):
    points = mesh_of(part, 0.005).points
    assert np.array_equal(points, points.astype(np.float32))
    meters = (points / 1e3).astype(np.float32)
    assert len(np.unique(meters, axis=0)) == len(points)


def test_marked_faces_are_the_floors_of_what_is_engraved():
    mesh = mesh_of(PARTS["plate with a hole, a pocket and a mark"], 0.005)
    corners = mesh.points[mesh.triangles[mesh.marked]]
    np.testing.assert_allclose(corners[..., 2], -0.1, atol=1e-4)
    middle = (corners[..., :2].min(axis=(0, 1)) + corners[..., :2].max(axis=(0, 1))) / 2
    np.testing.assert_allclose(middle, [-1.0, -2.0], atol=1e-3)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(pi * 0.8**2, rel=1e-3)


@pytest.mark.parametrize("tolerance", [0.05, 0.005])
def test_the_mesh_is_that_of_the_solid_that_the_kernel_builds(part, tolerance):
    """The corners of the triangles are on the solid's surface, their middles at most the tolerance from it."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex
    from OCP.BRepExtrema import BRepExtrema_DistShapeShape
    from OCP.gp import gp_Pnt

    shell = build(part).shape.Shells()[0].wrapped

    def off(point: np.ndarray) -> float:
        vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(*point.tolist())).Vertex()
        return BRepExtrema_DistShapeShape(vertex, shell).Value()

    mesh = mesh_of(part, tolerance)
    subset = np.random.default_rng(1).choice(len(mesh.triangles), 12, replace=False)
    # Half a step of the grid along each axis.
    assert max(off(point) for point in mesh.points[mesh.triangles[subset, 0]]) < 6e-5
    assert max(off(point) for point in mesh.points[mesh.triangles[subset]].mean(axis=1)) < tolerance + 1e-4


@pytest.mark.parametrize(("radius", "tolerance"), [(18.0, 0.005), (0.3, 0.005), (150.0, 0.1)])
def test_a_circle_has_the_fewest_chords_for_half_of_the_tolerance(radius, tolerance):
    mesh = mesh_of(Part("disc", "dark", (cylinder(0.0, 0.0, radius, -1.0, 0.0),)), tolerance)
    count = len(mesh.points) // 2
    enough = pi / np.arccos(1 - tolerance / 2 / radius)
    assert count % 4 == 0
    assert max(LEAST, enough) <= count < max(LEAST, enough) + 4
    # Two triangles for each chord of the wall, and n - 2 for each face.
    assert len(mesh.triangles) == 4 * count - 4


def test_a_ball_takes_less_than_twice_the_triangles_of_the_best_mesh():
    radius, tolerance = 18.0, 0.005
    ball = Part("ball", "dark", (Revolved(0.0, 0.0, Contour(((0.0, -radius), (0.0, radius)), (1.0, 0.0))),))
    # An equilateral triangle with its corners on the sphere and its middle a tolerance below has sides of sqrt(6 R t).
    best = 4 * pi * radius**2 / (sqrt(3) / 4 * 6 * radius * tolerance)
    assert best < len(mesh_of(ball, tolerance).triangles) < 1.6 * best


def test_an_inlay_and_its_pocket_have_the_same_points_until_they_are_kept_apart():
    plate = mesh_of(
        Part("plate", "light", (Prism(SQUARE, (), -3.0, 0.0),), (cylinder(1.0, 1.0, 2.0, -0.6, 0.0),)), 0.005
    )
    dot = mesh_of(Part("dot-0", "dark", (cylinder(1.0, 1.0, 2.0, -0.6, 0.0, 1.0),)), 0.005)
    core = mesh_of(Part("dot-0-core", "light", (cylinder(1.0, 1.0, 1.0, -0.6, 0.0),)), 0.005)

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
        assert 0 < mesh_volume(before) - mesh_volume(after) < 1e-3 * mesh_volume(before)


def test_what_is_open_or_inside_out_is_not_closed():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert is_closed(tetrahedron)
    assert not is_closed(tetrahedron[:3])
    assert not is_closed(np.concatenate([tetrahedron[:3], tetrahedron[3:, ::-1]]))
    assert not is_closed(np.concatenate([tetrahedron, tetrahedron]))


@pytest.mark.parametrize(
    ("cut", "result"),
    [
        ((cylinder(4.0, 0.0, 1.0, -1.0, 0.0),), "edges that cross at z = 0 mm"),
        ((cylinder(0.0, 0.0, 1.0, -1.0, 0.0), cylinder(0.0, 0.0, 2.0, -2.0, 0.0)), "bodies that overlap at z = 0 mm"),
        ((Prism(SQUARE, (), -1.0, 0.0),), "edges that cross at z = 0 mm"),
    ],
)
def test_bodies_that_make_no_closed_mesh_are_refused_by_name(cut, result):
    with pytest.raises(OutputError, match=f"the part 'plate-2', found {result}"):
        mesh_of(Part("plate-2", "light", (Prism(SQUARE, (), -3.0, 0.0),), cut), 0.005)
