import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import markergen as mg
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.optimize.dot_size import size_given
from markergen.optimize.problem import FeasibleRegion, breach, faults
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_from_mapping

FEW = "cone:distance=0.6..1.5m,tilt=0..60,count=8"
SQUARE = "0mm,100mm; -100mm,0mm; 0mm,-100mm; 100mm,0mm"
places = st.tuples(*[st.floats(-0.16, 0.16)] * 2)


def test_a_design_given_its_own_points_is_the_same_marker() -> None:
    usual = {"radius": "100mm", "poses": FEW}
    searched = mg.design(n=4, restarts=1, **usual).marker
    again = mg.design(points=searched.xyz[:, :2], **usual).marker
    assert again.control_points == searched.control_points


def test_points_are_taken_in_their_order_and_make_the_spec_another() -> None:
    turned = "100mm,0mm; 0mm,100mm; -100mm,0mm; 0mm,-100mm"
    result, rotated = (mg.design(points=points, poses=FEW) for points in (SQUARE, turned))
    np.testing.assert_allclose(result.marker.xyz[:, :2] * 10, [[0, 1], [-1, 0], [0, -1], [1, 0]], atol=1e-12)
    assert result.spec.hash != rotated.spec.hash
    stored = json.loads(json.dumps(result.marker.provenance["spec"]))
    assert spec_from_mapping(stored, stored=True).points == result.spec.points


def test_a_far_worse_layout_is_told() -> None:
    narrow = mg.design(points="0mm,50mm; -20mm,0mm; 0mm,-50mm; 20mm,10mm", dot="10mm", poses=FEW)
    assert any("a regular polygon has" in warning for warning in narrow.warnings)


@settings(max_examples=50, deadline=None)
@given(st.lists(places, min_size=4, max_size=8), st.floats(0.001, 0.05))
def test_faults_are_found_where_the_plain_geometry_has_them(points: list[tuple[float, float]], diameter: float) -> None:
    region = FeasibleRegion(Circle(0.15), diameter, diameter / 10)
    layout = np.array(points)
    worst = breach(layout, region.boundary, (), diameter, region.clearance)
    assert bool(faults(layout, region)) == (worst > 1e-9)


@settings(max_examples=50, deadline=None)
@given(st.lists(places, min_size=4, max_size=8))
def test_dots_are_the_largest_that_fit(points: list[tuple[float, float]]) -> None:
    spec = spec_from_mapping({"points": [list(row) for row in points]})
    diameter = size_given(spec, poses_from("paper")).diameter
    region = [FeasibleRegion(spec.boundary, size, size / 10) for size in (diameter, diameter + 1e-4)]
    assert diameter == pytest.approx(1e-4) or not faults(np.array(points), region[0])
    assert diameter == pytest.approx(0.036) or faults(np.array(points), region[1])


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"points": "0mm,0mm; 1mm,0mm; 0mm,90mm; 90mm,0mm"}, "dots 0 and 1 are 38.6 mm too near"),
        ({"points": SQUARE.replace("; 100mm,0mm", "; 149mm,0mm"), "dot": "36mm"}, "dot 3 is .* edge of the room"),
        ({"points": SQUARE, "n": 5}, "expected 5 control points, found 4 points"),
        ({"points": "0mm,1mm; 1mm,1mm; 2mm,0mm"}, "give 4 to 200 dots, not 3"),
        ({"points": SQUARE, "dot": "auto"}, "--dot auto"),
        ({"points": SQUARE, "relief": "10mm"}, "x, y and z"),
        ({"points": SQUARE, "asymmetric": 1.0}, "labels safe to 1 px"),
        ({"points": "0,1,2,3; 1,1; 2,2; 3,3"}, "give x and y"),
        ({"points": "0,one; 1,1; 2,2; 3,3"}, "one"),
        ({"points": "absent.csv"}, "absent.csv"),
    ],
)
def test_points_that_cannot_be_used_are_refused(options: dict[str, object], phrase: str) -> None:
    dot = {} if "dot" in options else {"dot": "36mm"}
    with pytest.raises(InputError, match=phrase):
        mg.design(**{**options, **dot})  # type: ignore[arg-type]


def test_a_table_of_another_unit_and_a_markers_own_table(tmp_path) -> None:
    usual = {"radius": "100mm", "relief": "20mm", "poses": FEW}
    marker = mg.design(n=4, restarts=1, output=[tmp_path / "m.csv"], **usual).marker
    loaded = mg.design(points=tmp_path / "m.csv", **usual).marker
    np.testing.assert_array_equal(loaded.xyz, marker.xyz)
    table = tmp_path / "inches.csv"
    table.write_text("name,y [in],x_mm\na,1,0\nb,0,-25.4\nc,-1,0\nd,0,25.4\n")
    points = mg.design(points=str(table), radius="100mm", poses=FEW).marker.xyz
    np.testing.assert_allclose(points[:, :2] / 0.0254, [[0, 1], [-1, 0], [0, -1], [1, 0]], atol=1e-9)
    table.write_text("x_mm,y_mm\n1,2\n3\n")
    with pytest.raises(InputError, match="line 3"):
        mg.design(points=table)
    table.write_text("u,v\n1,2\n")
    with pytest.raises(InputError, match="columns x, y"):
        mg.design(points=table)


def test_a_pillar_out_of_its_range_is_refused() -> None:
    rows = [[0.0, 0.1, 0.05], [-0.1, 0, 0], [0, -0.1, 0], [0.1, 0, 0]]
    with pytest.raises(InputError, match="points of a relief"):
        mg.design(points=rows, relief="20mm", dot="10mm")
