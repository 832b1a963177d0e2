"""Whatever stands in a file of poses, the answer is poses or one line."""

import json
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mutants import mutants

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.read.poses import poses_from, read_poses
from markergen.read.spec_file import spec_from_mapping

SEEDS = [
    "tx,ty,tz,qx,qy,qz,qw\n0,0,1,1,0,0,0\n0.01,0.2,1.5,0.6,0,0.8,0\n",
    'name;rx;ry;rz;tx;ty;tz\n"a;b";3.1;0;0;0;0;0.9\nc;0.1;-0.2;3;0;0;2\n',
    "# numpy\ntx ty tz r11 r12 r13 r21 r22 r23 r31 r32 r33\n0 0 1 1 0 0 0 -1 0 0 0 -1\n",
    '[{"tx": 0, "ty": 0, "tz": 1, "rx": 3.1, "ry": 0, "rz": 0.5},'
    ' {"tx": 1, "ty": 0, "tz": 1, "rx": 3, "ry": 0, "rz": 0}]',
    "# timestamp tx ty tz qx qy qz qw\n1305031098.6659 0.1 0 1.2 1 0 0 0\n1305031098.7 0.1 0 1.2 0.6 0.8 0 0\n",
    "# images\n1 0 1 0 0 0 0 1 1 a 1.jpg\n2.5 3.5 -1 1 2 7\n2 0 0.6 0.8 0 0 0 1 1 b.jpg\n\n",
]
TOKENS = [
    "0", "-1", "1e999", "1e300", "-1e-320", "nan", "inf", "9" * 5000, "", " ", "\n", "\r", "\t", ",", ";", ",,", '"',
    "[", "]", "{", "}", ":", "null", "true", "#", "\0", "\ufeff", "é", "😀", "\u0661", "1_0", "0x1p3", "tx", "qw",
    "r11", "timestamp", "\x1c", "\x85", "\v", "1 0 1 0 0 0 0 1 1 a\n", "\n\n",
]  # fmt: skip


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("poses") / "file.csv"


def outcome(path, data):
    """Read a file and use its poses; return them, if it has some."""
    path.write_bytes(data)
    poses, message = None, ""
    start = time.process_time()
    try:
        poses = read_poses(path)
        poses.seen_whole(Circle(0.1), PAPER_CAMERA)
    except InputError as error:
        message = str(error)
    # A million poses take 4 s; these have a handful.
    assert time.process_time() - start < 1
    assert len(message.splitlines()) <= 1
    assert len(message) < 1000
    if poses is not None:
        np.testing.assert_allclose(np.linalg.det(poses.rotation), 1, atol=1e-9)
        assert np.isfinite(poses.translation).all()
        carried = json.loads(json.dumps(poses.as_dict(), allow_nan=False))
        np.testing.assert_array_equal(spec_from_mapping({"poses": carried}).poses.rotation, poses.rotation)
    return poses


def test_the_seeds_are_poses(path):
    for text in SEEDS:
        assert len(outcome(path, text.encode())) in (1, 2)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=500)
@given(mutants(SEEDS, TOKENS, 20))
def test_anything(path, data):
    outcome(path, data)


NUMBERS = st.floats() | st.floats(-2, 2) | st.sampled_from([0.0, 1.0, -1.0])


ROWS = st.sampled_from([4, 3, 9]).flatmap(
    lambda width: st.lists(st.lists(NUMBERS, min_size=3 + width, max_size=3 + width), min_size=1, max_size=3)
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=100)
@given(ROWS)
def test_any_numbers(path, rows):
    names = {4: "qx qy qz qw", 3: "rx ry rz", 9: "r11 r12 r13 r21 r22 r23 r31 r32 r33"}[len(rows[0]) - 3]
    outcome(path, f"tx ty tz {names}\n".encode() + "\n".join(" ".join(map(repr, row)) for row in rows).encode())


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=100)
@given(st.lists(NUMBERS, min_size=6, max_size=6))
def test_any_json(path, row):
    outcome(path, json.dumps([dict(zip(["tx", "ty", "tz", "rx", "ry", "rz"], row, strict=True))]).encode())


@given(st.text(max_size=40))
def test_any_wish(text):
    message = ""
    try:
        assert len(poses_from(text))
    except InputError as error:
        message = str(error)
    assert len(message.splitlines()) <= 1
