"""Every template is ready to use: designed, validated and exported as it is shipped."""

import json
from pathlib import Path

import pytest

import markergen as mg
from markergen.api.shipped import overview
from markergen.cli import main
from markergen.model.rig import planned_print
from markergen.read.templates import read_template, shipped_templates

FOUND = {template.name: template for template in overview().templates}
QUICK = "desk-a4"
PAGE = (Path(__file__).parents[2] / "docs" / "templates.md").read_text()


def designed(name):
    return mg.rig(template=name) if FOUND[name].command == "rig" else mg.design(template=name)


@pytest.mark.parametrize(
    "name", [each if each == QUICK else pytest.param(each, marks=pytest.mark.long) for each in FOUND]
)
def test_it_is_designed_found_and_exported(name, tmp_path):
    made = designed(name)
    # What a template warns of, its user would have to mend.
    accepted = ("weak for", "pixel", "print error") if name in ("robot-flange", "drone-pad") else ()
    assert not [warning for warning in made.warnings if not any(phrase in warning for phrase in accepted)]
    target = made.rig if FOUND[name].command == "rig" else made.marker
    views = 3 if name == QUICK else 40
    seen = mg.validate(target, views=views, runs=1).results["views"]
    assert seen["wrong"] == 0
    assert seen["detected"] == views
    flat, solid = not getattr(target, "height", 0), name != "thermal"  # Light dots are not made as solids.
    process = {"process": values["process"]} if "process" in (values := read_template(name)) else {}
    one_page = flat and name not in ("landing-pad", "wall")
    # Of the quick one, other formats are verified by the tests of their exporters.
    for suffix in (".pdf",) * flat + ((".svg",) * one_page + (".step",) * solid) * (name != QUICK):
        path = tmp_path / f"made{suffix}"
        mg.export(target, path, **process)
        assert mg.verify(target, path).passed, suffix


def test_one_page_shows_them_all():
    for name, template in FOUND.items():
        assert f"## {name}" in PAGE
        assert template.title in PAGE
        assert f"--template {name}" in PAGE
        assert (Path(__file__).parents[2] / "docs" / "images" / "templates" / f"{name}.svg").exists() or (
            Path(__file__).parents[2] / "docs" / "images" / "templates" / f"{name}.png"
        ).exists()


def test_they_are_listed_with_sizes_for_people_and_programs(capsys):
    assert main(["templates", "--json", "-"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert [item["name"] for item in output] == list(shipped_templates())
    disk = next(item for item in output if item["name"] == "paper-disk")
    assert (disk["size"], disk["dots"], disk["camera"], disk["distances"]) == ([0.3, 0.3], 5, [640, 480], [0.6, 1.5])
    cube = next(item for item in output if item["name"] == "cube")
    assert (cube["command"], cube["size"], cube["dots"]) == ("rig", [0.08, 0.08, 0.08], 30)


def test_a_rig_and_a_plate_are_told_apart():
    with pytest.raises(mg.InputError, match="markergen rig --template cube"):
        mg.design(template="cube")
    with pytest.raises(mg.InputError, match="use markergen design --template desk-a4"):
        mg.rig(template="desk-a4")
    with pytest.raises(mg.InputError, match="a shape or a template"):
        mg.rig()


def test_what_is_given_replaces_what_the_template_says(tmp_path):
    (tmp_path / "two.toml").write_text(
        'title = "two"\nshape = "pair"\nplate = "90mm"\nn = 6\ntag = "aruco:DICT_4X4_50"\nrestarts = 1\n'
        'poses = "cone:distance=0.3..0.8m,tilt=0..60,count=30"\n'
    )
    made = mg.rig(template=str(tmp_path / "two.toml"), n=4)
    assert [len(marker.marker) for marker in made.rig.markers] == [4, 4]


@pytest.mark.parametrize(
    ("make", "text", "options", "phrase"),
    [
        (mg.design, 'radius = "abc"', {}, ["a valid spec in my.toml", "radius='abc'", "correct these places"]),
        (mg.design, 'paper = "A9"', {}, ["a known paper size in my.toml,"]),
        (mg.design, "n = 3", {"output": "marker.pdf"}, ["4 control points in my.toml, "]),
        (mg.design, 'objective = "poze"', {}, ["a known objective in my.toml, found 'poze'; did you mean 'pose'"]),
        (mg.design, 'aggregate = "men"', {}, ["a known aggregate in my.toml, found 'men'; did you mean 'mean'"]),
        (mg.design, 'coordinates = "hartley"', {}, ["coordinates that the objective knows in my.toml, "]),
        (mg.rig, 'shape = "cube"\nobjective = "poze"', {}, ["a known objective in my.toml, found 'poze'"]),
        (mg.design, "n = 6", {"n": 3}, ["4 control points in my.toml or the options, "]),
        (mg.rig, 'shape = "cube"\nedge = "x"', {}, ["a valid spec in my.toml", "edge='x'", "correct these places"]),
        (mg.rig, 'shape = "cube"\ntag = "x"', {"output": "rig.json"}, ["DICT_4X4_50 in my.toml, "]),
    ],
)
def test_an_error_in_a_template_names_its_file(make, text, options, phrase, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(text)
    with pytest.raises(mg.InputError) as refused:
        make(template="my.toml", **options)
    assert all(word in str(refused.value) for word in phrase)


def test_the_print_is_that_of_the_design():
    usual = {"n": 4, "radius": "60mm", "restarts": 1, "poses": "cone:count=4"}
    marker = mg.design(**usual, noise_model="image", print_sigma="0.5um").marker
    assert planned_print(marker) == 0.5e-6
    assert mg.validate(marker, views=0, runs=2).results["budget"]["print_sigma_mm"] == pytest.approx(5e-4)
    plain = mg.design(**usual).marker
    assert (planned_print(plain), planned_print(plain, marker)) == (1e-4, 1e-4)
