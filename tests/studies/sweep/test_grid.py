import re

import pytest

from markergen.errors import InputError
from markergen.model.camera import PAPER_CAMERA
from markergen.read.templates import template_text
from markergen.studies.sweep.grid import named_camera, read_sweep, studies, sweep_from_mapping

GRID = {"n": [4, 5], "layout": ["designed", "ngon"]}


def refusal(values):
    with pytest.raises(InputError) as caught:
        sweep_from_mapping(values)
    return caught.value.args[1]


def test_every_combination_is_a_point_and_the_last_axis_changes_fastest():
    sweep = sweep_from_mapping({"radius": "100mm", "grid": GRID, "study": {"noise": 0.5, "runs": 7}})
    assert [(point.spec.n, point.layout) for point in sweep.points] == [
        (4, "designed"), (4, "ngon"), (5, "designed"), (5, "ngon"),
    ]  # fmt: skip
    assert {point.noise_px for point in sweep.points} == {0.5}
    assert {point.spec.boundary.radius for point in sweep.points} == {0.1}
    assert sweep.runs == 7


def test_axes_are_any_keys_of_a_design_and_values_are_read_as_they_are():
    sweep = sweep_from_mapping(
        {
            "n": 6,
            "grid": {
                "boundary": ["circle:100mm", "rect:200mmx100mm", {"kind": "circle", "radius": "80mm"}],
                "camera": ["paper", "paper@2"],
                "dot": ["10mm", 0.02, 0],
            },
        }
    )
    assert len(sweep.points) == 18
    assert [point.spec.dot for point in sweep.points[:3]] == [0.01, 0.02, 0.0]
    assert sweep.points[3].spec.camera.width == 1280
    assert sweep.points[-1].spec.boundary.radius == 0.08
    assert sweep.points[0].axes == {"boundary": "circle:100mm", "camera": "paper", "dot": "10mm"}


def test_the_scale_of_a_camera_keeps_its_view():
    double = named_camera("paper@2")
    assert (double.width, double.height, double.fx) == (1280, 960, 1600)
    # The left edge of the image is half a pixel before the center of the first one.
    assert (double.cx + 0.5) / double.width == (PAPER_CAMERA.cx + 0.5) / PAPER_CAMERA.width
    assert named_camera("paper") == PAPER_CAMERA
    with pytest.raises(InputError, match="a scale above 0"):
        named_camera("paper@0")


def test_drawings_calibrations_and_poses_come_from_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "camera.toml").write_text("")
    (tmp_path / "plate.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="100mm" viewBox="0 0 200 100">'
        '<rect width="200" height="100"/></svg>'
    )
    (tmp_path / "poses.txt").write_text("0 0 0 0.8 1 0 0 0\n1 0 0 0.9 1 0 0 0\n")
    sweep = sweep_from_mapping({"grid": {"boundary": ["plate.svg"], "n": [4]}})
    assert sweep.points[0].spec.boundary.radius == pytest.approx(0.1118, abs=1e-4)
    phrase = refusal({"grid": {"boundary": ["plate.svg", "none.svg"], "camera": ["camera.toml"]}})
    assert "grid.boundary: expected" in phrase
    assert "grid.camera: expected" in phrase


def test_the_seed_may_stand_in_either_place_but_in_one():
    for values in ({"seed": 3}, {"study": {"seed": 3}}):
        assert sweep_from_mapping({**values, "grid": {"n": [4]}}).points[0].spec.seed == 3
    assert "seed: given twice" in refusal({"seed": 3, "study": {"seed": 3}, "grid": {"n": [4]}})


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({}, "grid: missing"),
        ({"grid": {}}, "grid: missing"),
        ({"grid": 3}, "grid: missing"),
        ({"study": 3, "grid": GRID}, "study: not a table (got 3)"),
        ({"grid": {"n": 4}}, "grid.n: not a list of values (got 4)"),
        ({"grid": {"n": []}}, "grid.n: not a list of values (got [])"),
        ({"grid": {"n": [4, 5, 4]}}, "grid.n: 4 twice"),
        ({"grid": {"m": [4]}}, "grid.m: unknown key (known: noise, layout, options of a spec, as in markergen design"),
        ({"grid": {"ojective": [4]}}, "grid.ojective: unknown key (did you mean 'objective'? Known: noise, layout, "),
        ({"m": 1, "grid": GRID}, "m: unknown key (got 1)"),
        ({"study": {"trials": 1}, "grid": GRID}, "study.trials: unknown key (known: name, seed, runs"),
        ({"study": {"run": 1}, "grid": GRID}, "study.run: unknown key (did you mean 'runs'? Known: name, seed, runs"),
        ({"study": {"runs": 2.5}, "grid": GRID}, "study.runs: a whole number from 0 to 2000 (got 2.5)"),
        ({"study": {"runs": True}, "grid": GRID}, "study.runs: a whole number"),
        ({"study": {"estimators": ["lm", "best"]}, "grid": GRID}, "study.estimators: a list of dlt"),
        ({"study": {"name": "two\nlines"}, "grid": GRID}, "study.name: a line of text"),
        ({"grid": {"noise": [0.2, -1, "much"]}}, "grid.noise: a number of px above 0, at most 1000 (got -1)"),
        ({"grid": {"layout": ["best"]}}, "grid.layout: one of designed, ngon, square, random (got 'best')"),
        ({"grid": {"radius": ["far"]}}, "grid.radius: write a number"),
        ({"n": 4, "grid": {"n": [4, 5]}}, "grid.n: given outside the grid, too"),
        ({"study": {"noise": 1}, "grid": {"noise": [1, 2]}}, "grid.noise: given outside the grid, too"),
        ({"radius": 0.1, "grid": {"boundary": ["circle:0.1"]}}, "grid.boundary: either radius or boundary"),
        ({"grid": {"boundary": ["circle:0.1"], "radius": [0.2]}}, "either radius or [boundary]"),
        ({"grid": {"n": [3, 4]}}, "n=3: expected at least 4 control points, found n=3"),
        ({"grid": {"objective": ["beauty"]}}, "expected a known objective, found 'beauty'"),
        ({"grid": {"aggregate": ["worst"]}}, "aggregate=worst: expected"),
        ({"poses": "nowhere", "grid": GRID}, "expected a known pose distribution, found 'nowhere'"),
        ({"relief": "20mm", "grid": GRID}, "expected layout='designed' for relief, found layout='ngon'"),
        ({"grid": {"relief": [0, 0.02], "objective": ["pose", "condition"]}}, "relief=0.02 objective=condition:"),
        ({"relief": 0.02, "study": {"estimators": ["dlt"]}, "grid": {"n": [6]}}, "estimators that support relief"),
        ({"grid": {"radius": ["150mm", "9m"]}}, "radius=9m: expected a pose that sees the whole marker"),
        ({"dot": "30mm", "grid": {"n": [4, 150]}}, "n=150: expected 150 dots that fit"),
        ({"grid": {"n": [4, "auto"]}, "dot": "20mm"}, "expected numbers of dots, all of one size, found n='auto'"),
        ({"shape": "cube", "grid": GRID}, "shape: a study compares layouts of one marker"),
        ({"grid": {"shape": ["cube"]}}, "grid.shape: a study compares layouts of one marker"),
        ({"grid": {"seed": list(range(101)), "n": list(range(4, 104))}}, "grid: 10100 combinations, at most 10000"),
    ],
)  # fmt: skip
def test_what_cannot_be_run_is_told(values, phrase):
    assert phrase in refusal(values)


def test_everything_that_is_wrong_is_told_at_once():
    phrase = refusal(
        {
            "shiny": True,
            "study": {"colour": "red", "runs": -1},
            "grid": {"n": [3, 4, "many"], "flavor": [1], "radius": ["150mm", "9m"]},
        }
    )
    for finding in (
        "shiny: unknown key", "study.colour: unknown key", "study.runs: a whole number", "grid.n: Input should be",
        "grid.flavor: unknown key", "n=3 radius=150mm and n=3 radius=9m: expected at least 4",
        "n=4 radius=9m: expected a pose that sees",
    ):  # fmt: skip
        assert finding in phrase
    assert len(re.findall(";", phrase)) == 6


def test_shipped_studies_are_ready_to_run():
    assert set(studies()) == {"layouts"}
    for name, path in studies().items():
        sweep = read_sweep(name)
        assert sweep.points
        # The command that the file gives is the one that runs it.
        assert f"markergen study {name} -o" in template_text(str(path))


def test_runs_may_be_given_beside_the_file():
    assert read_sweep("layouts").runs == 20
    assert read_sweep("layouts", runs=3).runs == 3
    with pytest.raises(InputError, match="runs"):
        read_sweep("layouts", runs=-3)


@pytest.mark.parametrize("name", ["none", "none.toml"])
def test_a_study_that_is_not_there_is_told(name):
    with pytest.raises(InputError):
        read_sweep(name)


def test_what_is_computed_makes_the_identity():
    def identity(**values):
        return sweep_from_mapping({"grid": GRID, **values}).identity

    assert identity() == identity()
    different = [identity(), identity(dot="20mm"), identity(study={"runs": 1}), identity(study={"estimators": ["lm"]})]
    assert len({str(item) for item in different}) == 4


def test_a_drawing_as_boundary(tmp_path):
    shape = '<path d="M0,0 h200 v100 h-200 z"/><path d="M9,9 L50,60 L70,20" fill="none" stroke="#000"/>'
    drawing = tmp_path / "open.svg"
    drawing.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 100">{shape}</svg>')
    values = {"boundary": str(drawing), "boundary_unit": "mm", "dot": "12mm", "grid": {"n": [5, 6]}}
    with pytest.raises(InputError, match="open"):
        sweep_from_mapping(values)
    sweep = sweep_from_mapping({**values, "ignore_open": True})
    assert sweep.points[0].spec.boundary.area == pytest.approx(0.02)
    with pytest.raises(InputError, match="ignore_open: without a drawing"):
        sweep_from_mapping({"radius": "5cm", "ignore_open": True, "grid": {"n": [5, 6]}})


def test_an_error_in_a_study_names_its_file(tmp_path):
    (tmp_path / "sweep.toml").write_text('objective = "poze"\n[grid]\nn = [4]\n')
    with pytest.raises(
        InputError, match=r"a study that can be run in .*sweep\.toml, found n=4: .*objective, found 'poze'"
    ):
        read_sweep(str(tmp_path / "sweep.toml"))
