"""What a user may say about room, camera, poses and criteria, and that all of it reaches the design."""

import csv
import json
import re

import numpy as np
import pytest
from sentences import sentence

from markergen.cli import main
from markergen.model.body_json import read_marker
from markergen.optimize.problem import breach

PLATE = """<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="200mm" viewBox="0 0 240 200">
<g id="outline"><path d="M20,20 h200 v160 h-200 z"/></g>
<g id="hole"><circle cx="150" cy="100" r="25"/></g>
</svg>"""

CAMERA = """image_width: 1280
image_height: 800
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [700.0, 0, 640, 0, 700, 400, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.2, 0.05, 0.001, -0.001, 0.0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [700.0, 0, 640, 0, 0, 700, 400, 0, 0, 0, 1, 0]}
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def quick(*arguments: str) -> list[str]:
    poses = () if "--poses" in arguments else ("--poses", "cone:distance=0.6..1.5m,tilt=0..60,count=10")
    return ["design", "--restarts", "1", "--dot", "20mm", *poses, "-o", "m.json", *arguments]


def kept(marker) -> bool:
    diameter = marker.dot_diameter
    return breach(marker.xyz, marker.boundary, marker.keep_outs, diameter, marker.clearance) <= 1e-9


def test_a_drawing_with_a_hole_and_a_keep_out(here, capsys):
    (here / "plate.svg").write_text(PLATE)
    keep_out = ["--keep-out", "circle:20mm@-50mm,30mm"]
    assert main(quick("--n", "6", "--boundary", "plate.svg", *keep_out, "-o", "m.svg")) == 0
    assert "200 mm x 160 mm" in capsys.readouterr().out
    marker = read_marker(here / "m.json")
    assert kept(marker)
    # The marker frame's origin is the plate's middle, y up: the hole is 30 mm right of it. Flattened to 5 um.
    assert np.isclose(marker.boundary.depth(np.array([[0.03, 0.0]]))[0], -0.025, atol=5e-6)
    assert [keep_out.center for keep_out in marker.keep_outs] == [(-0.05, 0.03)]


@pytest.mark.long
def test_keep_outs_of_a_drawing_lie_where_they_were_drawn(here):
    outline, hole = (PLATE.replace("<g", f'<g display="{state}"', 1) for state in ("inline", "none"))
    (here / "outline.svg").write_text(outline.replace('<g id="hole">', '<g id="hole" display="none">'))
    (here / "hole.svg").write_text(hole)
    assert main(quick("--boundary", "outline.svg", "--keep-out", "hole.svg")) == 0
    marker = read_marker(here / "m.json")
    assert kept(marker)
    assert np.allclose(marker.keep_outs[0].center, [0.03, 0.0], atol=5e-6)
    assert main(quick("--boundary", "outline.svg", "--keep-out", "hole.svg", "--origin", "file")) == 0
    # In the drawing y goes down.
    assert np.allclose(read_marker(here / "m.json").keep_outs[0].center, [0.15, -0.1], atol=5e-6)


def test_camera_and_poses_of_files_are_used_throughout(here, capsys):
    (here / "camera.yaml").write_text(CAMERA)
    with (here / "poses.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["tx", "ty", "tz", "qx", "qy", "qz", "qw"])
        for rotation in np.linspace(0.9, 1.1, 12):
            # About half a turn around x, so that the face looks at the camera; tilted by up to 36 degrees.
            angle = np.pi * rotation
            rows.writerow([0.01, 0.02, 0.8 + rotation / 10, np.sin(angle / 2), 0, 0, np.cos(angle / 2)])
    files = ["--camera", "camera.yaml", "--poses", "poses.csv"]
    assert main(quick("--boundary", "rect:0.2x0.15", *files, "--details")) == 0
    assert "12 poses (poses.csv)" in capsys.readouterr().out
    spec = json.loads((here / "m.json").read_text())["provenance"]["spec"]
    assert spec["camera"]["distortion"]["coefficients"][0] == -0.2
    # A marker.json stands alone.
    (here / "camera.yaml").unlink()
    (here / "poses.csv").unlink()
    assert main(["validate", "m.json", "--runs", "2", "--views", "2", "--workers", "1", "--json", "r.json"]) == 0
    results = json.loads((here / "r.json").read_text())
    assert results["poses"]["count"] == 12
    assert results["camera"]["distortion"]["coefficients"][0] == -0.2
    assert results["views"]["detected"] == 2


@pytest.mark.long
def test_losses_are_printed(here, capsys):
    assert main(quick("--n", "5", "--survive", "1", "--aggregate", "cvar:0.9", "--details")) == 0
    output = capsys.readouterr().out
    for phrase in ("none hidden", "worst: dot", "mean of any 1 hidden", "found in", "MB of memory"):
        assert phrase in output


def test_the_way_of_the_search(here):
    assert main(quick("--trace", "way.csv", "--trace", "way.svg")) == 0
    rows = list(csv.DictReader((here / "way.csv").read_text().splitlines()))
    assert rows[0]["stage"] == "start"
    assert float(rows[-1]["objective"]) <= float(rows[0]["objective"])
    criteria = json.loads((here / "m.json").read_text())["provenance"]["criteria"]["design"]
    # The table is rounded to eight digits, coordinates to a tenth of a nanometer.
    assert np.isclose(float(rows[-1]["objective"]), criteria["pose_m"], rtol=1e-6)
    assert "rotation" in (here / "way.svg").read_text()


@pytest.mark.parametrize(
    ("arguments", "phrase"),
    [
        ("--radius 0.1 --boundary rect:1x1", "a radius or a boundary"),
        ("--boundary none.svg", "No such file"),
        ("--boundary rect:0.2", "rect:200mmx100mm"),
        ("--layer A", "no --boundary"),
        ("--boundary-unit mm", "write the unit with the number"),
        ("--boundary rect:1x1 --layer A", "an outline file only"),
        ("--keep-out circle:1m", "nothing left"),
        ("--keep-out circle:1", "nothing left"),
        ("--relief 20mm -o m.pdf", "leave out --relief"),
        ("--relief 1m -o m.json", "no higher than the radius"),
        ("--relief 20mm --objective condition -o m.json", "pose, rotation or translation"),
        ("--relief 20mm --asymmetric 3 -o m.json", "leave out --asymmetric"),
        ("--asymmetric -1", "0 px or more"),
        ("--asymmetric nan", "asymmetric"),
        ("--survive 2", "use --n 6"),
        ("--survive 4 --n 12", "survive 1, 2 or 3"),
        ("--aggregate cvar:2", "cvar:0.9"),
        ("--camera none.yaml", "No such file"),
        ("--poses none.csv", "No such file"),
        ("--poses cone:tilt=200", "below 90"),
        ("--trace way.txt", ".csv, .svg, .mp4, .png"),
        ("--trace m.svg -o m.svg", "twice"),
        ("--boundary rect:2x2 --no-tile", "A0"),
        ("--dot 0 -o m.svg", "leave out --dot 0"),
    ],
)
def test_bad_requests(here, capsys, arguments, phrase):
    assert main(["design", *arguments.split()]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert len(output.err.splitlines()) == 1
    assert phrase in output.err
    assert not list(here.iterdir())


def test_inputs_are_not_overwritten(here, capsys):
    (here / "plate.svg").write_text(PLATE)
    assert main(["design", "--boundary", "plate.svg", "-o", "plate.svg"]) == 2
    assert sentence("input overwritten") in capsys.readouterr().err
    assert (here / "plate.svg").read_text() == PLATE
    assert main(["design", "--keep-out", "plate.svg#hole", "-o", "plate.svg"]) == 2
    assert sentence("input overwritten") in capsys.readouterr().err
    assert (here / "plate.svg").read_text() == PLATE


def test_a_keep_out_that_keeps_nothing_out_is_told(here, capsys):
    keep_outs = ["--keep-out", "circle:5mm@0.2m,10mm", "--keep-out", "circle:5mm@149mm,0"]
    assert main(quick("--n", "4", "--radius", "150mm", *keep_outs)) == 0
    (warning,) = capsys.readouterr().err.splitlines()
    assert sentence("keep-out outside", 1, "5 mm", "200 mm, 10 mm") in warning


def test_a_layout_without_a_homography_is_refused(here, capsys):
    """In an L whose arms are little wider than the dots the pose is known best with three of four dots on a line."""
    (here / "L.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="1000mm" height="1000mm" viewBox="0 0 1000 1000">'
        '<path d="M700 700h200v60h-140v140h-60z"/></svg>'
    )
    room = ["--n", "4", "--boundary", "L.svg", "--origin", "file", "--poses", "cone:distance=2..3m", "--dot", "45mm"]
    assert main(["design", "--restarts", "1", *room, "-o", "m.json"]) == 2
    assert "use --objective homography, or --n 5" in capsys.readouterr().err
    assert not (here / "m.json").exists()
    assert main(["design", "--restarts", "1", *room, "-o", "m.json", "--objective", "homography"]) == 0


def test_what_was_minimized_is_printed(here, capsys):
    """The table has each criterion with its own aggregate: that of the spec is told beside it."""
    phrase = ["--aggregate", "max", "--survive", "1", "--trace", "way.csv", "--details"]
    assert main(quick("--n", "5", "--poses", "cone:count=4", *phrase)) == 0
    value = float(list(csv.DictReader((here / "way.csv").read_text().splitlines()))[-1]["objective"])
    assert f"loss of 1 dot, {value:.4g} m, seed 0" in capsys.readouterr().out


@pytest.mark.long
def test_poses_that_mostly_miss_the_marker_are_told(here, capsys):
    assert main(quick("--n", "4", "--radius", "0.25", "--poses", "cone:distance=0.5..1m,tilt=0..30")) == 0
    output = capsys.readouterr()
    assert "see the whole" in output.out
    assert "not served: 0.5" in output.out
    assert "left out" in output.err


def test_a_layout_with_a_weak_homography_is_told(here, capsys):
    """Dots along the two arms of an L: near to two lines."""
    (here / "L.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="300mm" viewBox="0 0 300 300">'
        '<path d="M0 0h300v30h-270v270h-30z"/></svg>'
    )
    assert main(quick("--n", "4", "--boundary", "L.svg", "--dot", "15mm")) == 0
    assert "weak for a homography" in capsys.readouterr().err


def test_other_criteria_that_suffer_are_told(here, capsys):
    """A camera to one side: less displacement than the square's, for more rotation."""
    sided = ("--poses", "cone:distance=0.6..1.5,tilt=40..70,azimuth=-30..30,roll=0,count=20")
    options = ("--n", "4", "--radius", "150mm", "--dot", "10mm", *sided)
    assert main(quick(*options)) == 0
    message = capsys.readouterr().err
    assert "weak for rotation" in message
    assert re.search(r"off by [\d.]+ deg \(regular n-gon: [\d.]+\) for image noise of 1 px", message)
    assert "weak for pose" not in message
    assert main(quick(*options, "--objective", "rotation")) == 0
    assert "weak for rotation" not in capsys.readouterr().err
