"""Time of `validate` against a bare loop over the same arrays, OpenCV calls and DLT, with as many workers.

    python -m benchmarks.trials [--poses 400] [--runs 1000] [--workers 2]

The bare loop is given its arrays ready made, and only its calls are timed; `validate` is timed as a whole, with the
start of its processes, the noise, the errors and the statistics. OpenCV's own LM refinement is slower than everything
else together, so there are two ratios: with it in the bare loop, and with our batched LM in both.
"""

import argparse
import time
from functools import partial

import cv2
import numpy as np

from markergen.estimators import Correspondences
from markergen.estimators.ippe import IPPE
from markergen.estimators.lm import refine
from markergen.estimators.opencv import prepare
from markergen.maths.dlt import estimate_homography
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import PoseDistribution, paper
from markergen.validate.bounds import pose_bounds
from markergen.validate.pool import map_chunks, processor_count
from markergen.validate.run import POSES_AT_ONCE, validate
from markergen.validate.trials import Experiment, noisy_images

Times = dict[str, float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=400, help="every so many-th of the paper's poses is taken")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=processor_count())
    options = parser.parse_args()

    marker, poses = pentagon(), subset(paper(), options.poses)
    start = time.perf_counter()
    validate(marker, PAPER_CAMERA, poses, runs=options.runs, workers=options.workers).as_dict()
    ours = time.perf_counter() - start

    bounds = pose_bounds(marker.xyz, PAPER_CAMERA, poses, 0.2)
    experiment = Experiment(marker.xyz, 0.15, PAPER_CAMERA, poses, bounds, 0.2, options.runs, 0, ())
    chunks = [range(i, min(i + POSES_AT_ONCE, len(poses))) for i in range(0, len(poses), POSES_AT_ONCE)]
    parts = map_chunks(partial(bare_loop, experiment), chunks, options.workers, lambda _: None)
    spent = {name: sum(part[name] for part in parts) / options.workers for name in parts[0]}
    common = spent["dlt"] + spent["epnp"] + spent["ippe"] + spent["sqpnp"]

    trials = len(poses) * options.runs
    print(f"{len(poses)} poses x {options.runs} runs, {options.workers} workers")
    for name, seconds in spent.items():
        print(f"  {name:12} {seconds / trials * options.workers * 1e6:7.1f} us a trial")
    print(f"validate                          {ours:7.2f} s")
    for name, label in [("lm_opencv", "OpenCV's LM"), ("lm_batched", "our batched LM")]:
        bare = common + spent[name]
        print(f"bare loop with {label:18} {bare:7.2f} s, ratio {ours / bare:.2f}")


def pentagon() -> Marker:
    """Return the regular pentagon of 36 mm dots that fits a disk of radius 0.15 m."""
    angles = np.pi / 2 + 2 * np.pi * np.arange(5) / 5
    return Marker(
        tuple(
            ControlPoint(i, 0.1284 * np.cos(a), 0.1284 * np.sin(a), 0.0, Feature(0.036) if i else key_ring(0.036))
            for i, a in enumerate(angles)
        ),
        Circle(0.15),
        clearance=0.0036,
    )


def subset(poses: PoseDistribution, count: int) -> PoseDistribution:
    """Take `count` poses spread evenly over the distribution."""
    kept = np.linspace(0, len(poses) - 1, min(count, len(poses))).round().astype(int)
    return PoseDistribution(poses.name, poses.rotation[kept], poses.translation[kept])


def bare_loop(experiment: Experiment, indices: range) -> Times:
    """Seconds that the calls alone take, for each estimator."""
    spent = dict.fromkeys(["dlt", "epnp", "ippe", "sqpnp", "lm_opencv", "lm_batched"], 0.0)
    matrix = experiment.camera.matrix
    for index in indices:
        for images in noisy_images(experiment, index):
            batch = Correspondences(experiment.points, images, experiment.camera)
            objects, images, _ = prepare(batch)
            pairs = list(zip(objects, images, strict=True))
            start = time.perf_counter()
            estimate_homography(experiment.points[:, :2], images)
            spent["dlt"] += time.perf_counter() - start
            for name, flag in [("epnp", cv2.SOLVEPNP_EPNP), ("sqpnp", cv2.SOLVEPNP_SQPNP)]:
                start = time.perf_counter()
                for points, image in pairs:
                    cv2.solvePnP(points, image, matrix, None, flags=flag)
                spent[name] += time.perf_counter() - start
            start = time.perf_counter()
            starts = [
                cv2.solvePnPGeneric(points, image, matrix, None, flags=cv2.SOLVEPNP_IPPE) for points, image in pairs
            ]
            spent["ippe"] += time.perf_counter() - start
            start = time.perf_counter()
            for (points, image), (_, vectors, shifts, _) in zip(pairs, starts, strict=True):
                cv2.solvePnPRefineLM(points, image, matrix, None, vectors[0], shifts[0])
            spent["lm_opencv"] += time.perf_counter() - start
            best = batch.once(IPPE).best
            start = time.perf_counter()
            refine(batch, *best)
            spent["lm_batched"] += time.perf_counter() - start
    return spent


if __name__ == "__main__":
    main()
