"""Two cameras held together on simulated sets against the truth.

    python -m benchmarks.stereo [--sets 30] [--photos 12]

Each set: photographs of 12 printed dots that both cameras take at once, 120 mm apart and turned by 5 deg, with 0.03
px of noise, of a print off by 0.1 mm and bent by 0.5 mm. Rows: cameras exact, known with their covariance, or unknown.
Columns: RMS errors of the rotation and the translation of the second camera to the first; NEES per degree of freedom
of this pose (1 if the claims are right) and the share of its 6 unknowns within 1.96 of their sigmas (0.95); the same
errors if each camera is calibrated by itself, and the pose is the median of the photographs'.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.calibration_sets import CAMERA, hand_held, in_gauge, layout, nees, photographed, printed, wrong_camera
from markergen.arrays import Array
from markergen.calibration.network import CameraFreedom, Network
from markergen.calibration.relation import relate
from markergen.calibration.residuals import adjust_robustly
from markergen.defaults import PRINT_SIGMA
from markergen.maths.rotation import exponential, inverse_pose, logarithm, pose_product
from markergen.model.camera import Camera, Distortion

SECOND = Camera(800, 600, 700.0, 700.0, 402.0, 297.0, Distortion("radtan", (-0.2, 0.06, 0.0, 0.0, 0.0)))
"""Second camera, another one than the first."""

CAMERAS = ("exact", "covariance", "unknown")
SIGMA = np.array([2.0, 2.0, 2.0, 2.0, 0.01, 0.02, 1e-3, 1e-3, 1e-3])
"""Standard deviations of a camera that is known with its covariance."""


def one_set(rng: np.random.Generator, photos: int, knowledge: str) -> tuple[Array, Array, Array]:
    """Error (6,) of the second camera's pose to the first, its covariance, and the error without joint adjustment."""
    design = layout(12)
    true = printed(design, rng)
    away = exponential(np.deg2rad(5) * np.array([0.1, 1.0, 0.2])), np.array([-0.12, 0.002, 0.004])
    first = hand_held(photos, rng, design, tilt=(10.0, 45.0), distance=(0.5, 0.9))
    parts, networks = [], list[Network]()
    for camera, poses in ((CAMERA, first), (SECOND, pose_product(away, first))):
        made = photographed(design, true, *poses, rng, camera=camera)
        network = made.network()
        if knowledge == "covariance":
            lens, freedom = wrong_camera(rng, SIGMA[: len(camera.parameter_names)], camera)
            network = made.network(freedom, lens)
        elif knowledge == "unknown":
            network = made.unknown_camera()
        parts.append(made.views)
        networks.append(network)
    whole = replace(
        networks[0],
        cameras=(networks[0].camera, networks[1].camera),
        freedom=CameraFreedom.joined([network.freedom for network in networks]),
    )
    adjustment = adjust_robustly(
        whole, parts[0].joined(replace(parts[1], camera=np.ones(photos, dtype=np.intp)))
    ).adjustment
    relation = relate(None, adjustment, np.tile(np.arange(photos), 2), PRINT_SIGMA, ("left", "right"))
    # The scale is the gauge's: as the print's, with which poses grow.
    _, rotations, translations = in_gauge(whole, true, *pose_product(away, first))
    _, rotation, translation = in_gauge(whole, true, *first)
    there = pose_product((rotations, translations), inverse_pose((rotation, translation)))
    estimate = relation.cameras[0][1], relation.cameras[1][1]
    apart = [adjust_robustly(network, part).adjustment.views for network, part in zip(networks, parts, strict=True)]
    paired = pose_product(
        (apart[1].rotation, apart[1].translation), inverse_pose((apart[0].rotation, apart[0].translation))
    )
    median = paired[0][0] @ exponential(np.median(logarithm(paired[0][:1].swapaxes(-1, -2) @ paired[0]), axis=0))
    errors = [
        np.concatenate([logarithm(pose[0] @ there[0][0].T), pose[1] - there[1].mean(axis=0)])
        for pose in (estimate, (median, np.median(paired[1], axis=0)))
    ]
    return errors[0], relation.camera_covariance[6:, 6:], errors[1]


def scaled(error: Array, covariance: Array) -> tuple[Array, Array]:
    """Error and covariance in units of the standard deviations."""
    sigma = np.sqrt(np.diag(covariance))
    return error / sigma, covariance / sigma / sigma[:, None]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=30)
    parser.add_argument("--photos", type=int, default=12)
    arguments = parser.parse_args()
    print(f"{'cameras':>12} {'deg':>8} {'mm':>8} {'NEES':>6} {'covered':>8} {'apart, deg':>11} {'apart, mm':>10}")
    for knowledge in CAMERAS:
        results = [one_set(np.random.default_rng(seed), arguments.photos, knowledge) for seed in range(arguments.sets)]
        errors, apart = (np.array([result[k] for result in results]) for k in (0, 2))
        sizes = [np.sqrt((error.reshape(-1, 2, 3) ** 2).sum(axis=2).mean(axis=0)) for error in (errors, apart)]
        squares = [nees(*scaled(error, spread), 6) for error, spread, _ in results]
        within = np.abs(errors) < 1.96 * np.sqrt([np.diag(spread) for _, spread, _ in results])
        (angle, distance), (angle_apart, distance_apart) = ((np.rad2deg(size[0]), 1e3 * size[1]) for size in sizes)
        print(
            f"{knowledge:>12} {angle:8.4f} {distance:8.4f} {np.mean(squares):6.2f} {within.mean():8.3f} "
            f"{angle_apart:11.4f} {distance_apart:10.4f}"
        )


if __name__ == "__main__":
    main()
