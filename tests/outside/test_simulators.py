"""Simulator models in Gazebo's own reader, and in MuJoCo's pictures, where our detector finds the marker."""

import os
import subprocess
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from programs import program

from markergen.detect import Detector
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.maths.rotation import angle_between
from markergen.model.camera import Camera
from markergen.model.fabrication import Fabrication
from markergen.model.tag import Tag
from tests.support.rigs import cube

# Without a screen.
os.environ.setdefault("MUJOCO_GL", "egl")
mujoco = pytest.importorskip("mujoco")

PROCESSES = ["fdm", "cnc", "laser", "dome"]
WIDTH, HEIGHT, FOCAL = 960, 720, 1100.0


@pytest.fixture(scope="module")
def marker(make_ngon):
    return replace(make_ngon(5, 0.06, 0.012), tag=Tag("apriltag:36h11", 3, 0.02))


@pytest.fixture(scope="module")
def written(marker, tmp_path_factory):
    folders = {}
    for process in PROCESSES:
        folders[process] = tmp_path_factory.mktemp(process)
        made = replace(marker, tag=None) if process == "dome" else marker
        paths = [folders[process] / f"a b{suffix}" for suffix in (".sdf", ".urdf", ".mjcf.xml")]
        save(made, paths, ExportOptions(fabrication=Fabrication(process, engrave=False)))
    return folders


def by_ign(*phrase: str) -> str:
    result = subprocess.run(
        [program("libignition-tools-dev", "ign"), "sdf", *phrase],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "Error [" not in result.stderr
    assert "Warning [" not in result.stderr
    return result.stdout


@pytest.mark.parametrize("process", PROCESSES)
def test_gazebo_calls_the_sdf_valid(process, written):
    assert by_ign("-k", str(written[process] / "a b.sdf")).strip() == "Valid."


@pytest.mark.parametrize("suffix", [".sdf", ".urdf"])
@pytest.mark.parametrize("process", PROCESSES)
def test_gazebo_puts_the_meshes_into_the_frame_of_the_link(process, suffix, written):
    model = ElementTree.fromstring(by_ign("-p", str(written[process] / f"a b{suffix}")))
    assert [link.get("name") for link in model.iter("link")] == ["marker"]
    visuals = model.findall(".//visual")
    meshes = [visual.find("geometry/mesh") for visual in visuals]
    assert [mesh.find("uri").text for mesh in meshes] == ["meshes/a b-light.stl", "meshes/a b-dark.stl"]
    assert all((mesh.findtext("scale") or "1 1 1") == "1 1 1" for mesh in meshes)
    for pose in (*model.findall(".//link/pose"), *(visual.find("pose") for visual in visuals)):
        assert [float(word) for word in pose.text.split()] == [0] * 6
    grey = [float(visual.findtext("material/diffuse").split()[0]) for visual in visuals]
    # It rounds colors of a URDF up to some eighths.
    assert grey[0] == 1
    assert grey[1] < 0.13


def photograph(path, center: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """View by a camera at a center (3,) with rows of axes (3, 3), OpenCV's, in the marker frame."""
    scene = mujoco.MjSpec.from_file(str(path))
    scene.visual.headlight.ambient = [0.5, 0.5, 0.5]
    scene.visual.global_.offwidth, scene.visual.global_.offheight = WIDTH, HEIGHT
    # It looks along its -z, with y up.
    axes = rotation.T @ np.diag([1, -1, -1])
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    fovy = np.degrees(2 * np.arctan(HEIGHT / 2 / FOCAL))
    scene.worldbody.add_camera(name="camera", pos=center, quat=quaternion, fovy=fovy)
    scene.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.01], pos=[0, 0, -0.05], rgba=[0.6, 0.6, 0.6, 1]
    )
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    except Exception as error:
        pytest.skip(f"no GL without a screen: {error}")
    renderer.update_scene(data, camera="camera")
    image = renderer.render().mean(axis=-1).astype(np.uint8)
    renderer.close()
    return image


def looking_at_origin(center: np.ndarray) -> np.ndarray:
    """Rows of a camera's axes (3, 3) at a center (3,)."""
    ahead = -center / np.linalg.norm(center)
    right = np.cross(ahead, [0.3, 1, 0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


@pytest.mark.parametrize("process", ["fdm", "laser"])
def test_in_a_picture_by_mujoco_the_marker_is_where_it_is(process, marker, written):
    center = np.array([0.06, -0.12, 0.25])
    rotation = looking_at_origin(center)
    image = photograph(written[process] / "a b.mjcf.xml", center, rotation)
    camera = Camera(WIDTH, HEIGHT, FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    (finding,) = Detector(marker, camera)(image)
    pose = finding.pose
    # Measured: 0.007 degrees and 0.035 mm; OpenGL samples an edge at few points of a pixel.
    assert np.degrees(angle_between(pose.rotation, rotation)) < 0.05
    assert np.linalg.norm(pose.translation + rotation @ center) < 1e-4


@pytest.mark.parametrize("process", ["fdm", "laser"])
def test_in_pictures_by_mujoco_every_face_of_a_cube_is_where_it_is(process, tmp_path):
    rig = cube(0.08, seed=3, n=6, diameter=0.014)
    save(rig, [tmp_path / "cube.mjcf.xml"], ExportOptions(fabrication=Fabrication(process)))
    camera = Camera(WIDTH, HEIGHT, FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    for marker in rig.markers:
        center = 0.3 * marker.rotation_matrix[:, 2] + np.array([0.06, -0.05, 0.07])
        rotation = looking_at_origin(center)
        image = photograph(tmp_path / "cube.mjcf.xml", center, rotation)
        (finding,) = Detector(marker.marker, camera)(image)
        wanted, offset = marker.camera_pose(rotation, -rotation @ center)
        # Measured: at most 0.09 degrees and 0.09 mm, at 25 to 40 degrees of tilt.
        assert np.degrees(angle_between(finding.pose.rotation, wanted)) < 0.2
        assert np.linalg.norm(finding.pose.translation - offset) < 2e-4
