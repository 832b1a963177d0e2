from math import cos, pi, sin, sqrt, tan

import pytest
import shapely

from markergen.geometry.contour import Contour, circle
from markergen.solid.primitives import OFF, Part, Prism, Revolved, cylinder, size_of
from markergen.workshop.drafting.drawing import ViewFace
from markergen.workshop.projection import BACK, cut_along, elevation, seen

WIDE = (-100.0, -50.0, 100.0, 50.0)
SQUARE = Contour(((-20.0, -10.0), (20.0, -10.0), (20.0, 10.0), (-20.0, 10.0)))


def rings_of(face: ViewFace):
    outer, *holes = (contour.points for contour in face.contours)
    return outer, holes


def area(face: ViewFace) -> float:
    return shapely.Polygon(*rings_of(face)).area


def plate(*cut, add=(), marked=(), chamfer=0.0) -> Part:
    return Part("plate", "light", (Prism(SQUARE, (), -4.0, 0.0, chamfer), *add), cut, marked)


@pytest.mark.parametrize("away", [0.0, 2.0, 4.5])
def test_a_cylinder_is_cut_in_a_rectangle_as_wide_as_its_chord(away):
    (face,) = cut_along([Part("dot-0", "dark", (cylinder(3.0, 1.0, 5.0, -1.0, 2.0),))], 1.0 + away, WIDE)
    left, bottom, right, top = face.box
    half = sqrt(25 - away**2)
    # Exact but for the grid of a nanometer.
    assert (left, right) == pytest.approx((3 - half, 3 + half), abs=1e-5)
    assert (bottom, top) == pytest.approx((-1, 2), abs=1e-5)
    assert area(face) == pytest.approx(2 * half * 3, abs=1e-4)


@pytest.mark.parametrize("away", [0.0, 3.0])
def test_a_half_ball_is_cut_in_a_half_disk(away):
    profile = Contour(((0.0, 0.0), (5.0, 0.0), (0.0, 5.0)), (0.0, tan(pi / 8), 0.0))
    (face,) = cut_along([Part("dot-0", "dark", (Revolved(0.0, 0.0, profile),))], away, WIDE)
    radius = sqrt(25 - away**2)
    # The polygon lies within OFF of the arc.
    assert area(face) == pytest.approx(pi * radius**2 / 2, abs=OFF * pi * radius * 2)
    assert face.box[3] == pytest.approx(radius, abs=2 * OFF)


def test_what_is_cut_is_missing_and_neighbors_leave_no_slit():
    pillar = cylinder(0.0, 0.0, 6.0, 0.0, 8.0)
    part = plate(cylinder(0.0, 0.0, 5.0, 7.0, 8.0), add=(pillar,), chamfer=1.0)
    (face,) = cut_along([part], 0.0, WIDE)
    assert len(face.contours) == 1
    assert area(face) == pytest.approx(40 * 4 - 1 + 12 * 8 - 10 * 1, abs=1e-4)


def test_a_window_clips_and_parts_out_of_it_are_left_out():
    faces = cut_along([plate(), Part("dot-0", "dark", (cylinder(15.0, 0.0, 2.0, -1.0, 0.0),))], 0.0, (-5, -4, 5, 0))
    assert [face.material for face in faces] == ["light"]
    assert faces[0].box == pytest.approx((-5, -4, 5, 0))


def test_size_holds_arcs_exactly():
    c, s = cos(0.3), sin(0.3)
    rotated = Contour(((10 * c, 10 * s), (-10 * c, -10 * s)), (1.0, 1.0))
    assert size_of([Prism(rotated, (), 0.0, 1.0)]) == pytest.approx((20, 20), abs=1e-12)
    assert size_of([Prism(circle(10.0), (), 0.0, 1.0)]) == pytest.approx((20, 20), abs=1e-12)
    # A quarter that does not reach any axis but at its ends.
    quarter = Contour(((0.0, 0.0), (3.0, 0.0), (0.0, 3.0)), (0.0, tan(pi / 8), 0.0))
    assert size_of([Prism(quarter, (), 0.0, 1.0)]) == pytest.approx((3, 3), abs=1e-12)
    assert size_of([cylinder(1.0, 0.0, 2.0, 0, 1), cylinder(5.0, 1.0, 2.0, 0, 1)]) == pytest.approx((8, 5))


def test_what_is_nearer_comes_later_and_holes_go_through():
    sunk = Revolved(5.0, 0.0, Contour(((0.0, -4.0), (1.0, -4.0), (1.0, -1.0), (2.0, 0.0), (0.0, 0.0))))
    parts = [
        plate(cylinder(-5.0, 0.0, 3.0, -1.0, 0.0), sunk, add=(cylinder(-5.0, 6.0, 3.0, 0.0, 9.0),)),
        Part("dot-0", "dark", (cylinder(-5.0, 0.0, 3.0, -1.0, 0.0, 1.5),)),
    ]
    outline, pocket, hole, ring, pillar = seen(parts)
    assert [face.material for face in (outline, pocket, hole, ring, pillar)] == ["light", "light", "", "dark", "light"]
    assert len(ring.contours) == 2
    assert len(hole.edges) == 1
    assert max(x for x, _ in hole.edges[0].points) == pytest.approx(6.0)
    assert max(x for x, _ in hole.contours[0].points) == pytest.approx(7.0)
    assert pillar.box[3] == pytest.approx(9.0, abs=OFF)


def test_a_plug_below_a_half_ball_does_not_show():
    # The ball's arc has no corner above the plug's edge.
    half = Contour(((0.0, -1.5), (3.0, -1.5), (3.0, 0.0), (6.0, 0.0), (0.0, 6.0)), (0.0, 0.0, 0.0, tan(pi / 8), 0.0))
    faces = seen([Part("dot-0", "dark", (Revolved(0.0, 0.0, half),))])
    assert [face.edges for face in faces] == [()]
    step = Contour(((0.0, -1.5), (6.0, -1.5), (6.0, 0.0), (3.0, 0.0), (3.0, 2.0), (0.0, 2.0)))
    assert len(seen([Part("dot-0", "dark", (Revolved(0.0, 0.0, step),))])[0].edges) == 1


def test_from_the_back_x_runs_to_the_left_and_pockets_do_not_show():
    letter = Prism(Contour(((2.0, 0.0), (4.0, 0.0), (4.0, 3.0), (2.0, 3.0))), (), -4.0, -3.7)
    faces = seen([plate(cylinder(-5.0, 0.0, 3.0, -1.0, 0.0), letter)], BACK)
    assert len(faces) == 2
    assert faces[1].box == pytest.approx((-4, 0, -2, 3))
    assert faces[1].material == "light"
    # Of a countersunk hole the back shows the hole alone.
    sunk = Revolved(5.0, 0.0, Contour(((0.0, -4.0), (1.0, -4.0), (1.0, -1.0), (2.0, 0.0), (0.0, 0.0))))
    hole = seen([plate(sunk)], BACK)[1]
    assert hole.material == ""
    assert not hole.edges
    assert hole.box == pytest.approx((-6, -1, -4, 1), abs=OFF)
    # Nor does engraving show from the front.
    assert len(seen([plate(letter)])) == 1


def test_a_marked_floor_is_of_the_other_material():
    assert [face.material for face in seen([plate(marked=(cylinder(0.0, 0.0, 3.0, -0.1, 0.0),))])] == ["light", "dark"]


def test_from_the_side_flush_dots_do_not_show_and_balls_do():
    near, far = cylinder(0.0, -5.0, 2.0, 0.0, 3.0), cylinder(1.0, 5.0, 2.0, 0.0, 6.0)
    flush = [Part("dot-0", "dark", (cylinder(0.0, -5.0, 1.5, 2.0, 3.0),))]
    faces = elevation([plate(add=(near, far)), *flush])
    assert [face.box for face in faces] == [
        pytest.approx(box) for box in ((-1, 0, 3, 6), (-2, 0, 2, 3), (-20, -4, 20, 0))
    ]
    profile = Contour(((0.0, -2.0), (1.0, -2.0), (1.0, 0.0), (3.0, 0.0), (0.0, 3.0)), (0.0, 0.0, 0.0, tan(pi / 8), 0.0))
    ball, slab = elevation([plate(), Part("dot-0", "dark", (Revolved(0.0, 0.0, profile),))])
    assert ball.material == "dark"
    assert ball.box == pytest.approx((-3, 0, 3, 3), abs=OFF)
    assert slab.box == (-20, -4, 20, 0)
