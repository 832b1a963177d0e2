"""Open lines and loops that are left out with a word, and what a drawing holds besides outlines."""

import numpy as np
import pytest
from drawings import SQUARE, dxf, geojson, svg

from markergen.errors import InputError
from markergen.geometry.contour import Contour, without_loops
from markergen.geometry.contour import area as exact_area
from markergen.model.boundary import Polygon
from markergen.read.outlines.boundary import parse_boundary, read_contours
from markergen.read.remarks import collected_remarks
from markergen.read.spec_file import spec_from_mapping

OPEN = (
    '<path d="M0 0H50V50"/><path d="M50 50H0V0"/><path id="leg" d="M50 50L70 80"/><path id="foot" d="M70 80L75 80"/>'
    '<path id="bow" d="M10 10Q15 20 30 10"/>'
)


def test_open_lines_are_left_out_and_listed(write, refused):
    path = write(svg(f'<g fill="none" stroke="red">{OPEN}</g>'))
    assert "--ignore-open" in refused(path)
    with collected_remarks() as remarks:
        (contour,) = read_contours(path, ignore_open=True)
    assert exact_area(contour) == pytest.approx(2500e-6)
    (remark,) = remarks
    assert all(f"path '{name}'" in remark for name in ("leg", "foot", "bow"))
    with collected_remarks():
        room = spec_from_mapping({"boundary": str(path), "ignore_open": True}).boundary
        assert room == parse_boundary(path, ignore_open=True)
    assert isinstance(room, Polygon)


def test_nothing_is_left_of_open_lines_alone(write):
    path = write(svg('<path d="M0 0H50V50" fill="none" stroke="red"/>'))
    with pytest.raises(InputError, match="1 open ones"):
        read_contours(path, ignore_open=True)
    with pytest.raises(InputError, match="--ignore-open with an outline file"):
        parse_boundary("rect:0.2x0.1", ignore_open=True)


B = 0.05


@pytest.mark.parametrize(
    "corner",
    [
        # A quarter circle of half a kerf, beyond an inner corner and back: of box generators; as arc and as curves.
        f"H{30 - B} A{B} {B} 0 0 1 30 {10 - B}",
        f"H{30 - B} C{30 - B} {10 - B / 2} {30 - B / 2} {10 - B} 30 {10 - B}",
        f"H{30 - B} V{10 - B} H30",
    ],
)
def test_loops_of_box_generators(write, corner):
    path = write(svg(f'<path d="M0 0H50V10{corner}V40H0Z"/>'))
    with collected_remarks() as remarks:
        (contour,) = read_contours(path)
    assert exact_area(contour) == pytest.approx((50 * 10 + 30 * 30) * 1e-6, rel=1e-9)
    (remark,) = remarks
    assert "a loop below 0.01 mm^2, at (30 mm, 10 mm)" in remark


def test_small_loops_beside_the_outline_and_large_crossings(write, refused):
    path = write(svg('<path d="M0 0H50V50H0Z M10 10h.09v.09h-.09z M20 10h.11v.11h-.11z"/>'))
    with collected_remarks() as remarks:
        assert len(read_contours(path)) == 2
    assert len(remarks) == 1
    # A loop of 0.02 mm^2 is no dust.
    assert "29.8" not in refused(svg('<path d="M0 0H50V10H29.8V9.8H30V40H0Z"/>'))


@pytest.mark.parametrize("start", range(7))
def test_a_loop_is_cut_wherever_the_contour_starts(start):
    points = [(0, 0), (50, 0), (50, 10), (29.95, 10), (29.95, 9.95), (30, 9.95), (30, 40), (0, 40)]
    rotated = points[start:] + points[:start]
    contour, places = without_loops(Contour(tuple(rotated)), 0.01, 2.0)
    assert exact_area(contour) == pytest.approx(1400)
    np.testing.assert_allclose(places, [(30, 10)])
    assert without_loops(Contour(tuple(rotated)), 0.002, 2.0) == (Contour(tuple(rotated)), [])


def draw(document, model):
    model.add_lwpolyline(SQUARE[:-1], close=True)
    document.layers.add("HIDDEN").off()
    model.add_line((0, 0), (5, 5), dxfattribs={"layer": "HIDDEN"})
    model.add_text("note")
    model.add_3dface([(0, 0), (1, 0), (1, 1)])


@pytest.mark.parametrize(
    ("content", "unit", "parts"),
    [
        (svg('<rect width="9" height="9"/><text x="1">a</text><rect width="1" height="1" fill="none"/>'), None,
         ["text", "shapes without fill and stroke"]),
        (svg('<rect width="9" height="9"/><g display="none"><rect width="1" height="1"/></g>'), None,
         ["hidden shapes"]),
        (dxf(draw), None, ["hidden shapes", "3DFACE"]),
        (geojson(SQUARE).replace("{", '{"crs": {}, ', 1), "mm", ["the key crs"]),
    ],
)  # fmt: skip
def test_what_is_not_used_is_reported(write, content, unit, parts):
    path = write(content)
    with collected_remarks() as remarks:
        read_contours(path, unit)
    assert remarks == [f"not used of {path}: {', '.join(parts)}"]


def test_px_of_illustrator(write, refused):
    text = svg('<rect width="10" height="10"/>', 'width="10px" height="10px" viewBox="0 0 10 10"')
    path = write("<!-- Generator: Adobe Illustrator 16.0.0 -->" + text)
    assert "Adobe Illustrator, which wrote it, means pt by px" in refused(path)
    for unit, count in (("pt", 0), ("px", 1)):
        with collected_remarks() as remarks:
            (contour,) = read_contours(path, unit)
        assert len(remarks) == count
        assert exact_area(contour) == pytest.approx((10 * {"pt": 0.0254 / 72, "px": 0.0254 / 96}[unit]) ** 2)


def drawn_with_center_lines(document, space):
    document.linetypes.add("CENTER2", [0.5, 0.4, -0.1])
    document.layers.add("axes of the drawing", linetype="CENTER2")
    document.layers.add("Construction")
    space.add_lwpolyline([(0, 0), (50, 0), (50, 30), (0, 30)], close=True)
    space.add_line((-5, 15), (55, 15), {"linetype": "CENTER2"})
    space.add_line((25, -5), (25, 35), {"layer": "axes of the drawing"})
    space.add_circle((25, 15), 20, {"layer": "Construction"})


def test_center_lines_are_left_out_and_named(write):
    path = write(dxf(drawn_with_center_lines))
    with collected_remarks() as remarks:
        (contour,) = read_contours(path)
    assert exact_area(contour) == pytest.approx(1500e-6)
    assert remarks == [f"not used of {path}: 3 center lines"]
    with collected_remarks():
        (circle,) = read_contours(path, layer="construction")
    assert exact_area(circle) == pytest.approx(np.pi * 400e-6, rel=1e-6)
