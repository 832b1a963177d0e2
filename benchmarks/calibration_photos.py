"""Prints measured end to end: rendered photographs through `calibrate`, and fresh ones through `detect`.

    python -m benchmarks.calibration_photos [--sets 5] [--photos 20] [--n 5 24] [--views 40] [--known-only]

Prints and photographs are those of `benchmarks.calibration`, but rendered, through a lens with distortion, with blur
and 2 grey levels of noise. Each row: RMS error over the sets of poses that are fitted to exact images of the true
print over the paper's poses, with the 95 % interval (bootstrap over the sets); and RMS error of `detect` in fresh
rendered views, whose noise counts as well, with the number found.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import markergen as mg
from benchmarks.calibration import one_set, pose_error
from benchmarks.calibration_sets import CAMERA, SimulatedSet, in_gauge
from markergen.arrays import Array
from markergen.calibration.network import Network
from markergen.detect import Detector
from markergen.maths.rotation import angle_between
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import paper
from markergen.render import Optics, render_view
from markergen.validation.print_error import displaced


class Row:
    """Errors of one way to use a print, over the sets."""

    def __init__(self) -> None:
        self.exact: list[float] = []
        self.detected: list[float] = []
        self.shown = 0

    def add(self, made: SimulatedSet, network: Network, used: Marker, camera: Camera, fresh: "Fresh") -> None:
        """Measure the errors of poses by a marker and a camera, both as they are used."""
        self.exact.append(pose_error(made, network, used.xyz, camera)[0])
        _, rotation, _ = in_gauge(network, made.true, fresh.rotation, fresh.translation)
        detector = Detector(used, camera)
        for image, true in zip(fresh.images, rotation, strict=True):
            self.shown += 1
            findings = detector(image)
            if findings and findings[0].rotation is not None:
                self.detected.append(float(np.rad2deg(angle_between(findings[0].rotation, true))))

    def __str__(self) -> str:
        squares = np.square(self.exact)
        drawn = np.random.default_rng(0).choice(squares, size=(2000, len(squares))).mean(axis=1)
        low, high = np.sqrt(np.quantile(drawn, [0.025, 0.975]))
        seen = np.sqrt(np.mean(np.square(self.detected)))
        return (
            f"{np.sqrt(squares.mean()):.4f} ({low:.4f} to {high:.4f}) deg, detected {seen:.4f} deg, "
            f"{len(self.detected)} of {self.shown} found"
        )


class Fresh:
    """Rendered views of a print that took no part in its calibration, from the paper's poses that show all of it."""

    def __init__(self, printed: Marker, count: int, rng: np.random.Generator) -> None:
        poses = paper()
        whole = CAMERA.sees(CAMERA.project(printed.xyz, poses.rotation, poses.translation)).all(axis=1)
        chosen = rng.choice(np.flatnonzero(whole), count, replace=False)
        self.rotation, self.translation = poses.rotation[chosen], poses.translation[chosen]
        self.images = rendered(printed, self.rotation, self.translation, rng)


def rendered(printed: Marker, rotation: Array, translation: Array, rng: np.random.Generator) -> list[NDArray[np.uint8]]:
    """Photographs of a print."""
    poses = zip(rotation, translation, strict=True)
    return [np.asarray(render_view(printed, CAMERA, R, place, Optics(), rng)) for R, place in poses]


def errors(n: int, photos: int, sets: int, views: int, cameras: Sequence[str]) -> dict[str, Row]:
    """Rows by case, for fresh prints of one design."""
    rng, design = np.random.default_rng(n), mg.design(n=n, restarts=8, seed=0).marker
    rows: dict[str, Row] = {}
    for _ in range(sets):
        made = one_set(design.xyz, photos, rng)
        printed = displaced(design, made.true - design.xyz)
        images = rendered(printed, made.rotation, made.translation, rng)
        fresh = Fresh(printed, views, rng)
        held = made.network()
        rows.setdefault("as designed", Row()).add(made, held, design, CAMERA, fresh)
        for case in cameras:
            calibration = mg.calibrate(design, images, CAMERA if case == "camera known" else None, workers=1)
            rows.setdefault(case, Row()).add(made, held, calibration.markers[0], CAMERA, fresh)
            if case == "camera unknown":
                rows.setdefault(f"{case}, and used", Row()).add(
                    made, held, calibration.markers[0], calibration.camera, fresh
                )
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=5)
    parser.add_argument("--photos", type=int, default=20)
    parser.add_argument("--n", type=int, nargs="+", default=[5, 24])
    parser.add_argument("--views", type=int, default=40)
    parser.add_argument("--known-only", action="store_true", help="only with a known camera, which is faster")
    options = parser.parse_args()
    cameras = ["camera known"] if options.known_only else ["camera known", "camera unknown"]
    print("dots photographs case: rotation deg (95 % interval), by detect deg, found")
    for n in options.n:
        for case, row in errors(n, options.photos, options.sets, options.views, cameras).items():
            print(f"{n:3d} {options.photos:3d}  {case}: {row}", flush=True)


if __name__ == "__main__":
    main()
