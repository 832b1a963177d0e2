"""What `import markergen` gives: the documented names, at little cost, and a day of work with them."""

import doctest
import inspect
import json
import logging
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawings import dxf
from sentences import sentence

import markergen as mg
from markergen.render import Optics, render_view

HEAVY = ("numpy", "scipy", "cv2", "pydantic", "cadquery", "OCP", "matplotlib", "pandas", "shapely", "typer", "rich")
CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: webcam
camera_matrix: {rows: 3, cols: 3, data: [800, 0, 320, 0, 800, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0.0, 0.0, 0.0]}
"""


def loaded_by(code):
    """Modules that are loaded when a fresh interpreter has run some code."""
    run = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return set(run.stdout.splitlines()[-1].split())


def test_importing_loads_next_to_nothing():
    loaded = loaded_by("import markergen, markergen as mg; dir(mg); mg.__all__")
    assert not loaded & set(HEAVY)
    assert {name for name in loaded if name.startswith("markergen.")} == set()


def test_loading_a_marker_loads_no_more_than_it_needs(pentagon, tmp_path):
    pentagon.save(tmp_path / "m.json")
    loaded = loaded_by(f"import markergen as mg; mg.Marker.load({str(tmp_path / 'm.json')!r})")
    assert "scipy.optimize" not in loaded
    assert not loaded & {"cadquery", "OCP", "matplotlib", "cv2", "pandas", "typer", "rich", "autograd"}


def test_names_are_the_documented_ones_and_no_more():
    assert dir(mg) == sorted(mg.__all__)
    assert loaded_by("from markergen import *; assert callable(design) and callable(validate)")
    for name in mg.__all__:
        assert getattr(mg, name) is getattr(mg, name)
    with pytest.raises(AttributeError, match="no attribute 'designs'"):
        _ = mg.designs


def test_functions_stay_functions_whatever_is_imported():
    code = (
        "import importlib, pkgutil, markergen as mg\n"
        "for module in pkgutil.iter_modules(mg.__path__): importlib.import_module('markergen.' + module.name)\n"
        "assert all(not isinstance(getattr(mg, name), type(mg)) for name in mg.__all__)"
    )
    loaded_by(code)


@pytest.mark.parametrize("name", mg.__all__)
def test_every_name_has_an_example(name):
    thing = getattr(mg, name)
    assert any(test.examples for test in doctest.DocTestFinder(recurse=False).find(thing, name))


def test_the_library_is_silent_until_somebody_listens():
    code = "import logging, markergen as mg; logging.getLogger('markergen.any').warning('no')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (run.stdout, run.stderr) == ("", "")
    assert logging.getLogger("markergen").level == logging.NOTSET


def flange(_, model):
    for x, y, radius in [(0, 0, 125), (0, 0, 40), (70, 70, 4.5), (-70, 70, 4.5), (-70, -70, 4.5), (70, -70, 4.5)]:
        model.add_circle((x, y), radius)


@pytest.mark.long
def test_a_day_with_the_library(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("plate.dxf").write_text(dxf(flange))
    Path("camera_info.yaml").write_text(CAMERA_INFO)

    design = mg.design(
        n=8,
        boundary="plate.dxf",
        camera="camera_info.yaml",
        poses="cone:tilt=0..60,distance=0.5..3m,count=60",
        restarts=2,
    )
    assert sentence("polygon", "250 mm x 250 mm", "5 holes") in str(design)
    design.marker.save("marker.pdf", "marker.json", "marker.dxf", paper="A4")
    assert Path("marker.pdf").read_bytes().startswith(b"%PDF")

    marker = mg.Marker.load("marker.json")
    assert marker == design.marker
    with Path("marker.json").open() as file:
        assert mg.Marker.load(file) == marker
    assert mg.Marker.load(json.loads(Path("marker.json").read_text())) == marker
    camera = mg.Camera.load("camera_info.yaml")
    distortion = np.array([-0.1, 0.02, 0, 0, 0])
    assert mg.Camera.from_cv2(np.array([[800, 0, 320], [0, 800, 240], [0, 0, 1.0]]), distortion, (640, 480)) == camera

    detector = mg.Detector(marker, camera)
    pose = cv2.Rodrigues(np.array([0.3, -0.2, 0.1]))[0] @ np.diag([1.0, -1, -1]), np.array([0.02, -0.01, 0.6])
    grey = render_view(marker, camera, *pose, Optics(), np.random.default_rng(0))
    frame = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for image in (frame, grey, cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA), grey.astype(np.uint16) * 256):
        [finding] = detector(image)
        assert finding.ok, finding.reason
        assert finding.reason == ""
        assert finding.pixels.shape == (len(finding.ids), 2)
        assert finding.covariance.shape == (6, 6)
        seen, _ = cv2.projectPoints(finding.xyz, finding.rvec, finding.tvec, camera.matrix, camera.cv2_distortion)
        # A hundredth of a pixel is what noise of 2 grey levels does to dots of this size.
        assert np.abs(seen[:, 0] - finding.pixels).max() < 0.1
        # In m: three standard deviations of the pose's own covariance, with 0.1 mm of print error.
        sigma = np.sqrt(np.diag(finding.covariance)[3:])
        assert (np.abs(finding.tvec[:, 0] - pose[1]) < 5 * sigma).all()
    before = frame.copy()
    assert finding.draw(frame) is frame
    assert (frame != before).any()
    assert len(detector.dots(frame)) >= 4

    validation = mg.validate(marker, camera, poses="cone:tilt=0..60,distance=0.5..1m,count=12", runs=5, views=2)
    validation.save("report.html")
    assert Path("report.html").read_text().startswith("<!DOCTYPE html>")
    assert validation.bound["rotation_deg"] > 0
    frame = validation.to_frame()
    assert set(frame[frame.source == "trials"].estimator) == set(validation.estimators)

    assert mg.verify(marker, "marker.dxf", "marker.pdf").passed
    comparison = mg.compare(marker, "square", views=2, poses="cone:count=12", workers=1)
    assert "square" in str(comparison)
    assert mg.rescale(marker, measured_x="248mm", nominal_x="250mm").marker.print_scale[0] == pytest.approx(0.992)
    for result in (design, validation, comparison, *detector(grey)):
        assert len(repr(result)) < 2000
        assert result._repr_html_().startswith("<")


@pytest.mark.parametrize("name", ["design", "export", "validate", "compare", "verify", "rescale", "study"])
def test_what_is_wrong_is_told_by_our_own_errors(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function = getattr(mg, name)
    needed = [
        parameter for parameter in inspect.signature(function).parameters.values()
        if parameter.kind is parameter.POSITIONAL_OR_KEYWORD and parameter.default is parameter.empty
    ]  # fmt: skip
    for wrong in (3, object(), b"marker.json", {"a": 1}, [None]):
        with pytest.raises(mg.MarkergenError):
            function(*[wrong for _ in needed] or [wrong] * (name == "compare"), **{"no_such_option": 1})
