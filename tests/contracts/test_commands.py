"""What every command promises: with --json, programs can read its results; with --quiet, it says nothing else."""

import json
import shutil

import cv2
import numpy as np
import pytest
import typer

import markergen as mg
from markergen.cli import main
from markergen.cli.commands import app
from markergen.comparison import compare
from markergen.maths.rotation import exponential
from markergen.model.camera import Camera
from markergen.render import Optics, render_view

FEW = "cone:distance=0.4..0.6m,tilt=0..40,count=6"
COMMANDS = {
    "calibrate": "m.json photos --camera camera.yaml -o back.json",
    "compare": "m.json square --views 1 --workers 1 --poses cone:distance=1.3..1.5m,count=6",
    "design": f"--n 4 --radius 60mm --dot 20mm --restarts 1 --poses {FEW} -o new.pdf",
    "detect": "photos --marker m.json --overlay seen",
    "doctor": "",
    "export": "m.json -o m.dxf",
    "handeye": "m.json photos --robot poses.json --robot-frame flange-in-base --robot-unit m --camera camera.yaml",
    "inspect": "camera.yaml --plot camera.svg",
    "rescale": "m.json --measured-x 198mm --measured-y 198mm -o smaller.json",
    "rig": f"pair --plate 100mm --n 4 --tag aruco:DICT_4X4_50 --restarts 1 --poses {FEW} -o pair.json",
    "study": "sweep.toml -o swept --runs 0 --workers 1",
    "templates": "",
    "validate": "m.json --runs 2 --views 0",
    "verify": "m.json m.pdf",
}
"""Words of each command that has results."""

KEYS = {
    "calibrate": {"camera", "rms_px"},
    "compare": {"contestants", "views"},
    "detect": {"image", "markers"},
    "design": {"value", "lower_bound", "dots", "criteria", "warnings", "files"},
    "doctor": {"name", "state"},
    "export": {"path", "notes"},
    "handeye": {"T_flange_camera", "T_base_marker", "scale", "covariance"},
    "inspect": {"camera", "unused", "warnings", "files"},
    "rescale": {"print_scale", "notes", "files"},
    "rig": {"plates", "expected", "in_view", "warnings", "files"},
    "study": {"rows", "files"},
    "templates": {"name", "dots"},
    "validate": {"headline", "estimators"},
    "verify": {"file", "passed"},
}
"""Some of the keys that programs read, of the first entry where the results are a list."""

SWEEP = f'radius = "60mm"\ndot = "20mm"\nposes = "{FEW}"\n[grid]\nn = [4]\nlayout = ["ngon"]\n'


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a marker, its sheet, photographs of it, the camera, and a sweep."""
    folder = tmp_path_factory.mktemp("made")
    marker = mg.design(n=5, radius="60mm", dot="20mm", restarts=1, poses=FEW).marker
    camera, rng = Camera(400, 300, 500.0, 500.0, 199.5, 149.5), np.random.default_rng(0)
    marker.save(folder / "m.json", folder / "m.pdf")
    camera.save(folder / "camera.yaml")
    (folder / "sweep.toml").write_text(SWEEP)
    (folder / "photos").mkdir()
    poses = []
    for k in range(4):
        lean = np.deg2rad(20 + 5 * k) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0])
        rotation = exponential(lean) @ np.diag([1.0, -1.0, -1.0])
        place = np.array([0.0, 0.0, 0.3 + 0.05 * k])
        image = render_view(marker, camera, rotation, place, Optics(), rng)
        cv2.imwrite(str(folder / "photos" / f"{k}.png"), image)
        matrix = np.vstack([np.c_[rotation.T, -rotation.T @ place], [0, 0, 0, 1]])
        poses.append({"photo": f"{k}.png", "matrix": matrix.tolist()})
    (folder / "poses.json").write_text(json.dumps(poses))
    return folder


@pytest.fixture(autouse=True)
def here(made, tmp_path, monkeypatch):
    """A copy of that folder as the current one, and the least work for a comparison."""
    shutil.copytree(made, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(compare, "TUNING_VIEWS", 2)
    return tmp_path / "here"


def test_every_command_with_results_is_listed():
    assert set(typer.main.get_command(app).commands) - set(COMMANDS) == {"studio", "example"}
    assert set(KEYS) == set(COMMANDS)


# A study draws its figures, which takes seconds.
@pytest.mark.parametrize("name", [pytest.param(k, marks=pytest.mark.long) if k == "study" else k for k in COMMANDS])
def test_results_are_json_on_standard_output_or_in_a_file_and_nothing_is_said(name, here, capfd):
    arguments = [name, *COMMANDS[name].split(), "--quiet"]
    assert main([*arguments, "--json", "-"]) == 0
    output, complaints = capfd.readouterr()
    results = json.loads(output)
    first = results[0] if isinstance(results, list) else results
    assert KEYS[name] <= set(first)
    assert complaints == ""
    shutil.rmtree("swept", ignore_errors=True)
    assert main([*arguments, "--json", "results.json"]) == 0
    assert capfd.readouterr() == ("", "")
    # Durations aside, the same input gives the same results.
    again = json.loads((here / "results.json").read_text())
    assert type(again) is type(results)
    assert name in ("compare", "validate") or again == results


@pytest.mark.parametrize("name", COMMANDS)
def test_a_file_for_results_that_cannot_be_written_ends_the_command_before_any_work(name, here, capfd):
    before = sorted(here.rglob("*"))
    assert main([name, *COMMANDS[name].split(), "--json", "nowhere/results.json"]) == 2
    output, complaints = capfd.readouterr()
    assert output == ""
    assert complaints.count("\n") == 1
    assert "nowhere" in complaints
    assert sorted(here.rglob("*")) == before
