"""Claimed errors of dots, poses, cameras and prints behind lenses, for dots of 10 to 100 px.

    python -m benchmarks.lens_claims [--sets 100] [--photos 8]

Each set: photographs of 12 dots of one size, 960x720 px, tilted by 10 to 50 degrees, rendered exactly through a lens
with blur and 2 grey levels of noise. Columns, each a squared error over its claimed covariance per degree of freedom
(NEES, 1 if the claims are right): of the fitted ellipse centers, less those predicted through the lens; beside it, less
the images of the centers that a pinhole camera would see; of the poses of `detect` with the true print and camera; of
dots, and of the camera, adjusted from the photographs alone. Last, the variance of whole dots' fitted centers over the
bound of `validate`.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
from collections import defaultdict
from dataclasses import replace

import numpy as np

import markergen as mg
from benchmarks.calibration_sets import in_gauge, nees
from markergen.arrays import Array
from markergen.bounds.dot_covariances import plate_covariances
from markergen.calibration.calibration import Known, network_of
from markergen.calibration.judging import parameters_of
from markergen.calibration.network import CameraFreedom
from markergen.calibration.photos import find_dots
from markergen.calibration.residuals import adjust_robustly
from markergen.detect import Detector
from markergen.maths.conics import outlines
from markergen.maths.rotation import exponential, logarithm
from markergen.model.camera import Camera, Distortion
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.render import Optics, render_view

PLAIN = Camera(960, 720, 900.0, 903.0, 475.0, 362.0)
LENSES = {
    "none": (PLAIN, ("fx", "fy", "cx", "cy")),
    "radtan, weak": (
        replace(PLAIN, distortion=Distortion("radtan", (-0.12, 0.03, 5e-4, -3e-4))),
        ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    ),
    "radtan, strong": (
        replace(PLAIN, distortion=Distortion("radtan", (-0.35, 0.12, 1e-3, 0.0, 0.0))),
        ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    ),
    "rational": (
        replace(PLAIN, distortion=Distortion("rational", (0.3, 0.1, 0.0, 0.0, 0.02, 0.6, 0.2, 0.03))),
        ("fx", "fy", "cx", "cy", "k1", "k2"),
    ),
    "equidistant": (
        replace(PLAIN, fx=500.0, fy=500.0, distortion=Distortion("equidistant", (0.02, -0.01, 0.0, 0.0))),
        ("fx", "fy", "cx", "cy", "k1", "k2"),
    ),
}
"""Cameras, and the parameters that the photographs are to find."""

COLUMNS = ("centers", "as by a pinhole", "poses", "dots", "camera", "bound")


def poses_of(camera: Camera, photos: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Poses from which the marker is 0.7 to 1.0 times as high as the image, its middle up to 15 % of it aside."""
    rotations, translations = [], []
    for _ in range(photos):
        azimuth, tilt = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(10, 50))
        lean = exponential(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
        rotations.append(lean @ np.diag([1.0, -1.0, -1.0]) @ exponential(np.array([0, 0, rng.uniform(0, 2 * np.pi)])))
        depth = 0.18 * camera.fx / camera.height / rng.uniform(0.7, 1.0)
        middle = camera.from_pixels(rng.uniform(0.35, 0.65, 2) * [camera.width, camera.height])
        translations.append(depth * np.append(middle, 1.0))
    return np.array(rotations), np.array(translations)


def sized(layout: Marker, diameter: float) -> Marker:
    """Return the layout with dots of another size."""
    points = [
        replace(
            p, feature=replace(p.feature, diameter=diameter, inner_diameter=diameter / 2 * (p.feature.kind == "ring"))
        )
        for p in layout.control_points
    ]
    return replace(layout, control_points=tuple(points))


def one_set(
    layout: Marker, name: str, px: float, photos: int, rng: np.random.Generator
) -> dict[str, tuple[float, int]]:
    """Sums of squares and degrees of freedom by column."""
    camera, freed = LENSES[name]
    rotation, translation = poses_of(camera, photos, rng)
    marker = sized(layout, px * float(np.median(translation[:, 2])) / camera.fx)
    optics = Optics()
    images = [render_view(marker, camera, *pose, optics, rng) for pose in zip(rotation, translation, strict=True)]
    sums: dict[str, tuple[float, int]] = {}

    detector, poses = Detector(marker, camera, print_sigma=1e-8), []
    for image, R, place in zip(images, rotation, translation, strict=True):
        for result in detector(image):
            if result.covariance is not None:
                off = np.concatenate([logarithm(result.rotation @ R.T), result.translation - place])
                scale = np.sqrt(np.diag(result.covariance))
                poses.append(6 * nees(off / scale, result.covariance / scale / scale[:, None], 6))
    sums["poses"] = sum(poses), 6 * len(poses)

    sightings, _ = find_dots([marker], images, camera, workers=1)
    # Where the image does not show the key ring, the labels of a regular layout may be turned.
    printed = camera.project(marker.xyz, rotation, translation)[sightings.photo]
    off = np.linalg.norm(sightings.views.pixels - printed, axis=-1)
    right = np.where(sightings.views.seen, off, 0.0).max(axis=1) < px
    views, photo = sightings.views.take(right), sightings.photo[right]
    seen, rotation, translation = views.seen, rotation[photo], translation[photo]
    drawn = outlines(marker.xyz, marker.radii, rotation, translation)
    weight = np.linalg.inv(views.covariance)
    for column, center in (
        ("centers", camera.dot_centers(drawn.center, drawn.shape)),
        ("as by a pinhole", camera.to_pixels(drawn.center)),
    ):
        squares = np.einsum("vni,vnij,vnj->vn", *(off := views.pixels - center, weight, off))
        sums[column] = float(squares[seen].sum()), 2 * int(seen.sum())
    noise = (optics.light - optics.dark) / optics.noise_grey
    bound = plate_covariances(
        marker,
        camera,
        PoseDistribution("", rotation, translation),
        optics.edge_blur,
        lambda at: np.full(at.shape[:-1], noise),
    )
    center = camera.dot_centers(drawn.center, drawn.shape)
    whole = seen & camera.sees(center - 0.8 * px) & camera.sees(center + 0.8 * px)
    squares = np.einsum("vni,vnij,vnj->vn", *(off := views.pixels - center, np.linalg.inv(bound), off))
    sums["bound"] = float(squares[whole].sum()), 2 * int(whole.sum())

    freedom = CameraFreedom.of_names(camera, freed)
    network = replace(network_of([marker], Known(camera=camera), camera, ()), freedom=freedom)
    adjusted = adjust_robustly(network, views).adjustment
    places = in_gauge(adjusted.network, marker.xyz, rotation, translation)[0]
    rank = 3 * len(marker) - 7
    sums["dots"] = rank * nees((adjusted.places - places).ravel(), adjusted.covariance / adjusted.scale, rank), rank
    findings = [camera.parameter_names.index(parameter) for parameter in freed]
    off = (parameters_of(adjusted.camera) - parameters_of(camera))[findings]
    spread = adjusted.camera_covariance[np.ix_(findings, findings)] / adjusted.scale
    scale = np.sqrt(np.diag(spread))
    sums["camera"] = len(findings) * nees(off / scale, spread / scale / scale[:, None], len(findings)), len(findings)
    return sums


def main() -> None:
    """Print a table by lens, and one by size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--photos", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    layout = mg.design(n=12, radius=0.09, dot=0.03, restarts=4, seed=0).marker
    sizes = np.geomspace(10, 100, 5)
    totals: dict[str, dict[str, list[tuple[float, int]]]] = defaultdict(lambda: defaultdict(list))
    for k in range(options.sets):
        rng = np.random.default_rng([options.seed, k])
        name, px = list(LENSES)[k % len(LENSES)], sizes[k // len(LENSES) % len(sizes)]
        for column, part in one_set(layout, name, px, options.photos, rng).items():
            for row in (name, f"{px:.0f} px", "all"):
                totals[row][column].append(part)
        print(f"{k + 1} of {options.sets} sets", end="\r", file=sys.stderr, flush=True)
    print(" " * 16 + "".join(f"{column:>17s}" for column in COLUMNS))
    for row, columns in totals.items():
        sums = [np.sum(columns[column], axis=0) for column in COLUMNS]
        print(f"{row:16s}" + "".join(f"{total / max(count, 1):17.3f}" for total, count in sums))


if __name__ == "__main__":
    main()
