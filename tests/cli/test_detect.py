import json

import cv2
import numpy as np
import pytest
from sentences import sentence

from markergen.cli import main
from markergen.model.body_json import to_json
from markergen.model.camera import Camera, Distortion
from markergen.model.poses import paper
from markergen.render import Optics, render_view

POSES = paper()
CAMERA = Camera(640, 480, 800, 800, 320, 240, Distortion("radtan", (-0.28, 0.09, 0.001, -0.0005, 0.0)))
CAMERA_INFO = """\
image_width: 640
image_height: 480
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [800, 0, 320, 0, 800, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.09, 0.001, -0.0005, 0.0]}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pentagon):
    """Marker, camera, two photos of it, an empty one, and a broken one."""
    folder = tmp_path_factory.mktemp("photos")
    (folder / "marker.json").write_bytes(to_json(pentagon))
    (folder / "camera.yaml").write_text(CAMERA_INFO)
    (folder / "good").mkdir()
    for pose in (130, 250):
        rng = np.random.default_rng(pose)
        image = render_view(pentagon, CAMERA, POSES.rotation[pose], POSES.translation[pose], Optics(), rng)
        cv2.imwrite(str(folder / "good" / f"{pose}.png"), image)
    cv2.imwrite(str(folder / "empty.png"), np.full((480, 640), 200, np.uint8))
    (folder / "broken.png").write_bytes((folder / "good" / "130.png").read_bytes()[:3000])
    return folder


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


ALL = ["--marker", "marker.json", "--camera", "camera.yaml"]


def test_a_folder_of_photos(here, capsys, tmp_path):
    found, seen = tmp_path / "found.json", tmp_path / "seen"
    assert main(["detect", "good", *ALL, "--json", str(found), "--overlay", str(seen)]) == 0
    output = capsys.readouterr()
    assert sentence("markers found", "2 of 2 images") in output.out
    assert not output.err
    entries = json.loads(found.read_text())
    assert [entry["image"] for entry in entries] == ["good/130.png", "good/250.png"]
    for entry, pose in zip(entries, (130, 250), strict=True):
        translation = np.array(entry["markers"][0]["pose"]["translation"])
        # 0.003 % RMS was measured without print error, which these photos do not have.
        np.testing.assert_allclose(translation, POSES.translation[pose], atol=2e-4)
    assert sorted(path.name for path in seen.iterdir()) == ["130.png", "250.png"]


def test_videos_among_the_images_are_left_out_and_told(here, capsys, tmp_path):
    (tmp_path / "a.png").write_bytes((here / "empty.png").read_bytes())
    (tmp_path / "walk.mp4").write_bytes(b"a video")
    assert main(["detect", str(tmp_path), *ALL]) == 1
    assert capsys.readouterr().err == f"{tmp_path}: {sentence('video left out')}\n"


def test_heic_among_the_images_is_told(here, capsys, tmp_path):
    (tmp_path / "a.png").write_bytes((here / "good" / "130.png").read_bytes())
    (tmp_path / "b.heic").write_bytes(b"a photo")
    assert main(["detect", str(tmp_path), *ALL]) == 0
    output = f"{tmp_path}: 1 HEIC file is not read: set the phone to JPEG, or convert it\n"
    assert capsys.readouterr().err == output


def test_standard_output_is_json_alone(here, capsys):
    assert main(["detect", "good/*.png", *ALL, "--json", "-"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == 2


def test_a_scale_that_nobody_measured_counts_in_the_distance(here, capsys):
    """Of a print whose scale is off by 1 % along x and along y, distances are off by 0.7 %."""
    assert main(["detect", "good/130.png", *ALL, "--scale-sigma", "0.01", "--json", "-"]) == 0
    pose = json.loads(capsys.readouterr().out)[0]["markers"][0]["pose"]
    distance = np.linalg.norm(pose["translation"])
    assert 0.6 < pose["sigma"]["translation"]["print"] / (0.01 * distance) < 1.2


def test_a_photo_without_the_marker_is_status_1(here, capsys):
    assert main(["detect", "empty.png", "good/130.png", *ALL]) == 1
    output = capsys.readouterr().out
    assert "empty.png: marker.json not found: found 0 dots" in output
    assert "good/130.png: marker.json, 5 of 5 dots" in output


def test_a_broken_photo_is_status_2_and_the_others_are_done(here, capsys, tmp_path):
    path = tmp_path / "found.json"
    assert main(["detect", "broken.png", "good/130.png", *ALL, "--json", str(path)]) == 2
    output = capsys.readouterr()
    assert len(output.err.strip().splitlines()) == 1
    assert "broken.png" in output.err
    broken, good = json.loads(path.read_text())
    assert broken["error"]
    assert good["markers"][0]["found"]


def test_without_a_camera(here, capsys):
    assert main(["detect", "good/130.png", "--marker", "marker.json"]) == 0
    assert "homography only" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere*.png", *ALL], "nowhere"),
        (["good", "--marker", "none.json"], "none.json"),
        (["good", "--marker", "marker.json", "--camera", "marker.json"], "camera"),
        (["good", *ALL, "--symmetric", "magic"], "none or any"),
        (["good", *ALL, "--smallest", "-1"], "0 px or more"),
        (["good", *ALL, "--print-sigma", "-1mm"], "print"),
        (["good", *ALL, "--scale-sigma", "0.5"], "scale"),
        (["good", "--marker", "marker.json", "--camera-covariance", "x"], "--camera"),
        (["good"], "--marker"),
        (["good", *ALL, "--json", "no/such/folder/f.json"], "no/such/folder"),
    ],
)
def test_bad_input_is_one_line_and_status_2(here, capsys, arguments, message):
    assert main(["detect", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("markergen: error: ")
    assert len(error.strip().splitlines()) == 1
    assert message in error


def test_inputs_are_never_overwritten(here, capsys):
    before = (here / "good" / "130.png").read_bytes(), (here / "marker.json").read_bytes()
    assert main(["detect", "good", *ALL, "--json", "marker.json"]) == 2
    assert sentence("input overwritten") in capsys.readouterr().err
    assert ((here / "good" / "130.png").read_bytes(), (here / "marker.json").read_bytes()) == before


def test_overlays_never_stand_among_the_photos(here, capsys, tmp_path):
    """The next calibration would take them for photographs."""
    (tmp_path / "a.jpg").write_bytes((here / "good" / "130.png").read_bytes())
    for images, folder in (("good", "good"), (str(tmp_path / "*.jpg"), str(tmp_path))):
        assert main(["detect", images, *ALL, "--overlay", folder]) == 2
        message = capsys.readouterr().err
        assert len(message.strip().splitlines()) == 1
        assert "folder for overlays" in message
        assert f"such as --overlay {folder}/seen" in message
    assert [path.name for path in tmp_path.iterdir()] == ["a.jpg"]
    assert len(list((here / "good").iterdir())) == 2


def test_an_overlay_that_cannot_be_written_does_not_stop_the_batch(here, capsys, tmp_path, monkeypatch):
    from markergen.detect import batch

    honest = batch.write_atomic

    def full(path, data):
        if path.name == "130.png":
            raise batch.OutputError("expected to write 130.png, found: No space left on device")
        honest(path, data)

    monkeypatch.setattr(batch, "write_atomic", full)
    output = tmp_path / "found.json"
    assert main(["detect", "good", *ALL, "--json", str(output), "--overlay", str(tmp_path / "seen")]) == 2
    assert "No space left" in capsys.readouterr().err
    assert len(json.loads(output.read_text())) == 2
    assert [path.name for path in (tmp_path / "seen").iterdir()] == ["250.png"]


def test_an_option_of_the_release_before_changes_nothing(here, capsys):
    assert main(["detect", "good", *ALL, "--json", "-"]) == 0
    plain = capsys.readouterr()
    assert main(["detect", "good", *ALL, "--json", "-", "--refine", "photometric"]) == 0
    refined = capsys.readouterr()
    assert refined.out == plain.out
    assert refined.err == "--refine has no effect any more, and goes with the next release\n" + plain.err


def test_verdict_and_state_of_the_tag_are_in_the_results(here, capsys):
    assert (
        main(["detect", "good", *ALL, "--json", "-", "--deadline", "60", "--smallest", "3", "--symmetric", "any"]) == 0
    )
    (findings,) = json.loads(capsys.readouterr().out)[0]["markers"]
    assert findings["verdict"]["consistent"]
    assert findings["tag_state"] == "none"
    assert findings["turns_deg"] == []


def test_what_was_found_before_an_interruption_is_kept(here, tmp_path, monkeypatch, capsys):
    from markergen.detect import batch

    honest = batch.look_at

    def interrupted(detector, path, deadline):
        if path.name == "250.png":
            raise KeyboardInterrupt
        return honest(detector, path, deadline)

    monkeypatch.setattr(batch, "look_at", interrupted)
    output = tmp_path / "found.json"
    assert main(["detect", "good", *ALL, "--json", str(output)]) == 130
    assert len(json.loads(output.read_text())) == 1
    assert capsys.readouterr().err.splitlines() == ["1 of 2 images were searched", "markergen: error: interrupted"]
