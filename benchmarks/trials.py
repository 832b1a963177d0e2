"""Time of trials against a bare loop over the same arrays, OpenCV calls and DLT, with as many workers.

    python -m benchmarks.trials [--poses 400] [--runs 1000] [--workers 2]

The bare loop is given its arrays ready made, and only its calls are timed; ours are timed as a whole, with the
start of its processes, the noise, the errors and the statistics. OpenCV's own LM refinement is slower than everything
else but SQPnP, so there are two ratios: with it in the bare loop, and with our batched LM in both.

Processor time is given beside the time on the wall, because on a busy machine only that one compares; then for both
the seconds of all workers together.
"""

import argparse
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from markergen.estimators import Correspondences
from markergen.estimators.base import opencv_arguments
from markergen.estimators.ippe import IPPE
from markergen.estimators.lm import refine
from markergen.maths.dlt import estimate_homography
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import PoseDistribution, paper
from markergen.pool import map_chunks, processor_count
from markergen.validation.bounds import pose_bounds
from markergen.validation.trials import POSES_AT_ONCE, Experiment, noisy_images, run_experiment

Times = dict[str, NDArray[np.float64]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=400, help="every so many-th of the paper's poses is taken")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=processor_count())
    options = parser.parse_args()

    marker, poses = pentagon(), subset(paper(), options.poses)
    before, start = processor_seconds(), time.perf_counter()
    run_experiment(marker, PAPER_CAMERA, poses, runs=options.runs, workers=options.workers).as_dict()
    ours = np.array([time.perf_counter() - start, processor_seconds() - before])

    bounds = pose_bounds(marker.xyz, PAPER_CAMERA, poses, 0.2)
    experiment = Experiment(marker.xyz, 0.15, PAPER_CAMERA, poses, bounds, 0.2, options.runs, 0, ())
    chunks = [range(i, min(i + POSES_AT_ONCE, len(poses))) for i in range(0, len(poses), POSES_AT_ONCE)]
    parts = map_chunks(partial(bare_loop, experiment), chunks, options.workers, lambda *_: None)
    spent = {name: np.sum([part[name] for part in parts], axis=0) for name in parts[0]}

    print(f"{len(poses)} poses x {options.runs} runs, {options.workers} workers")
    print("                                    wall s  processor s")
    for name, (wall, processor) in spent.items():
        print(f"  {name:30} {wall / options.workers:9.2f} {processor:12.2f}")
    print(f"run_experiment                   {ours[0]:9.2f} {ours[1]:12.2f}")
    for name, label in [("lm_opencv", "OpenCV's LM"), ("lm_batched", "our batched LM")]:
        bare = (spent["dlt"] + spent["epnp"] + spent["ippe"] + spent["sqpnp"] + spent[name]) / [options.workers, 1]
        print(f"bare loop with {label:17} {bare[0]:9.2f} {bare[1]:12.2f}")
        print(f"  ratio                          {ours[0] / bare[0]:9.2f} {ours[1] / bare[1]:12.2f}")


def processor_seconds() -> float:
    """Processor time of this process and of the workers that it has seen end."""
    return sum(os.times()[:4])


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
    """Seconds on the wall and of the processor that the calls alone take, for each estimator."""
    spent: Times = {}
    matrix = experiment.camera.matrix

    @contextmanager
    def timed(name: str) -> Iterator[None]:
        wall, processor = time.perf_counter(), time.process_time()
        yield
        taken = np.array([time.perf_counter() - wall, time.process_time() - processor])
        spent[name] = spent.get(name, np.zeros(2)) + taken

    for index in indices:
        for images in noisy_images(experiment, index):
            batch = Correspondences(experiment.points, images, experiment.camera)
            objects, images, _ = opencv_arguments(batch)
            pairs = list(zip(objects, images, strict=True))
            with timed("dlt"):
                estimate_homography(experiment.points[:, :2], images)
            with timed("epnp"):
                # Twice, as our entry does, and for the same reason.
                for points, image in pairs * 2:
                    cv2.solvePnP(points, image, matrix, None, flags=cv2.SOLVEPNP_EPNP)
            with timed("sqpnp"):
                for points, image in pairs:
                    cv2.solvePnP(points, image, matrix, None, flags=cv2.SOLVEPNP_SQPNP)
            with timed("ippe"):
                starts = [cv2.solvePnPGeneric(*pair, matrix, None, flags=cv2.SOLVEPNP_IPPE) for pair in pairs]
            with timed("lm_opencv"):
                for (points, image), (_, vectors, shifts, _) in zip(pairs, starts, strict=True):
                    cv2.solvePnPRefineLM(points, image, matrix, None, vectors[0], shifts[0])
            best = batch.once(IPPE).best
            with timed("lm_batched"):
                refine(batch, *best)
    return spent


if __name__ == "__main__":
    main()
