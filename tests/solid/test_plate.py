from dataclasses import replace
from math import acos, pi, tan

import numpy as np
import pytest
from cad import build

from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, circle, placed
from markergen.model.boundary import Circle, polygon_from
from markergen.model.substrate import Hole, Substrate
from markergen.solid.plate import SolidPlate, plate_of, plate_size
from markergen.solid.primitives import Part, cylinder

EXACT = 1e-9
"""Coordinates are rounded to picometers."""


def made(marker, **measures):
    return replace(marker, substrate=Substrate(**measures))


def plate_radius(marker):
    ((disk,),) = plate_of(marker).outlines
    return disk.as_circle[2]


def plan_area(marker):
    return sum(area(path) for outline in plate_of(marker).outlines for path in outline)


def test_a_disk_s_plate_holds_the_boundary_and_every_quiet_zone(make_ngon):
    assert plate_radius(make_ngon(5, 0.15, 0.036)) == pytest.approx(128.4 + 36)
    assert plate_radius(make_ngon(5, 0.15, 0.002)) == pytest.approx(152)
    assert plate_radius(made(make_ngon(5, 0.15, 0.002), edge=0.01)) == pytest.approx(160)
    assert plate_size(make_ngon(5, 0.15, 0.002)) == "304 mm across"


@pytest.mark.parametrize("edge", [0.0, 0.002, None])
def test_a_rectangle_has_a_mitered_edge_and_any_other_outline_is_the_plate(shape, make_in, edge):
    marker = made(make_in(shape, 5, 0.01), edge=edge)
    edge = (0.002 if edge is None else edge) if len(shape.rings) == 1 and len(shape.rings[0]) == 4 else 0.0
    wide = shape.region.offset(edge, "miter")
    assert plan_area(marker) == pytest.approx(1e6 * wide.area, rel=EXACT)
    corners = [corner for ring in shape.outlines() for corner in (1e3 * ring).tolist()]
    # No corner is nearer to the rim than the edge is wide, and none of its sides farther.
    distances = np.abs(plate_of(marker).face.depth(corners))
    assert distances == pytest.approx(1e3 * edge, abs=1e-6)


def test_an_outline_with_a_sharp_corner_or_in_two_parts_is_the_plate_as_it_is(make_in):
    needle = polygon_from([np.array([[0, 0], [0.2, -0.008], [0.2, 0.008]])])
    marker = make_in(needle, 1, 0.005)
    (plate,) = plate_of(marker).outlines
    assert np.ptp(np.array(plate[0].points)[:, 0]) == pytest.approx(200, abs=EXACT)
    gap = 0.003
    halves = polygon_from([np.array([[x, 0], [x + 0.05, 0], [x + 0.05, 0.05], [x, 0.05]]) for x in (0, 0.05 + gap)])
    assert [part.name for part in plate_of(make_in(halves, 2, 0.01)).parts()] == ["plate-1", "plate-2"]
    # What an old file says of an edge around an outline is not made either.
    assert [part.name for part in plate_of(made(make_in(halves, 2, 0.01), edge=0.002)).parts()] == [
        "plate-1",
        "plate-2",
    ]
    assert plate_size(make_in(halves, 2, 0.01)) == "103 x 50 mm"


def test_corners_are_rounded_inner_ones_too(shapes, make_in):
    marker = made(make_in(shapes["L"], 5, 0.01), edge=0.0, corner_radius=0.004)
    (plate,) = plate_of(marker).parts()
    # Five corners lose what a sixth one gains.
    assert plan_area(marker) == pytest.approx(25600 - 4 * (4 - pi) / 4 * 16, rel=EXACT)
    solid = build(plate).shape
    radii = sorted(round(e.radius(), 6) for e in solid.Edges() if e.geomType() == "CIRCLE")
    assert radii == [4.0] * 12
    # The holes of a plate are curves, and have no corners.
    with_holes = [make_in(shapes["plate"], 5, 0.01), 0.004]
    assert plan_area(made(with_holes[0], corner_radius=0.004)) == pytest.approx(
        plan_area(with_holes[0]) - (4 - pi) * 16, rel=EXACT
    )


def test_corners_and_chamfers_that_do_not_fit_are_told(shapes, make_in, make_ngon):
    marker = make_in(shapes["rectangle"], 5, 0.01)
    with pytest.raises(InputError, match=r"52 mm .*corner_radius=60 mm; use --corner-radius 52mm"):
        plate_of(made(marker, corner_radius=0.06))
    plate_of(made(marker, corner_radius=0.052))
    with pytest.raises(InputError, match=r"below 1 mm .*chamfer=1.5 mm; use --chamfer 0.99mm"):
        plate_of(made(marker, corner_radius=0.001, chamfer=0.0015))
    plate_of(made(marker, corner_radius=0.001, chamfer=0.0009))
    with pytest.raises(InputError, match="a chamfer below 12 mm"):
        plate_of(replace(make_ngon(4, 0.01, 0.002), substrate=Substrate(thickness=0.02, chamfer=0.015)))


def test_a_chamfer_that_reaches_a_hole_of_the_outline_is_told(make_ngon):
    square = [(-60, -60), (60, -60), (60, 60), (-60, 60)]
    bend = [(-60, -60), (60, -60), (60, 0), (0, 0), (0, 60), (-60, 60)]
    # Around a bend the chamfer is wider by sqrt(2).
    for corners, x, y, most in [(square, -58.2, 20, 0.79), (bend, -1.4, -1.4, 0.68)]:
        drawn = [placed(item, 1e-3) for item in (Contour(tuple(corners)), circle(1, x, y, hole=True))]
        marker = replace(make_ngon(5, 0.05, 0.01), boundary=polygon_from(drawn, "file"))
        with pytest.raises(InputError, match=f"before the holes .* --chamfer {most}mm,"):
            plate_of(made(marker, chamfer=0.001))
        build(plate_of(made(marker, chamfer=1e-3 * most)).parts()[0])


def test_the_upper_face_is_within_the_chamfer(make_ngon):
    outlines = plate_of(make_ngon(5, 0.15, 0.002)).outlines
    # Polygons are 2 um off their arcs at most.
    assert SolidPlate(outlines, 3.0, 1.5).face.area == pytest.approx(pi * 150.5**2, abs=2 * pi * 150.5 * 2e-3)


@pytest.mark.parametrize(
    ("hole", "removed"),
    [
        (Hole(0.14, 0.0, 0.0034), pi * 1.7**2 * 3),
        # A head of 6 mm: 1.3 mm of a cone, and the rest.
        (Hole(0.0, -0.14, 0.0034, 0.006), pi / 3 * 1.3 * (3**2 + 3 * 1.7 + 1.7**2) + pi * 1.7**2 * 1.7),
        (Hole(-0.14, 0.0, 0.004, use="dowel"), pi * 2**2 * 3),
    ],
)
def test_holes(make_ngon, hole, removed):
    marker = made(make_ngon(5, 0.15, 0.01), holes=(hole,))
    (plate,) = plate_of(marker).parts()
    assert plate.volume == pytest.approx(pi * 154**2 * 3 - removed, rel=EXACT)
    solid = build(plate).shape
    rims = [edge for edge in solid.Edges() if edge.geomType() == "CIRCLE" and edge.radius() < 10]
    for edge in rims:
        assert (edge.arcCenter().x, edge.arcCenter().y) == pytest.approx((1e3 * hole.x, 1e3 * hole.y), abs=1e-6)
    top = max(rims, key=lambda edge: edge.arcCenter().z)
    assert (top.arcCenter().z, top.radius()) == pytest.approx((0, 1e3 * hole.radius), abs=1e-9)


def test_an_outline_of_its_own_has_no_edge(make_ngon):
    marker = made(make_ngon(5, 0.05, 0.01), outline=Circle(0.08), edge=0.002, thickness=0.004)
    assert plate_of(marker).outlines == ((circle(80),),)
    assert plate_size(marker) == "160 mm across"
    square = polygon_from([0.07 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])])
    (plate,) = plate_of(made(make_ngon(5, 0.05, 0.01), outline=square, corner_radius=0.01, thickness=0.004)).parts()
    assert plate.volume == pytest.approx(4 * (140**2 - (4 - pi) * 100), rel=EXACT)


def test_the_face_may_be_lower(make_ngon):
    (plate,) = plate_of(make_ngon(5, 0.05, 0.01)).parts(face=-1.5)
    assert (plate.add[0].bottom, plate.add[0].top) == (-4.5, -1.5)


def test_each_plate_gets_what_lies_in_it(shapes, make_in):
    plate = plate_of(make_in(shapes["two squares"], 5, 0.01))
    results = plate.parts(0.0, [cylinder(80, 0, 1, -1, 0)], [cylinder(-80, 0, 1, -1, 0)], [cylinder(80, 9, 1, 0, 1)])
    results.sort(key=lambda part: part.add[0].outer.points[0][0])
    assert [(len(part.add), len(part.cut), len(part.marked)) for part in results] == [(1, 0, 1), (2, 1, 0)]
    assert isinstance(results[0], Part)


def arcs_plate():
    """200 x 120 mm with fillets of 15, a slot of 50 x 10, a D of radius 10 cut at 6, and a hole of 8.5."""
    q, rotation = tan(pi / 8), 2 * pi - 2 * acos(0.6)
    points = [(-85, -60), (85, -60), (100, -45), (100, 45), (85, 60), (-85, 60), (-100, 45), (-100, -45)]
    outer = Contour(tuple(points), (0, q) * 4)
    slot = Contour(((-60, -40), (-20, -40), (-20, -30), (-60, -30)), (0, 1, 0, 1))
    d_hole = Contour(((56, 8), (40, 0), (56, -8)), (tan(rotation / 8), tan(rotation / 8), 0))
    hole = circle(4.25, -80.0, 40.0)
    contours = [placed(contour, 1e-3, digits=12) for contour in (outer, slot, d_hole, hole)]
    lost = [400 + pi * 25, 100 * (rotation / 2) + 6 * 8, pi * 4.25**2]
    return polygon_from(contours), 200 * 120 - (4 - pi) * 225 - sum(lost)


def edges_of(shape):
    return sorted(round(edge.radius(), 9) for edge in shape.Edges() if edge.geomType() == "CIRCLE")


def test_arcs_stay_arcs_from_the_boundary_to_the_solid(make_in):
    boundary, flat = arcs_plate()
    marker = make_in(boundary, 5, 0.01)
    (plate,) = plate_of(marker).parts()
    assert plate.volume == pytest.approx(3 * flat, rel=EXACT)
    solid = build(plate).shape
    assert solid.Volume() == pytest.approx(3 * flat, rel=1e-9)
    # The D's arc is two of them, and the hole one.
    assert edges_of(solid) == [4.25] * 2 + [5.0] * 4 + [10.0] * 4 + [15.0] * 8
    walls = sorted(face.geomType() for face in solid.Faces() if abs(face.normalAt().z) < 0.5)
    assert walls == ["CYLINDER"] * 9 + ["PLANE"] * 7
    assert plate_size(marker) == "200 x 120 mm"


@pytest.mark.parametrize("chamfer", [0.0, 0.0005])
def test_corners_between_arcs_and_lines_are_rounded(make_in, chamfer):
    boundary, flat = arcs_plate()
    marker = made(make_in(boundary, 5, 0.01), corner_radius=0.001, chamfer=chamfer)
    (plate,) = plate_of(marker).parts()
    solid = build(plate).shape
    assert solid.isValid()
    assert edges_of(solid).count(1.0) == 4
    # The two corners of the D are all that is rounded.
    lost = (plate.volume - 3 * flat) if not chamfer else 0.0
    assert 0 <= lost < 3 * 2 * 0.5
    cones = [face for face in solid.Faces() if face.geomType() == "CONE"]
    assert len(cones) == (4 if chamfer else 0)


def test_a_chamfer_around_an_outline_of_arcs(make_in):
    disk = polygon_from([circle(0.125), circle(0.04)])
    (plate,) = plate_of(made(make_in(disk, 5, 0.01), chamfer=0.001)).parts()
    # Less than a cylinder by what is around a cone's stump of 1 mm.
    lost = pi * (125**2 - (125**2 + 125 * 124 + 124**2) / 3)
    assert plate.volume == pytest.approx(3 * pi * (125**2 - 40**2) - lost, rel=EXACT)
    assert build(plate).shape.Volume() == pytest.approx(plate.volume, rel=1e-9)
    # An arc that turns inward: its cone opens upward.
    bite = Contour(((-80, -50), (80, -50), (80, 50), (30, 50), (-30, 50), (-80, 50)), (0, 0, 0, -1, 0, 0))
    with pytest.raises(InputError, match=r"turns by .* degrees .* --corner-radius,"):
        plate_of(made(make_in(polygon_from([placed(bite, 1e-3)]), 5, 0.01), chamfer=0.001)).parts()
    # With a radius in every corner it goes all around.
    rounded = made(make_in(polygon_from([placed(bite, 1e-3)]), 5, 0.01), chamfer=0.001, corner_radius=0.002)
    (plate,) = plate_of(rounded).parts()
    assert build(plate).shape.Volume() == pytest.approx(plate.volume, rel=1e-7)


def test_an_outline_of_its_own_keeps_its_arcs(make_ngon):
    boundary, flat = arcs_plate()
    marker = made(make_ngon(4, 0.02, 0.004), outline=boundary, thickness=0.004)
    (plate,) = plate_of(marker).parts()
    assert plate.volume == pytest.approx(4 * flat, rel=EXACT)


def test_an_island_in_a_hole_is_a_plate_of_its_own(make_in):
    rings = [circle(0.1), circle(0.08, hole=True), circle(0.07), circle(0.03, hole=True), circle(0.01, 0.05, 0.0)]
    plates = plate_of(make_in(polygon_from(rings), 5, 0.004)).parts()
    assert [part.name for part in plates] == ["plate-1", "plate-2"]
    areas = [pi * (100**2 - 80**2), pi * (70**2 - 30**2 - 10**2)]
    assert [part.volume / 3 for part in plates] == pytest.approx(areas)
