"""Orders, units and frames that a pose file states are followed; what is open is asked about, by SciPy's rotations."""

import json
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.pose_sources.cone import Cone
from markergen.read.poses import poses_as_stated, read_poses
from markergen.read.poses.conventions import PoseConvention, column_of, stated
from markergen.read.remarks import collected_remarks
from markergen.read.spec_file import spec_from_mapping

FILE = "poses.txt"
CAMERA = PoseConvention("camera-in-marker")
R, T = Cone((0.5, 1.2), (5, 60), count=7).sample()
CENTER = -np.einsum("pji,pj->pi", R, T)
BACK = Rotation.from_matrix(R.swapaxes(1, 2))
XYZW, FORWARD = BACK.as_quat(), Rotation.from_matrix(R).as_quat()
WXYZ = np.roll(XYZW, 1, axis=1)
GL = BACK * Rotation.from_matrix(np.diag([1.0, -1, -1]))


def rows(*columns, mark=" ", head=""):
    lines = np.column_stack(columns)
    return head + "".join(mark.join(f"{value:.17g}" for value in line) + "\n" for line in lines)


STAMPS = np.arange(len(T)) + 1e9
TUM = np.column_stack([STAMPS, CENTER])


NAMES = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


def dicts(*columns, names=NAMES):
    return [dict(zip(names, row, strict=True)) for row in np.column_stack(columns).tolist()]


def same(poses):
    np.testing.assert_allclose(poses.rotation, R, atol=1e-10)
    np.testing.assert_allclose(poses.translation, T, atol=1e-10)


@pytest.mark.parametrize(
    "head",
    [
        "# timestamp tx ty tz qw qx qy qz\n", "#TIMESTAMP TX TY TZ QW QX QY QZ\n", "# time x y z q_w q_x q_y q_z\n",
        "# scalar-first quaternions\n", "# t, p, q (w, x, y, z)\n", "#\n# quaternion order: wxyz\n", "# Scalar First\n",
        "# time[s] px[m] py[m] pz[m] quat_w quat_x quat_y quat_z\n", "# w x y z\n", "# real-first\n",
        "# timestamp,tx,ty,tz,qw,qx,qy,qz\n", "# position.x position.y position.z\n# qw qx qy qz\n",
    ],
)  # fmt: skip
def test_w_first_wherever_it_is_stated(write, head):
    same(read_poses(write(rows(TUM, WXYZ, head=head))))


@pytest.mark.parametrize("head", ["", "# timestamp tx ty tz qx qy qz qw\n", "# scalar last\n", "# ground truth\n"])
def test_w_last_elsewhere(write, head):
    same(read_poses(write(rows(TUM, XYZW, head=head))))


def test_columns_in_any_order(write):
    head = "# qz qy qx qw tz ty tx timestamp\n"
    same(read_poses(write(rows(XYZW[:, [2, 1, 0, 3]], CENTER[:, ::-1], STAMPS, head=head))))


EUROC = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
MORE = ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1]"
ROS = "%time,field.header.seq," + ",".join(f"field.pose.position.{axis}" for axis in "xyz") + ","
ROS += ",".join(f"field.pose.orientation.{axis}" for axis in "xyzw")
KAPTURE = "# kapture format: 1.1\n# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz\n"
FRAMES = np.zeros((len(T), 4, 4))
FRAMES[:, :3, :3], FRAMES[:, :3, 3], FRAMES[:, 3, 3] = GL.as_matrix(), CENTER, 1
FORMATS = {
    "euroc": (rows(TUM, WXYZ, mark=",", head=EUROC + "\n"), CAMERA),
    "euroc with velocities": (rows(TUM, WXYZ, np.ones((len(T), 4)), mark=",", head=f"{EUROC}{MORE}\n"), CAMERA),
    "ros": (rows(STAMPS, STAMPS, CENTER, XYZW, mark=",", head=f"{ROS}\n"), CAMERA),
    "kitti": (rows(np.concatenate([BACK.as_matrix(), CENTER[:, :, None]], axis=2).reshape(-1, 12)), PoseConvention()),
    "kapture": (
        KAPTURE + "7, cam0, " + rows(np.roll(FORWARD, 1, axis=1), T, mark=", ").replace("\n", "\n7, cam0, ")[:-9],
        PoseConvention(),
    ),
    "nerf": (
        json.dumps({"camera_model": "OPENCV", "fl_x": 900, "w": 1280, "frames": [
            {"file_path": "a.png", "transform_matrix": frame} for frame in FRAMES.tolist()]}), PoseConvention(),
    ),
    "json of nested keys": (
        json.dumps([{"pose": {"position": p, "orientation": q}} for p, q in zip(
            dicts(CENTER, names="xyz"), dicts(XYZW, names="xyzw"), strict=True)]), CAMERA,
    ),
    "table in mm": (
        rows(1e3 * T, FORWARD, mark=",", head="tx_mm,ty [mm],tz (mm),qx,qy,qz,qw\n"), PoseConvention(),
    ),
    "trajectory in mm": (rows(STAMPS, 1e3 * CENTER, XYZW, head="# in millimeters\n"), PoseConvention()),
    "json in cm": (
        json.dumps({"unit": "cm", "poses": dicts(1e2 * T, FORWARD)}), PoseConvention(),
    ),
    "millimeters of a user": (rows(STAMPS, 1e3 * CENTER, XYZW), PoseConvention(unit="mm")),
    "opengl of a user": (rows(TUM, GL.as_quat()), PoseConvention(axes="opengl")),
    "inverse of a user": (rows(STAMPS, T, FORWARD), PoseConvention("marker-in-camera")),
    "opengl and inverse": (
        rows(STAMPS, T * [1, -1, -1], GL.inv().as_quat()), PoseConvention("marker-in-camera", "opengl"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_poses_of_every_program(write, name):
    text, convention = FORMATS[name]
    with collected_remarks() as remarks:
        same(read_poses(write(text), convention))
    assert not remarks


def test_images_of_colmap_in_bytes(write):
    quaternions = np.roll(FORWARD, 1, axis=1)
    data = struct.pack("<Q", len(T))
    for i, (q, t) in enumerate(zip(quaternions, T, strict=True)):
        data += struct.pack("<I7dI", i + 1, *q, *t, 1) + b"a/0.png\0" + struct.pack("<Q", i % 2) + b"\1" * 24 * (i % 2)
    same(read_poses(write(data, "images.bin")))
    for damaged in (data[:-1], data + b"\0"):
        with pytest.raises(InputError, match="bytes that are not text"):
            read_poses(write(damaged, "images.bin"))


def test_a_body_with_a_camera(write):
    # T_marker_body = T_marker_camera T_camera_body.
    mount = Rotation.from_rotvec([0.3, -1.2, 0.4])
    arm = np.array([0.05, -0.02, 0.11])
    rotated = BACK * mount.inv()
    file = write(rows(STAMPS, CENTER - rotated.apply(arm), rotated.as_quat()))
    body = write(rows(arm[None], mount.as_quat()[None], head="tx ty tz qx qy qz qw\n"), "arm.txt")
    options = {"poses_frame": "body", "camera_in_body": body}
    same(poses_as_stated(str(file), options))
    spec = spec_from_mapping({"poses": str(file), **options, "camera_in_body": str(body)})
    same(spec.poses)
    assert spec.poses != read_poses(file)
    with pytest.raises(InputError, match="one pose, of the camera in the body"):
        poses_as_stated(str(file), {**options, "camera_in_body": file})


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"poses_frame": "body"}, "--poses-frame body with --camera-in-body FILE, found --poses-frame body alone"),
        ({"poses_frame": "world"}, "a known --poses-frame, found 'world'"),
        ({"poses_axes": "vulkan"}, "a known --poses-axes"),
        ({"poses_axes": "opncv"}, "found 'opncv'; did you mean 'opencv'"),
        ({"poses_unit": "px"}, "a known --poses-unit"),
    ],
)
def test_options_that_say_nothing(write, options, phrase):
    path = write(rows(TUM, XYZW))
    for text, expected in ((str(path), phrase), ("paper", "a file of poses with --poses-"), (None, "a file of poses")):
        with pytest.raises(InputError) as caught:
            poses_as_stated(text, options)
        assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        (FORMATS["euroc"][0], "--poses-frame for poses.txt, found poses that may be those of a body or of a camera"),
        (FORMATS["ros"][0], "--poses-frame for poses.txt"),
        (rows(TUM, XYZW, head="# T_cam_world\n"), "a comment about world to camera"),
        (rows(TUM, XYZW, head="# poses of the IMU\n"), "poses that may be those of a body"),
        (rows(TUM, XYZW, head="# OpenGL axes\n"), "--poses-axes for poses.txt"),
        (rows(TUM, XYZW, head="# wxyz\n# scalar last\n"), "one order of the poses in poses.txt, found wxyz and xyzw"),
        (rows(TUM, XYZW, head="# scalar first\n# timestamp tx ty tz qx qy qz qw\n"), "one order of the"),
        (rows(TUM, XYZW, head="# unit: furlong\n"), "a known unit of length in poses.txt, found 'furlong'"),
        (rows(TUM, XYZW, np.ones(len(T)), head="# timestamp tx ty tz qx qy qz qw\n"), "8 columns as a comment says"),
        (rows(T, XYZW, mark=",", head="tx_mm,ty_m,tz,qx,qy,qz,qw\n"), "one known unit of length"),
        (rows(T, XYZW, mark=",", head="tx [furlong],ty,tz,qx,qy,qz,qw\n"), "one known unit of length"),
        (rows(T, BACK.as_rotvec(), mark=",", head="tx,ty,tz,rx [deg],ry [deg],rz [deg]\n"), "a rotation in rad"),
        (rows(STAMPS, 1e3 * CENTER + 1e3, XYZW), "is the unit another? Give --poses-unit mm"),
        (json.dumps({"unit": "yard", "poses": [{"tx": 0}]}), "a known unit"),
        ("# IMAGE_ID, QX, QY, QZ, QW, TX, TY, TZ\n1 1 0 0 0 0 0 1 1 a.png\n\n", "a comment with qw"),
        (rows(T, T, mark=",", head="# angles in degrees\ntx,ty,tz,rx,ry,rz\n"), "a comment about degrees"),
        (rows(T, FORWARD, mark=",", head="# pose of the camera in the world frame\ntx,ty,tz,qx,qy,qz,qw\n"),
         "a comment about camera to world"),
        (rows(TUM, XYZW, head="# world -> camera\n"), "a comment about world to camera"),
        (rows(TUM, XYZW, head="# the board's pose: marker pose relative to the camera\n"), "a comment about world to"),
        (rows(TUM, XYZW, head="# left-handed, z up\n"), "right-handed frames in poses.txt"),
        (json.dumps({"frames": [{"transform_matrix": frame, "w2c": True} for frame in FRAMES.tolist()]}),
         "a comment about world to camera"),
    ],
)  # fmt: skip
def test_contradictions_and_what_is_open_are_refused(write, text, phrase):
    with pytest.raises(InputError) as caught:
        read_poses(write(text))
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unused_columns_and_keys_are_reported(write):
    quaternion = FORWARD
    text = rows(T, quaternion, STAMPS, STAMPS, mark=",", head="tx,ty,tz,qx,qy,qz,qw,frame,scale\n")
    with collected_remarks() as remarks:
        read_poses(write(text))
    assert remarks == ["not used of line 1 of poses.txt: column scale"]
    pose = dict(zip(("tx", "ty", "tz", "qx", "qy", "qz", "qw"), [0, 0, 1, 1, 0, 0, 0], strict=True))
    with collected_remarks() as remarks:
        read_poses(write(json.dumps({"rate": 30, "poses": [pose]})))
    assert remarks == ["not used of poses.txt: rate"]
    frames = [
        {"file_path": "a.png", "sharpness": 9, "exposure": 1, "transform_matrix": frame} for frame in FRAMES.tolist()
    ]
    with collected_remarks() as remarks:
        read_poses(write(json.dumps({"frames": frames})))
    assert remarks == ["not used of poses.txt: exposure"]


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("tx", "tx"), ("X", "tx"), ("p_RS_R_z [m]", "tz"), ("field.pose.position.y", "ty"),
        ("translation.x", "tx"),
        ("qw", "qw"), ("Q_x", "qx"), ("q_RS_w []", "qw"), ("pose.orientation.z", "qz"), ("rotation.w", "qw"),
        ("rx", "rx"), ("r12", "r12"), ("#timestamp [ns]", "time"), ("%time", "time"),
        ("field.header.stamp.secs", "time"),
        ("frame_id", "ignored"), ("v_RS_R_x [m s^-1]", "ignored"), ("roll", ""), ("scale", ""), ("qa", ""),
    ],
)  # fmt: skip
def test_names_of_columns(name, kind):
    assert column_of(name).kind in (kind, "ignored" if kind == "time" else kind)


def test_comments_about_other_things_state_nothing():
    for text in (
        "ground truth trajectory",
        "file: rgbd_dataset_freiburg1_xyz.bag",
        "created by evo",
        "x y z are positions",
        "camera intrinsics of the world's largest lens",
        "quaternions of unity norm",
    ):
        assert stated([text], "x") == {}


@pytest.mark.parametrize(
    ("poses", "phrase"),
    [
        (rows(TUM, WXYZ), "had the quaternion's w first"),
        (rows(STAMPS, 400 * CENTER, XYZW), "px wide: is the unit another?"),
        (rows(STAMPS, T, FORWARD), "held their inverses"),
    ],
)
def test_other_conventions_are_tried(write, poses, phrase):
    recorded = read_poses(write(poses))
    try:
        doubt = recorded.seen_whole(Circle(0.05), PAPER_CAMERA).doubt
    except InputError as error:
        doubt = str(error)
    assert phrase in doubt
