"""marker.json version 2, and that version 1 stays what it was."""

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
from markergen.guard import KINDS
from markergen.model.body_json import from_json, load_rig, read_marker, rig_to_json, to_json
from markergen.model.feature import Feature
from markergen.model.marker import JointCovariance, MeasuredSize
from markergen.model.marker_file import SINCE, VERSIONS, checked_file
from markergen.model.rig import Rig

DATA = Path(__file__).parent / "data"
OLD = ["designed-v1.json", "measured-v1.json"]
"""As the last version that knew version 1 alone wrote them, by design and by rescale."""
FULL = "full-v2.json"
"""Two sides of a cube, with every key of version 2."""


@pytest.fixture
def full():
    return json.loads((DATA / FULL).read_text())


def refusal(content) -> str:
    with pytest.raises(InputError) as caught:
        from_json(json.dumps(content))
    message = str(caught.value)
    assert "\n" not in message
    return message


def at(content, path):
    for step in path:
        content = content[step]
    return content


@pytest.mark.parametrize("name", OLD)
def test_files_are_saved_again_byte_for_byte(name):
    data = (DATA / name).read_bytes()
    assert to_json(read_marker(DATA / name)) == data


@pytest.mark.parametrize(("name", "version"), [*[(name, 1) for name in OLD], (FULL, 2)])
def test_files_keep_to_the_schema_of_their_version(name, version):
    content = json.loads((DATA / name).read_bytes())
    assert content["version"] == version
    for item in VERSIONS:
        schema = json_schema(item)
        jsonschema.Draft202012Validator.check_schema(schema)
        valid = jsonschema.Draft202012Validator(schema).is_valid({**content, "version": item})
        # What is valid as version 1 is valid as version 2.
        assert valid == (item >= version)


def test_every_key_of_version_2_is_in_the_file_and_in_no_schema_of_version_1(full):
    def keys(schema):
        forms = [schema, *schema["$defs"].values()]
        return {(form["title"], key): value for form in forms for key, value in form.get("properties", {}).items()}

    new = {key for (_, key), value in keys(json_schema(2)).items() if value.get(SINCE) == 2}
    assert new >= {"polarity", "measured", "designed_z", "joint_covariance", "rulers", "plates", "extensions"}
    text = json.dumps(full)
    assert [key for key in new if f'"{key}"' not in text] == []
    assert {key for _, key in keys(json_schema(1))}.isdisjoint(new)


def test_a_file_with_plates_opens_as_a_rig_with_everything_in_it(full):
    rig = Rig.load(DATA / FULL)
    assert load_rig(rig_content := json.loads(rig_to_json(rig))) == rig
    assert rig_content["format"] == "markergen-rig"
    whole = checked_file(full, FULL).build()
    front, right = (plate.marker for plate in rig.plates)
    assert [point.feature.polarity for point in whole.control_points] == ["dark"] * 4 + ["light"] * 4
    assert [plate.name for plate in rig.plates] == [plate["name"] for plate in full["plates"]]
    points = [point for plate in rig.plates for point in plate.marker.control_points]
    assert {point.id: (point.feature, point.measured) for point in points} == {
        point.id: (point.feature, point.measured) for point in whole.control_points
    }
    xyz = dict(zip((point.id for point in whole.control_points), whole.xyz, strict=True))
    np.testing.assert_allclose(rig.xyz, [xyz[point.id] for point in points], atol=1e-15)
    assert front.tag.id == 3
    assert front.rulers == right.rulers == (0.05, None)
    assert rig.extensions == {"org.example.line": {"lot": 7, "passed": True, "notes": [None, "µ"]}}
    # Its face looks along x of the marker; three dots are on it, one is raised by 4 mm.
    np.testing.assert_allclose(right.as_designed.xyz[:, 2], [0, 0, 0, 0.004], atol=1e-12)


def test_what_was_measured_of_one_plate_is_turned_into_its_frame(full):
    rig, whole = Rig.load(DATA / FULL), checked_file(full, FULL).build()
    order = {number: k for k, number in enumerate(whole.joint_covariance.order)}
    matrix = whole.joint_covariance.array.reshape(len(order), 3, len(order), 3)
    for plate in rig.plates:
        joint = plate.marker.joint_covariance
        rows = [order[number] for number in joint.order]
        rotated = np.einsum(
            "ia,majb->mijb", plate.rotation_matrix, joint.array.reshape(len(rows), 3, len(rows), 3)[:, :, :, :]
        )
        rotated = np.einsum("mijb,cb->mijc", rotated, plate.rotation_matrix)
        np.testing.assert_allclose(rotated, matrix[np.ix_(rows, range(3), rows, range(3))], atol=1e-20)


def test_a_file_with_plates_is_refused_where_a_marker_is_asked_for():
    with pytest.raises(InputError, match="on one plate"):
        read_marker(DATA / FULL)


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("extensions", {"org.example": 1}),
        ("rulers", (0.1, 0.2)),
        ("joint_covariance", JointCovariance((3, 1), "xy", tuple(map(tuple, np.diag([1e-9, 2e-9, 0.0, 1e-9]))))),
    ],
)
def test_version_2_is_written_only_where_it_is_needed(pentagon, change, value):
    assert json.loads(to_json(pentagon))["version"] == 1
    changed = replace(pentagon, **{change: value})
    data = to_json(changed)
    assert json.loads(data)["version"] == 2
    assert from_json(data.decode()) == changed
    # What says 2 and needs nothing of it is read, and becomes version 1 again.
    assert to_json(from_json(to_json(pentagon).decode().replace('"version": 1', '"version": 2'))) == to_json(pentagon)


@pytest.mark.parametrize("change", [{"measured": MeasuredSize(0.0361)}, {"designed_z": 0.001},
                                    {"feature": Feature(0.036, polarity="light")}])  # fmt: skip
def test_one_dot_is_enough_to_need_version_2(pentagon, change):
    dots = (*pentagon.control_points[:-1], replace(pentagon.control_points[-1], **change))
    changed = replace(pentagon, control_points=dots)
    data = to_json(changed)
    assert json.loads(data)["version"] == 2
    assert from_json(data.decode()) == changed


def test_keys_of_version_2_are_refused_in_version_1(full):
    message = refusal({**full, "version": 1})
    for phrase in (
        "joint_covariance: a key of version 2, in a file that says version 1",
        "control_points[4].feature.polarity: a key of version 2",
        "control_points[0].measured: a key of version 2",
        "plates: a key of version 2",
    ):
        assert phrase in message


def test_a_newer_file_says_by_what_it_was_written(full):
    full["version"] = 3
    assert "version 1 or 2 in marker.json, " + sentence("newer version", "") in refusal(full)
    full["provenance"]["versions"] = {"markergen": "7.1.0"}
    assert sentence("newer version", " (7.1.0)") in refusal(full)
    full["provenance"]["versions"] = {"markergen": "9" * 1000}
    assert len(refusal(full)) < 300
    assert "found version 0; design" in refusal({**full, "version": 0})


@pytest.mark.parametrize(
    ("path", "key", "phrase"),
    [
        ((), "ruler", "ruler: unknown key, did you mean 'rulers'? (got 1)"),
        (("control_points", 2, "feature"), "polarty", ".feature.polarty: unknown key, did you mean 'polarity'?"),
        (("control_points", 2), "mesured", "control_points[2].mesured: unknown key, did you mean 'measured'?"),
        (("boundary",), "radiuss", "boundary.radiuss: unknown key, did you mean 'radius'?"),
        (("plates", 0, "boundary"), "radius", "plates[0].boundary.radius: unknown key (got 1)"),
        (("plates", 1, "pose"), "rotatoin", "plates[1].pose.rotatoin: unknown key, did you mean 'rotation'?"),
        (("joint_covariance",), "zzz", "joint_covariance.zzz: unknown key (got 1)"),
    ],
)
def test_unknown_keys_are_told_with_the_nearest_known_one(full, path, key, phrase):
    at(full, path)[key] = 1
    assert phrase in refusal(full)


def test_a_file_of_version_1_is_not_led_to_keys_of_version_2(full):
    content = json.loads((DATA / OLD[0]).read_text())
    assert "ruler: unknown key" in refusal({**content, "ruler": 1})


@pytest.mark.parametrize(
    ("path", "value", "phrase"),
    [
        (("joint_covariance", "order"), [0, 1, 2, 3, 4, 4], "joint_covariance: expected ids of control points, each"),
        (("joint_covariance", "order"), [0, 1, 2, 3, 4, 9], "joint_covariance.order[5]: no control point has the id 9"),
        (("joint_covariance", "order"), [0, 1], "expected 6 x 6 numbers for 2 control points along xyz, found 18 rows"),
        (("joint_covariance", "axes"), "xy", "expected 12 x 12 numbers for 6 control points along xy"),
        (("joint_covariance", "axes"), "yx", "joint_covariance.axes: Input should be 'xy' or 'xyz'"),
        (("joint_covariance", "matrix", 3), [0.0], "found 18 rows of 1 or 18"),
        (("joint_covariance", "matrix", 0, 1), 1e-9, "expected a symmetric covariance"),
        (("joint_covariance", "matrix", 0, 1), 1.0, "expected a covariance, found one that exceeds its variances"),
        (("joint_covariance", "matrix", 2, 2), -1e-9, "expected variances of 0 or more, found -1e-09 m^2"),
        (("joint_covariance", "matrix", 2, 2), "x", "joint_covariance.matrix[2][2]: Input should be a valid number"),
        (("control_points", 3, "covariance"), [1e-9, 0, 1e-9], "control_points[3].covariance: joint_covariance stands"),
        (("control_points", 3, "measured"), {"diameter": 0}, "control_points[3].measured.diameter: Input should be gr"),
        (("control_points", 3, "measured"), {}, "control_points[3].measured.diameter: missing"),
        (("control_points", 3, "feature", "polarity"), "grey", ".polarity: Input should be 'dark' or 'light'"),
        (("rulers", "x"), 0, "rulers.x: Input should be greater than 0"),
        (("extensions",), [], "extensions: should be a table of values"),
        (("plates", 0, "name"), "right", "plates[1].name: 'right' is used twice"),
        (("plates", 0, "pose", "rotation", 0, 0), -1.0, "plates[0]: expected a pose with a rotation"),
        (("plates", 0, "pose", "rotation", 0, 0), 1.00001, "plates[0]: expected a pose with a rotation"),
        (("plates", 0, "pose", "rotation", 0, 0), 1e200, "plates[0]: expected a pose with a rotation"),
        (("plates", 0, "pose", "translation"), [0, 0], "plates[0].pose.translation: List should have at least 3"),
        (("plates", 0, "control_points"), [0, 1, 2], "control_points[3]: on none of the plates"),
        (("plates", 0, "control_points"), [0, 1, 2, 3, 4], "plates[1].control_points[0]: 4 is on a plate already"),
        (("plates", 0, "control_points"), [0, 1, 2, 3, 8], "plates[0].control_points[4]: no control point has"),
        (("plates", 0, "boundary", "outlines", 0, 0), [-0.03, -0.03], "over the boundary of plates[0]"),
        (("plates", 0, "keep_outs", 0, "radius"), 0.05, "over keep_outs[0] of plates[0]"),
        (("plates", 0, "tag", "side"), 0.03, "plates[0].tag.corners: not those of an upright square"),
        (("plates", 0, "tag", "id"), 587, "plates[0].tag.id: expected an id of 0 to 586"),
        (("control_points", 0, "designed"), [0.0, 0.0], "control_points[0]: stands"),
        (("tag",), "PLATE", "tag: of a marker on one plate"),
        (("keep_outs",), [{"kind": "circle", "radius": 0.001}], "keep_outs: of a marker on one plate"),
        (("print_correction",), {"scale_x": 1.0, "scale_y": 0.99}, "print_correction: of a marker on one plate"),
        (("substrate", "holes"), [{"x": 0, "y": 0, "diameter": 0.003}], "substrate.holes: of a marker on one plate"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_version_2_is_told_with_its_path(full, path, value, phrase):
    place = at(full, path[:-1])
    place[path[-1]] = full["plates"][0]["tag"] if value == "PLATE" else value
    assert phrase in refusal(full)


def test_an_indefinite_covariance_is_refused():
    # Each pair is a covariance, the three together are none.
    weights = np.array([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]])
    with pytest.raises(InputError, match="positive semidefinite"):
        JointCovariance((0, 1), "xy", np.block([[weights, np.zeros((3, 1))], [np.zeros((1, 3)), 1.0]]) * 1e-10)
    # One without a frame has directions of no variance at all, up to rounding.
    drawn = np.random.default_rng(0).normal(size=(300, 250)) * 1e-5
    JointCovariance(tuple(range(100)), "xyz", drawn @ drawn.T)


def test_dots_of_different_plates_may_be_near_each_other(full):
    # The same two places in the marker frame's x and y, on plates that look elsewhere.
    xy = {point["id"]: (point["x"], point["y"]) for point in full["control_points"]}
    assert min(np.hypot(*np.subtract(xy[a], xy[b])) for a in range(4) for b in range(4, 8)) < 0.02
    assert len(load_rig(full)) == 8


COORDINATES = st.floats(-0.04, 0.04).map(lambda value: round(value, 6))
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**6), 10**6) | st.floats(-1e6, 1e6) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
SIZES = st.builds(MeasuredSize, st.floats(1e-6, 1.0), st.none() | st.floats(0, 1.0))


@st.composite
def markers(draw, base):
    """Markers with any of the attributes of version 2, also none."""
    light = st.sampled_from(["dark", "light"])
    points = tuple(
        replace(
            point,
            feature=replace(point.feature, polarity=draw(light)),
            measured=draw(st.none() | SIZES),
            designed_z=draw(st.none() | st.floats(-0.01, 0.01)),
        )
        for point in base.control_points
    )
    joint = None
    if draw(st.booleans()):
        axes, count = draw(st.sampled_from(["xy", "xyz"])), draw(st.integers(1, len(points)))
        half = np.random.default_rng(draw(st.integers(0, 99))).normal(size=(len(axes) * count, 3)) * 1e-5
        joint = JointCovariance(tuple(range(count)), axes, half @ half.T)
    ruler = st.none() | st.floats(1e-3, 1.0)
    return replace(
        base,
        control_points=points,
        joint_covariance=joint,
        rulers=draw(st.none() | st.tuples(ruler, ruler)),
        extensions=draw(st.dictionaries(st.text(max_size=5), JSON, max_size=2)),
    )


@given(st.data())
def test_a_damaged_value_anywhere_is_one_line_or_harmless(pentagon, data):
    content = json.loads(data.draw(st.sampled_from([(DATA / FULL).read_text(), to_json(pentagon)])))
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


@pytest.mark.parametrize("key", ["control_points", "plates", "joint_covariance", "extensions"])
def test_endless_nesting_is_one_line(full, key):
    nested = []
    for _ in range(800):
        nested = [nested]
    assert f"{key}" in refusal({**full, key: nested})


@given(st.data())
def test_whatever_a_marker_has_comes_back(pentagon, data):
    marker = data.draw(markers(pentagon))
    text = to_json(marker)
    again = from_json(text.decode())
    assert again == marker
    assert to_json(again) == text
    jsonschema.Draft202012Validator(json_schema(json.loads(text)["version"])).validate(json.loads(text))


def test_the_matrix_of_200_dots_in_space_can_be_read_again(make_marker):
    half = np.random.default_rng(0).normal(size=(600, 700)) * 1e-5
    joint = JointCovariance(tuple(range(200)), "xyz", half @ half.T)
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 20), np.linspace(-0.1, 0.1, 10))
    marker = replace(make_marker(np.stack([x.ravel(), y.ravel()], axis=-1), 0.15, 0.005), joint_covariance=joint)
    data = to_json(marker)
    assert len(data) < KINDS["marker"].largest
    assert from_json(data.decode()).joint_covariance == joint


def test_a_matrix_elsewhere_is_left_alone(pentagon):
    covariance = JointCovariance((0, 1), "xy", np.eye(4) * 1e-9)
    marker = replace(pentagon, joint_covariance=covariance, provenance={"matrix": None, "note": '\n    "matrix": null'})
    assert from_json(to_json(marker).decode()) == marker


@pytest.mark.parametrize("key", ["clearance", "diameter"])
@pytest.mark.parametrize("length", [1e-9, 1e4, 1e300])
def test_sizes_are_from_1_um_to_1_km(pentagon, key, length):
    values = json.loads(to_json(pentagon))
    (values if key == "clearance" else values["control_points"][1]["feature"])[key] = length
    with pytest.raises(InputError, match=key):
        from_json(json.dumps(values).encode())
