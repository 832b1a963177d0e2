import jsonschema
import pytest

from markergen.errors import InputError
from markergen.options import OUTSIDE_FILES, DesignKeywords, declared
from markergen.read.spec_file import spec_from_mapping
from markergen.read.spec_schema import spec_schema
from markergen.read.templates import read_template, templates

CAMERA = {"width": 640, "height": 480, "fx": 800.0, "fy": 800.0, "cx": 320.0, "cy": 240.0}
SCHEMA = spec_schema()


def fits(values):
    return jsonschema.Draft202012Validator(SCHEMA).is_valid(values)


def test_it_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", templates())
def test_the_templates_fit(name):
    assert fits(read_template(name))


def test_every_option_that_a_file_has_is_described():
    described = {name: table["description"] for name, table in SCHEMA["properties"].items() if "description" in table}
    for name, option in declared(DesignKeywords).items():
        assert (name in described) == (name not in OUTSIDE_FILES)
        assert name in OUTSIDE_FILES or option.help in described[name]


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"n": 6, "radius": "80mm", "camera": CAMERA, "keep_outs": ["circle:3mm"], "mount": "4xM3@120mm"},
        {"boundary": {"kind": "circle", "radius": "80mm"}, "clearance": 0.001, "survive": 1, "paper": "A4"},
        {"substrate": {"thickness": "4mm", "holes": [{"x": 0.05, "y": "0mm", "diameter": "3mm"}]}},
        {"image_noise": {"blur_px": 1.0}, "noise_model": "image", "dot": "auto", "title": "t", "tile": False},
    ],
)
def test_what_the_reader_takes_fits(values):
    spec_from_mapping(values)
    assert fits(values)


@pytest.mark.parametrize(
    "values",
    [
        {"dots": 6}, {"n": 6.5}, {"n": "6"}, {"radius": [1]}, {"camera": {**CAMERA, "f": 1.0}}, {"tile": "no"},
        {"substrate": {"color": "white"}}, {"keep_outs": [3]}, {"image_noise": {"blur": 1.0}}, {"output": "m.pdf"},
    ],
)  # fmt: skip
def test_what_the_reader_refuses_for_its_form_does_not_fit(values):
    with pytest.raises(InputError):
        spec_from_mapping(values)
    assert not fits(values)
