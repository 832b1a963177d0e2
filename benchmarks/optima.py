"""How reliably the search finds the best known optimum, by the seed; n = 4..12.

    python -m benchmarks.optima pose                         bare points on the paper's disk, 20 seeds
    python -m benchmarks.optima condition --seeds 20 --starts 200
    python -m benchmarks.optima pose --shapes --seeds 10     dots in six other shapes
    python -m benchmarks.optima pose --shapes L star --n 12 --dot 0.02

Each row counts the seeds that end within a tolerance of the best of all runs, one with many starts among them, and has
the largest breach of the constraints, measured independently.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from dataclasses import replace

import numpy as np

from benchmarks.shapes import shapes
from markergen.model.boundary import Boundary, Circle
from markergen.model.poses import paper
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.check import breach
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.dots import choose_dots
from markergen.optimize.goal import objective_of, room_of, rough_of
from markergen.optimize.multistart import Optimum, search
from markergen.optimize.region import Region


def main() -> None:
    """Run the search for every shape, n and seed, and print how the results spread."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("objective", choices=list(OBJECTIVES), nargs="?", default="pose")
    parser.add_argument("--n", type=int, nargs="*", default=list(range(4, 13)))
    parser.add_argument("--shapes", nargs="*", choices=list(shapes()), help="none named: all six")
    parser.add_argument("--dot", type=float, help="diameter in m; default 0 in the disk, what design takes elsewhere")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--starts", type=int, default=200, help="of the one run that sets the mark")
    options = parser.parse_args()
    print(f"{options.objective}, {options.seeds} seeds")
    print("shape      n dot mm      best  best/n-gon  worst/best  <=0.1 %  <=0.5 %   breach m  CPU s each")
    for name in ["disk"] if options.shapes is None else options.shapes or list(shapes()):
        boundary, keep_outs = (Circle(0.15), ()) if name == "disk" else shapes()[name]
        spec = Spec(
            objective=options.objective, boundary=boundary, keep_outs=keep_outs,
            dot=0.0 if name == "disk" and options.dot is None else options.dot,
        )  # fmt: skip
        for n in options.n:
            row(name, replace(spec, n=n), options.seeds, options.starts)


def row(name: str, spec: Spec, seeds: int, starts: int) -> None:
    """Print one line: a shape and an n."""
    setting = Setting(spec.boundary, spec.camera, paper().seen_whole(spec.boundary, spec.camera))
    dots = choose_dots(spec, setting.poses)
    room: Boundary = room_of(spec)
    region = Region(room, dots.diameter, dots.clearance)
    objective, rough = objective_of(spec, setting), rough_of(spec, setting)

    def run(seed: int, restarts: int = 0) -> Optimum:
        return search(objective, region, spec.n, np.random.default_rng(seed), restarts, rough=rough)

    mark = run(10_000, starts).value
    start = time.process_time()
    found = [run(seed) for seed in range(seeds)]
    seconds = (time.process_time() - start) / seeds
    values = np.array([optimum.value for optimum in found])
    worst = max(
        breach(optimum.points, spec.boundary, spec.keep_outs, dots.diameter, dots.clearance) for optimum in found
    )
    polygon = comparison_layouts(region, spec.n, setting=setting).get("ngon")
    best = min(mark, values.min())
    within = [int(np.sum(values <= best * (1 + tolerance))) for tolerance in (1e-3, 5e-3)]
    ratio = f"{best / objective(polygon)[0]:.5f}" if polygon is not None else "-"
    print(
        f"{name:<9} {spec.n:>2} {dots.diameter * 1e3:>6.1f} {best:>9.6f} {ratio:>11} {values.max() / best:>11.5f} "
        f"{within[0]:>8} {within[1]:>8} {worst:>10.1e} {seconds:>11.2f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
