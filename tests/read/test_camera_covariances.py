"""Covariances of calibrations: standard deviations in a row, or the whole matrix."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.read.cameras.covariance import read_camera_covariance

FILE = "camera.yaml"

LENS = Camera(640, 480, 800.0, 800.0, 320.0, 240.0, Distortion("radtan", (-0.1, 0.01, 0.0, 0.0)))


def test_standard_deviations(write):
    expected = np.diag([0.25, 0.25, 1.0, 1.0])
    for text in ("0.5 0.5 1 1\n", "# fx fy cx cy\n0.5, 0.5,1,\t1  # px", "0.5\n0.5\n1\n1\n"):
        np.testing.assert_array_equal(read_camera_covariance(write(text), PAPER_CAMERA), expected)
    padded = read_camera_covariance(write("0.5 0.5 1 1"), LENS)
    np.testing.assert_array_equal(padded, np.diag([0.25, 0.25, 1, 1, 0, 0, 0, 0]))
    whole = read_camera_covariance(write("0.5 0.5 1 1 1e-3 1e-3 0 0"), LENS)
    np.testing.assert_array_equal(whole, np.diag([0.25, 0.25, 1, 1, 1e-6, 1e-6, 0, 0]))


@pytest.mark.parametrize("count", [4, 8])
def test_a_covariance(write, tmp_path, count):
    root = np.random.default_rng(0).normal(size=(count, count)) * np.array([1, 1, 1, 1, 1e-3, 1e-3, 1e-4, 1e-4])[:count]
    covariance = root.T @ root
    expected = np.zeros((8, 8))
    expected[:count, :count] = covariance
    path = tmp_path / "camera.npy"
    np.save(path, covariance)
    # Symmetric to the last bit or made so: one rounding.
    np.testing.assert_allclose(read_camera_covariance(path, LENS), expected, rtol=1e-15)
    text = "\n".join(", ".join(f"{value:.9g}" for value in row) for row in covariance)
    result = read_camera_covariance(write(text), LENS)
    np.testing.assert_array_equal(result, result.T)
    # Nine digits.
    np.testing.assert_allclose(result, expected, rtol=1e-8)
    np.save(path, np.sqrt(np.diag(covariance)))
    np.testing.assert_allclose(np.diag(read_camera_covariance(path, LENS)), np.diag(expected), rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("1 2 3", "4 standard deviations or 4x4 numbers or 8 standard deviations or 8x8 numbers"),
        ("1 2 3 4 5 6", "found 1 rows of 6; the parameters are fx fy cx cy k1 k2 p1 p2"),
        ("1 0 0 0\n0 1 0 0", "found 2 rows of 4"),
        ("1 0 0 0\n0 1 0", "rows of equal length"),
        ("1 1 1 x", "a finite number at line 1 in"),
        ("1 1 1\n\n1 1 nan", "a finite number at line 3 in"),
        ("# nothing", "rows of equal length"),
        ("1 1 1 -1", "standard deviations of 0 or more"),
        ("1 1 1 1e300", "standard deviations of 0 or more"),
        ("1 .5 0 0\n.5 1 0 0\n0 0 -1 0\n0 0 0 1", "variances of 0 or more in mine.txt, found -1.0 for cx"),
        ("1 .5 0 0\n.4 1 0 0\n0 0 1 0\n0 0 0 1", "a symmetric covariance"),
        ("1 2 0 0\n2 1 0 0\n0 0 1 0\n0 0 0 1", "one that exceeds its variances"),
        ("0 1 0 0\n1 1 0 0\n0 0 1 0\n0 0 0 1", "one that exceeds its variances"),
        ("1 -.9 -.9 0\n-.9 1 -.9 0\n-.9 -.9 1 0\n0 0 0 1", "a positive semidefinite covariance"),
    ],
)
def test_what_is_no_covariance_is_named(write, monkeypatch, text, phrase):
    path = write(text, "mine.txt")
    monkeypatch.chdir(path.parent)
    with pytest.raises(InputError) as caught:
        read_camera_covariance("mine.txt", LENS)
    assert phrase in str(caught.value)
    assert "mine.txt" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_arrays_that_are_no_covariance(tmp_path, write):
    path = tmp_path / "a.npy"
    for values, phrase in (
        (np.array([None] * 4), "a .npy of numbers"),
        (np.array(["1"] * 4), "in one or two dimensions"),
        (np.ones((4, 4, 1)), "in one or two dimensions"),
        (np.ones(3), "4 standard deviations"),
        (np.array([1.0, 1, 1, np.nan]), "finite numbers"),
        (np.ones(20_000), "in one or two dimensions"),
    ):
        np.save(path, values)
        with pytest.raises(InputError, match=phrase):
            read_camera_covariance(path, PAPER_CAMERA)
    np.save(path, np.ones(4))
    data = path.read_bytes()
    for bad in (
        data[:20],
        data[:-1],
        data[:6],
        data.replace(b"(4,)", b"(9**99,)"),
        data.replace(b"(4,)", b"(4000000000,)"),
    ):
        with pytest.raises(InputError, match="npy of numbers"):
            read_camera_covariance(write(bad), PAPER_CAMERA)


def test_arrays_are_taken_as_files_are(write):
    expected = read_camera_covariance(write("0.5 0.5 1 1"), LENS)
    for stated in ([0.5, 0.5, 1, 1], np.array([0.5, 0.5, 1, 1]), np.diag([0.25, 0.25, 1, 1])):
        np.testing.assert_array_equal(read_camera_covariance(stated, LENS), expected)
    for stated in (7.0, np.zeros((2, 2, 2)), [], ["a"], object(), [[1, 2], [3]], np.full(4, np.nan), np.ones(5)):
        with pytest.raises(InputError) as caught:
            read_camera_covariance(stated, LENS)
        assert "\n" not in str(caught.value)
