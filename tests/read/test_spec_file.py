import pytest

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.spec import Spec
from markergen.read.spec_file import read_template, spec_from_mapping, templates


def test_templates_are_ready_to_use():
    assert set(templates()) == {"desk-a4", "paper-disk"}
    for name in templates():
        values = read_template(name)
        assert values["title"]
        spec = spec_from_mapping(values, name)
        assert spec.n >= 4


def test_the_papers_template_is_the_default():
    assert spec_from_mapping(read_template("paper-disk")) == Spec()


def test_what_a_marker_carries_gives_its_spec_back():
    spec = Spec(n=7, boundary=Circle(0.2), dot=0.02, objective="condition", coordinates="metric", poses="paper-roll")
    assert spec_from_mapping(spec.as_dict()) == spec


def test_lengths_may_carry_units():
    spec = spec_from_mapping({"radius": "80mm", "dot": "1in", "clearance": 0.002})
    assert (spec.boundary.radius, spec.dot, spec.clearance) == (0.08, 0.0254, 0.002)
    assert spec.camera == PAPER_CAMERA


def test_all_errors_are_listed_with_their_paths():
    with pytest.raises(InputError) as caught:
        spec_from_mapping({"n": "many", "radius": "wide", "camera": {"width": 640}, "color": "red"}, "my.toml")
    for words in ("my.toml", "n: ", "radius: ", "camera.height: ", "color: "):
        assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_templates_from_files(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('n = 6\nradius = "60mm"\n')
    assert spec_from_mapping(read_template(str(path))).boundary.radius == 0.06
    path.write_text("n = = 6")
    with pytest.raises(InputError, match="TOML"):
        read_template(str(path))
    path.write_bytes(b"\xff")
    with pytest.raises(InputError, match="UTF-8"):
        read_template(str(path))
    with pytest.raises(InputError, match="No such file"):
        read_template(str(tmp_path / "none.toml"))
    with pytest.raises(InputError, match="known: desk-a4, paper-disk"):
        read_template("desk")
