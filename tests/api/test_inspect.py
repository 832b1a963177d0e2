"""What inspect shows of each kind of file, against numbers by hand; and conversions, read back by other programs."""

import json
import math

import cv2
import ezdxf
import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

import markergen as mg
from markergen.geometry.contour import area
from markergen.model.camera import Camera, Distortion
from markergen.model.pose_sources.cone import Cone
from markergen.read.cameras.covariance import camera_covariance
from markergen.read.outlines.boundary import parse_boundary, read_contours
from markergen.read.poses import read_poses
from markergen.read.templates import template_text

LENS = Distortion("radtan", (0.1, -0.2, 0.001, -0.002))
CAMERA = Camera(1280, 720, 900.0, 905.0, 640.0, 361.0, LENS)
R, T = Cone((0.5, 1.2), (5, 60), count=9).sample()
PLATE = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="50mm" viewBox="0 0 100 50">'
    '<path d="M0 0H90A10 10 0 0 1 100 10V50H0Z"/><circle cx="20" cy="20" r="5"/></svg>'
)


@pytest.fixture
def poses_file(tmp_path):
    path = tmp_path / "poses.csv"
    rows = np.column_stack([T, Rotation.from_matrix(R).as_quat()])
    path.write_text("tx,ty,tz,qx,qy,qz,qw\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist()))
    return path


def test_a_camera(tmp_path):
    path = tmp_path / "camera.yaml"
    CAMERA.save(path)
    inspection = mg.inspect(path, plot=tmp_path / "a.svg", json=tmp_path / "a.json")
    (facts,) = inspection.facts
    assert facts.values == json.loads((tmp_path / "a.json").read_text())["camera"]
    assert facts.values["format"] == "opencv"
    # By OpenCV's own inverse of the lens.
    edges = np.array([[-0.5, 361.0], [1279.5, 361.0], [-0.5, -0.5], [1279.5, 719.5]])
    rays = np.zeros((4, 2))
    for _ in range(200):  # Fixed point of OpenCV's projection.
        ends, _ = cv2.projectPoints(np.column_stack([rays, np.ones(4)]), np.zeros(3), np.zeros(3), CAMERA.matrix,
                                    np.array(LENS.coefficients))  # fmt: skip
        rays += (edges - ends[:, 0]) / CAMERA.focal
    angles = np.rad2deg(np.arctan(np.linalg.norm(rays, axis=1)))
    view = facts.values["field_of_view_deg"]
    assert view["horizontal"] == pytest.approx(angles[:2].sum(), abs=0.06)
    assert view["diagonal"] == pytest.approx(angles[2:].sum(), abs=0.06)
    corner = CAMERA.focal * rays[2] + [CAMERA.cx, CAMERA.cy]
    assert facts.values["corner_distortion_px"][0] == pytest.approx(math.dist(corner, edges[2]), abs=0.006)
    assert (tmp_path / "a.svg").read_bytes().startswith(b"<?xml")
    assert not inspection.remarks


def test_what_is_odd_of_a_camera_and_not_used(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({
        "image_width": 1080, "image_height": 1920, "camera_matrix": [[1000, 0, 960], [0, 1000, 540], [0, 0, 1]],
        "distortion_coefficients": [0.0] * 5, "gamma_table": 7,
    }))  # fmt: skip
    inspection = mg.inspect(path)
    values = json.loads(inspection.to_json())
    assert len(values["unused"]) == 1
    assert "gamma_table" in values["unused"][0]
    assert "width and height exchanged" in values["warnings"][0]
    assert "1080 x 1920 px" in str(inspection)


@pytest.mark.parametrize("name", ["a.yaml", "a.xml", "a.json", "a.ros.yaml", "a.kalibr.yaml", "a.toml", "cameras.txt"])
def test_cameras_are_converted_between_all_formats(tmp_path, name):
    first, second = tmp_path / "first.toml", tmp_path / name
    CAMERA.save(first)
    mg.inspect(first, to=second)
    back = Camera.load(second)
    np.testing.assert_allclose(back.matrix, CAMERA.matrix, atol=1e-9)
    coefficients = [*back.distortion.coefficients, 0.0][:5]
    np.testing.assert_allclose(coefficients, [*LENS.coefficients, 0.0], atol=1e-12)


def test_what_a_target_cannot_hold_is_refused(tmp_path):
    path = tmp_path / "wide.toml"
    Camera(640, 480, 300.0, 300.0, 320.0, 240.0, Distortion("rational", (0.1,) * 8)).save(path)
    with pytest.raises(mg.InputError, match="a lens that"):
        mg.inspect(path, to=tmp_path / "a.kalibr.yaml")
    CAMERA.save(tmp_path / "sd.yaml", covariance=np.diag([1.0, 1, 1, 1, 1e-4, 1e-4, 1e-6, 1e-6]))
    mg.inspect(tmp_path / "sd.yaml", to=tmp_path / "sd.xml")
    covariance = camera_covariance(None, tmp_path / "sd.xml", CAMERA)
    assert covariance[0, 0] == 1
    (tmp_path / "plate.svg").write_text(PLATE)
    with pytest.raises(mg.InputError, match="without arcs"):
        mg.inspect(tmp_path / "plate.svg", to=tmp_path / "plate.geojson")
    assert not (tmp_path / "plate.geojson").exists()
    with pytest.raises(mg.InputError, match=r"known endings: .*\.dxf"):
        mg.inspect(tmp_path / "plate.svg", to=tmp_path / "plate.step")


def test_a_matrix_without_the_size_of_images(tmp_path):
    path = tmp_path / "calibration_matrix.yaml"
    path.write_text(
        "camera_matrix:\n- [900, 0, 640]\n- [0, 905, 361]\n- [0, 0, 1]\ndist_coeff:\n- [0.1, -0.2, 0, 0, 0]\n"
    )
    with pytest.raises(mg.InputError, match="--image-size"):
        mg.inspect(path)
    assert mg.inspect(path, image_size="1280x720").facts[0].values["width"] == 1280
    assert Camera.load(f"{path}#1280x720").height == 720
    with pytest.raises(mg.InputError, match="640x480"):
        mg.inspect(path, image_size="wide")


@pytest.mark.parametrize("name", ["b.csv", "b.json", "b.tum", "b.kitti.txt", "images.txt", "transforms.json"])
def test_poses_are_converted_between_all_formats(tmp_path, poses_file, name):
    target = tmp_path / name
    mg.inspect(poses_file, to=target)
    back = read_poses(target)
    np.testing.assert_allclose(back.rotation, R, atol=1e-11)
    np.testing.assert_allclose(back.translation, T, atol=1e-11)
    facts = mg.inspect(target, plot=tmp_path / "a.png").facts[0].values
    assert facts["count"] == facts["from_the_front"] == 9
    assert facts["distance_m"]["min"] == pytest.approx(np.linalg.norm(T, axis=1).min())
    assert facts["axes"] == ("opengl" if name == "transforms.json" else "opencv")
    rows = [mg.inspect(poses_file, poses_unit=unit).facts[0].rows["read as"] for unit in (None, "mm")]
    assert [row.partition(", in ")[2] for row in rows] == ["", "mm"]


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        (lambda q, t: (q, t), ""),
        (lambda q, t: (np.roll(q, 1, axis=1), t), "had the quaternion's w first"),
        (lambda q, t: (q, 200 * t), "is the unit another"),
        (lambda q, t: (q, t * [1, -1, -1]), "look at the marker's front"),
        (lambda q, t: (q, -t), "look at the marker's front"),
    ],
)
def test_poses_that_do_not_look_at_the_marker(tmp_path, change, phrase):
    q, t = change(Rotation.from_matrix(R).as_quat(), T)
    path = tmp_path / "poses.csv"
    rows = np.column_stack([t, q])
    path.write_text("tx,ty,tz,qx,qy,qz,qw\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist()))
    remarks = " ".join(mg.inspect(path).remarks)
    assert (phrase in remarks) if phrase else not remarks


def test_an_outline_as_other_programs_read_it(tmp_path):
    path = tmp_path / "plate.svg"
    path.write_text(PLATE)
    expected = 5000 - 100 + 25 * math.pi - 25 * math.pi
    facts = mg.inspect(path, to=tmp_path / "plate.dxf", plot=tmp_path / "plate.png").facts[0]
    values = facts.values
    assert facts.rows["outlines"] == "1, with 1 hole"
    assert values["area_m2"] * 1e6 == pytest.approx(expected)
    assert (values["outlines"], values["holes"], values["lines"], values["arcs"]) == (1, 1, 4, 3)
    np.testing.assert_allclose(values["size_m"], (0.1, 0.05))
    kept, moved = (parse_boundary(str(path), origin=origin) for origin in ("file", "center"))
    np.testing.assert_allclose(kept.outlines()[0] - values["center_m"], moved.outlines()[0], atol=1e-9)
    model = ezdxf.readfile(tmp_path / "plate.dxf").modelspace()
    (circle,), (line,) = model.query("CIRCLE"), model.query("LWPOLYLINE")
    assert circle.dxf.radius == pytest.approx(5)
    assert len(line) == 5
    mg.inspect(tmp_path / "plate.dxf", to=tmp_path / "again.svg")
    (outer, hole), first = read_contours(tmp_path / "again.svg"), read_contours(path)
    assert area(outer) == pytest.approx(area(first[0]), rel=1e-9)
    np.testing.assert_allclose(hole.as_circle, first[1].as_circle, atol=1e-12)
    assert (tmp_path / "plate.dxf").read_bytes() == _again(path, tmp_path / "twice.dxf")


def _again(path, target):
    mg.inspect(path, to=target)
    return target.read_bytes()


def test_an_outline_without_arcs_as_geojson(tmp_path):
    path = tmp_path / "plate.svg"
    path.write_text(PLATE.replace("A10 10 0 0 1 100 10", "L100 10").replace("<circle", "<g").replace('r="5"/>', "/>"))
    mg.inspect(path, to=tmp_path / "plate.geojson")
    shape = shapely.from_geojson((tmp_path / "plate.geojson").read_text())
    assert shape.area * 1e6 == pytest.approx(4950)


def test_a_file_of_two_kinds_and_of_none(tmp_path, poses_file):
    path = tmp_path / "transforms.json"
    mg.inspect(poses_file, to=path)
    content = json.loads(path.read_text()) | {"fl_x": 900, "fl_y": 900, "cx": 640, "cy": 360, "w": 1280, "h": 720}
    path.write_text(json.dumps(content))
    assert [facts.kind for facts in mg.inspect(path).facts] == ["camera", "poses"]
    with pytest.raises(mg.InputError, match="--kind camera or --kind poses"):
        mg.inspect(path, to=tmp_path / "a.json")
    mg.inspect(path, kind="camera", to=tmp_path / "a.json")
    mg.inspect(path, to=tmp_path / "a.csv")
    secret = tmp_path / "passwd"
    secret.write_text("root:x:0:0:root:/root:/bin/bash\n")
    with pytest.raises(mg.InputError) as caught:
        mg.inspect(secret)
    assert "root:" not in str(caught.value)
    with pytest.raises(mg.InputError, match="known --kind"):
        mg.inspect(path, kind="photograph")


def test_markers_specs_and_points(tmp_path):
    marker = mg.design(n=4, dot="20mm", restarts=2).marker
    marker.save(tmp_path / "m.json")
    facts = mg.inspect(tmp_path / "m.json", plot=tmp_path / "m.svg").facts[0]
    assert (facts.kind, facts.values["dots"]) == ("marker", 4)
    with pytest.raises(mg.InputError, match="to convert"):
        mg.inspect(tmp_path / "m.json", to=tmp_path / "m.csv")
    (tmp_path / "s.toml").write_text(
        'n = 6\nradius = "80mm"\n[camera]\nwidth=640\nheight=480\nfx=800\nfy=800\ncx=320\ncy=240\n'
    )
    facts = mg.inspect(tmp_path / "s.toml").facts[0]
    assert facts.kind == "spec"
    assert "80 mm" in facts.values["boundary"]
    (tmp_path / "p.csv").write_text("id,x_mm,y_mm\n0,1,2\n1,30,2\n2,1,40\n3,5,-6\n")
    assert mg.inspect(tmp_path / "p.csv").facts[0].values["count"] == 4


def test_a_spec_of_a_rig(tmp_path):
    (tmp_path / "cube.toml").write_text(template_text("cube"))
    (facts,) = mg.inspect(tmp_path / "cube.toml").facts
    assert facts.kind == "spec"
    assert facts.rows["shape"] == "'cube'"
    (tmp_path / "cube.toml").write_text(template_text("cube").replace('"pose"', '"poe"'))
    with pytest.raises(mg.InputError, match="poe"):
        mg.inspect(tmp_path / "cube.toml")


@pytest.mark.parametrize(
    ("option", "value", "kind"),
    [("image_size", "640x480", "camera"), ("poses_unit", "mm", "poses"), ("ignore_open", True, "outline")],
)
def test_options_of_another_kind_are_refused(tmp_path, option, value, kind):
    path = tmp_path / "marker.json"
    mg.design(n=4, dot="20mm", restarts=2).marker.save(path)
    with pytest.raises(mg.InputError, match=f"kind {kind} for --{option.replace('_', '-')}, found kind marker"):
        mg.inspect(path, **{option: value})


def test_what_is_no_path_is_refused():
    with pytest.raises(mg.InputError, match=r"a path, found 3\.0"):
        mg.inspect(3.0)
