"""The node for ROS 2, with stand-ins for rclpy and messages: images of any layout, and covariances as ROS has them."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from markergen_detect import DescriptionError

import markergen as mg
from markergen.maths.rotation import exponential
from markergen.model.boundary import Circle
from markergen.model.marker import build_marker
from markergen.render import Optics, render_view
from tests.support.rigs import cube
from tests.support.ros2 import Node, put_in_place

PACKAGE = Path(__file__).parents[2] / "examples" / "ros2"
CAMERA = mg.Camera(320, 240, 400, 400, 159.5, 119.5)
POSE = exponential(np.array([0.5, 0.3, 0.1])) @ np.diag([1.0, -1, -1]), np.array([0.01, -0.02, 0.5])
POINTS = np.array([[0.05, 0.05], [-0.05, 0.05], [-0.05, -0.05], [0.05, -0.05], [0.01, 0.0]])
INFO = {"width": 320, "height": 240, "distortion_model": "plumb_bob", "d": [0.0] * 5, "k": CAMERA.matrix.ravel()}
INFO |= {"binning_x": 0, "binning_y": 0}


@pytest.fixture
def ros(monkeypatch):
    put_in_place(monkeypatch)
    monkeypatch.syspath_prepend(str(PACKAGE))
    from markergen_ros import images, node

    yield SimpleNamespace(array_of=images.array_of, Node=node.MarkerNode)
    for name in [name for name in sys.modules if name.startswith("markergen_ros")]:
        del sys.modules[name]


def message(image, encoding, pad=0, big=False):
    rows = image.astype(image.dtype.newbyteorder(">" if big else "<"))
    rows = rows.reshape(len(image), -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=7)
    size = {"height": image.shape[0], "width": image.shape[1], "step": rows.shape[1], "is_bigendian": int(big)}
    return SimpleNamespace(**size, encoding=encoding, data=rows.tobytes(), header=header())


def header():
    return SimpleNamespace(stamp=3, frame_id="camera_optical")


@pytest.mark.parametrize(
    ("encoding", "channels", "kind"),
    [("mono8", [0], np.uint8), ("mono16", [0], np.uint16), ("8UC3", [0, 1, 2], np.uint8), ("bgr8", [0, 1, 2], np.uint8),
     ("rgb8", [2, 1, 0], np.uint8), ("rgb16", [2, 1, 0], np.uint16), ("bgra8", [0, 1, 2, 3], np.uint8),
     ("rgba8", [2, 1, 0, 3], np.uint8)],
)  # fmt: skip
@pytest.mark.parametrize(("pad", "big"), [(0, False), (5, True)])
def test_images_of_any_layout_are_those_of_opencv(ros, encoding, channels, kind, pad, big):
    truth = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (4, 6, len(channels))).astype(kind)
    result = ros.array_of(message(truth[..., channels], encoding, pad, big))
    np.testing.assert_array_equal(result, truth[..., 0] if len(channels) == 1 else truth)
    assert result.dtype == kind


def test_other_images_are_refused_in_a_line(ros):
    bayer = message(np.zeros((4, 6), np.uint8), "bayer_rggb8")
    with pytest.raises(DescriptionError, match=r"found bayer_rggb8; convert it, as image_proc does$"):
        ros.array_of(bayer)
    short = message(np.zeros((4, 6), np.uint8), "mono8")
    short.data = short.data[:-1]
    with pytest.raises(DescriptionError, match="expected 4 rows of at least 6 bytes, found 23 bytes with step 6"):
        ros.array_of(short)


def node_for(ros, monkeypatch, **parameters):
    monkeypatch.setattr(Node, "parameters", parameters)
    return ros.Node()


def turn(quaternion):
    """Rotation of a unit quaternion by its definition, v -> q v q*."""
    w, v = quaternion.w, np.array([quaternion.x, quaternion.y, quaternion.z])
    assert w**2 + v @ v == pytest.approx(1)
    return np.column_stack([e + 2 * np.cross(v, np.cross(v, e) + w * e) for e in np.eye(3)])


def test_the_pose_and_its_covariance_are_as_ros_means_them(ros, monkeypatch, tmp_path):
    """The covariance against that of the dots' pixels, by differences along and about the fixed axes of the camera."""
    marker = build_marker(POINTS, Circle(0.085), diameter=0.02, clearance=0.002)
    marker.save(tmp_path / "marker.json")
    node = node_for(ros, monkeypatch, markers=f"dock={tmp_path / 'marker.json'}", print_sigma=1e-7)
    image = message(render_view(marker, CAMERA, *POSE, Optics(), np.random.default_rng(0)), "mono8", pad=3)
    node.callbacks["image"](image)
    assert not any(node.published.values())
    node.callbacks["camera_info"](SimpleNamespace(**INFO))
    node.callbacks["image"](image)
    assert not node.errors
    assert node.before[0].ok, node.before[0].reason
    (pose,), (transform,), (dots,) = (node.published[topic] for topic in ("~/dock/pose", "/tf", "~/dots"))
    at, covariance = pose.pose.pose.position, np.reshape(pose.pose.covariance, (6, 6))
    translation, rotation = np.array([at.x, at.y, at.z]), turn(pose.pose.pose.orientation)
    np.testing.assert_allclose(translation, POSE[1], atol=2e-3)
    np.testing.assert_allclose(rotation, POSE[0], atol=0.01)

    finding = node.before[0]

    def pixels(step):
        rotated, moved = exponential(step[3:]) @ rotation, translation + step[:3]
        return CAMERA.project(marker.xyz[finding.ids], rotated[None], moved[None])[0]

    slopes = np.stack([(pixels(e) - pixels(-e)) / 2e-6 for e in 1e-6 * np.eye(6)], axis=-1)
    weights = np.linalg.inv(finding.pixel_covariance)
    expected = np.linalg.inv(np.einsum("kia,kij,kjb->ab", slopes, weights, slopes))
    scale = np.trace(covariance) / np.trace(expected)  # chi2 over its degrees of freedom, if that is above 1
    np.testing.assert_allclose(covariance, scale * expected, rtol=0.02, atol=1e-3 * scale * np.abs(expected).max())
    assert scale >= 0.98

    assert transform.child_frame_id == dots.ns == "dock"
    assert transform.header.frame_id == pose.header.frame_id == dots.header.frame_id == "camera_optical"
    assert vars(transform.transform.translation) == vars(at)
    assert [[p.x, p.y, p.z] for p in dots.points] == marker.xyz.tolist()
    assert dots.scale.x == 0.02


def test_a_rig_is_a_body_of_its_own(ros, monkeypatch, tmp_path):
    rig = cube()
    rig.save(tmp_path / "cube.json")
    node = node_for(ros, monkeypatch, markers=str(tmp_path / "cube.json"))
    node.callbacks["camera_info"](SimpleNamespace(**INFO))
    rotation, translation = exponential(np.array([2.2, 0.4, 0.5])), np.array([0, 0, 0.35])
    image = render_view(rig, CAMERA, rotation, translation, Optics(), np.random.default_rng(0))
    node.callbacks["image"](message(image, "mono8"))
    assert not node.errors
    (pose,) = node.published["~/cube/pose"]
    np.testing.assert_allclose(turn(pose.pose.pose.orientation), rotation, atol=0.02)


def test_what_is_wrong_is_logged_in_a_line(ros, monkeypatch, tmp_path):
    node = node_for(ros, monkeypatch, markers=str(tmp_path / "missing.json"))
    node.callbacks["camera_info"](SimpleNamespace(**INFO))
    node.callbacks["camera_info"](SimpleNamespace(**(INFO | {"k": [0.0] * 9})))
    node.callbacks["image"](message(np.zeros((4, 6), np.uint8), "mono8"))
    missing, uncalibrated = node.errors
    assert "missing.json" in missing
    assert "focal lengths above 0" in uncalibrated
    assert "\n" not in missing + uncalibrated


def test_the_package_lists_its_files_and_what_it_imports():
    setup = (PACKAGE / "setup.py").read_text()
    assert (PACKAGE / "resource" / "markergen_ros").exists()
    for name in re.findall(r'"(package\.xml|launch/\w+\.py)"', setup):
        assert (PACKAGE / name).exists()
    imported = set()
    for path in PACKAGE.rglob("*.py"):
        imported |= set(re.findall(r"^from (\w+)|^import (\w+)", path.read_text(), re.MULTILINE))
    packages = {first or second for first, second in imported}
    declared = set(re.findall(r"<exec_depend>(\w+)<", (PACKAGE / "package.xml").read_text()))
    assert {name for name in packages if name.endswith(("_msgs", "_ros", "rclpy"))} <= declared | {"markergen_ros"}
