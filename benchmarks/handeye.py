"""Hand-eye calibration on simulated robots against the truth, beside the five methods of OpenCV 4.

    python -m benchmarks.handeye [--sets 30] [--photos 12]

Each set: photographs of 12 printed dots from poses that a robot reached with errors of 0.1 mm and 0.02 deg along each
axis, 0.03 px of noise, a print off by 0.1 mm and bent by 0.5 mm. Rows: camera on the hand or beside the robot; camera
exact, known with its covariance, or unknown. Columns: RMS errors of the camera's place and rotation; NEES per degree
of freedom of X, Z and the scale together (1 if the claims are right) and the share of the 13 unknowns within 1.96 of
their sigmas (0.95). OpenCV's methods get the poses of the same photographs, by the same fit with the print as designed;
OpenCV 5 has none of them, so they run in a venv that is made in the temporary folder, once.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import subprocess
import tempfile
import venv
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.calibration_sets import (
    CAMERA,
    hand_held,
    in_gauge,
    layout,
    nees,
    photographed,
    printed,
    wrong_camera,
)
from markergen.arrays import Array
from markergen.calibration.adjustment import adjust
from markergen.calibration.calibration import LOOSE_HEIGHT, LOOSE_PLANE
from markergen.calibration.handeye import HandEyeFit, agreeing, hand_eye
from markergen.calibration.network import Network, Pose
from markergen.calibration.residuals import adjust_robustly
from markergen.defaults import PRINT_SIGMA
from markergen.maths.rotation import exponential, inverse_pose, logarithm, pose_product

ROBOT = np.deg2rad(0.02), 1e-4
"""Standard deviations of the robot's rotations and translations along each axis, rad and m."""

CAMERAS = ("exact", "covariance", "unknown")
SIGMA = np.array([2.0, 2.0, 2.0, 2.0, 0.01, 0.02, 1e-3, 1e-3, 1e-3])
"""Standard deviations of a camera that is known with its covariance."""

OPENCV = """
import sys, numpy as np, cv2
data = np.load(sys.argv[1])
sets = []
for k in range(int(data["sets"])):
    flange, marker = (data[f"{name}{k}"] for name in ("flange", "marker"))
    row = []
    for method in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"):
        R, t = cv2.calibrateHandEye(
            list(flange[:, :3, :3]), list(flange[:, :3, 3]), list(marker[:, :3, :3]), list(marker[:, :3, 3]),
            method=getattr(cv2, "CALIB_HAND_EYE_" + method))
        row.append(np.c_[R, t])
    sets.append(row)
np.save(sys.argv[2], np.array(sets))
"""
METHODS = ("Tsai", "Park", "Horaud", "Andreff", "Daniilidis")


def one_set(
    rng: np.random.Generator, photos: int, on_hand: bool, camera: str
) -> tuple[HandEyeFit, Array, Pose, Pose, Pose]:
    """Fit of one set, errors (13,) in the order of its covariance, those of the camera, and what OpenCV gets."""
    design = layout(12)
    true = printed(design, rng)
    rotation, translation = hand_held(photos, rng, design, tilt=(5.0, 40.0), distance=(0.4, 0.7))
    made = photographed(design, true, rotation, translation, rng)
    network: Network = made.network()
    if camera == "covariance":
        lens, freedom = wrong_camera(rng, SIGMA[: len(CAMERA.parameter_names)])
        network = made.network(freedom, lens)
    elif camera == "unknown":
        network = made.unknown_camera()
    network = replace(network, loose=(LOOSE_PLANE * PRINT_SIGMA, LOOSE_HEIGHT * PRINT_SIGMA))
    _, rotation, translation = in_gauge(network, true, rotation, translation)
    scale = float(np.exp(rng.normal(0, 0.002)))
    fixed = exponential(rng.normal(0, 1, 3)), rng.normal(0, 0.6, 3)
    carried = exponential(rng.normal(0, 1, 3)), rng.normal(0, 0.1, 3)
    moving = rotation, scale * translation
    flange = pose_product(pose_product(fixed, inverse_pose(moving) if on_hand else moving), inverse_pose(carried))
    read = (
        exponential(rng.normal(0, ROBOT[0], (photos, 3))) @ flange[0],
        flange[1] + rng.normal(0, ROBOT[1], (photos, 3)),
    )
    adjustment = adjust_robustly(network, made.views).adjustment
    robot, kept = agreeing(adjustment.views, read, [str(k) for k in range(photos)], on_hand)
    assert len(kept) == photos
    fit = hand_eye(adjustment, robot)
    error = np.concatenate(
        [
            part
            for k, pose in enumerate((fixed, carried))
            for part in (logarithm(fit.robot.rotation[k] @ pose[0].T), fit.robot.translation[k] - pose[1])
        ]
        + [fit.robot.log_scale - np.log(scale)]
    )
    held = adjust(
        replace(network, free=False, loose=None, freedom=network.freedom.none, cameras=adjustment.cameras), made.views
    )
    X = carried if on_hand else fixed
    return fit, error, (held.views.rotation, held.views.translation), read, X


def matrices(poses: Pose) -> Array:
    """Matrices (k, 4, 4)."""
    whole = np.tile(np.eye(4), (len(poses[0]), 1, 1))
    whole[:, :3, :3], whole[:, :3, 3] = poses
    return whole


def python_with_opencv() -> Path | str:
    """Interpreter of a venv with OpenCV 4, or why there is none."""
    folder = Path(tempfile.gettempdir()) / "markergen-opencv4"
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True, clear=True)
    probe = [str(python), "-c", "import cv2; cv2.calibrateHandEye"]
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if subprocess.run(probe, env=clean, capture_output=True, check=False).returncode == 0:
        return python
    install = [str(python), "-m", "pip", "install", "-q", "opencv-python-headless<5", "numpy"]
    done = subprocess.run(install, env=clean, capture_output=True, text=True, check=False)
    return python if done.returncode == 0 else f"OpenCV 4 cannot be installed: {done.stderr.strip().splitlines()[-1]}"


def opencv(cases: list[tuple[Pose, Pose]]) -> Array | str:
    """X (sets, 5, 3, 4) by OpenCV's methods from poses of flange and marker, or why there are none."""
    python = python_with_opencv()
    if isinstance(python, str):
        return python
    with tempfile.TemporaryDirectory() as folder:
        data, result = Path(folder) / "sets.npz", Path(folder) / "found.npy"
        arrays = {f"flange{k}": matrices(flange) for k, (flange, _) in enumerate(cases)}
        arrays |= {f"marker{k}": matrices(marker) for k, (_, marker) in enumerate(cases)}
        np.savez(data, allow_pickle=False, sets=np.array(len(cases)), **arrays)
        clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        subprocess.run([str(python), "-c", OPENCV, str(data), str(result)], env=clean, check=True)
        return np.asarray(np.load(result))


def rms(error: Array) -> float:
    """Root mean square of the lengths of vectors (k, 3)."""
    return float(np.sqrt((error**2).sum(axis=-1).mean()))


def main(sets: int, photos: int) -> None:
    """Print the table."""
    print(f"{sets} sets of {photos} photographs\n{'':32}{'place, mm':>12}{'rotation, deg':>15}{'NEES':>7}{'within':>8}")
    for on_hand in (True, False):
        for camera in CAMERAS:
            errors, squares, cases, truth = [], [], [], []
            for seed in range(sets):
                fit, error, marker, flange, X = one_set(np.random.default_rng(seed), photos, on_hand, camera)
                sigma = np.sqrt(np.diag(fit.covariance))
                squares.append(nees(error / sigma, fit.covariance / sigma / sigma[:, None], 13))
                errors.append(np.r_[error, np.abs(error) < 1.96 * sigma])
                cases.append((flange if on_hand else inverse_pose(flange), marker))
                truth.append(X)
            table, first = np.array(errors), 6 if on_hand else 0
            title = f"{'on the hand' if on_hand else 'beside'}, camera {camera}"
            print(
                f"{title:32}{1e3 * rms(table[:, first + 3 : first + 6]):12.3f}"
                f"{np.rad2deg(rms(table[:, first : first + 3])):15.4f}{np.mean(squares):7.2f}"
                f"{table[:, 13:].mean():8.3f}"
            )
            transforms = opencv(cases)
            if isinstance(transforms, str):
                print(f"  {transforms}")
                continue
            for k, method in enumerate(METHODS):
                rotated = logarithm(transforms[:, k, :, :3] @ np.array([X[0].T for X in truth]))
                moved = transforms[:, k, :, 3] - np.array([X[1] for X in truth])
                print(f"  OpenCV, {method:22}{1e3 * rms(moved):12.3f}{np.rad2deg(rms(rotated)):15.4f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=30)
    parser.add_argument("--photos", type=int, default=12)
    main(**vars(parser.parse_args()))
