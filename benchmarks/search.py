"""Time to the best known optimum, beside scipy's SLSQP from random starts and its differential evolution.

    python -m benchmarks.search [--n 8] [--seeds 3] [--patience 600]

All minimize the same objective over the same disk, our code for its value and gradient, bare points, 400 poses. Ours
is timed as a whole; the peers are stopped as soon as they are within a tenth of a percent of the best known value, or
when their patience ends. Both get what helps them: SLSQP the gradient, evolution whole generations at once.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, NonlinearConstraint, differential_evolution, minimize

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.multistart import search
from markergen.optimize.region import Region

Array = NDArray[np.float64]

RADIUS, NEAR = 0.15, 1e-3


class Reached(Exception):
    """A peer is near enough, or out of patience."""


class Watch:
    """Counts the processor seconds of a peer until it first meets the mark, and keeps its best value."""

    def __init__(self, mark: float, patience: float) -> None:
        self.mark, self.patience, self.best = mark, patience, np.inf
        self.start = time.process_time()
        self.seconds = np.inf

    def saw(self, value: float) -> None:
        """Stop the peer when it is done."""
        spent = time.process_time() - self.start
        self.best = min(self.best, value)
        if self.best <= self.mark * (1 + NEAR):
            self.seconds = spent
        if self.seconds < np.inf or spent > self.patience:
            raise Reached


def main() -> None:
    """Print the processor seconds of each, by the seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=8)
    parser.add_argument("--objectives", nargs="*", default=["pose", "condition"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--patience", type=float, default=600.0, help="processor seconds for each run of a peer")
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    boundary = Circle(RADIUS)
    region, setting = Region(boundary), Setting(boundary, PAPER_CAMERA, paper())
    print(f"processor seconds to within 0.1 % of the best known optimum, n = {options.n}, one core")
    print(f"{'objective':<10} {'seed':>4} {'ours':>7} {'SLSQP':>9} {'evolution':>10} {'SLSQP/ours':>11} {'evolution/ours':>15}"
          f" {'value':>9} {'peers':>19}")
    for name in options.objectives:
        objective = OBJECTIVES[name](setting)
        marks = [search(objective, region, options.n, np.random.default_rng(10_000), 100).value]
        marks.append(float(objective(comparison_layouts(region, options.n, setting=setting)["ngon"])[0]))
        for seed in range(options.seeds):
            start = time.process_time()
            found = search(objective, region, options.n, np.random.default_rng(seed))
            ours = time.process_time() - start
            mark = min([*marks, found.value])
            peers = [run(peer, objective, options.n, seed, Watch(mark, options.patience)) for peer in (slsqp, evolution)]
            print(
                f"{name:<10} {seed:>4} {ours:>7.2f} "
                + " ".join(f"{time_of(watch):>{width}}" for watch, width in zip(peers, (9, 10), strict=True))
                + " "
                + " ".join(f"{ratio(watch, ours):>{width}}" for watch, width in zip(peers, (11, 15), strict=True))
                + f" {found.value:>9.6f} "
                + " ".join(f"{watch.best:>9.6f}" for watch in peers),
                flush=True,
            )


def run(peer: Callable[[Objective, int, int, Watch], None], objective: Objective, n: int, seed: int, watch: Watch) -> Watch:
    """Let a peer search until its watch stops it."""
    try:
        peer(objective, n, seed, watch)
    except Reached:
        pass
    return watch


def slsqp(objective: Objective, n: int, seed: int, watch: Watch) -> None:
    """SLSQP with the gradient, in units of the radius, from one random layout after the other."""
    rng, region = np.random.default_rng(seed), Region(objective.setting.boundary)

    def value_and_gradient(flat: Array) -> tuple[float, Array]:
        value, gradient = objective.value_and_gradient(RADIUS * flat.reshape(1, n, 2))
        inside = np.linalg.norm(flat.reshape(n, 2), axis=-1).max() <= 1 + 1e-9
        watch.saw(float(value[0]) if inside else np.inf)
        # The logarithm, as in our descent: SLSQP's tolerance is absolute, and values of millimeters would end it at once.
        return float(np.log(value[0])), RADIUS * gradient.ravel() / float(value[0])

    room = {
        "type": "ineq",
        "fun": lambda flat: 1 - np.sum(flat.reshape(n, 2) ** 2, axis=-1),
        "jac": lambda flat: -2 * np.kron(np.eye(n), [[1.0, 1.0]]) * flat,
    }
    while True:
        start = region.sample(1, n, rng).ravel() / RADIUS
        minimize(value_and_gradient, start, jac=True, method="SLSQP", constraints=[room], options={"maxiter": 300})


def evolution(objective: Objective, n: int, seed: int, watch: Watch) -> None:
    """Differential evolution over the square around the disk, with the disk as its constraint; again if it ends."""

    def values(population: Array) -> Array:
        layouts = np.moveaxis(population.reshape(n, 2, -1), -1, 0)
        result = objective(RADIUS * layouts)
        inside = np.linalg.norm(layouts, axis=-1).max(axis=-1) <= 1 + 1e-9
        watch.saw(float(np.min(result[inside], initial=np.inf)))
        return np.minimum(result, 1e6)

    room = NonlinearConstraint(lambda flat: np.sum(flat.reshape(n, 2, *flat.shape[1:]) ** 2, axis=1), -np.inf, 1.0)
    for attempt in range(1000):
        differential_evolution(
            values, Bounds([-1.0] * 2 * n, [1.0] * 2 * n), constraints=room, maxiter=100_000, polish=False,
            vectorized=True, updating="deferred", rng=np.random.default_rng([seed, attempt]),
        )


def time_of(watch: Watch) -> str:
    return f"{watch.seconds:.1f}" if watch.seconds < np.inf else f"> {watch.patience:.0f}"


def ratio(watch: Watch, ours: float) -> str:
    return f"{watch.seconds / ours:.1f}" if watch.seconds < np.inf else f"> {watch.patience / ours:.0f}"


if __name__ == "__main__":
    main()
