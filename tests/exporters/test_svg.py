import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from markergen.drawing.scene import Disk, Layer, Line, Scene
from markergen.drawing.sheet_layout import sheet_for
from markergen.exporters.formats.sheets import write_svg

NS = {"s": "http://www.w3.org/2000/svg"}
WRITTEN = 1e-6  # mm; six decimals, rounded, and one subtraction from the page height


def number(text: str) -> float:
    return float(text)


@pytest.fixture(scope="module", params=[(5, 0.15, 0.036), (12, 0.15, 0.036), (4, 0.0413, 0.0077)])
def case(make_ngon, request):
    marker = make_ngon(*request.param)
    sheet = sheet_for(marker)
    return marker, sheet, ElementTree.fromstring(write_svg(sheet))


def test_page_is_in_mm(case):
    _, sheet, root = case
    assert root.get("width") == f"{sheet.paper.width:g}mm"
    assert root.get("height") == f"{sheet.paper.height:g}mm"
    assert root.get("viewBox") == f"0 0 {sheet.paper.width:g} {sheet.paper.height:g}"
    assert root.findtext("s:title", namespaces=NS) == sheet.title == "markergen-1a2b3c4d"
    assert "true size" in root.findtext("s:desc", namespaces=NS)


def test_dots_are_exact_circles_within_a_micrometer_of_the_marker(case):
    marker, sheet, root = case
    dots = {element.get("id"): element for element in root.find("s:g[@id='dots']", NS)}
    assert list(dots) == [f"dot-{point.id}" for point in marker.control_points]
    for point in marker.control_points:
        element = dots[f"dot-{point.id}"]
        expected = sheet.origins_mm[0][0] + point.x * 1e3, sheet.paper.height - sheet.origins_mm[0][1] - point.y * 1e3
        if point.feature.kind == "dot":
            center = number(element.get("cx")), number(element.get("cy"))
            assert number(element.get("r")) == pytest.approx(point.feature.diameter * 500, abs=WRITTEN)
            np.testing.assert_allclose(center, expected, atol=WRITTEN, rtol=0)
            continue
        assert element.get("fill-rule") == "evenodd"
        arcs = re.findall(
            r"M([-\d.]+),([-\d.]+) A([\d.]+),([\d.]+) 0 1 0 ([-\d.]+),([-\d.]+) A\3,\4 0 1 0 \1,\2 Z", element.get("d")
        )
        assert len(arcs) == 2
        for arc, diameter in zip(arcs, (point.feature.diameter, point.feature.inner_diameter), strict=True):
            x0, y0, rx, ry, x1, y1 = map(float, arc)
            assert rx == ry == pytest.approx(diameter * 500, abs=WRITTEN)
            np.testing.assert_allclose(((x0 + x1) / 2, (y0 + y1) / 2), expected, atol=WRITTEN, rtol=0)
            assert abs(x0 - x1) == pytest.approx(2 * rx, abs=3 * WRITTEN)


def test_ruler_is_true_to_ten_micrometers(case):
    _, sheet, root = case
    xs = {}
    for mm in range(0, int(sheet.rulers_mm[0]) + 1, 10):
        points = root.find(f".//s:polyline[@id='ruler-{mm}']", NS).get("points").split()
        xs[mm] = number(points[0].split(",")[0])
    assert all(abs(x - xs[0] - mm) <= 2 * WRITTEN for mm, x in xs.items())


def test_no_transforms_no_live_text_and_unique_ids(case):
    _, sheet, root = case
    elements = list(root.iter())
    assert not [e for e in elements if e.get("transform") or e.get("style")]
    assert {e.tag.split("}")[1] for e in elements} == {
        "svg",
        "title",
        "desc",
        "rect",
        "g",
        "circle",
        "path",
        "polyline",
    }
    ids = [e.get("id") for e in elements if e.get("id")]
    assert len(ids) == len(set(ids))
    assert [g.get("id") for g in root.findall("s:g", NS)] == [layer.name for layer in sheet.scene.layers]
    assert len(ids) == 1 + len(sheet.scene.layers) + len(list(sheet.scene))


def test_all_numbers_are_on_the_page(case):
    _, sheet, root = case
    for path in root.iter("{http://www.w3.org/2000/svg}path"):
        if path.get("fill-rule"):
            continue
        pairs = np.array(re.findall(r"(-?[\d.]+),(-?[\d.]+)", path.get("d")), dtype=float)
        assert pairs.min() >= 0
        assert np.all(pairs <= [sheet.paper.width, sheet.paper.height])


def test_every_dot_is_a_disk_of_the_scene(case):
    _, sheet, _ = case
    assert all(isinstance(shape, Disk) for shape in sheet.scene["dots"])


def test_layers_are_layers_in_inkscape(case):
    _, sheet, root = case
    inkscape = "{http://www.inkscape.org/namespaces/inkscape}"
    groups = root.findall("s:g", NS)
    assert {group.get(inkscape + "groupmode") for group in groups} == {"layer"}
    assert [group.get(inkscape + "label") for group in groups] == [layer.name for layer in sheet.scene.layers]


def test_a_closed_line_is_a_polygon_and_a_spot_color_its_look_with_its_name_on_the_layer(case):
    _, sheet, _ = case
    square = Line(((10, 10), (30, 10), (30, 30), (10, 30), (10, 10)), 0.1, "edge", "CutContour=#ff00ff")
    scene = Scene((Layer("cut", (square,)),))
    root = ElementTree.fromstring(write_svg(replace(sheet, scene=scene)))
    polygon = root.find(".//s:polygon", NS)
    assert len(polygon.get("points").split()) == 4
    assert (polygon.get("stroke"), polygon.get("fill")) == ("#ff00ff", "none")
    group = root.find("s:g", NS)
    assert group.get("{http://www.inkscape.org/namespaces/inkscape}label") == "cut (CutContour)"
