import json
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.model.marker_json import from_json, json_schema, read_marker, to_json

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
    assert json.loads(SCHEMA.read_text()) == json_schema()
    jsonschema.validate(content, json_schema())
    content["control_points"][0]["x"] = "left"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, json_schema())


def test_every_error_is_told_with_its_path(content):
    content["control_points"][0]["id"] = 3
    content["control_points"][1]["x"] = "left"
    content["control_points"][2]["y"] = 0.149
    content["control_points"][4]["feature"]["inner_diameter"] = 0.05
    content["surprise"] = 1
    del content["clearance"]
    message = refusal(content)
    for words in (
        "control_points[1].x: Input should be a valid number",
        "surprise: Extra inputs are not permitted",
        "clearance: Field required",
        "control_points[3].id: 3 is used twice",
        "control_points[2]: stands",
        "control_points[4].feature.inner_diameter: not below the diameter",
    ):
        assert words in message


def test_overlapping_dots_are_told(content):
    content["control_points"][1]["x"] = content["control_points"][0]["x"] + 0.01
    content["control_points"][1]["y"] = content["control_points"][0]["y"]
    assert "control_points[1]: overlaps control_points[0] by 26 mm" in refusal(content)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"version": 2}, "found version 2; update markergen"),
        ({"version": "1"}, "found version '1'"),
        ({"format": "something"}, "another kind of file"),
        ({"boundary": {"kind": "circle", "radius": -1}}, "boundary.radius"),
        ({"boundary": {"kind": "circle", "radius": float("nan")}}, "boundary.radius"),
        ({"control_points": []}, "control_points: List should have at least 4 items"),
        ({"control_points": "none"}, "control_points: Input should be a valid list"),
    ],
)
def test_each_kind_of_damage_is_named(content, change, words):
    assert words in refusal({**content, **change})


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null", '"x"', "[" * 100_000])
def test_what_is_no_marker_is_refused(text):
    refusal(text)


@given(st.data())
def test_a_cut_off_file_is_refused_wherever_it_ends(pentagon, data):
    text = to_json(pentagon).decode().rstrip()
    refusal(text[: data.draw(st.integers(0, len(text) - 1))])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(st.data())
def test_a_damaged_value_anywhere_is_one_line_or_harmless(pentagon, data):
    content = json.loads(to_json(pentagon))
    place = content
    while True:
        key = data.draw(st.sampled_from(range(len(place)) if isinstance(place, list) else sorted(place)))
        if not isinstance(place[key], (dict, list)) or not place[key] or data.draw(st.booleans()):
            break
        place = place[key]
    place[key] = data.draw(JSON)
    message = ""
    try:
        from_json(json.dumps(content))
    except InputError as error:
        message = str(error)
    assert "\n" not in message


def test_unreadable_files_are_one_line(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_marker(tmp_path / "none.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        read_marker(tmp_path / "binary.json")
    with pytest.raises(InputError, match="directory"):
        read_marker(tmp_path)
