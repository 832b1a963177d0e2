"""Markers by hand: loading them, printing them, and refusing what nothing can use yet."""

import doctest
import io
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from sentences import sentence

from markergen.comparison.baselines import line_up
from markergen.detect import Detector
from markergen.detect.detector import detect
from markergen.errors import InputError
from markergen.exporters.saving import outputs_of
from markergen.model import camera, marker
from markergen.model.body_json import from_json, to_json
from markergen.model.boundary import Circle
from markergen.model.feature import Feature
from markergen.model.marker import (
    ControlPoint,
    Marker,
    MeasuredSize,
    check_supported,
    light_marker,
)
from markergen.model.rescale import MeasuredDot, Rulers, remeasure, rescale_body
from markergen.model.tag import FAMILIES, family_bits, family_size
from markergen.render import DEFAULT_OPTICS, render_view
from markergen.validation.validation import run_validation
from markergen.validation.views import SyntheticViews
from markergen.verification.check import verify

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize("module", [marker, camera], ids=lambda module: module.__name__)
def test_examples_run(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert not result.failed


def test_a_marker_is_loaded_from_whatever_holds_it(pentagon, tmp_path):
    data, path = to_json(pentagon), tmp_path / "m.json"
    path.write_bytes(data)
    content = json.loads(data)
    with path.open("rb") as binary, path.open(encoding="utf-8") as text:
        sources = [str(path), path, binary, text, io.BytesIO(data), io.StringIO("\ufeff" + data.decode()), content]
        assert [Marker.load(source) for source in sources] == [pentagon] * len(sources)
    # Nothing is shared with the dict.
    loaded = Marker.load(content)
    content["provenance"]["spec_hash"] = "changed"
    assert loaded == pentagon


class Unreadable(io.StringIO):
    def read(self, *_):
        raise io.UnsupportedOperation("not readable")


class Broken(io.RawIOBase):
    def read(self, *_):
        raise OSError(5, "Input/output error")


def closed():
    file = io.StringIO("{}")
    file.close()
    return file


@pytest.mark.parametrize(
    ("source", "phrase"),
    [
        (3, "expected a path, an open file or a dict of marker.json, found int 3; give"),
        (None, "found NoneType None"),
        ([{}], "found list [{}]"),
        (b"m.json", "found bytes b'm.json'"),
        (np.zeros(3), "found ndarray array([0., 0., 0.])"),
        (Marker, "found ABCMeta <class"),
        ("no/such.json", "a readable marker.json at no/such.json, found No such file"),
        ("a\0b", "embedded null byte"),
        ("x" * 5000, "at 'xxxxxxxxxxxx...xxxxxxxxxxxxx', found File name too long"),
        ("", "at '', found Is a directory"),
        (Unreadable(), "a readable marker.json at the open file, found not readable; open it for reading"),
        (closed(), "a readable marker.json at the open file, found I/O operation on closed file"),
        (Broken(), "a readable marker.json at the open file, found Input/output error"),
        (io.BytesIO(b"\xff\xfe"), "bytes that are not UTF-8 text"),
        (io.StringIO("{"), "complete JSON in the open file"),
        (io.StringIO(" " * 10_000_001), "at most 10 MB"),
        ({}, "another kind of file"),
        ({"format": object()}, "a marker of plain JSON values and finite numbers, found object <object"),
        ({"format": float("nan")}, "plain JSON values and finite numbers"),
        ({("a", "b"): 1}, "plain JSON values"),
    ],
)  # fmt: skip
def test_what_is_no_marker_is_one_line(source, phrase):
    with pytest.raises(InputError) as caught:
        Marker.load(source)
    message = str(caught.value)
    assert phrase in message
    assert "\n" not in message


def test_markers_may_be_kept_in_sets(pentagon, tmp_path):
    pentagon.save(tmp_path / "m.json")
    again = Marker.load(tmp_path / "m.json")
    assert len({Marker.load(tmp_path / "m.json"), again}) == 1
    assert {again: "kept"}[again] == "kept"


def test_a_dict_that_holds_itself_is_refused():
    endless = {"format": "markergen-marker"}
    endless["provenance"] = endless
    with pytest.raises(InputError, match="plain JSON values"):
        Marker.load(endless)


def test_numbers_of_numpy_are_written_as_any_others():
    points = tuple(
        ControlPoint(
            np.int64(i),
            np.float32(x),
            np.float64(0.01),
            np.float16(0),
            Feature(np.float32(0.015625), 0.0),
            tuple(np.array([1e-10, 0, 1e-10])),
            tuple(np.array([x, 0.01])),
            measured=MeasuredSize(np.float32(0.5)),
        )
        for i, x in enumerate([-0.0625, -0.03125, 0.03125, 0.0625])
    )
    made = Marker(points, Circle(np.float64(0.125)), np.float32(0.0), provenance={"seed": np.int32(3), "K": np.eye(2)})
    again = from_json(to_json(made).decode())
    assert again.control_points[0] == points[0]
    assert again.provenance == {"seed": 3, "K": [[1.0, 0.0], [0.0, 1.0]]}
    assert to_json(again) == to_json(made)


@pytest.mark.parametrize("value", [object(), {1, 2}, float("nan"), Path("x"), {(1, 2): 3}])
def test_what_json_has_not_is_refused(pentagon, value):
    with pytest.raises(InputError, match="plain JSON values"):
        to_json(replace(pentagon, provenance={"value": value}))


def test_markers_print_in_a_line(pentagon, make_marker):
    assert repr(pentagon) == sentence("marker", 5, ", dots of 36 mm, spec 1a2b3c4d")
    many = make_marker(np.random.default_rng(0).uniform(-0.1, 0.1, (200, 2)), 0.15, 0.0)
    assert repr(many) == sentence("marker", 200, ", bare points, spec 1a2b3c4d")
    assert len(repr(replace(many, provenance={"spec_hash": "x" * 10_000}))) < 200
    assert repr(Marker((), Circle(0.15), 0.0)) == sentence("marker", 0, "")
    assert "12 control points in" in str(Marker.load(DATA / "designed-v1.json"))


@pytest.mark.parametrize("name", ["designed-v1.json", "measured-v1.json"])
def test_notebooks_show_the_layout(name):
    printed = Marker.load(DATA / name)
    root = ElementTree.fromstring(printed._repr_html_())
    dots = [dot for dot in root.iter() if dot.tag.endswith("text")]
    assert [dot.text for dot in dots] == [str(point.id) for point in printed.control_points]
    left, top, width, height = map(float, root.get("viewBox").split())
    for dot, point in zip(dots, printed.control_points, strict=True):
        assert (float(dot.get("x")), float(dot.get("y"))) == pytest.approx((1e3 * point.x, -1e3 * point.y), abs=1e-3)
        assert left < 1e3 * point.x < left + width
        assert top < -1e3 * point.y < top + height


def test_notebooks_show_bare_points():
    ElementTree.fromstring(Marker((ControlPoint(0, 0.0, 0.0, 0.0, Feature(0.0)),), Circle(0.1), 0.0)._repr_html_())


def with_light(pentagon):
    """On no ground can dots of both kinds be seen."""
    return replace(pentagon, control_points=(*pentagon.control_points[:2], *light_marker(pentagon).control_points[2:]))


UNUSED = {"light dots": with_light}


@pytest.fixture(params=UNUSED)
def unused(request, pentagon):
    """A marker that can be written and read, and the words that refuse to use it."""
    made = UNUSED[request.param](pentagon)
    assert from_json(to_json(made).decode()) == made
    return made, request.param


def seen(made, setting):
    pose = setting.poses.rotation[0], setting.poses.translation[0]
    return render_view(made, setting.camera, *pose, DEFAULT_OPTICS, np.random.default_rng(0))


def test_what_cannot_be_used_yet_is_refused_at_every_door(unused, setting, tmp_path):
    made, phrase = unused
    path = tmp_path / "m.json"
    path.write_bytes(to_json(made))
    image = np.full((480, 640), 200, np.uint8)
    doors = {
        "to detect": [lambda: detect(image, made), lambda: Detector(path)],
        "to validate": [lambda: run_validation(SyntheticViews(made, setting.camera, setting.poses, 0), runs=0)],
        "to compare": [lambda: line_up([str(path)])],
        "to rescale": [lambda: rescale_body(made, Rulers(0.199, None))],
        "to measure dots of": [lambda: remeasure(made, (MeasuredDot(0, 0, 0), MeasuredDot(1, 1, 0)))],
        "for .svg": [lambda: outputs_of(made, [tmp_path / "m.svg"])],
        "for .csv": [lambda: outputs_of(made, [tmp_path / "m.json", tmp_path / "m.csv"])],
        "to verify a file against": [lambda: verify(made, tmp_path / "m.svg")],
        "to render": [lambda: seen(made, setting)],
    }
    for doing, calls in doors.items():
        for call in calls:
            with pytest.raises(InputError) as caught:
                call()
            assert f" {doing}, found " in str(caught.value)
            assert phrase in str(caught.value)
    outputs_of(made, [path])


def test_light_dots_are_refused_by_solids_alone(pentagon, tmp_path):
    light = light_marker(pentagon)
    assert light.light
    assert not pentagon.light
    assert from_json(to_json(light).decode()) == light
    path = tmp_path / "m.step"
    with pytest.raises(
        InputError,
        match=r"\.step, found light dots: 0, 1, 2, 3, 4;",
    ):
        outputs_of(light, [path])
    assert rescale_body(light, Rulers(0.199, None))[0].light


def test_what_is_known_passes_every_door(pentagon):
    check_supported(pentagon, "to detect")
    check_supported(replace(pentagon, extensions={"a": 1}, rulers=(0.2, 0.2)), "to detect")


def test_sizes_survive_a_correction_by_rulers(pentagon):
    dots = tuple(replace(point, measured=MeasuredSize(0.0361, 1e-5)) for point in pentagon.control_points)
    after, _ = rescale_body(
        replace(pentagon, control_points=dots, rulers=(0.2, None), extensions={"a": 1}), Rulers(0.198, None)
    )
    assert {point.measured for point in after.control_points} == {MeasuredSize(0.0361, 1e-5)}
    assert (after.rulers, after.extensions) == ((0.2, None), {"a": 1})


def test_rulers_are_those_that_were_printed(pentagon):
    printed = replace(pentagon, rulers=(0.1, 0.05))
    with pytest.raises(InputError, match="100 mm, found nominal_x=200 mm; give --nominal-x 100mm"):
        rescale_body(printed, Rulers(0.198, None, 0.2))
    with pytest.raises(InputError, match=r"about 100 mm .*found 198 mm.*--force"):
        rescale_body(printed, Rulers(0.198, None))
    for nominal in ((0.1, 0.05), (None, None)):
        after, message = rescale_body(printed, Rulers(0.099, 0.0495, *nominal))
        assert after.print_scale == pytest.approx((0.99, 0.99))
        assert not any("taken for" in item for item in message)


def test_bad_sizes_and_polarities_are_refused():
    for size in [(0.0,), (float("nan"),), (0.01, -1e-6), (0.01, float("inf"))]:
        with pytest.raises(InputError, match="measured diameter"):
            MeasuredSize(*size)
    with pytest.raises(InputError, match="dark or light"):
        Feature(0.01, polarity="grey")


def test_families_of_tags_are_opencvs():
    import cv2

    for family, name in FAMILIES.items():
        theirs = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        assert (family_bits(family), family_size(family)) == (theirs.markerSize, len(theirs.bytesList))
