"""The descent of the condition number, beside autograd through the SVD on one layout at a time, the paper's way.

    python -m benchmarks.descent [--poses 4] [--starts 500]

Every start is descended for as many steps by both, with the same rule; both are timed in turns on one core, per layout
and step, and so is numpy's batched eigh of as many 9x9 matrices, the floor. Then both are run until they no longer
improve, and their final values are held against each other.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Callable
from functools import partial

import autograd.numpy as anp
import numpy as np
from autograd import value_and_grad
from numpy.typing import NDArray

from benchmarks.condition import fastest
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution, paper
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.region import Region
from markergen.optimize.supersab import GROW, LONGEST, SHRINK, descend

Array = NDArray[np.float64]
Gradient = Callable[[Array], tuple[float, Array]]

RADIUS, STEPS, PEER_LAYOUTS = 0.15, 40, 10


def main() -> None:
    """Print the time per layout and step of both and of the floor, and how far apart the final values are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=4, help="spread evenly over the paper's 400")
    parser.add_argument("--starts", type=int, default=500, help="random layouts in one batch, for each pose")
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"descent of c(A), one pose at a time, {options.starts} starts in a batch, {STEPS} steps, one core")
    print(f"{'n':>3} {'ours us':>9} {'autograd us':>12} {'eigh us':>9} {'autograd/ours':>14} {'ours/eigh':>10} {'c apart':>10}")
    for n in range(4, 9):
        print(row(n, options.poses, options.starts), flush=True)


def row(n: int, poses: int, count: int) -> str:
    """One line: n control points."""
    boundary, rng = Circle(RADIUS), np.random.default_rng(n)
    region, distribution = Region(boundary), paper()
    half = rng.normal(size=(count, 9, 9))
    matrices = half @ half.swapaxes(-1, -2)
    times, apart = [], 0.0
    for pose in np.linspace(0, len(distribution) - 1, poses).round().astype(int):
        setting = Setting(boundary, PAPER_CAMERA, PoseDistribution("one", distribution.rotation[[pose]], distribution.translation[[pose]]))
        objective = OBJECTIVES["condition"](setting, aggregate="mean")
        gradient = by_autograd(setting)
        starts = region.sample(count, n, rng)
        few = starts[:PEER_LAYOUTS]

        ours = partial(descend, objective, region, starts, steps=STEPS, patience=STEPS + 1)
        peer = partial(one_by_one, gradient, few, STEPS)
        ours_s, peer_s, floor_s = fastest(ours, peer, partial(np.linalg.eigh, matrices), rounds=3)
        times.append(
            (ours_s / (count * (STEPS + 1)), peer_s / (len(few) * (STEPS + 1)), floor_s / count)
        )
        final = descend(objective, region, few, steps=400, patience=401).values
        apart = max(apart, float(np.max(np.abs(final / one_by_one(gradient, few, 400) - 1))))
    ours_us, peer_us, floor_us = 1e6 * np.mean(times, axis=0)
    return (
        f"{n:>3} {ours_us:>9.2f} {peer_us:>12.1f} {floor_us:>9.2f} {peer_us / ours_us:>14.1f} {ours_us / floor_us:>10.2f}"
        f" {apart:>10.1e}"
    )


def by_autograd(setting: Setting) -> Gradient:
    """Log of c(A) and its gradient for one layout (n, 2) in one pose, through autograd's SVD; unit coordinates."""
    rotation, translation = setting.poses.rotation[0], setting.poses.translation[0]
    radius, depth = setting.boundary.radius, translation[2]

    def log_condition(points: Array) -> float:
        camera = points @ rotation[:, :2].T + translation
        image = (camera[:, :2] / camera[:, 2:] - translation[:2] / depth) * (depth / radius)
        p = anp.concatenate([points / radius, anp.ones((len(points), 1))], axis=1)
        zero = anp.zeros(p.shape)
        above = anp.concatenate([zero, -p, image[:, 1:] * p], axis=1)
        below = anp.concatenate([p, zero, -image[:, :1] * p], axis=1)
        values = anp.linalg.svd(anp.concatenate([above, below]), compute_uv=False)
        return anp.log(values[0] / values[7])

    return value_and_grad(log_condition)


def one_by_one(gradient_of: Gradient, starts: Array, steps: int) -> Array:
    """SuperSAB in the disk from every start, one after the other; the best values (B,) met."""
    best = np.empty(len(starts))
    for index, start in enumerate(starts):
        points = start.copy()
        value, gradient = gradient_of(points)
        step = np.full(points.shape, 0.05 * RADIUS / np.abs(gradient).max())
        lowest = value
        for _ in range(steps):
            points = points - np.clip(step * gradient, -LONGEST * RADIUS, LONGEST * RADIUS)
            reach = np.hypot(points[:, 0], points[:, 1])
            points = points * np.minimum(1.0, RADIUS / np.maximum(reach, 1e-300))[:, None]
            value, fresh = gradient_of(points)
            agreement = fresh * gradient
            step = step * np.where(agreement > 0, GROW, np.where(agreement < 0, SHRINK, 1.0))
            gradient, lowest = fresh, min(lowest, value)
        best[index] = np.exp(lowest)
    return best


if __name__ == "__main__":
    main()
