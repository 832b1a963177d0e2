"""How reliably the search finds the best known optimum: bare points on the paper's disk, n = 4..12, 20 seeds.

    python -m benchmarks.optima pose
    python -m benchmarks.optima condition --seeds 20 --starts 200

Each row counts the seeds that end within a tolerance of the best of all runs, one with many starts among them.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time

import numpy as np

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.multistart import search
from markergen.optimize.region import Region


def main() -> None:
    """Run the search for every n and seed, and print how the results spread."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("objective", choices=list(OBJECTIVES), nargs="?", default="pose")
    parser.add_argument("--n", type=int, nargs="*", default=list(range(4, 13)))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--starts", type=int, default=200, help="of the one run that sets the mark")
    options = parser.parse_args()
    boundary = Circle(0.15)
    region = Region(boundary)
    objective = OBJECTIVES[options.objective](Setting(boundary, PAPER_CAMERA, paper()))
    print(f"{options.objective} ({objective.aggregate}), bare points, {options.seeds} seeds")
    print(" n     n-gon      best  best/n-gon  worst/best  <=0.1 %  <=0.5 %  s each")
    for n in options.n:
        mark = search(objective, region, n, np.random.default_rng(10_000), options.starts).value
        start = time.perf_counter()
        values = np.array([search(objective, region, n, np.random.default_rng(s)).value for s in range(options.seeds)])
        seconds = (time.perf_counter() - start) / options.seeds
        polygon = float(objective(regular_polygon(n, boundary.radius)[None])[0])
        best = min(mark, values.min())
        within = [int(np.sum(values <= best * (1 + tolerance))) for tolerance in (1e-3, 5e-3)]
        print(
            f"{n:>2} {polygon:>9.6f} {best:>9.6f} {best / polygon:>11.5f} {values.max() / best:>11.5f} "
            f"{within[0]:>8} {within[1]:>8} {seconds:>7.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
