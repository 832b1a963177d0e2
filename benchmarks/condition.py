"""Value and gradient of the condition number, beside numpy's batched eigh of as many 9x9 matrices (the floor).

python -m benchmarks.condition
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.objectives import OBJECTIVES, Setting

LAYOUTS, ROUNDS = 10, 30


def main() -> None:
    """Print the ratio for n = 4..12: 10 layouts under 400 poses, a batch of 4,000."""
    # The floor runs on one core, so ours does too.
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    boundary = Circle(0.15)
    objective = OBJECTIVES["condition"](Setting(boundary, PAPER_CAMERA, paper()))
    rng = np.random.default_rng(0)
    print("condition, value and gradient, 10 layouts x 400 poses, one core")
    print(f"{'n':>3} {'ours us':>9} {'eigh us':>9} {'ratio':>6}")
    for n in range(4, 13):
        points = rng.uniform(-0.1, 0.1, (LAYOUTS, n, 2))
        half = rng.normal(size=(LAYOUTS * 400, 9, 9))
        matrices = half @ half.swapaxes(-1, -2)
        ours, floor = fastest(partial(objective.value_and_gradient, points), partial(np.linalg.eigh, matrices))
        scale = 1e6 / (LAYOUTS * 400)
        print(f"{n:>3} {ours * scale:>9.2f} {floor * scale:>9.2f} {ours / floor:>6.2f}")


def fastest(*calls: Callable[[], object], rounds: int = ROUNDS) -> list[float]:
    """Least time in s of each call; they take turns, so that a busy machine is unfair to none."""
    best = [np.inf] * len(calls)
    for _ in range(rounds):
        for index, call in enumerate(calls):
            start = time.perf_counter()
            call()
            best[index] = min(best[index], time.perf_counter() - start)
    return best


if __name__ == "__main__":
    main()
