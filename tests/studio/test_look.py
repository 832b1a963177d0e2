import json
import shlex
import tomllib
from typing import Any

import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from markergen.api.design import rig_request_of
from markergen.cli import main
from markergen.errors import InputError
from markergen.options.rig import RigKeywords
from markergen.studio.look import _SEEN, clean, look, more, sketch
from markergen.studio.state import declared_options, design_of, plain_options, spec_of_options, words
from markergen.validation.bounds import error_budget

POINTS = "0mm,120mm; -110mm,-20mm; 10mm,-100mm; 90mm,30mm; 0mm,0mm"
MOVED = {"points": POINTS, "dot": "30mm", "radius": "150mm"}


def test_errors_are_those_of_validate() -> None:
    results, series = look(MOVED), sketch(MOVED).series
    budget = error_budget(series)
    assert results["expected"]["rotation_deg"] == pytest.approx(budget["rotation_deg"]["total"], rel=0.01)
    parts = {name: np.array(results["poses"][name]) for name in ("image", "print", "calibration")}
    np.testing.assert_allclose(sum(parts.values()), 1, atol=1e-5)
    mean = np.sqrt(np.mean(parts["print"] * np.array(results["poses"]["rotation"]) ** 2))
    assert mean == pytest.approx(budget["rotation_deg"]["print"], rel=0.01)


def test_the_objective_is_that_of_the_design() -> None:
    results, design = look(MOVED)["objective"], mg.design(**MOVED)
    assert results["value"] == pytest.approx(1e3 * design.value, rel=1e-4)
    assert results["ngon"] == pytest.approx(1e3 * design.criteria["ngon"]["pose_m"], rel=1e-3)


def test_without_points_it_begins_with_the_regular_polygon_as_a_state_with_points() -> None:
    results = look({"n": "6"})
    assert results["start"] == "a regular polygon"
    assert len(results["dots"]) == 6
    assert not results["problems"]
    again = look(results["options"])
    assert not again["start"]
    assert again["dots"] == results["dots"]


def test_where_no_regular_polygon_fits_it_begins_with_a_random_layout() -> None:
    assert look({"n": 12, "dot": "14mm", "boundary": "rect:120mmx60mm"})["start"] == "a random layout"


def test_the_best_seen_is_at_least_the_regular_polygon_beside_it() -> None:
    results = look({"dot": "30mm", "radius": "151mm", "points": POINTS})["objective"]
    assert results["best_known"] == min(results["value"], results["ngon"]) == results["ngon"]


def test_what_a_page_begins_with_fits() -> None:
    """Rounding moves none of sixty dots, which stand close to each other and to the edge, where it must not be."""
    result = sketch({"n": "60", "dot": "10mm"})
    assert len(result.points) == 60
    assert not result.faults


def test_faults_are_said_and_do_not_stop_the_numbers() -> None:
    results = look({**MOVED, "points": POINTS.replace("0mm,0mm", "10mm,-90mm")})
    assert [item["dots"] for item in results["problems"]] == [[2, 4]]
    assert results["expected"]["rotation_deg"] > 0
    [edge] = look({**MOVED, "points": POINTS.replace("0mm,120mm", "0mm,200mm")})["problems"]
    assert edge["dots"] == [0]
    assert edge["line"].endswith(sentence("near edge"))
    [inside] = look({**MOVED, "keep_out": ["circle:5mm@0mm,0mm"]})["problems"]
    assert inside["dots"] == [4]
    assert inside["line"].endswith(sentence("near region"))


def test_poses_that_do_not_see_the_whole_marker_are_counted_at_once():
    nearby = {
        "boundary": "rect:180mmx260mm",
        "n": 4,
        "dot": "20mm",
        "poses": "cone:distance=0.3..0.5m,tilt=0..60,count=100",
    }
    expected = look(nearby)["expected"]
    assert expected["poses"] + expected["dropped"] == 100
    assert expected["missed"].startswith(f"{expected['dropped']} of 100 poses")
    assert not look({**nearby, "poses": "cone:distance=1..1.5m,tilt=0..60,count=10"})["expected"]["missed"]


def test_a_relief_a_tag_and_keep_outs_are_drawn() -> None:
    relief = look({"points": "0mm,50mm,10mm; -50mm,0mm,0mm; 0mm,-50mm,5mm; 50mm,0mm,0mm", "relief": "10mm"})
    assert [dot["z"] for dot in relief["dots"]] == [0.01, 0, 0.005, 0]
    results = look({"n": 5, "keep_out": ["circle:5mm@0,0.05"], "tag": "aruco:DICT_4X4_50:7", "mount": ["4xM4@240mm"]})
    assert len(results["room"]["keep_outs"]) == 1
    assert results["room"]["tag"]["name"] == "aruco:DICT_4X4_50:7"
    assert len(results["room"]["holes"]) == 4


@pytest.mark.long
def test_more_says_what_takes_longer() -> None:
    results = more({"points": POINTS, "dot": "30mm", "poses": "cone:count=12"})
    assert results["plan"][0].startswith("At up to 1.4 m, scale and calibration exact; ")
    assert [row["name"] for row in results["beside"]][:2] == ["this marker", "aruco:DICT_4X4_50"]
    errors = [row["rotation_deg"] for row in results["more_dots"]]
    assert errors[0] > errors[-1] > 0
    assert json.dumps(results)


def test_errors_beyond_first_order_are_words_not_numbers() -> None:
    expected = look({"points": POINTS, "dot": "30mm", "poses": "cone:count=12,distance=400..500m"})["expected"]
    assert expected["rotation"] == "an undetermined rotation"
    assert expected["translation"] == "an undetermined position"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "options of a design"),
        ({"output": "marker.pdf"}, "output="),
        ({"sideways": 1}, "no such option"),
        ({"n": "many"}, "a whole number"),
        ({"radius": "1 parsec"}, "length"),
        ({"radius": "8,5cm"}, "write a point: 8.5cm"),
        ({"print_sigma": "0mm"}, "leave it out for 0.1mm"),
        ({"camera": "1012,1009"}, "write webcam or phone or 1280x720@60deg, or open the file"),
        ({"tag": "aruco"}, "a known family of tags such as aruco:DICT_4X4_50"),
        ({"points": "0,0"}, "4 to 200 dots"),
        ({"paper": "bananas"}, "a known paper size"),
        ({"dpi": "-7"}, "dpi"),
    ],
)
def test_states_that_are_none_are_refused(options: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        look(options)


def test_a_design_needs_points() -> None:
    with pytest.raises(InputError, match="points of a layout"):
        design_of({"n": 5})


@pytest.mark.long
def test_command_python_and_spec_make_the_marker_of_the_state(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    state = {**MOVED, "keep_out": ["circle:5mm@0,0.05"], "n": "", "tile": False}
    results, marker = words(state), design_of(state).marker
    assert tomllib.loads(results["spec"]) == plain_options(state)
    made: dict[str, Any] = {}
    exec(results["python"].replace("design.marker.save", "str"), made)
    assert made["design"].marker == marker
    (tmp_path / "marker.toml").write_text(results["spec"])
    typed = shlex.split(results["command"].replace("marker.pdf", "typed.json"))
    for line in (typed, ["markergen", "design", "--template", "marker.toml", "-o", "spec.json"]):
        assert main(line[1:]) == 0
    assert mg.Marker.load("typed.json") == mg.Marker.load("spec.json") == marker


def test_the_command_of_a_drawn_boundary_writes_its_spec() -> None:
    drawn = {"kind": "polygon", "outlines": [[[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]]}
    results = words({"boundary": drawn, "n": 4, "objective": "a\nEOF\n"})
    assert tomllib.loads(results["spec"])["boundary"] == drawn
    first, *spec, last, command = results["command"].split("\n")
    assert (first, last) == ("cat > marker.toml <<'EOF'", "EOF")
    assert "\n".join([*spec, ""]) == results["spec"]
    assert "EOF" not in spec
    assert command == "markergen design --template marker.toml -o marker.pdf"


def test_what_a_page_notes_beside_the_options_is_no_option() -> None:
    assert plain_options({"n": "4", "drawing_center": [0.1, 0.2]}) == {"n": 4}
    # Typical cameras are no files.
    assert spec_of_options({"camera": "phone"}).camera.width == 4032


def test_a_page_can_show_all_options() -> None:
    results = json.loads(json.dumps(declared_options()))
    marker, rig = (
        {option["name"]: option for group in results["forms"][kind] for option in group["options"]}
        for kind in ("marker", "rig")
    )
    assert {"n", "points", "radius", "camera", "paper", "mount"} <= marker.keys()
    assert {"n", "plate", "angle", "without", "camera", "paper"} <= rig.keys()
    assert not rig.keys() & {"points", "radius", "mount"}
    assert not (marker.keys() | rig.keys()) & {"output", "template", "boundary_unit", "layer", "origin"}
    assert "mm" in results["units"]
    assert {"pose", "condition"} <= {*marker["objective"]["choices"]}
    assert "paper" in marker["poses"]["choices"]
    assert rig["poses"]["choices"] == []
    assert {".pdf", ".step", ".toml"} <= {item["suffix"] for item in results["formats"]}


def test_values_that_are_not_finite_become_null() -> None:
    assert clean({"a": np.array([1.0, np.inf]), "b": (np.float32(0.5), np.nan)}) == {"a": [1.0, None], "b": [0.5, None]}


def test_what_is_kept_of_other_dots_changes_no_number() -> None:
    """As one dot after the other is moved, and then the room."""
    moved = [POINTS.replace("0mm,0mm", f"{x}mm,5mm") for x in (1, 2, 1)]
    states = [*({**MOVED, "points": points} for points in moved), {**MOVED, "dot": "28mm"}, MOVED]
    for state in states:
        after = look(state)
        _SEEN.clear()
        alone = look(state)
        np.testing.assert_allclose(after["poses"]["rotation"], alone["poses"]["rotation"], rtol=1e-5)
        np.testing.assert_allclose(after["poses"]["translation"], alone["poses"]["translation"], rtol=1e-5)
        look({**MOVED, "points": moved[0]})


def test_every_template_that_is_listed_is_a_state() -> None:
    listed = declared_options()["templates"]
    assert {"desk-a4", "thermal"} <= {item["name"] for item in listed}
    assert {item["name"]: item["shape"] for item in listed if item["shape"]} == {"cube": "cube", "wall": "wall 3x2"}
    for item in listed:
        if item["shape"]:
            assert rig_request_of(item["shape"], plain_options(item["options"], RigKeywords)).spec.camera.width
        else:
            assert spec_of_options(item["options"]).camera.width


def test_a_rig_is_said_by_its_shape_and_its_own_options() -> None:
    results = words({"shape": "wall 3x2", "n": "4", "drawing_center": [0, 0]})
    assert results["command"] == "markergen rig 'wall 3x2' --n 4 -o rig.json"
    assert tomllib.loads(results["spec"]) == {"shape": "wall 3x2", "n": 4}
    assert "mg.rig(\n    'wall 3x2',\n    n=4,\n)\ndesign.rig.save(\"rig.json\")" in results["python"]
    camera = {"width": 640, "height": 480, "fx": 700, "fy": 700, "cx": 320, "cy": 240}
    assert "\nmarkergen rig --template rig.toml -o rig.json" in words({"shape": "cube", "camera": camera})["command"]
    with pytest.raises(InputError, match="shape of a rig"):
        words({"shape": "plates.csv"})
