"""Poses from a program: arrays, pairs as OpenCV's, data frames, and functions of a generator."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import markergen as mg

VECTORS = np.array([[np.pi, 0.0, 0.0], [2.8, 0.3, 0.1], [2.9, -0.2, 0.4]])
PLACES = np.array([[0.0, 0.0, 0.5], [0.02, 0.0, 0.6], [0.0, -0.01, 0.7]])
MATRICES = np.tile(np.eye(4), (3, 1, 1))
MATRICES[:, :3, :3], MATRICES[:, :3, 3] = Rotation.from_rotvec(VECTORS).as_matrix(), PLACES
FRAME = pd.DataFrame(np.hstack([PLACES, VECTORS]), columns=["tx", "ty", "tz", "rx", "ry", "rz"])


@pytest.mark.parametrize(
    "source",
    [
        MATRICES,
        MATRICES.tolist(),
        list(zip(VECTORS, PLACES, strict=True)),
        zip(VECTORS[..., None], PLACES[..., None], strict=True),  # as cv2.calibrateCamera returns them
        FRAME,
        lambda generator: MATRICES,
    ],
    ids=["array", "lists", "pairs", "columns", "frame", "function"],
)
def test_all_forms_are_the_same_poses(source):
    poses = mg.Poses.load(source)
    assert np.allclose(poses.rotation, MATRICES[:, :3, :3], atol=1e-9)
    assert np.allclose(poses.translation, PLACES)
    assert repr(poses).endswith("0.5 to 0.7 m away>")


def test_one_matrix_is_one_pose():
    assert len(mg.Poses.load(MATRICES[0])) == 1


def test_a_file_is_read_as_stated(tmp_path):
    path = tmp_path / "motion.csv"
    rows = np.hstack([np.arange(3)[:, None], 1e3 * PLACES, Rotation.from_rotvec(VECTORS).as_quat()])
    np.savetxt(path, rows, delimiter=",", header="t,tx,ty,tz,qx,qy,qz,qw", comments="")
    with pytest.raises(mg.InputError, match="--poses-frame"):
        mg.Poses.load(path)
    poses = mg.Poses.load(path, poses_frame="marker-in-camera", poses_unit="mm")
    assert np.allclose(poses.rotation, MATRICES[:, :3, :3])
    assert np.allclose(poses.translation, PLACES)


def test_only_a_file_is_read_as_stated():
    with pytest.raises(mg.InputError, match="a file of poses"):
        mg.Poses.load("cone:tilt=0..60", poses_unit="mm")
    with pytest.raises(TypeError, match="not unit"):
        mg.Poses.load("cone:tilt=0..60", unit="mm")


def test_a_file_of_an_array_holds_its_poses(tmp_path):
    np.save(tmp_path / "poses.npy", MATRICES)
    np.testing.assert_allclose(mg.Poses.load(tmp_path / "poses.npy").translation, MATRICES[:, :3, 3], atol=1e-12)


def test_a_function_draws_the_same_every_time():
    def drawn(generator):
        moved = MATRICES.copy()
        moved[:, 2, 3] += generator.uniform(0, 0.1, 3)
        return moved

    one, other = (mg.design(n=4, radius="50mm", restarts=1, poses=drawn).marker for _ in range(2))
    assert one == other
    assert one.spec_hash != mg.design(n=4, radius="50mm", restarts=1, poses=MATRICES).marker.spec_hash


def test_validation_takes_them_too(pentagon):
    camera = mg.Camera(640, 480, 800, 800, 320, 240)
    from_array, from_frame = (
        mg.validate(pentagon, camera, poses=poses, runs=0, views=0) for poses in (MATRICES, FRAME)
    )
    assert from_array.bound == from_frame.bound


@pytest.mark.parametrize(
    ("source", "wanted"),
    [
        ([], "expected poses, found"),
        (np.zeros((3, 4)), "matrices (k, 4, 4)"),
        (2 * MATRICES, "last rows are not 0 0 0 1"),
        (np.zeros((0, 4, 4)), "at least one pose"),
        (MATRICES * [[[2], [1], [1], [1]]], "at poses[0]"),
        (5, "DataFrame"),
        (pd.DataFrame({"x": [1]}), "the DataFrame"),
    ],
)
def test_what_is_no_pose_is_refused_in_the_callers_words(source, wanted):
    with pytest.raises(mg.InputError) as error:
        mg.design(poses=source)
    assert wanted in str(error.value)
