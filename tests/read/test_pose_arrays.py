"""Poses in .npy files are those that the same array is in Python."""

import numpy as np
import pytest

import markergen as mg
from markergen.errors import InputError
from markergen.read.kinds import kinds_of
from markergen.read.poses import poses_from

MATRICES = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (5, 1, 1))
MATRICES[:, 2, 3] = np.linspace(0.5, 0.9, 5)
PAIRS = np.stack([np.tile([np.pi, 0, 0], (5, 1)), MATRICES[:, :3, 3]], axis=1)


@pytest.mark.parametrize(
    "values",
    [
        MATRICES,
        MATRICES[:, :3],
        MATRICES.reshape(5, 16),
        MATRICES[:, :3].reshape(5, 12),
        PAIRS,
        np.asfortranarray(PAIRS),
    ],
    ids=["4x4", "3x4", "16", "12", "rvec and tvec", "by columns"],
)
def test_an_array_is_read_as_in_python(values, tmp_path):
    np.save(tmp_path / "poses.npy", values)
    poses = poses_from(tmp_path / "poses.npy")
    np.testing.assert_allclose(poses.translation, MATRICES[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(poses.rotation, MATRICES[:, :3, :3], atol=1e-12)
    assert kinds_of(tmp_path / "poses.npy") == ["poses"]


def test_unit_and_frame_are_followed(tmp_path):
    in_mm = MATRICES.copy()
    in_mm[:, :3, 3] *= 1000
    np.save(tmp_path / "poses.npy", np.linalg.inv(in_mm))
    poses = poses_from(tmp_path / "poses.npy", poses_unit="mm", poses_frame="camera-in-marker")
    np.testing.assert_allclose(poses.translation, MATRICES[:, :3, 3], atol=1e-12)
    assert mg.inspect(tmp_path / "poses.npy", poses_unit="mm").facts[0].values["format"] == "npy"


def test_other_arrays_are_no_poses(tmp_path):
    for name, values, expected in (
        ("camera", np.eye(3), "a NumPy array, without an image size"),
        ("sheared", np.tile(np.eye(4)[::-1], (2, 1, 1)), "whose last rows are not 0 0 0 1"),
    ):
        np.save(tmp_path / f"{name}.npy", values)
        with pytest.raises(InputError, match=expected):
            mg.inspect(tmp_path / f"{name}.npy")
    cut = tmp_path / "cut.npy"
    np.save(cut, MATRICES)
    cut.write_bytes(cut.read_bytes()[:-8])
    with pytest.raises(InputError, match="an array of another shape"):
        poses_from(cut)
