"""Every example runs as it is written, and says what it promises."""

import runpy
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from markergen.cli import main
from markergen.exporters.glb import write_glb
from markergen.exporters.meshes import MeshedPart
from markergen.model.marker_json import to_json
from markergen.solid.mesh import Mesh

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


def test_picture_of_a_solid(monkeypatch, capsys, tmp_path):
    corners = np.array([[x, y, z] for x in (-30, 30) for y in (-20, 20) for z in (-3, 0)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    sides = np.array([side for a, b, c, d in quads for side in ((a, b, c), (a, c, d))])
    plate = Mesh(corners, sides, np.zeros(12, bool))
    block = Mesh(corners * [0.3, 0.3, -2] + [-10, 0, 0], sides[:, ::-1], np.zeros(12, bool))
    source, target = tmp_path / "m.glb", tmp_path / "m.png"
    source.write_bytes(write_glb([MeshedPart("plate", "light", plate), MeshedPart("dot-0", "dark", block)], "m"))
    run("picture_of_a_solid.py", source, target, "--width", 90, monkeypatch=monkeypatch)
    assert "90 x 60 pixels" in capsys.readouterr().out
    image = cv2.imread(str(target))
    # The table is blue, the plate grey, and the block on its left hides what is behind it and shades what is beside.
    blue, green, red = image[2, 2].astype(int)
    assert blue > green > red
    assert (image.max(axis=-1) < 40).mean() > 0.02
    grey = image[np.ptp(image, axis=-1) == 0][:, 0]
    assert (grey > 200).mean() > 0.2
    assert ((grey > 60) & (grey < 180)).mean() > 0.05
