"""The search beside general optimizers: SLSQP from random layouts, and differential evolution with a penalty.

    python -m benchmarks.search_rivals                     n = 8, 20 and 40, each rival with three times its CPU time
    python -m benchmarks.search_rivals rotation --n 8 --times 10

Every row has the value over that of the search, below 1 where a rival is better, and CPU seconds.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time

import numpy as np
from scipy.optimize import differential_evolution

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.optimize.polish import polish
from markergen.optimize.problem import FeasibleRegion, fewer
from markergen.optimize.search import search

PENALTY = 1e3
"""Price of a meter of violation, in the logarithm of the value."""


def main() -> None:
    """Print one line for each number of dots and rival."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("objective", choices=list(OBJECTIVES), nargs="?", default="pose")
    parser.add_argument("--n", type=int, nargs="*", default=[8, 20, 40])
    parser.add_argument("--dot", type=float, default=0.02, help="diameter in m")
    parser.add_argument("--times", type=float, default=3.0, help="CPU time of a rival, in that of the search")
    options = parser.parse_args()
    boundary = Circle(0.15)
    poses = paper().seen_whole(boundary, PAPER_CAMERA)
    objective = OBJECTIVES[options.objective](Setting(boundary, PAPER_CAMERA, poses))
    rough = OBJECTIVES[options.objective](Setting(boundary, PAPER_CAMERA, fewer(poses)))
    region = FeasibleRegion(boundary, options.dot, options.dot / 10)
    for n in options.n:
        begin = time.process_time()
        value = search(objective, region, n, np.random.default_rng(0), rough=rough).value
        seconds = time.process_time() - begin
        print(f"{n:>3} search                 {1:9.5f} {seconds:8.1f}", flush=True)
        for name, rival in (("SLSQP", slsqp), ("differential evolution", evolved)):
            begin = time.process_time()
            points = rival(rough, region, n, begin + options.times * seconds)
            points, best = polish(objective, region, points)
            print(f"{n:>3} {name:22} {best / value:9.5f} {time.process_time() - begin:8.1f}", flush=True)


def slsqp(rough: Objective, region: FeasibleRegion, n: int, until: float) -> np.ndarray:
    """Best polish (n, 2) of random layouts."""
    rng, best = np.random.default_rng(1), (np.empty((n, 2)), np.inf)
    while time.process_time() < until:
        best = min(best, polish(rough, region, region.sample(1, n, rng)[0]), key=lambda end: end[1])
    return best[0]


def evolved(rough: Objective, region: FeasibleRegion, n: int, until: float) -> np.ndarray:
    """Layout (n, 2) by differential evolution, pushed apart."""
    radius = region.boundary.radius

    def cost(columns: np.ndarray) -> np.ndarray:
        layouts = columns.T.reshape(-1, n, 2)
        return np.log(rough(layouts)) + PENALTY * np.maximum(region.violation(layouts), 0.0)

    def is_late(*_: object) -> bool:
        return time.process_time() >= until

    result = differential_evolution(
        cost, [(-radius, radius)] * (2 * n), maxiter=10**6, popsize=5, rng=1, polish=False, vectorized=True,
        updating="deferred", callback=is_late, tol=0,
    )  # fmt: skip
    return region.project(result.x.reshape(1, n, 2))[0]


if __name__ == "__main__":
    main()
