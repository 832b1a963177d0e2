import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sentences import sentence

from docs.generate import json_schema
from markergen.errors import InputError
from markergen.model.body_json import from_json, load_marker_or_rig, load_rig, read_marker, to_json
from markergen.model.boundary import Circle, polygon_from
from markergen.model.substrate import Hole, Substrate, parse_dowel
from markergen.model.tag import Tag

SCHEMA = Path(__file__).parents[2] / "docs" / "marker-v1.schema.json"


@pytest.fixture
def content(pentagon):
    return json.loads(to_json(pentagon))


def refusal(content) -> str:
    with pytest.raises(InputError) as caught:
        from_json(content if isinstance(content, str) else json.dumps(content))
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_writing_and_reading_is_the_identity(pentagon):
    again = from_json(to_json(pentagon).decode())
    assert to_json(again) == to_json(pentagon)
    assert again.control_points == pentagon.control_points
    assert again.boundary == pentagon.boundary


def test_the_published_schema_is_this_one_and_holds(content):
    assert json.loads(SCHEMA.read_text()) == json_schema(1)
    jsonschema.validate(content, json_schema(1))
    content["control_points"][0]["x"] = "left"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, json_schema(1))


def test_every_error_is_told_with_its_path(content):
    content["control_points"][0]["id"] = 3
    content["control_points"][1]["x"] = "left"
    content["control_points"][2]["y"] = 0.149
    content["control_points"][4]["feature"]["inner_diameter"] = 0.05
    content["surprise"] = 1
    content["two\nlines"] = 2
    content["k" * 1_000_000] = 3
    del content["clearance"]
    message = refusal(content)
    assert len(message) < 1000
    for phrase in (
        "control_points[1].x: Input should be a valid number",
        "surprise: unknown key (got 1)",
        "clearance: missing",
        "control_points[3].id: 3 is used twice",
        "control_points[2]: stands",
        "control_points[4].feature.inner_diameter: not below the diameter of 0.036 (got 0.05)",
        "['two\\nlines']: unknown key",
        "kkk']: unknown key (got 3)",
    ):
        assert phrase in message


def test_overlapping_dots_are_told(content):
    content["control_points"][1]["x"] = content["control_points"][0]["x"] + 0.01
    content["control_points"][1]["y"] = content["control_points"][0]["y"]
    assert "control_points[1]: overlaps control_points[0] by 26 mm" in refusal(content)


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"version": 3}, "found version 3, written by a newer markergen; update markergen"),
        ({"version": "1"}, "found version '1'"),
        ({"format": "something"}, "another kind of file"),
        ({"format": "markergen-rig"}, "found a markergen-rig; give a marker.json"),
        ({"boundary": {"kind": "circle", "radius": -1}}, "boundary.radius"),
        ({"boundary": {"kind": "circle", "radius": float("nan")}}, "found the number NaN"),
        ({"provenance": {"camera": {"fx": float("-inf")}}}, "found the number -Infinity"),
        ({"version": True}, "found version True"),
        ({"version": 1.0}, "found version 1.0"),
        ({"version": ["2"] * 1000}, "found version ['2', '2',"),
        ({"substrate": {"thickness": 9e-6}}, "substrate.thickness: Input should be greater than or equal to 0.00001"),
        ({"substrate": {"thickness": 1.1}}, "substrate.thickness: Input should be less than or equal to 1 (got 1.1)"),
        ({"control_points": [0] * 1001}, "control_points: List should have at most 1000 items"),
        ({"control_points": []}, "control_points: List should have at least 4 items"),
        ({"control_points": "none"}, "control_points: Input should be a valid list"),
    ],
)
def test_each_kind_of_damage_is_named(content, change, phrase):
    assert phrase in refusal({**content, **change})


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null", '"x"', "[" * 100_000])
def test_what_is_no_marker_is_refused(text):
    refusal(text)


@given(st.data())
def test_a_cut_off_file_is_refused_wherever_it_ends(pentagon, data):
    text = to_json(pentagon).decode().rstrip()
    refusal(text[: data.draw(st.integers(0, len(text) - 1))])


KEEP_OUTS = (Circle(0.02, (0.1, 0.0)), Circle(0.004, (-0.08, -0.08)))


def test_any_shape_and_its_keep_outs_come_back(shape, make_in):
    marker = make_in(shape, 6, 0.01, KEEP_OUTS)
    data = to_json(marker)
    again = from_json(data.decode())
    assert (again.boundary, again.keep_outs) == (shape, KEEP_OUTS)
    assert to_json(again) == data
    content = json.loads(data)
    jsonschema.validate(content, json_schema(1))
    assert content["frame"]["origin"] == sentence("origin of circle")


def test_a_kept_origin_is_told(make_in):
    boundary = polygon_from([np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])], origin="file")
    content = json.loads(to_json(make_in(boundary, 5, 0.01)))
    assert content["frame"]["origin"] == sentence("origin of drawing")
    jsonschema.validate(content, json_schema(1))
    assert from_json(json.dumps(content)).boundary == boundary


@pytest.fixture
def l_shaped(shapes, make_in):
    return json.loads(to_json(make_in(shapes["L"], 6, 0.01, (Circle(0.01, (-0.06, -0.06)),))))


def test_dots_off_the_boundary_and_in_keep_outs_are_told(l_shaped):
    for point, (x, y) in zip(l_shaped["control_points"], [(0.03, 0.03), (-0.06, -0.05), (0.095, -0.05)], strict=False):
        point["x"], point["y"] = x, y
    message = refusal(l_shaped)
    # The wall is at x = -0.02; dots have a radius of 5 mm and a clearance of 1 mm.
    assert sentence("over", "control_points[0]", "55 mm", "boundary") in message
    assert "control_points[1]: stands 5 mm over keep_outs[0]" in message
    assert sentence("too near", "control_points[2]", "1 mm", "the boundary") in message


def test_coordinates_beyond_all_squares_are_outside(l_shaped):
    l_shaped["control_points"][0]["x"] = 1e300
    assert sentence("over", "control_points[0]", "1e+103 mm", "boundary") in refusal(l_shaped)


def test_dots_far_above_the_plate_are_told(l_shaped):
    l_shaped["control_points"][0]["z"] = 1e30
    assert "control_points[0].z: 1e+30 m" in refusal(l_shaped)


@pytest.mark.parametrize(
    ("path", "value", "phrase"),
    [
        (("boundary", "kind"), "star", "boundary: Input should be a table with kind circle or polygon (got {"),
        (("boundary", "kind"), 3, "boundary: Input should be a table with kind circle or polygon (got {"),
        (("boundary",), [1], "boundary: Input should be a table with kind circle or polygon (got [1])"),
        (("boundary", "radius"), 1, "boundary.radius: unknown key (got 1)"),
        (("boundary", "outlines"), [], "boundary.outlines: List should have at least 1 item"),
        (("boundary", "outlines", 0), [[0, 0], [1, 1]], "boundary.outlines[0]: List should have at least 3 items"),
        (("boundary", "outlines", 0, 2), [0, 0, 0], "boundary.outlines[0][2]: List should have at most 2 items"),
        (
            ("boundary", "outlines", 0, 2, 1),
            "x",
            "boundary.outlines[0][2][1]: Input should be a valid number (got 'x')",
        ),
        (("boundary", "outlines", 0, 1), [-0.1, 0.2], "boundary: expected outlines that do not cross"),
        (("keep_outs", 0, "radius"), -1, "keep_outs[0].radius: Input should be greater than 0 (got -1)"),
        (("keep_outs", 0), {"kind": "polygon"}, "keep_outs[0].outlines: missing"),
        (("keep_outs",), {}, "keep_outs: Input should be a valid list"),
        (("frame", "origin"), "here", "frame.origin: Input should be"),
    ],
)
def test_what_is_wrong_with_a_shape_is_told_with_its_path(l_shaped, path, value, phrase):
    place = l_shaped
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    assert phrase in refusal(l_shaped)


@pytest.mark.parametrize(
    ("number", "phrase"),
    [("1e999", "1e999"), ("9" * 5000, "99999999999999999..."), ("-" + "9" * 400, "-9999999999999999...")],
)
def test_numbers_without_end_are_refused_wherever_they_stand(pentagon, number, phrase):
    text = to_json(pentagon).decode().replace('"1a2b3c4d"', number)
    assert f"the number {phrase}," in refusal(text)


def test_keys_given_twice_are_refused(pentagon):
    text = to_json(pentagon).decode()
    assert "'diameter' twice" in refusal(text.replace('"inner_diameter"', '"diameter"', 1))
    assert "'format' twice" in refusal('{"format": 1, "format": 2}')


def test_half_characters_survive_reading_and_writing(content):
    content["provenance"] = {"note": "\ud800 µ"}
    marker = from_json(json.dumps(content))
    assert marker.provenance == content["provenance"]
    assert from_json(to_json(marker).decode()) == marker


def test_identifiers_fit_32_bits(content):
    content["control_points"][1]["id"] = 2**31 - 1
    from_json(json.dumps(content))
    content["control_points"][1]["id"] += 1
    assert "2147483647 (got 2147483648)" in refusal(content)


@pytest.mark.parametrize(
    ("feature", "phrase"),
    [
        ({"kind": "dot", "diameter": 0.036, "inner_diameter": 0.018}, ".kind: a ring has"),
        ({"kind": "ring", "diameter": 0.036, "inner_diameter": 0}, ".kind: a ring has"),
        ({"kind": "ring", "diameter": 0, "inner_diameter": 0}, ".kind: a ring has"),
        ({"kind": "ring", "diameter": 0.036, "inner_diameter": 0.036}, ".inner_diameter: not below"),
        ({"kind": "ring", "diameter": 0, "inner_diameter": 0.001}, ".inner_diameter: not below"),
    ],
)
def test_features_that_contradict_themselves_are_told(content, feature, phrase):
    content["control_points"][1]["feature"] = feature
    message = refusal(content)
    assert f"control_points[1].feature{phrase}" in message
    assert message.count("control_points[1]") == 1


def test_bare_points_are_dots_of_diameter_0(content):
    content["control_points"][1]["feature"] = {"kind": "dot", "diameter": 0, "inner_diameter": 0}
    assert from_json(json.dumps(content)).control_points[1].feature.diameter == 0


def test_a_breach_of_the_clearance_is_told_once(content):
    # The topmost dot moves 1 mm nearer to the rim, where it stood exactly at the clearance of 3.6 mm.
    first, second = content["control_points"][:2]
    first["y"] += 0.001
    assert f"found {sentence('too near', 'control_points[0]', '1 mm', 'the boundary')}; " in refusal(content)
    # 2 mm from edge to edge instead of 3.6.
    first["y"] -= 0.001
    second["x"], second["y"] = 0.0, first["y"] - 0.036 - 0.002
    message = refusal(content)
    assert sentence("too near", "control_points[1]", "1.6 mm", "control_points[0]") in message
    assert "overlaps" not in message
    second["y"] += 0.003
    message = refusal(content)
    assert "control_points[1]: overlaps control_points[0] by 1 mm" in message
    assert "clearance" not in message
    # The rounding of written coordinates is no breach.
    second["y"] = first["y"] - 0.036 - content["clearance"] + 5e-10
    from_json(json.dumps(content))


def test_of_many_findings_the_first_20_are_listed(content):
    content["control_points"] = [dict(content["control_points"][0], id=0) for _ in range(30)]
    message = refusal(content)
    # 29 identifiers used twice, and 30 * 29 / 2 pairs that overlap.
    assert message.count("control_points[") == 20
    assert f"and {29 + 435 - 20} more" in message


def test_coordinates_beyond_all_measure_are_outside(content):
    content["control_points"][0].update(x=1.7e308, y=-1.7e308)
    content["control_points"][1].update(x=-1.7e308)
    assert "control_points[1]: stands" in refusal(content)


def test_a_file_without_end_is_refused(tmp_path):
    with pytest.raises(InputError, match="at most 10 MB"):
        read_marker(Path("/dev/zero"))
    (tmp_path / "large.json").write_bytes(b" " * 10_000_000)
    with pytest.raises(InputError, match="complete JSON"):
        read_marker(tmp_path / "large.json")
    (tmp_path / "empty.json").write_bytes(b"")
    with pytest.raises(InputError, match="an empty file"):
        read_marker(tmp_path / "empty.json")


def test_a_byte_order_mark_is_accepted(pentagon, tmp_path):
    (tmp_path / "m.json").write_bytes(b"\xef\xbb\xbf" + to_json(pentagon))
    assert read_marker(tmp_path / "m.json") == pentagon


def test_unreadable_files_are_one_line(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_marker(tmp_path / "none.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        read_marker(tmp_path / "binary.json")
    with pytest.raises(InputError, match="directory"):
        read_marker(tmp_path)


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("marker.pdf", b"%PDF-1.7\n\xff"),
        ("marker.step", b"ISO-10303-21;"),
        ("marker.svg", b"<svg>"),
        ("layout.csv", b"x_mm,y_mm"),
        ("marker", b"\xff"),
    ],
)
def test_a_sheet_or_solid_in_place_of_the_marker_is_named(pentagon, tmp_path, name, start):
    path = tmp_path / name
    path.write_bytes(start)
    kind = name.partition(".")[2].upper()
    message = f"a marker.json at .*{name}, found a {kind} file; give the .json that was written with it"
    for load in (read_marker, load_marker_or_rig, load_rig):
        with pytest.raises(InputError, match=message if kind else "not UTF-8"):
            load(path)
    # Any name will do for what is a marker, or was one.
    path.write_bytes(b"\xef\xbb\xbf" + to_json(pentagon))
    assert read_marker(path) == pentagon
    path.write_bytes(to_json(pentagon)[:50])
    with pytest.raises(InputError, match="or damaged"):
        read_marker(path)


@pytest.fixture
def tagged(pentagon):
    return replace(pentagon, tag=Tag("apriltag:36h11", 3, 0.06, (0.001, -0.002)))


def test_a_tag_is_written_with_its_corners_and_read_back(tagged):
    content = json.loads(to_json(tagged))
    assert content["tag"] == {
        "family": "apriltag:36h11",
        "id": 3,
        "side": 0.06,
        "quiet_zone": 0.0075,
        "corner_order": "top left, top right, bottom right, bottom left",
        "corners": content["tag"]["corners"],
    }
    # As it stands in marker.json: in m, in the marker frame, x right and y up.
    expected = [[-0.029, 0.028, 0], [0.031, 0.028, 0], [0.031, -0.032, 0], [-0.029, -0.032, 0]]
    np.testing.assert_allclose(content["tag"]["corners"], expected, atol=1e-15, rtol=0)
    jsonschema.validate(content, json_schema(1))
    again = from_json(to_json(tagged).decode())
    assert again == tagged
    assert to_json(again) == to_json(tagged)


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"family": "apriltag:36h12"}, "tag.family: Input should be"),
        ({"id": 587}, "tag.id: expected an id of 0 to 586 in apriltag:36h11, found id=587"),
        ({"id": -1}, "tag.id: Input should be greater"),
        ({"side": 0.05}, "tag.corners: not those of an upright square of side 0.05"),
        ({"side": 0.0}, "tag.side: Input should be greater than 0"),
        ({"quiet_zone": 0.01}, "tag.quiet_zone: 0.01, and one cell of the tag is 0.0075"),
        ({"corners": [[0, 0, 0]] * 4}, "tag.corners: not those of an upright square"),
        ({"corners": [[0.0, 0.0]] * 4}, "tag.corners[0]"),
        ({"corner_order": "any"}, "tag.corner_order: Input should be"),
        ({"color": "red"}, "tag.color: unknown key"),
    ],
)
def test_errors_of_a_tag_are_told_with_their_paths(tagged, change, phrase):
    content = json.loads(to_json(tagged))
    content["tag"].update(change)
    assert phrase in refusal(content)


def test_corners_in_another_order_are_refused(tagged):
    content = json.loads(to_json(tagged))
    corners = content["tag"]["corners"]
    content["tag"]["corners"] = corners[1:] + corners[:1]
    assert "order stated" in refusal(content)


def test_a_dot_over_the_quiet_zone_of_a_tag_is_told(tagged):
    content = json.loads(to_json(tagged))
    # The quiet zone ends 37.5 mm right of the tag's middle; the dot's edge is 18 mm from its own.
    content["control_points"][4].update(x=0.001 + 0.0375 + 0.018 + 0.001, y=0.0)
    assert sentence("too near", "control_points[4]", "2.6 mm", sentence("quiet zone")) in refusal(content)
    content["control_points"][4].update(x=0.001 + 0.0375 + 0.018 - 0.001, y=0.0)
    assert sentence("over", "control_points[4]", "1 mm", "quiet zone of the tag") in refusal(content)


PLATE = Substrate(
    0.004,
    0.001,
    0.005,
    0.0005,
    Circle(0.2),
    (Hole(0.0, -0.128, 0.0034, 0.00672, name="M3"), *parse_dowel("2x4mm@60mm")),
)


def test_a_substrate_is_written_and_read_back(pentagon):
    marker = replace(pentagon, substrate=PLATE)
    data = to_json(marker)
    jsonschema.validate(json.loads(data), json_schema(1))
    again = from_json(data.decode())
    assert again == marker
    assert again.substrate == PLATE
    assert to_json(again) == data


def test_a_plain_substrate_is_written_as_it_always_was(pentagon, content):
    assert content["substrate"] == {"thickness": 0.003}
    assert from_json(json.dumps(content)).substrate == Substrate()
    # A hole says what it is for and by what name only if somebody said so.
    content["substrate"]["holes"] = [{"x": 0, "y": 0, "diameter": 0.0034}]
    assert from_json(json.dumps(content)).substrate.holes == (Hole(0, 0, 0.0034),)


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"edge": -0.001}, "substrate.edge: Input should be greater than or equal to 0 (got -0.001)"),
        ({"chamfer": 0.003}, "substrate: expected a chamfer of 0 or more, and below the thickness of 3 mm"),
        ({"corner_radius": "5mm"}, "substrate.corner_radius: Input should be a valid number"),
        ({"color": "white"}, "substrate.color: unknown key"),
        ({"outline": {"kind": "star"}}, "substrate.outline: Input should be a table with kind circle or polygon"),
        ({"outline": {"kind": "circle", "radius": 0}}, "substrate.outline.radius: Input should be greater than 0"),
        ({"holes": {}}, "substrate.holes: Input should be a valid list"),
        ({"holes": [{"x": 0, "y": 0}]}, "substrate.holes[0].diameter: missing"),
        ({"holes": [{"x": 0, "y": 0, "diameter": 0}]}, "substrate.holes[0].diameter: Input should be greater than 0"),
        ({"holes": [{"x": 0, "y": 0, "diameter": 0.1, "use": "door"}]}, "substrate.holes[0].use: Input should be"),
        (
            {"holes": [{"x": 0, "y": 0, "diameter": 0.005, "sink": 0.004}]},
            "substrate.holes[0]: expected a countersink wider than its hole of 5 mm, found sink=0.004 m",
        ),
        (
            {"holes": [{"x": 0, "y": 0, "diameter": 0.003, "sink": 0.01}]},
            "substrate.holes[0]: has a countersink 3.5 mm deep in a plate of 3 mm",
        ),
        (
            {"holes": [{"x": 0, "y": -0.128, "diameter": 0.003}, {"x": 0, "y": 0.12, "diameter": 0.003}]},
            "substrate.holes[1]: is 11.1 mm over control_points[0]",
        ),
        (
            {"holes": [{"x": 0, "y": 0, "diameter": 0.003}, {"x": 0.002, "y": 0, "diameter": 0.003}]},
            "substrate.holes[1]: is 1 mm over the hole 3 mm at 0 mm, 0 mm",
        ),
        ({"holes": [{"x": 0, "y": 0, "diameter": 0.003}] * 201}, "substrate.holes: List should have at most 200 items"),
    ],
)
def test_what_is_wrong_with_a_substrate_is_told_with_its_path(content, change, phrase):
    content["substrate"] |= change
    assert phrase in refusal(content)


def test_holes_in_the_tag_are_told(tagged):
    content = json.loads(to_json(tagged))
    content["substrate"]["holes"] = [{"x": 0, "y": 0, "diameter": 0.003}]
    assert "substrate.holes[0]: is 37 mm over " + sentence("quiet zone") in refusal(content)


def test_holes_are_held_against_the_design_and_not_against_the_print(content):
    # The clearance of the topmost dot ends at 106.8 mm, and 2 % nearer in the print.
    content["substrate"]["holes"] = [{"x": 0, "y": 0.105, "diameter": 0.003}]
    for point in content["control_points"]:
        point["x"], point["y"] = 0.98 * point["x"], 0.98 * point["y"]
    assert "control_points[0]" in refusal(content)
    content["print_correction"] = {"scale_x": 0.98, "scale_y": 0.98}
    from_json(json.dumps(content))
