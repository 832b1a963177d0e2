"""Views, files, bodies and photographs of a state."""

import base64
import io
import json
import zipfile

import cv2
import numpy as np
import pytest
import trimesh

import markergen as mg
from markergen.calibration import camera_choice
from markergen.cli import main
from markergen.errors import InputError
from markergen.model.body import Plate
from markergen.model.body_json import load_marker, rig_to_json
from markergen.model.rig import Rig
from markergen.optimize.certificate import Certificate
from markergen.optimize.design import Design
from markergen.studio.showing import parsed_request
from markergen.validation.sentences import amount
from markergen.validation.setting import setting_of


@pytest.fixture(scope="module")
def pair(make_ngon):
    marker = make_ngon(4, 0.04, 0.012)
    identity = tuple(map(tuple, np.eye(3).tolist()))
    return Rig((Plate("left", marker, identity, (-0.05, 0.0, 0.0)), Plate("right", marker, identity, (0.05, 0.0, 0.0))))


def dots_of(png: bytes, dots: list[list[float]]) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)
    return np.array([image[round(y), round(x)] for x, y in dots])


def test_a_view_is_what_the_camera_sees_from_there(studio, options):
    answer = studio.post("view", {"options": options, "pose": {"tilt": 40, "azimuth": 90, "distance": 1}})
    assert answer.headers["content-type"] == "image/png"
    dots = json.loads(answer.headers["x-dots"])
    # The key ring is light inside.
    assert (dots_of(answer.data, dots)[1:] < 60).all()
    # By hand: a camera 1 m away in the plane x = 0, 40 deg from the normal toward +y, with y of the image away from it.
    sine, cosine = np.sin(np.deg2rad(40)), np.cos(np.deg2rad(40))
    depth = 1 - sine * np.array(options["points"])[:, 1]
    distance = np.hypot(np.array(dots)[:, 0] - 320, np.array(dots)[:, 1] - 240)
    x, y = np.array(options["points"]).T
    assert distance == pytest.approx(800 * np.hypot(x, y * cosine) / depth, abs=0.02)


def test_a_pose_by_its_index_is_that_of_validate(studio, options):
    marker = mg.design(**options).marker
    setting = setting_of(marker)
    answer = studio.post("view", {"options": options, "pose": 2})
    pixels = setting.camera.project(marker.xyz, setting.poses.rotation[2:3], setting.poses.translation[2:3])[0]
    assert np.array(json.loads(answer.headers["x-dots"])) == pytest.approx(pixels, abs=0.006)


@pytest.mark.parametrize("pose", [3, -1, True, "0", {"tilt": 40}, {"tilt": "steep", "azimuth": 0, "distance": 1}, None])
def test_a_pose_that_is_none_is_refused(studio, options, pose):
    assert "a pose of 0 to 2" in studio.post("view", {"options": options, "pose": pose}).json["line"]
    beyond = {"tilt": 95, "azimuth": 0, "distance": 1}
    assert "tilt" in studio.post("view", {"options": options, "pose": beyond}).json["line"]


@pytest.mark.parametrize(
    "suffixes", [[".json"], pytest.param([".svg", ".csv", ".pdf", ".step"], marks=pytest.mark.long)]
)
def test_a_download_is_what_the_command_writes(studio, options, suffixes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Design, "certify", lambda self, progress=None: Certificate(4, 1.0, 0.0, "for another test"))
    # Labels take most of the time, and bare points have none.
    dot = "0mm" if suffixes == [".json"] else "30mm"
    more = {"paper": "A1", "mount": ["4xM3@260mm"], "dot": dot}
    points = "; ".join(f"{x},{y}" for x, y in options["points"])
    command = ["design", "--radius", "150mm", "--dot", dot, "--points", points, "--poses", options["poses"]]
    files = [word for suffix in suffixes for word in ("-o", f"marker{suffix}")]
    assert main([*command, "--paper", "A1", "--mount", "4xM3@260mm", *files]) == 0
    for suffix in suffixes:
        answer = studio.post("export", {"options": {**options, **more}, "suffix": suffix})
        assert answer.data == (tmp_path / f"marker{suffix}").read_bytes()
        assert answer.headers["content-disposition"] == f"attachment; filename*=UTF-8''marker{suffix}"


@pytest.mark.long
def test_files_that_come_together_are_packed(studio, options):
    answer = studio.post("export", {"options": options, "suffix": ".urdf"})
    assert answer.headers["content-type"] == "application/zip"
    names = zipfile.ZipFile(io.BytesIO(answer.data)).namelist()
    assert names[0] == "marker.urdf"
    assert names[1:]
    assert "marker.json" not in names
    assert studio.post("export", {"options": options, "suffix": ".urdf"}).data == answer.data


@pytest.mark.parametrize("suffix", [".exe", "", "pdf", "/../../x.pdf", ".pdf/x", None, 5])
def test_a_format_that_is_none_is_refused(studio, options, suffix):
    assert "suffix" in studio.post("export", {"options": options, "suffix": suffix}).json["line"]


def test_a_family_is_packed_or_on_one_sheet(studio, options):
    asked = {**options, "tag": "aruco:DICT_4X4_50", "tag_size": "20mm", "ids": "0,3"}
    packed = studio.post("export", {"options": asked, "suffix": ".json"})
    with zipfile.ZipFile(io.BytesIO(packed.data)) as archive:
        tags = {name: str(load_marker(json.loads(archive.read(name))).tag) for name in archive.namelist()}
    assert tags == {f"marker-{k}.json": f"aruco:DICT_4X4_50:{k}" for k in (0, 3)}
    assert studio.post("export", {"options": asked, "suffix": ".svg"}).data.count(b"<svg") == 1


def test_dots_have_to_be_there(studio):
    assert "dots to export, found" in studio.post("export", {"options": {}, "suffix": ".pdf"}).json["line"]


def test_a_body_is_shown_with_its_poses(studio, options, pair):
    for asked, size in (({"options": options}, 0.3), ({"rig": json.loads(rig_to_json(pair))}, 0.15)):
        results = studio.post("scene", asked).json
        body = trimesh.load(io.BytesIO(base64.b64decode(results["glb"])), file_type="glb")
        assert body.extents.max() > size
        poses = results["poses"]
        far = np.sqrt(np.sum([np.square(poses[axis]) for axis in "xyz"], axis=0))
        assert far == pytest.approx(poses["distance"])
        lean = np.rad2deg(np.arccos(np.clip(np.array(poses["z"]) / far, -1, 1)))
        assert lean == pytest.approx(poses["tilt"], abs=1e-4)


def test_a_body_is_shown_with_the_errors_of_validate(studio, options, pair):
    marker = studio.post("export", {"options": options, "suffix": ".json"}).json
    for asked, what in (({"marker": marker}, load_marker(marker)), ({"rig": json.loads(rig_to_json(pair))}, pair)):
        results = studio.post("scene", asked).json
        expected = mg.validate(what, runs=0, views=0).budget["rotation_deg"]["total"]
        seen = np.array([item for item in results["poses"]["rotation"] if item is not None])
        assert np.sqrt(np.mean(seen**2)) == pytest.approx(expected, rel=1e-4)
        assert results["expected"].startswith(f"Expect {amount(expected)} deg and ")


def test_a_photograph_shows_what_detect_finds(studio, options):
    camera = {"width": 640, "height": 480, "fx": 800, "fy": 800, "cx": 320, "cy": 240}
    view = studio.post("view", {"options": options, "pose": {"tilt": 30, "azimuth": 20, "distance": 0.8}})
    asked = json.dumps({"options": options, "camera": camera}).encode() + b"\n"
    findings = studio.post("detect", asked + view.data, X_Name="caf%C3%A9.png").json
    assert findings["found"]
    assert not findings["why"]
    truth = json.loads(view.headers["x-dots"])
    seen = {dot["id"]: (dot["x"], dot["y"]) for dot in findings["dots"]}
    assert [seen[k] for k in range(4)] == [pytest.approx(pixel, abs=0.5) for pixel in truth]
    assert np.linalg.norm(findings["pose"]["translation"]) == pytest.approx(0.8, abs=0.01)
    kind, data = findings["overlay"].split(",")
    assert kind in ("data:image/jpeg;base64", "data:image/png;base64")
    assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR).shape == (480, 640, 3)


def photographed(studio, options, count=8):
    """Views of a marker from around, and the request that comes before them."""
    poses = [{"tilt": 20 + 4 * k, "azimuth": 100 * k, "distance": 0.6 + 0.03 * k} for k in range(count)]
    views = [studio.post("view", {"options": options, "pose": pose}).data for pose in poses]
    names = [{"name": f"IMG {k}.png", "size": len(view)} for k, view in enumerate(views)]
    return {"options": options, "files": names}, b"".join(views)


@pytest.mark.parametrize("camera", [None, {"width": 640, "height": 480, "fx": 800, "fy": 800, "cx": 320, "cy": 240}])
def test_photographs_calibrate_print_and_camera(studio, options, camera, tmp_path, monkeypatch):
    # No more parameters of the camera than the first few are tried, which takes most of the time.
    monkeypatch.setattr(camera_choice, "_EXTRA", ())
    asked, views = photographed(studio, options, 5)
    *stages, calibration = studio.post(
        "calibrate", json.dumps({**asked, "camera": camera}).encode() + b"\n" + views
    ).lines
    assert stages[-1]["done"] == stages[-1]["total"]
    assert "a pose error of" in calibration["verdict"]
    assert list(calibration["files"]) == ["measured.json"] + ["camera.yaml"] * (camera is None)
    for name, text in calibration["files"].items():
        (tmp_path / name).write_text(text)
    assert mg.Marker.load(tmp_path / "measured.json").places_measured
    if camera is None:
        assert mg.Camera.load(tmp_path / "camera.yaml").fx == pytest.approx(800, rel=0.02)


def test_what_calibrates_nothing_is_refused(studio, options):
    asked, views = photographed(studio, options, 2)
    [error] = [
        line["error"] for line in studio.post("calibrate", json.dumps(asked).encode() + b"\n" + views).lines[-1:]
    ]
    assert "photographs" in error["line"]
    assert "/tmp" not in error["line"]
    for files in (None, [], [{"name": "a", "size": 3}], [{"name": "a", "size": -1}], "a"):
        refused = studio.post("calibrate", json.dumps({**asked, "files": files}).encode() + b"\n" + views).lines[-1]
        assert refused["error"]["line"].startswith("expected photographs with their sizes")


@pytest.mark.parametrize("camera", [None, "phone", "webcam"])
def test_a_photograph_is_found_where_the_camera_is_a_typical_one(studio, options, camera):
    """Its size and calibration are not those of the photograph: there are dots, and no pose."""
    view = studio.post("view", {"options": options, "pose": {"tilt": 30, "azimuth": 20, "distance": 0.8}})
    asked = json.dumps({"options": options, "camera": camera, "camera_covariance": [1.0, 1.0, 1.0, 1.0]}).encode()
    findings = studio.post("detect", asked + b"\n" + view.data, X_Name="photo.png").json
    assert (findings["found"], len(findings["dots"]), findings["pose"]) == (True, 4, None)


def test_a_photograph_without_the_marker_says_why(studio, options):
    blank = bytes(cv2.imencode(".png", np.full((480, 640), 200, np.uint8))[1])
    asked = json.dumps({"options": options}).encode() + b"\n"
    findings = studio.post("detect", asked + blank, X_Name="blank.png").json
    assert (findings["found"], findings["pose"], findings["dots"]) == (False, None, [])
    assert findings["why"].startswith("found 0 dots")
    for data, message in ((b"", "caf\u00e9.png"), (b"not a picture", "caf\u00e9.png"), (blank[:200], "caf\u00e9.png")):
        refused = studio.post("detect", asked + data, X_Name="caf%C3%A9.png")
        assert refused.status == 422
        assert message in refused.json["line"]
    other = json.dumps({"options": options, "camera": {"width": 10, "height": 10}}).encode() + b"\n"
    assert studio.post("detect", other + blank).status == 422


def test_a_rig_is_seen_exported_and_found(studio, pair):
    asked = {"rig": json.loads(rig_to_json(pair))}
    view = studio.post("view", {**asked, "pose": {"tilt": 20, "azimuth": 0, "distance": 0.4}})
    assert view.status == 200, view.data
    assert (dots_of(view.data, json.loads(view.headers["x-dots"]))[[1, 2, 3, 5, 6, 7]] < 60).all()
    assert studio.post("export", {**asked, "suffix": ".json"}).data == rig_to_json(pair)
    refused = studio.post(
        "scene", {"rig": {"format": "markergen-rig", "markers": [{"name": "a", "file": "/etc/passwd"}]}}
    )
    assert "its markers inside" in refused.json["line"]


@pytest.mark.parametrize(("data", "printed"), [(b"{n: 5}", "'{n: 5}'"), (b"[1]", "'[1]'"), (b"\xff", "'\ufffd'")])
def test_what_is_no_json_is_shown_as_text(data, printed):
    with pytest.raises(InputError) as refused:
        parsed_request(data)
    assert refused.value.args[1] == printed
