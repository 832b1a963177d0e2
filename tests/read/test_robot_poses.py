"""Poses of robots as their controllers write them, against rotations made by other means."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markergen.errors import InputError
from markergen.read.robot_poses import BASE_IN_FLANGE, FLANGE_IN_BASE, RobotConvention, robot_poses

NAMES = ("0", "10", "12", "2")
PHOTOS = [Path(f"photos/{name}.png") for name in NAMES]
TURNS = Rotation.random(4, random_state=1)
PLACES = np.random.default_rng(0).normal(0, 0.5, (4, 3))
QUATERNIONS = TURNS.as_quat()
STATED = {"frame": FLANGE_IN_BASE, "unit": "mm"}


def axis(name, degrees):
    return Rotation.from_rotvec(np.deg2rad(degrees) * np.eye(3)["xyz".index(name)])


def table(header, values, names=NAMES, mark=","):
    rows = [mark.join([name, *(repr(float(value)) for value in row)]) for name, row in zip(names, values, strict=True)]
    return "\n".join([header, *rows]) + "\n"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def reading(text, name="poses.csv", **convention):
    Path(name).write_text(text)
    return robot_poses(name, PHOTOS, RobotConvention(**convention))


def check(poses, count=4):
    assert len(poses) == count
    for k, (rotation, translation) in poses.items():
        np.testing.assert_allclose(rotation, TURNS[k].as_matrix(), atol=1e-6)
        np.testing.assert_allclose(translation, PLACES[k], atol=1e-8)


def refusal(text, name="poses.csv", **convention):
    with pytest.raises(InputError) as raised:
        reading(text, name, **convention)
    assert "\n" not in str(raised.value)
    return raised.value


MM = 1e3 * PLACES
CASES = {
    "quaternion by name": ("photo,x,y,z,qx,qy,qz,qw", np.c_[MM, QUATERNIONS], {}),
    "quaternion in other order": ("image,x,y,z,qw,qx,qy,qz", np.c_[MM, QUATERNIONS[:, [3, 0, 1, 2]]], {}),
    "ABB": ("file,x,y,z,q1,q2,q3,q4", np.c_[MM, QUATERNIONS[:, [3, 0, 1, 2]]], {"rotation": "abb"}),
    "quaternion stated": ("file,x,y,z,q1,q2,q3,q4", np.c_[MM, QUATERNIONS], {"rotation": "xyzw"}),
    "KUKA": ("photo,X,Y,Z,A,B,C", np.c_[MM, TURNS.as_euler("ZYX", True)], {"rotation": "kuka"}),
    "FANUC": ("photo,X,Y,Z,W,P,R", np.c_[MM, TURNS.as_euler("xyz", True)], {"rotation": "fanuc"}),
    "Staubli": ("photo,X,Y,Z,Rx,Ry,Rz", np.c_[MM, TURNS.as_euler("XYZ", True)], {"rotation": "staubli"}),
    "Yaskawa": ("photo,X,Y,Z,Rx,Ry,Rz", np.c_[MM, TURNS.as_euler("xyz", True)], {"rotation": "yaskawa"}),
    "Kawasaki": ("photo,X,Y,Z,O,A,T", np.c_[MM, TURNS.as_euler("ZYZ", True)], {"rotation": "kawasaki"}),
    "Universal Robots": ("photo,X,Y,Z,Rx,Ry,Rz", np.c_[MM, TURNS.as_rotvec()], {"rotation": "ur"}),
    "axes by name, order stated": (
        "photo,x,y,z,rx_deg,ry_deg,rz_deg",
        np.c_[MM, TURNS.as_euler("ZYX", True)[:, ::-1]],
        {"rotation": "ZYX"},
    ),
    "roll, pitch, yaw in rad": (
        "photo,x,y,z,roll,pitch,yaw",
        np.c_[MM, TURNS.as_euler("xyz")],
        {"rotation": "xyz", "angle": "rad"},
    ),
    "matrix": (
        "photo,tx,ty,tz,r11,r12,r13,r21,r22,r23,r31,r32,r33",
        np.c_[MM, TURNS.as_matrix().reshape(-1, 9)],
        {},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_rotations_of_tables(case):
    header, values, convention = CASES[case]
    check(reading(table(header, values), **STATED, **convention))


def test_named_orders_are_those_of_the_controllers():
    # By products of rotations about axes: KUKA's A about Z, B about the new Y, C about the new X; FANUC's W about X,
    # then P about Y, then R about Z, all fixed.
    angles = np.array([[20.0, -30.0, 40.0]])
    a, b, c = angles[0]
    for rotation, expected in (
        ("kuka", axis("z", a) * axis("y", b) * axis("x", c)),
        ("fanuc", axis("z", c) * axis("y", b) * axis("x", a)),
        ("staubli", axis("x", a) * axis("y", b) * axis("z", c)),
    ):
        text = table(
            "photo,x,y,z,rx,ry,rz" if rotation != "kuka" else "photo,x,y,z,a,b,c", np.c_[[[0, 0, 0]], angles], ["0"]
        )
        np.testing.assert_allclose(reading(text, **STATED, rotation=rotation)[0][0], expected.as_matrix(), atol=1e-9)


def test_the_file_may_state_everything():
    text = "# T_base_flange, unit: mm, rotation: ZYX, degrees\n" + CASES["KUKA"][0] + "\n"
    check(reading(text + table("", CASES["KUKA"][1]).lstrip()))
    check(reading(table("photo,x_mm,y_mm,z_mm,qx,qy,qz,qw", np.c_[MM, QUATERNIONS]), frame=FLANGE_IN_BASE))
    check(
        reading(table("photo;x [mm];y [mm];z [mm];qx;qy;qz;qw", np.c_[MM, QUATERNIONS], mark=";"), frame=FLANGE_IN_BASE)
    )


def test_the_inverse_direction():
    back = TURNS.inv()
    text = table("photo,x,y,z,qx,qy,qz,qw", np.c_[-back.apply(MM), back.as_quat()])
    check(reading(text, frame=BASE_IN_FLANGE, unit="mm"))
    check(reading("# gripper_from_base\n" + text, unit="mm"))


@pytest.mark.parametrize(
    ("lacking", "options"),
    [
        ({"frame"}, {"--robot-frame"}),
        ({"unit"}, {"--robot-unit"}),
        ({"rotation"}, {"--robot-rotation"}),
        ({"angle"}, {"--robot-angle"}),
        ({"frame", "unit", "rotation", "angle"}, {"--robot-frame", "--robot-unit", "--robot-rotation"}),
    ],
)
def test_what_is_not_stated_is_asked_for_in_one_line(lacking, options):
    whole = {**STATED, "rotation": "ZYX", "angle": "deg"}
    header, values, _ = CASES["KUKA"]
    error = refusal(table(header, values), **{key: value for key, value in whole.items() if key not in lacking})
    named = {
        option
        for option in ("--robot-frame", "--robot-unit", "--robot-rotation", "--robot-angle")
        if option in error.args[2]
    }
    assert named == options


def test_contradictions_are_refused():
    header, values, _ = CASES["quaternion by name"]
    assert "--robot-unit" in refusal("# unit: m\n" + table(header, values), **STATED).args[1]
    assert "kuka" in refusal(table(header, values), **STATED, rotation="kuka").args[1]
    angles = table(*CASES["KUKA"][:2])
    assert "deg" in refusal(angles, **STATED, rotation="ZYX", angle="rad").args[2]
    assert "wxyz" in refusal(angles, **STATED, rotation="wxyz").args[0]
    with pytest.raises(InputError, match="ZZY"):
        RobotConvention(rotation="ZZY")


def test_a_translation_of_kilometers_is_answered_with_the_robots_option():
    text = table("photo,x,y,z,qx,qy,qz,qw", np.c_[1e6 * PLACES, QUATERNIONS])
    assert "--robot-unit mm" in refusal(text, frame=FLANGE_IN_BASE, unit="m").args[2]


def test_photographs_are_named_with_or_without_folder_and_ending():
    header, values, _ = CASES["quaternion by name"]
    for names in (("0.png", "10.PNG", "12", "photos/2.png"), ("000", "0010", "12", "C:\\shots\\2.png")):
        check(reading(table(header, values, names), **STATED))
    # Rows of other photographs are left out, and photographs without a row.
    check(reading(table(header, values, ("0", "10", "99", "2")), **STATED), 3)
    assert "0.png" in refusal(table(header, values, ("0", "0.png", "12", "2")), **STATED).args[1]
    assert "0.png" in refusal(table(header, values, ("a", "b", "c", "d")), **STATED).args[1]
    assert "photo" in refusal(table(header.replace("photo", "speed"), values), **STATED).args[2]


def matrix(k):
    return np.vstack([np.c_[TURNS[k].as_matrix(), MM[k]], [0, 0, 0, 1]])


BESIDE = {
    "matrix as text": (".txt", lambda k: "\n".join(" ".join(map(str, row)) for row in matrix(k)), {}),
    "matrix in JSON": (".json", lambda k: json.dumps({"T_base_flange": matrix(k).tolist()}), {}),
    "keys": (
        ".flange-pose.yaml",
        lambda k: "".join(
            f"{n}: {v}\n"
            for n, v in zip(["x", "y", "z", "qx", "qy", "qz", "qw"], [*MM[k], *QUATERNIONS[k]], strict=True)
        ),
        {},
    ),
    "nested keys": (
        ".json",
        lambda k: json.dumps(
            {
                "pose": {
                    "position": dict(zip("xyz", MM[k], strict=True)),
                    "orientation": dict(zip("xyzw", QUATERNIONS[k], strict=True)),
                }
            }
        ),
        {},
    ),
    "lists": (
        ".json",
        lambda k: json.dumps({"translation": MM[k].tolist(), "rotation": QUATERNIONS[k].tolist()}),
        {"rotation": "xyzw"},
    ),
    "numbers alone": (
        "_pose.txt",
        lambda k: ", ".join(map(str, [*MM[k], *TURNS[k].as_euler("ZYX", True)])),
        {"rotation": "kuka"},
    ),
}


@pytest.mark.parametrize("case", BESIDE)
def test_files_beside_the_photographs(case, here):
    ending, write, convention = BESIDE[case]
    (here / "photos").mkdir()
    for k, name in enumerate(NAMES):
        (here / f"photos/{name}{ending}").write_text(write(k))
        (here / f"photos/{name}.png").touch()
    for source in ("photos", f"photos/*{ending}"):
        check(robot_poses(source, PHOTOS, RobotConvention(**STATED, **convention)))
    (here / "photos/0.labels.json").write_text("{}")
    with pytest.raises(InputError, match="pattern"):
        robot_poses("photos", PHOTOS, RobotConvention(**STATED, **convention))


def test_a_list_of_records():
    text = json.dumps(
        [
            {"image": f"{name}.png", "position": list(place), "quaternion": dict(zip("xyzw", rotation, strict=True))}
            for name, place, rotation in zip(NAMES, MM, QUATERNIONS, strict=True)
        ]
    )
    check(reading(text, "poses.json", **STATED))


@pytest.mark.parametrize(
    "text",
    [
        "photo,x,y,z\n0,1,2,3\n",
        "0.png,1,2,3,0,0,0,1\n",
        "photo,x,y,z,qx,qy,qz,qw\n",
        "photo,x,y,z,qx,qy,qz,qw\n0,1,2\n",
        "photo,x,y,z,qx,qy,qz,qw\n0,a,2,3,0,0,0,1\n",
        "[1]",
        "{}",
    ],
)
def test_other_files_are_refused_in_one_line(text):
    refusal(text, **STATED)
