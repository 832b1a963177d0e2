"""Every example runs as it is written, and says what it promises."""

import runpy
import sys
from pathlib import Path

import pytest

from markergen.cli import main
from markergen.model.marker_json import to_json

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(name, *arguments, monkeypatch):
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")


def test_condition_against_pose(monkeypatch, capsys):
    run("condition_against_pose.py", 4, monkeypatch=monkeypatch)
    condition, pose, polygon = (float(word) for word in capsys.readouterr().out.splitlines()[-1].split()[1:])
    # For four points all three are the square.
    assert condition == pytest.approx(3.10, abs=0.01)
    assert pose == pytest.approx(polygon, rel=2e-3)


def test_own_camera(monkeypatch, capsys, tmp_path):
    run("own_camera.py", tmp_path / "m.pdf", monkeypatch=monkeypatch)
    assert (tmp_path / "m.pdf").read_bytes().startswith(b"%PDF")
    assert (tmp_path / "m.json").is_file()
    assert "6 control points in a disk of radius 100 mm" in capsys.readouterr().out


def test_every_example_is_run_here():
    here = Path(__file__).read_text()
    assert all(path.name in here for path in EXAMPLES.glob("*.py"))


def test_see_a_view(monkeypatch, capsys, tmp_path):
    run("see_a_view.py", tmp_path / "view.png", monkeypatch=monkeypatch)
    assert (tmp_path / "view.png").read_bytes().startswith(b"\x89PNG")
    # Noise alone gives about 0.005 px at these sizes; a wrong label would give tens of pixels.
    assert float(capsys.readouterr().out.split()[-2]) < 0.05


def test_take_photos_that_are_found(monkeypatch, tmp_path, make_ngon):
    marker, folder = tmp_path / "marker.json", tmp_path / "photos"
    marker.write_bytes(to_json(make_ngon(5, 0.1284, 0.036)))
    run("take_photos.py", marker, folder, monkeypatch=monkeypatch)
    assert main(["detect", str(folder), "--marker", str(marker), "--camera", str(folder / "camera.yaml")]) == 0


def test_one_sided_camera(monkeypatch, capsys):
    run("one_sided_camera.py", 5, monkeypatch=monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6
    assert float(lines[-1].split()[-3]) > 5
