"""Pose errors with a print that photographs measured, and the adjustment beside other solvers.

    python -m benchmarks.calibration [--sets 30] [--photos 20] [--n 5 24] [--skip-peers]

The prints are off by 0.1 mm along each axis, 0.3 % longer along x, and bulge by 0.5 mm. Photographs are hand-held:
tilts of 10 to 60 degrees to all sides, all rolls, 0.4 to 1 m, and dots are measured to 0.03 px along each axis. The
error is that of poses which are fitted with the measured dots to exact images of the true print, over the paper's 400
poses.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix

import markergen as mg
from benchmarks.calibration_sets import CAMERA, SimulatedSet, hand_held, in_gauge, photographed, printed
from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment, adjust
from markergen.calibration.camera_choice import CameraChoice, choose_camera
from markergen.calibration.network import CameraFreedom, Network, Views, moved_camera
from markergen.calibration.residuals import adjust_robustly
from markergen.maths.conics import refine_poses
from markergen.maths.rotation import angle_between, exponential
from markergen.model.camera import Camera, Distortion
from markergen.model.poses import paper

SIGMA = 0.03
FALSE = 0.05
"""Share of false dots, 0.5 to 20 px off."""

UNKNOWN = ("fx", "cx", "cy", "k1", "k2")
ROUGH = replace(CAMERA, fx=780.0, fy=780.0, cx=319.5, cy=239.5, distortion=Distortion("radtan", (0.0,) * 5))
"""What an unknown camera is estimated from."""


def designed(n: int) -> Array:
    """Dots (n, 3) in m of the default design."""
    return np.asarray(mg.design(n=n, restarts=8, seed=0).marker.xyz)


def one_set(design: Array, photos: int, rng: np.random.Generator, camera: Camera = CAMERA) -> SimulatedSet:
    """Photographs of a fresh print."""
    true = printed(design, rng)
    return photographed(design, true, *hand_held(photos, rng, design, camera), rng, SIGMA, camera)


def pose_error(made: SimulatedSet, network: Network, places: Array, camera: Camera) -> tuple[float, float]:
    """RMS rotation in deg and translation in mm over the paper's poses, for poses fitted with dots and camera."""
    poses = paper()
    true, rotation, translation = in_gauge(network, made.true, poses.rotation, poses.translation)
    pixels = made.camera.project(true, rotation, translation)
    seen = camera.from_pixels(pixels)
    kept = np.isfinite(seen).all(axis=(1, 2)) & made.camera.sees(pixels).all(axis=1)
    seen, rotation, translation = seen[kept], rotation[kept], translation[kept]
    weight = np.broadcast_to(np.eye(2), (*seen.shape, 2))
    refined = refine_poses(places, np.zeros(len(places)), seen, weight, rotation, translation, steps=30)
    rotated = np.rad2deg(angle_between(refined[0], rotation))
    moved = 1e3 * np.linalg.norm(refined[1] - translation, axis=1)
    return float(np.sqrt(np.mean(rotated**2))), float(np.sqrt(np.mean(moved**2)))


def spoiled(views: Views, rng: np.random.Generator) -> Views:
    """Displace some of the dots by 0.5 to 20 px."""
    false = rng.random(views.seen.shape) < FALSE
    angle, far = rng.uniform(0, 2 * np.pi, false.shape), np.exp(rng.uniform(np.log(0.5), np.log(20), false.shape))
    moved = np.stack([far * np.cos(angle), far * np.sin(angle)], axis=-1)
    return replace(views, pixels=views.pixels + np.where(false[..., None], moved, 0))


def accuracy(n: int, photos: int, sets: int) -> list[tuple[str, float, float, float]]:
    """Rows of case, RMS rotation in deg over the sets, its standard error, and RMS translation in mm."""
    rng, design = np.random.default_rng(n), designed(n)
    errors: dict[str, list[tuple[float, float]]] = {}
    for _ in range(sets):
        made = one_set(design, photos, rng)
        held = made.network()
        errors.setdefault("as designed", []).append(pose_error(made, held, design, made.camera))
        reference = adjust_robustly(held, made.views).adjustment
        errors.setdefault("camera known", []).append(pose_error(made, held, reference.places, made.camera))
        false = adjust_robustly(held, spoiled(made.views, rng)).adjustment
        errors.setdefault("camera known, 5 % of false dots", []).append(
            pose_error(made, held, false.places, made.camera)
        )
        unknown = estimated(made)
        errors.setdefault("camera unknown", []).append(pose_error(made, held, unknown.places, made.camera))
        errors.setdefault("camera unknown, and used", []).append(pose_error(made, held, unknown.places, unknown.camera))
    rows = []
    for case, values in errors.items():
        rotated, moved = np.array(values).T
        mean = np.mean(rotated**2)
        sigma = np.std(rotated**2) / np.sqrt(sets) / (2 * np.sqrt(mean))
        rows.append((case, float(np.sqrt(mean)), float(sigma), float(np.sqrt(np.mean(moved**2)))))
    return rows


def estimated(made: SimulatedSet) -> Adjustment:
    """Adjustment with an unknown camera, whose parameters left-out photographs choose."""
    network = made.network(CameraFreedom.of_names(ROUGH, UNKNOWN), ROUGH)
    result = adjust_robustly(network, made.views).adjustment
    choice = choose_camera(result.network, result.views, np.arange(len(result.views)), result.weights)
    if isinstance(choice, CameraChoice) and choice.names != UNKNOWN:
        network = replace(network, cameras=(choice.camera,), freedom=choice.freedom)
        result = adjust_robustly(network, made.views).adjustment
    return result


def timed(call: Callable[[], float]) -> tuple[float, float]:
    """Seconds and RMS in px of a solver."""
    began = time.perf_counter()
    rms = call()
    return time.perf_counter() - began, rms


def by_scipy(network: Network, views: Views) -> float:
    """RMS in px by scipy's solver on the same squares, with the structure of the Jacobian, from the same start."""
    v, n = views.seen.shape
    r = len(network.freedom)

    def residuals(unknowns: Array) -> Array:
        rotation = exponential(unknowns[: 3 * v].reshape(v, 3)) @ views.rotation
        translation = views.translation + unknowns[3 * v : 6 * v].reshape(v, 3)
        places = network.design + unknowns[6 * v : 6 * v + 3 * n].reshape(n, 3)
        camera = moved_camera(network.camera, network.freedom.directions @ unknowns[6 * v + 3 * n :])
        left = (views.pixels - camera.project(places, rotation, translation)).ravel()
        # Without the gauge the sparse solver creeps; at the minimum these are 0.
        return np.concatenate([left, weight * gauge.T @ (places - network.design).ravel()])

    gauge, weight = network.gauge(network.design), 1e3
    pattern = lil_matrix((2 * v * n + gauge.shape[1], 6 * v + 3 * n + r), dtype=np.int8)
    pattern[2 * v * n :, 6 * v : 6 * v + 3 * n] = 1
    for j in range(v):
        for i in range(n):
            rows = slice(2 * (j * n + i), 2 * (j * n + i) + 2)
            pattern[rows, 3 * j : 3 * j + 3] = pattern[rows, 3 * v + 3 * j : 3 * v + 3 * j + 3] = 1
            pattern[rows, 6 * v + 3 * i : 6 * v + 3 * i + 3] = 1
            pattern[rows, 6 * v + 3 * n :] = 1
    start = np.zeros(6 * v + 3 * n + r)
    result = least_squares(
        residuals, start, jac_sparsity=pattern, method="trf", x_scale="jac", ftol=1e-12, xtol=1e-12, gtol=1e-12,
        max_nfev=100,
    )  # fmt: skip
    return float(np.sqrt(2 * result.cost / (v * n)))


def by_opencv(network: Network, views: Views) -> float:
    """RMS in px of cv2.calibrateCameraRO, which frees the dots of a planar target: f, c, k1 and k2, fx = fy."""
    # Dot 0, the one farthest from it and the height of the last define its frame and scale.
    far = 1 + int(np.argmax(np.linalg.norm(network.design[1:-1] - network.design[0], axis=1)))
    points = [network.design.astype(np.float32)] * len(views)
    pixels = [pixel.astype(np.float32) for pixel in views.pixels]
    camera = network.camera
    # OpenCV 5 frees the sensor's tilt unless told, and its faster solver fails where dots are free.
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_USE_INTRINSIC_GUESS
    flags |= cv2.CALIB_DISABLE_SCHUR_COMPLEMENT | cv2.CALIB_FIX_TAUX_TAUY
    rms = cv2.calibrateCameraRO(
        points, pixels, (camera.width, camera.height), far, camera.matrix.copy(), np.zeros(5), flags=flags,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-15),
    )[0]  # fmt: skip
    return float(rms)


def compared(design: Array, photos: int, rng: np.random.Generator) -> tuple[Network, Views]:
    """One problem for all solvers: an unknown camera, all dots seen, points, equal weights, single precision."""
    made = one_set(design.astype(np.float32).astype(float), photos, rng)
    # OpenCV takes single precision.
    pixels = made.views.pixels.astype(np.float32).astype(float)
    spread = np.broadcast_to(np.eye(2), made.views.covariance.shape)
    network = made.network(CameraFreedom.of_names(ROUGH, UNKNOWN), ROUGH)
    return network, replace(made.views, pixels=pixels, covariance=spread)


def peers(n: int, photos: int) -> list[tuple[str, float, float]]:
    """Rows of solver, seconds and RMS in px on one problem, see `compared`."""
    network, plain = compared(designed(n) if n < 100 else grid(n), photos, np.random.default_rng(1))
    calls: dict[str, Callable[[], float]] = {
        "markergen": lambda: adjust(network, plain).rms,
        "scipy, sparse": lambda: by_scipy(network, plain),
        "cv2.calibrateCameraRO": lambda: by_opencv(network, plain),
    }
    return [(name, *timed(call)) for name, call in calls.items()]


def grid(n: int) -> Array:
    """Dots (n, 3) in m of a hexagonal packing in a disk of 0.13 m."""
    pitch, reach = 0.013, range(-30, 31)
    rows = np.array([[pitch * (i + 0.5 * (j % 2)), pitch * j * np.sqrt(0.75), 0.0] for j in reach for i in reach])
    return rows[np.argsort(np.linalg.norm(rows, axis=1), kind="stable")[:n]]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=30)
    parser.add_argument("--photos", type=int, default=20)
    parser.add_argument("--n", type=int, nargs="+", default=[5, 24])
    parser.add_argument("--skip-peers", action="store_true")
    options = parser.parse_args()
    print("dots photographs case: rotation deg +- standard error, translation mm")
    for n in options.n:
        for case, rotated, sigma, moved in accuracy(n, options.photos, options.sets):
            print(f"{n:3d} {options.photos:3d}  {case}: {rotated:.4f} +- {sigma:.4f} deg, {moved:.4f} mm")
    if not options.skip_peers:
        print("\ndots photographs solver: seconds, RMS px")
        for n, photos in ((24, 40), (336, 15)):
            for name, seconds, rms in peers(n, photos):
                print(f"{n:3d} {photos:3d}  {name}: {seconds:.3f} s, {rms:.9f} px")


if __name__ == "__main__":
    main()
