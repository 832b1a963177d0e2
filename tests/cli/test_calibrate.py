import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from markergen.calibration.calibration import Calibration
from markergen.calibration.judging import CrossValidation
from markergen.cli import main
from markergen.maths.rotation import exponential, logarithm, pose_product
from markergen.model.camera import Camera
from markergen.render import Optics, render_view

OFF = 2e-4 * np.array([[0, 1], [1, 0], [-1, 0], [0, -1], [1, 1]])
CAMERA = Camera(400, 300, 500.0, 500.0, 199.5, 149.5)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a marker, five photographs of a print of it with dots 0.2 mm off, and the camera."""
    folder = tmp_path_factory.mktemp("made")
    marker, rng = mg.design(n=5, radius="60mm", dot="20mm", restarts=1).marker, np.random.default_rng(0)
    marker.save(folder / "marker.json", folder / "marker.pdf")
    CAMERA.save(folder / "camera.yaml")
    moved = zip(marker.control_points, OFF, strict=True)
    printed = replace(marker, control_points=tuple(replace(p, x=p.x + dx, y=p.y + dy) for p, (dx, dy) in moved))
    (folder / "photos").mkdir()
    for k in range(5):
        lean = np.deg2rad(20 + 5 * k) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0])
        rotation = exponential(lean) @ np.diag([1.0, -1.0, -1.0])
        image = render_view(printed, CAMERA, rotation, np.array([0.0, 0.0, 0.35]), Optics(), rng)
        cv2.imwrite(str(folder / "photos" / f"{k}.png"), image)
    return folder


@pytest.fixture(autouse=True)
def here(made, monkeypatch):
    monkeypatch.chdir(made)
    return made


ALL = ["calibrate", "marker.json", "photos", "--camera", "camera.yaml"]


@pytest.fixture
def unconfirmed(monkeypatch):
    """Left-out photographs do not tell the measured print from the design."""

    def worse(result):
        gain = replace(result.gain, low=0.9)
        return CrossValidation(result.photos, result.measured, result.nominal, result.refitted, gain)

    honest = Calibration.saved
    monkeypatch.setattr(
        Calibration,
        "saved",
        lambda result, targets: honest(replace(result, cross_validation=worse(result.cross_validation)), targets),
    )


def test_without_files_that_is_said(capsys):
    assert main(ALL) == 0
    output = capsys.readouterr()
    assert output.out.startswith(sentence("use measured"))
    assert output.err == sentence("nothing written") + "\n"
    assert main([*ALL, "--json", "-"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["use"]
    assert output.err == ""


def test_a_marker_that_is_not_to_be_used_is_status_1_and_written(tmp_path, capsys, unconfirmed):
    output = tmp_path / "measured.json"
    assert main([*ALL, "-o", str(output)]) == 1
    message = capsys.readouterr()
    assert message.out.startswith(sentence("not yet"))
    assert message.err == sentence("unusable files", output) + "\n"
    assert output.exists()
    assert main([*ALL, "--quiet", "--json", "-"]) == 1
    message = capsys.readouterr()
    assert not json.loads(message.out)["use"]
    assert message.err == sentence("unusable result") + "\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            "calibrate marker.json photos --camera camera.yaml -o new.yaml",
            "expected no camera to write, since the given one is taken as exact, found -o new.yaml; leave out "
            "-o new.yaml, or --camera, or give --camera-covariance",
        ),
        ("calibrate marker.json photo.heic", "expected a readable image at photo.heic, found No such file"),
        ("calibrate marker.json photos/0.png -o camera.yaml", "two photographs or more"),
        (
            "calibrate marker.json photos -o a.yaml -o b.yaml",
            "cameras, 1, found 2; give an -o ....yaml for each, in order; several",
        ),
        ("calibrate marker.json photos --image-size 640x480", "found no camera; give --camera FILE, or leave it out"),
        ("calibrate marker.json photos --print-sigma 0 -o new.json", "expected a --print-sigma above 0 for dots to"),
        (
            "calibrate marker.json photos --measured 0-2=150,4mm",
            "expected a length for measured, found '150,4mm'; write a point: 150.4mm",
        ),
        (
            "calibrate marker.json photos/[0-2].png -o camera.yaml",
            "expected photographs that determine the dots and the camera, found that 3 photographs of 5 dots with an "
            "unknown camera have no more measurements than unknowns; take ",
        ),
        (
            "calibrate marker.pdf photos",
            "expected a marker.json at marker.pdf, found a PDF file; give the .json that was written with it",
        ),
        (
            "calibrate photos/0.png photos",
            "expected a marker.json at photos/0.png, found a PNG file; give the .json that was written with it",
        ),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments, message, capsys):
    assert main(arguments.split()) == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1
    assert message in error


@pytest.fixture(scope="module")
def pairs(made):
    """Photographs of the print by two cameras, 60 mm apart and turned by 3 deg, in folders of their names."""
    marker, rng = mg.Marker.load(made / "marker.json"), np.random.default_rng(1)
    away = exponential(np.array([0, np.deg2rad(3), 0])), np.array([-0.06, 0.0, 0.0])
    for k in range(4):
        lean = exponential(np.deg2rad(25) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0]))
        first = lean @ np.diag([1.0, -1.0, -1.0]), np.array([0.02, 0.0, 0.4])
        for name, pose in (("left", first), ("right", pose_product(away, first))):
            (made / "pairs" / name).mkdir(exist_ok=True, parents=True)
            photo = render_view(marker, CAMERA, *pose, Optics(), rng)
            cv2.imwrite(str(made / "pairs" / name / f"{name}{k}.png"), photo)
    return away


def test_two_cameras_are_calibrated_together(pairs, made):
    cameras = ["--camera", "left=camera.yaml", "--camera", "right=camera.yaml"]
    assert main(["calibrate", "marker.json", "pairs", *cameras, "--json", "pairs.json", "-o", "together.json"]) == 0
    (left, right) = json.loads((made / "pairs.json").read_text())["cameras"]
    assert (left["name"], right["name"]) == ("left", "right")
    assert left["T_camera_left"]["translation"] == [0, 0, 0]
    rotation, translation = (np.array(right["T_camera_left"][name]) for name in ("rotation", "translation"))
    error = np.concatenate([logarithm(rotation @ pairs[0].T), translation - pairs[1]])
    assert np.all(np.abs(error) < 4 * np.sqrt(np.diag(right["pose_covariance"])))
    # What is unknown of the print's scale is unknown of the distance: 0.14 % of 60 mm.
    assert np.sqrt(right["pose_covariance"][3][3]) == pytest.approx(0.06 * 0.002 / np.sqrt(2), rel=0.1)


@pytest.mark.parametrize(
    ("photos", "cameras", "message"),
    [
        (["pairs"], ["left=camera.yaml", "camera.yaml"], "a name of its own for each of several cameras"),
        (["pairs", "photos"], ["left=camera.yaml", "right="], "photographs in a folder of each camera's name"),
        (["pairs/left"], ["left=camera.yaml", "right="], "photographs of every camera, found none of right"),
        (["pairs"], ["left=camera.yaml", "right=camera.yaml", "-o", "one.yaml"], "no camera to write"),
    ],
)
def test_what_is_amiss_with_several_cameras_is_one_line(pairs, capsys, photos, cameras, message):
    options = [
        part for text in cameras for part in (["--camera", text] if "=" in text or text == "camera.yaml" else [text])
    ]
    assert main(["calibrate", "marker.json", *photos, *options]) == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1
    assert message in error
