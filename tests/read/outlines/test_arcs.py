"""Arcs and circles of drawings stay what they are; all else becomes polygons."""

import math

import numpy as np
import pytest
from drawings import dxf, read_outline, svg

from markergen.geometry.contour import area, center_of, radius_of
from markergen.model.boundary import polygon_from
from markergen.read.outlines.boundary import read_contours

QUARTER = math.tan(math.pi / 8)


def circles(path, **options):
    return [contour.as_circle for contour in read_contours(path, **options)]


def radii(contour):
    return [round(radius_of(side), 9) for side in contour.sides if side[2]]


def test_circles_of_a_dxf(write):
    def draw(_, model):
        model.add_circle((0, 0), 125)
        model.add_circle((0, 0), 40)
        for x, y in ((70, 70), (-70, 70)):
            model.add_circle((x, y), 4.5)
        # Seen from behind, x is to the left.
        model.add_circle((70, -70), 4.5, dxfattribs={"extrusion": (0, 0, -1)})

    result = circles(write(dxf(draw)))
    wanted = [(0, 0, 0.125), (0, 0, 0.04), (0.07, 0.07, 0.0045), (-0.07, 0.07, 0.0045), (-0.07, -0.07, 0.0045)]
    assert np.array(result) == pytest.approx(np.array(wanted), abs=1e-15)
    assert [area(contour) > 0 for contour in read_contours(write(dxf(draw)))] == [True] + [False] * 4


def test_lines_and_arcs_of_a_dxf_in_any_direction(write):
    """A plate of 200 x 120 mm with fillets of 15 mm, whose pieces come in any order."""

    def draw(_, model):
        w, h, r = 200, 120, 15
        model.add_line((w - r, 0), (r, 0))
        model.add_arc((w - r, r), r, 270, 0)
        model.add_line((w, h - r), (w, r))
        model.add_arc((r, h - r), r, 90, 180)
        model.add_line((w - r, h), (r, h))
        model.add_arc((w - r, h - r), r, 0, 90)
        model.add_line((0, r), (0, h - r))
        model.add_arc((r, r), r, 180, 270)

    (plate,) = read_contours(write(dxf(draw)))
    assert len(plate.points) == 8
    assert sorted(plate.bulges) == pytest.approx([0.0] * 4 + [QUARTER] * 4, abs=1e-15)
    assert area(plate) == pytest.approx(0.2 * 0.12 - (4 - math.pi) * 0.015**2, rel=1e-12)


@pytest.mark.parametrize("kind", ["lwpolyline", "polyline"])
def test_polylines_with_bulges(write, kind):
    slot = [(0, 0, 0), (40, 0, 1), (40, 10, 0), (0, 10, 1)]
    # Three quarters of a circle and a straight line: two arcs of its radius.
    cut = [(10, 100, math.tan(3 * math.pi / 8)), (0, 90, 0)]

    def draw(_, model):
        for points in (slot, cut):
            if kind == "lwpolyline":
                model.add_lwpolyline(points, format="xyb", close=True)
            else:
                model.add_polyline2d(points, format="xyb", close=True)

    found_slot, found_cut = read_contours(write(dxf(draw)))
    assert radii(found_slot) == [0.005, 0.005]
    assert area(found_slot) == pytest.approx(40e-5 + math.pi * 25e-6, rel=1e-12)
    assert radii(found_cut) == [0.01, 0.01]
    assert all(abs(bulge) <= 1 for bulge in found_cut.bulges)
    assert area(found_cut) == pytest.approx(0.75 * math.pi * 1e-4 + 0.5e-4, rel=1e-9)


def test_blocks_keep_circles_where_they_are_scaled_alike_along_both_axes(write):
    def draw(document, model):
        block = document.blocks.new("HOLE")
        block.add_circle((1, 0), 2)
        model.add_lwpolyline([(-50, -50), (150, -50), (150, 50), (-50, 50)], close=True)
        model.add_blockref("HOLE", (0, 0), dxfattribs={"rotation": 30, "xscale": 3, "yscale": 3, "zscale": 3})
        model.add_blockref("HOLE", (60, 0), dxfattribs={"xscale": -3, "yscale": 3, "zscale": 3})
        model.add_blockref("HOLE", (120, 0), dxfattribs={"xscale": 3, "yscale": 4, "zscale": 3})

    _, rotated, flipped, stretched = read_contours(write(dxf(draw)))
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    assert rotated.as_circle == pytest.approx((3e-3 * c, 3e-3 * s, 6e-3), abs=1e-15)
    assert flipped.as_circle == pytest.approx((57e-3, 0, 6e-3), abs=1e-15)
    assert not stretched.has_arcs
    assert area(stretched) == pytest.approx(-math.pi * 48e-6, rel=1e-2)


def test_ellipses_and_splines_become_polygons(write):
    def draw(_, model):
        model.add_ellipse((0, 0), (50, 0), 0.6)
        model.add_spline([(100, 0), (140, 30), (180, 0), (140, -30), (100, 0)])

    for contour in read_contours(write(dxf(draw))):
        assert not contour.has_arcs
        assert len(contour.points) > 50


@pytest.mark.parametrize(
    "attributes",
    [
        "",
        'transform="rotate(30)"',
        'transform="matrix(0.8660254 0.5 -0.5 0.8660254 3 4)"',
        'transform="translate(10,20) scale(-1,1)"',
    ],
)
def test_circles_of_an_svg_under_similarities(write, attributes):
    shapes = f'<g {attributes}><rect width="100" height="80" rx="9"/><circle cx="50" cy="40" r="4.5"/></g>'
    plate, hole = read_contours(write(svg(shapes)))
    assert hole.as_circle[2] == pytest.approx(4.5e-3, rel=1e-6)
    assert radii(plate) == pytest.approx([9e-3] * 4, rel=1e-6)
    assert abs(area(plate)) == pytest.approx(8e-3 - (4 - math.pi) * 81e-6, rel=1e-6)
    assert area(plate) > 0 > area(hole)


def test_places_in_an_svg_have_y_up(write):
    _, hole = read_contours(write(svg('<rect width="100" height="80"/><circle cx="30" cy="20" r="4.5"/>')))
    assert hole.as_circle == pytest.approx((0.03, -0.02, 0.0045), abs=1e-15)
    # An arc over the upper side of a half disk is still over it.
    (half,) = read_contours(write(svg('<path d="M10 40 A20 20 0 0 1 50 40 Z"/>')))
    (side,) = [side for side in half.sides if side[2]]
    assert center_of(side) == pytest.approx((0.03, -0.04), abs=1e-12)
    depth = polygon_from([half], "file").depth(np.array([[0.03, -0.03], [0.03, -0.05]]))
    assert depth == pytest.approx([0.01, -0.01], abs=4.5e-6)


@pytest.mark.parametrize(
    "path",
    [
        "M25.5 40 A4.5 4.5 0 1 0 34.5 40 A4.5 4.5 0 1 0 25.5 40 Z",
        "m 34.5,40 a 4.5,4.5 0 0 1 -4.5,4.5 4.5,4.5 0 0 1 -4.5,-4.5 4.5,4.5 0 0 1 4.5,-4.5 4.5,4.5 0 0 1 4.5,4.5 z",
        # As an editor rounds it.
        "M34.1448 41.7524 A4.5 4.5 0 0 1 26.3949 42.6931 A4.5 4.5 0 1 1 34.1448 41.7524 Z",
    ],
)
def test_a_path_of_arcs_of_one_circle_is_a_circle(write, path):
    (circle,) = circles(write(svg(f'<path d="{path}"/>')))
    assert circle == pytest.approx((0.03, -0.04, 0.0045), abs=1e-6)


def test_what_is_no_arc_of_a_circle_is_as_it_was(write):
    body = (
        '<ellipse cx="30" cy="30" rx="20" ry="10"/><path d="M60 60 A20 10 0 0 1 100 60 Z"/>'
        '<g transform="skewX(20)"><circle cx="100" cy="30" r="9"/></g><path d="M150 20 C160 0 170 0 180 20 Z"/>'
    )
    results = read_contours(write(svg(body)))
    assert len(results) == 4
    assert not any(contour.has_arcs for contour in results)


def test_outlines_are_polygons_of_the_contours(write):
    path = write(svg('<circle cx="60" cy="50" r="40"/>'))
    (ring,), (contour,) = read_outline(path), read_contours(path)
    away = np.hypot(*(ring - contour.as_circle[:2]).T)
    assert away == pytest.approx(np.full(len(ring), 0.04), abs=1e-12)
    middle = (ring + np.roll(ring, -1, axis=0)) / 2
    assert np.hypot(*(middle - contour.as_circle[:2]).T).min() >= 0.04 - 5e-6
