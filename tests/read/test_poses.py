"""Files of poses: every format means what its sentence says, and what is wrong is told with its place."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sentences import pattern

from markergen import guard
from markergen.errors import InputError
from markergen.model.body_json import from_json, to_json
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.pose_sources.cone import Cone
from markergen.model.poses import POSES, paper
from markergen.model.recorded_poses import RecordedPoses
from markergen.optimize.design import design
from markergen.read.poses import POSE_FORMATS, poses_from, read_poses
from markergen.read.poses.rows import numbers_of_rows
from markergen.read.spec_file import spec_from_mapping
from markergen.validation.setting import setting_of

FILE = "poses.txt"

QUATERNION = "tx,ty,tz,qx,qy,qz,qw"
GOOD = "0,0,1,1,0,0,0"


def numbers(row, mark=","):
    return mark.join(f"{value:.17g}" for value in row)


def table(header, rows, mark=","):
    return mark.join(header) + "\n" + "".join(numbers(row, mark) + "\n" for row in rows)


def as_csv(rotation, translation, mark=","):
    rows = np.concatenate([Rotation.from_matrix(rotation).as_quat(), translation], axis=-1)
    return table(["qx", "qy", "qz", "qw", "tx", "ty", "tz"], rows, mark)


def as_vectors(rotation, translation):
    rows = np.concatenate([translation, Rotation.from_matrix(rotation).as_rotvec()], axis=-1)
    return table(["tx", "ty", "tz", "rx", "ry", "rz"], rows, ";")


def as_matrices(rotation, translation):
    names = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    return table([*names, "tx", "ty", "tz"], np.concatenate([rotation.reshape(-1, 9), translation], axis=-1), "  ")


def as_json(rotation, translation):
    rows = np.concatenate([translation, Rotation.from_matrix(rotation).as_quat()], axis=-1)
    return json.dumps([dict(zip(QUATERNION.split(","), row, strict=True)) for row in rows.tolist()])


def as_tum(rotation, translation):
    # The camera in the world: its center, and the turn from camera to world axes.
    center = -np.einsum("pji,pj->pi", rotation, translation)
    rows = np.concatenate([center, Rotation.from_matrix(rotation.swapaxes(1, 2)).as_quat()], axis=-1)
    head = "# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n"
    return head + "".join(f"{1305031098.6659 + i:.4f} {numbers(row, ' ')}\n" for i, row in enumerate(rows))


def as_colmap(rotation, translation):
    rows = np.concatenate([np.roll(Rotation.from_matrix(rotation).as_quat(), 1, axis=-1), translation], axis=-1)
    points = ["", "362.5 201.25 -1 10.5 20.5 63390 1 2 3"]
    return "# Image list with two lines of data per image:\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n" + "".join(
        f"{i + 1} {numbers(row, ' ')} 1 frame {i:04d}.png\n{points[i % 2]}\n" for i, row in enumerate(rows)
    )


WRITERS = {
    "csv": as_csv, "semicolons": lambda r, t: as_csv(r, t, ";"), "tabs": lambda r, t: as_csv(r, t, "\t"),
    "blanks": lambda r, t: as_csv(r, t, " "), "vectors": as_vectors, "matrices": as_matrices, "json": as_json,
    "tum": as_tum, "colmap": as_colmap,
}  # fmt: skip


@pytest.mark.parametrize("kind", WRITERS)
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 5))
def test_every_format_gives_back_the_poses_that_were_written(write, kind, seed, count):
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_quat(rng.normal(size=(count, 4))).as_matrix()
    translation = rng.normal(size=(count, 3))
    poses = read_poses(write(WRITERS[kind](rotation, translation)))
    # Numbers are kept to 12 decimals; a trajectory's are turned by a rotation rounded so.
    np.testing.assert_allclose(poses.rotation, rotation, atol=1e-11)
    np.testing.assert_allclose(poses.translation, translation, atol=1e-11)
    # R of the kept quaternion by the textbook's formula.
    x, y, z, w = poses.numbers[:, 3:].T
    np.testing.assert_allclose(poses.rotation[:, 0, 1], 2 * (x * y - z * w), atol=1e-11)
    np.testing.assert_allclose(poses.rotation[:, 2, 2], 1 - 2 * (x * x + y * y), atol=1e-11)
    assert poses.dropped == 0
    # Written and read again, not a bit changes.
    again = numbers_of_rows(json.loads(json.dumps(poses.as_dict()))["rows"])
    np.testing.assert_array_equal(again, poses.numbers)
    np.testing.assert_array_equal(RecordedPoses.of(again, "", "").rotation, poses.rotation)


def test_which_way_each_goes_by_hand(write):
    # The camera stands 2 m in front of the marker and 1 m to its right, upright, looking straight ahead: the marker is
    # 1 m to the left of its axis. Camera y points down, so that the turn is half a turn about x.
    expected = [-1, 0, 2]
    for text in (
        f"{QUATERNION}\n-1,0,2,1,0,0,0\n",
        f"tx ty tz rx ry rz\n-1 0 2 {math.pi} 0 0\n",
        "tx ty tz r11 r12 r13 r21 r22 r23 r31 r32 r33\n-1 0 2 1 0 0 0 -1 0 0 0 -1\n",
        '[{"tx": -1, "ty": 0, "tz": 2, "qx": 1, "qy": 0, "qz": 0, "qw": 0}]',
        '{"poses": [{"tx": -1, "ty": 0, "tz": 2, "qx": 1, "qy": 0, "qz": 0, "qw": 0}]}',
        "0.0 1 0 2 1 0 0 0\n",
        "1 0 1 0 0 -1 0 2 1 a.png\n\n",
    ):
        poses = read_poses(write(text))
        np.testing.assert_allclose(poses.translation[0], expected, atol=1e-12)
        np.testing.assert_allclose(poses.rotation[0], np.diag([1, -1, -1]), atol=1e-12)
        # A point at the marker's right edge and up: right and up in the image, too.
        pixel = PAPER_CAMERA.project(np.array([[1.1, 0.1]]), poses.rotation, poses.translation)[0, 0]
        np.testing.assert_allclose(pixel, [320 + 800 * 0.1 / 2, 240 - 800 * 0.1 / 2], atol=1e-6)


def test_formats_by_name():
    assert list(POSE_FORMATS) == ["colmap", "csv", "json", "kitti", "npy", "tum"]


def test_one_format_at_most_fits(write):
    rotation, translation = Cone(count=3).sample()
    from markergen.read.poses.rows import RowsFile

    for kind, writer in WRITERS.items():
        file = RowsFile("x", writer(rotation, translation).encode())
        assert sum(POSE_FORMATS[name].fits(file) for name in POSE_FORMATS) == 1, kind


def test_tables_as_programs_write_them(write):
    for text in (
        f"\ufeff{QUATERNION}\r\n{GOOD}\r\n",
        f"# made by hand\n\n{QUATERNION}\n# one\n{GOOD}\n\n",
        '"tx","ty","tz","qx","qy","qz","qw"\n"0","0","1","1","0","0","0"\n',
        'image;tx;ty;tz;qx;qy;qz;qw\n"a_1;b.png";0;0;1;1;0;0;0\n',
        " TX , Ty ,tz, qx,qy,qz,qw , Frame \n 0 , 0 , 1e0 ,+1,-0,0.,.0,a_b\n",
        f"{QUATERNION}\n0,0,1,-1,0,0,0\n",
        f"{QUATERNION}\n0,0,1,1.0009,0,0,0\n",
        GOOD.replace(",", " ").join(["1.5 ", "\n"]),
        f"12.5,{GOOD.replace('1,1', '1,1')}\n",
    ):
        poses = read_poses(write(text))
        np.testing.assert_allclose(abs(poses.rotation[0]), np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("", "an empty file"),
        (" \n\t\n", "an empty file"),
        ("# nothing\n", "poses in poses.txt, found an unknown format; known formats: colmap: lines of IMAGE_ID"),
        (b"\x89PNG\r\n\x1a\n\0\0", "bytes that are not text"),
        (b"\xff\xfet\0x\0", "bytes that are not text"),
        (b"tx,ty,tz,qx,qy,qz,qw\n\xff,0,1,1,0,0,0\n", "text at line 2 of poses.txt, found bytes that are not UTF-8"),
        ("<svg/>", "an unknown format"),
        (QUATERNION, "at least one pose in poses.txt, found none"),
        ("tx,ty,tz,qx,qy,qz\n", "the columns tx ty tz qx qy qz qw at line 1 of poses.txt, found no qw"),
        ("tx,ty,qx,qy,qz,qw\n", "found no tz"),
        ("tx,ty,tz\n", "one kind of rotation at line 1 of poses.txt, found no rotation"),
        ("tx,ty,tz,rx,ry,rz,qx,qy,qz,qw\n", "one kind of rotation at line 1 of poses.txt, found qx and rx"),
        (f"{QUATERNION},tx\n", "every column once at line 1 of poses.txt, found 'tx' twice"),
        (f"{QUATERNION},name,Name\n", "found 'Name' twice"),
        (f"{QUATERNION},x\n", "every column once at line 1 of poses.txt, found 'tx' and 'x', both read as tx"),
        (f"timestamp,{QUATERNION}\n1,{GOOD}", "--poses-frame for poses.txt, found poses that may be those of a body"),
        (f"{QUATERNION}\n{GOOD}\n0,0,1,1,0,0\n", "7 values at line 3 of poses.txt, found 6"),
        (f"{QUATERNION}\n{GOOD},\n", "7 values at line 2 of poses.txt, found 8"),
        (f"{QUATERNION}\n# c\n\n0,0,one,1,0,0,0\n", "numbers at line 4 of poses.txt, found 'one'"),
        (f"{QUATERNION}\n0,0,,1,0,0,0\n", "numbers at line 2 of poses.txt, found ''"),
        (f"{QUATERNION}\n0,0,1_0,1,0,0,0\n", "remove the _"),
        ("tx;ty;tz;rx;ry;rz\n0;0;1,5;3;0;0\n", "decimal points at line 2 of poses.txt, found '1,5'"),
        (f"{QUATERNION}\n{GOOD}\n0,0,nan,1,0,0,0\n", "finite numbers at line 3 of poses.txt, found 0 0 nan"),
        (f"{QUATERNION}\n0,0,1,1,0,0,inf\n", "finite numbers at line 2 of poses.txt, found 1 0 0 inf"),
        (f"{QUATERNION}\n0,0,1e999,1,0,0,0\n", "finite numbers at line 2"),
        (f"{QUATERNION}\n0,0,2e6,1,0,0,0\n", "a translation of at most 1 km at line 2 of poses.txt, found 0 0"),
        (f"{QUATERNION}\n{GOOD}\n0,0,1,0,0,0,0\n", "length 1 at line 3 of poses.txt, found 0 0 0 0"),
        (f"{QUATERNION}\n0,0,1,1.002,0,0,0\n", "a quaternion qx qy qz qw of length 1 at line 2"),
        (f"{QUATERNION}\n0,0,1,1e300,1e300,0,0\n", "a quaternion qx qy qz qw of length 1 at line 2"),
        (f"{QUATERNION}\n0,0,1,1e-300,0,0,0\n", "a quaternion qx qy qz qw of length 1 at line 2"),
        ("tx,ty,tz,rx,ry,rz\n0,0,1,180,0,0\n", "a rotation vector rx ry rz in rad, at most a whole turn at line 2"),
        ("tx,ty,tz,rx,ry,rz\n0,0,1,5,5,0\n", "a rotation vector rx ry rz in rad"),
        ("tx,ty,tz,rx,ry,rz\n0,0,1,-1e300,0,0\n", "a rotation vector rx ry rz in rad"),
        ("tx ty tz r11 r12 r13 r21 r22 r23 r31 r32 r33\n0 0 1 1 0 0 0 1 0 0 0 -1\n", "not a reflection at line 2"),
        ("tx ty tz r11 r12 r13 r21 r22 r23 r31 r32 r33\n0 0 1 0 0 0 0 0 0 0 0 0\n", "with R'R = I at line 2"),
        ("tx ty tz r11 r12 r13 r21 r22 r23 r31 r32 r33\n0 0 1 2 0 0 0 2 0 0 0 2\n", "with R'R = I at line 2"),
        ("tx ty tz r11 r12 r13 r21 r22 r23 r31 r32 r33\n0 0 1 1 0 0 1 0 0 0 0 1\n", "with R'R = I at line 2"),
        ("tx ty tz r11 r12 r13 r21 r22 r23 r31 r32 r33\n0 0 1 1e300 0 0 0 1 0 0 0 1\n", "with R'R = I at line 2"),
        ("0 0 0 1 1 0 0\n", "8 numbers timestamp tx ty tz qx qy qz qw at line 1 of poses.txt, found 7"),
        ("0 0 0 1 1 0 0 0\n0 0 0 1 1 0 0 0 5\n", "8 values at line 2 of poses.txt, found 9"),
        ("# t\n0 0 0 1 2 0 0 0\n", "a quaternion qx qy qz qw of length 1 at line 2 of poses.txt, found 2 0 0 0"),
        ("1 1 0 0 0 0 0 1 1 a\n\n2 1 0 0 0 0 0 1 1\n\n", "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME at line 3"),
        (
            "1 1 0 0 0 0 0 1 1 a\n\n" + "9" * 20_000 + " 1 0 0 0 0 0 1 1 a\n\n",
            "TZ CAMERA_ID NAME at line 3 of poses.txt, found an endless number",
        ),
        ("1 1 0 0 0 0 0 1 1 a\n2 1 0 0 0 0 0 1 1 b.jpg\n", "or an empty line, at line 2 of poses.txt, found another"),
        ("1 1 0 0 0 0 0 x 1 a\n\n", "numbers at line 1 of poses.txt, found 'x'"),
        ("1 0 0 0 0 0 0 1 1 a\n\n", "a quaternion qx qy qz qw of length 1 at line 1 of poses.txt, found 0 0 0 0"),
        ("[]", "an array of poses in poses.txt, found something else"),
        ("{}", "an array of poses in poses.txt, found something else"),
        ("[1]", "an array of poses in poses.txt, found something else"),
        ("[{}]", "one kind of rotation at pose 0 of poses.txt"),
        ('[{"tx": 0', "complete JSON in poses.txt"),
        ('[{"tx": 0, "tx": 0}]', "the key 'tx' twice in one object"),
        ("[" * 100_000, "endless nesting"),
        ('[{"tx":0,"ty":0,"tz":1,"rx":3,"ry":0,"rz":"0"}]', "a number for rz of pose 0 of poses.txt, found '0'"),
        ('[{"tx":0,"ty":0,"tz":1,"rx":3,"ry":0,"rz":true}]', "a number for rz of pose 0 of poses.txt, found True"),
        ('[{"tx":0,"ty":0,"tz":NaN,"rx":3,"ry":0,"rz":0}]', "finite numbers at pose 0 of poses.txt"),
        (f'[{{"tx":0,"ty":0,"tz":1{"0" * 400},"rx":3,"ry":0,"rz":0}}]', "a number for tz of pose 0"),
        (f'[{{"tx":0,"ty":0,"tz":{"9" * 5000},"rx":3,"ry":0,"rz":0}}]', "complete JSON in poses.txt"),
        (
            '[{"tx":0,"ty":0,"tz":1,"rx":3,"ry":0,"rz":0},{"tx":0,"ty":0,"tz":1,"rx":3,"ry":0}]',
            "the keys of pose 0 at pose 1 of poses.txt, found 'rz' differs",
        ),
        (b'[{"tx":"\xff"}]', "can't decode byte 0xff"),
        ("tx," * 5000, "at most 10000 characters at line 1"),
        (f"{QUATERNION}\n" + "1," * 5001, "at most 10000 characters at line 2 of poses.txt, found 10002"),
    ],
)
def test_each_defect_is_one_line_with_its_place(write, text, phrase):
    with pytest.raises(InputError) as caught:
        read_poses(write(text))
    message = str(caught.value)
    assert phrase in message
    assert len(message.splitlines()) == 1
    assert len(message) < 500


def test_files_that_are_too_large_or_not_there(write, tmp_path, monkeypatch):
    monkeypatch.setitem(guard.KINDS, "poses", replace(guard.KINDS["poses"], largest=1_000_000))
    with pytest.raises(InputError, match=r"1 MB at .*, found a larger"):
        read_poses(write("0" * 1_000_001))
    monkeypatch.setattr("markergen.read.poses.rows.MOST_ROWS", 3)
    assert len(read_poses(write(f"{QUATERNION}\n" + f"{GOOD}\n" * 3))) == 3
    with pytest.raises(InputError, match=r"3 poses in poses.txt, found more"):
        read_poses(write(f"{QUATERNION}\n" + f"{GOOD}\n" * 4))
    monkeypatch.setattr("markergen.read.poses.MOST_LINES", 10)
    with pytest.raises(InputError, match="more than 10 lines"):
        read_poses(write("#\n" * 11))
    monkeypatch.setattr("markergen.read.poses.rows.LARGEST_JSON", 10)
    with pytest.raises(InputError, match="poses as CSV"):
        read_poses(write("[" * 11))
    with pytest.raises(InputError, match="No such file"):
        read_poses(tmp_path / "none.csv")
    with pytest.raises(InputError, match="Is a directory"):
        read_poses(tmp_path)
    with pytest.raises(InputError, match=pattern("no pose file")):
        read_poses("a\0b.csv")


def test_a_name_with_a_line_break_stays_in_its_line(write):
    poses = read_poses(write(f"{QUATERNION}\n{GOOD}\n", "a\nb.csv"))
    assert poses.name == "'a\\nb.csv'"
    with pytest.raises(InputError) as caught:
        read_poses(write("tx", "a\nb.csv"))
    assert "\n" not in str(caught.value)


def test_poses_from_any_wish(write, tmp_path, monkeypatch):
    for name in (item for item in POSES if not POSES[item].form):
        assert poses_from(name).name == name
    np.testing.assert_array_equal(poses_from("paper").rotation, paper().rotation)
    assert len(poses_from("cone:count=7")) == 7
    stated = paper()
    assert poses_from(stated) is stated
    path = write(f"{QUATERNION}\n{GOOD}\n", "mine")
    assert poses_from(str(path)).name == "mine"
    monkeypatch.chdir(tmp_path)
    assert poses_from("mine").name == "mine"
    for wish in ("nothing", "", "x" * 5000, "a\0b"):
        with pytest.raises(InputError, match=r"paper, paper-roll, cone:distance=A\.\.B.* and files") as caught:
            poses_from(wish)
        assert len(str(caught.value)) < 500
    with pytest.raises(InputError, match=pattern("no pose file") + " at no/such.csv"):
        poses_from("no/such.csv")


def test_a_design_is_repeated_from_its_marker_without_the_file(write):
    rotation, translation = Cone((0.5, 1.2), (30, 60), (-40, 40), count=60).sample()
    # The last ten are too near to see the marker whole.
    translation[-10:, 2] = 0.15
    path = write(as_csv(rotation, translation), "arm.csv")
    spec = spec_from_mapping({"n": 4, "radius": 0.1, "restarts": 2, "poses": str(path)})
    actual = design(spec)
    assert (len(actual.setting.poses), actual.setting.poses.dropped) == (50, 10)
    path.unlink()
    data = to_json(actual.marker)
    marker = from_json(data.decode())
    assert marker.provenance["poses"] == {"name": "arm.csv", "count": 50, "dropped": 10}
    assert str(path.parent) not in data.decode()
    setting = setting_of(marker)
    np.testing.assert_array_equal(setting.poses.rotation, actual.setting.poses.rotation)
    np.testing.assert_array_equal(setting.poses.translation, actual.setting.poses.translation)
    assert (setting.poses.name, setting.poses.dropped) == ("arm.csv", 10)
    again = spec_from_mapping(marker.provenance["spec"], stored=True)
    assert again == spec
    assert again.hash == spec.hash == marker.spec_hash
    assert to_json(design(again).marker) == data


@pytest.mark.long
def test_of_a_long_file_the_marker_keeps_the_poses_that_it_was_designed_for(write):
    rotation, translation = Cone((0.5, 1.5), (30, 60), count=2500).sample()
    spec = spec_from_mapping({"n": 4, "restarts": 1, "poses": str(write(as_tum(rotation, translation), "way.txt"))})
    actual = design(spec)
    seen = actual.setting.poses
    assert len(seen) == 2000
    stored = actual.marker.provenance["spec"]["poses"]
    assert (stored["file"], len(stored["rows"]), stored["sampled_from"]) == ("way.txt", 2000, seen.sampled_from)
    assert stored["dropped"] == 2500 - seen.sampled_from == seen.dropped > 0
    assert actual.marker.provenance["poses"]["name"] == f"way.txt, a sample of {seen.sampled_from}"
    assert actual.marker.provenance["spec_hash"] == spec.hash
    again = setting_of(from_json(to_json(actual.marker).decode())).poses
    np.testing.assert_array_equal(again.rotation, seen.rotation)
    assert (again.name, again.dropped) == (seen.name, seen.dropped)
    assert len(to_json(actual.marker)) < 500_000


def test_a_marker_names_no_files(write):
    path = write(f"{QUATERNION}\n{GOOD}\n")
    with pytest.raises(InputError, match="a known pose distribution"):
        spec_from_mapping({"poses": str(path)}, "provenance.spec", stored=True)


STORED = {
    "file": "a.csv", "sha256": "0" * 64, "dropped": 0, "sampled_from": 0, "columns": "tx ty tz qx qy qz qw",
    "rows": ["0.0 0.0 1.0 1.0 0.0 0.0 0.0"],
}  # fmt: skip


def test_what_a_marker_carries_is_read():
    spec = spec_from_mapping({"poses": STORED}, stored=True)
    assert spec.as_dict()["poses"] == STORED
    assert len(spec.poses.seen_whole(Circle(0.1), PAPER_CAMERA)) == 1


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"rows": []}, "rows: List should have at least 1 item"),
        ({"rows": ["0 0 1 1 0 0 0"] * 2001}, "rows: List should have at most 2000 items"),
        ({"rows": ["0 0 1 1 0 0"]}, "7 numbers tx ty tz qx qy qz qw at row 0, found '0 0 1 1 0 0'"),
        ({"rows": ["0 0 1 1 0 0 0", "0 0 1 1 0 0 x"]}, "at row 1"),
        ({"rows": ["0 0 1 0 0 0 0"]}, "a quaternion qx qy qz qw of length 1 at row 0"),
        ({"rows": ["0 0 nan 1 0 0 0"]}, "finite numbers at row 0"),
        ({"rows": [7]}, "rows[0]: Input should be a valid string"),
        ({"sha256": "xyz"}, "sha256: String should match pattern"),
        ({"dropped": -1}, "dropped: Input should be greater than or equal to 0"),
        ({"dropped": True}, "dropped: Input should be a valid integer"),
        ({"columns": "x y z"}, "columns: Input should be"),
        ({"file": ""}, "file: String should have at least 1 character"),
        ({"more": 1}, "more: unknown key"),
    ],
)
def test_what_a_marker_carries_is_checked(change, phrase):
    with pytest.raises(InputError) as caught:
        spec_from_mapping({"n": 5, "poses": STORED | change}, "provenance.spec", stored=True)
    assert phrase in str(caught.value)
    assert "poses: " in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [3, None, ["paper"]])
def test_poses_are_text_or_a_table(value):
    with pytest.raises(InputError, match="expected poses, found"):
        spec_from_mapping({"poses": value})


@pytest.mark.parametrize(
    ("poses", "phrase"), [(np.zeros((4, 5)), r"shape \(4, 5\); give"), (np.ones((3, 4, 4)), "0 0 0 1; transpose")]
)
def test_arrays_that_are_no_poses_are_known_by_their_shape(poses, phrase):
    with pytest.raises(InputError, match=phrase):
        poses_from(poses)
