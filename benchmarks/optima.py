"""How reliably the search finds the best known optimum, by the seed; n = 4..12.

    python -m benchmarks.optima pose                         bare points on the paper's disk, 20 seeds
    python -m benchmarks.optima condition --n 6 --seeds 5

`python -m benchmarks.shapes` does the same for other shapes. Each row counts the seeds that end within a tolerance of
the best of all runs, one with many starts among them, and has the largest breach of the constraints, measured
independently.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from dataclasses import replace

import numpy as np

from markergen.model.boundary import Circle
from markergen.model.poses import paper
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.design import design
from markergen.optimize.dot_size import choose_dots
from markergen.optimize.layouts import regular_layouts
from markergen.optimize.problem import FeasibleRegion, breach, objective_of, room_of, rough_of
from markergen.optimize.search import Optimum, search

HEADINGS = "shape      n dot mm      best  best/n-gon  worst/best  <=0.1 %  <=0.5 %   breach m  CPU s each"


def main() -> None:
    """Run the search for every n and seed, and print how the results spread."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, seeds=20, starts=200)
    parser.add_argument("--dot", type=float, default=0.0, help="diameter in m")
    options = parser.parse_args()
    print(f"{options.objective}, {options.seeds} seeds\n{HEADINGS}")
    for n in options.n:
        spec = Spec(n=n, objective=options.objective, aggregate=options.aggregate, boundary=Circle(0.15))
        print(row("disk", replace(spec, dot=options.dot), options.seeds, options.starts), flush=True)


def add_options(parser: argparse.ArgumentParser, seeds: int, starts: int) -> None:
    """Add what is searched and how often to the options of a benchmark."""
    parser.add_argument("objective", choices=list(OBJECTIVES), nargs="?", default="pose")
    parser.add_argument("--aggregate", default="", help="over the poses; default the objective's own")
    parser.add_argument("--n", type=int, nargs="*", default=list(range(4, 13)))
    parser.add_argument("--seeds", type=int, default=seeds)
    parser.add_argument("--starts", type=int, default=starts, help="of the one run that sets the mark")


def row(name: str, spec: Spec, seeds: int, starts: int) -> str:
    """One line: how the search fares in one shape with one n."""
    setting = Setting(spec.boundary, spec.camera, paper().seen_whole(spec.boundary, spec.camera))
    dots = choose_dots(spec, setting.poses)
    region = FeasibleRegion(room_of(spec), dots.diameter, dots.clearance)
    objective, rough = objective_of(spec, setting), rough_of(spec, setting)

    def run(seed: int, restarts: int = 0) -> Optimum:
        return search(objective, region, spec.n, np.random.default_rng(seed), restarts, rough=rough)

    mark = run(10_000, starts).value
    start = time.process_time()
    results = [run(seed) for seed in range(seeds)]
    seconds = (time.process_time() - start) / seeds
    values = np.array([optimum.value for optimum in results])
    worst = max(
        breach(optimum.points, spec.boundary, spec.keep_outs, dots.diameter, dots.clearance) for optimum in results
    )
    polygon = comparison_layouts(region, spec.n, setting=setting).get("ngon")
    best = min(mark, values.min())
    within = [int(np.sum(values <= best * (1 + tolerance))) for tolerance in (1e-3, 5e-3)]
    ratio = f"{best / objective(polygon)[0]:.5f}" if polygon is not None else "-"
    return (
        f"{name:<9} {spec.n:>2} {dots.diameter * 1e3:>6.1f} {best:>9.6f} {ratio:>11} {values.max() / best:>11.5f} "
        f"{within[0]:>8} {within[1]:>8} {worst:>10.1e} {seconds:>11.2f}"
    )


BESIDE = "room       n objective    aggregate   design/best  best is  design/bound   seconds"


def beside(name: str, spec: Spec, starts: int) -> tuple[str, float]:
    """One line, and the ratio of a design to the best of the regular layouts and a search with other seed and `starts`.

    Zero starts leaves that search out. All keep the gap of the design. The bound is its certificate's, if it has one.
    """
    start = time.process_time()
    actual = design(spec)
    seconds = time.process_time() - start
    # With the gap, if any, that keeps images of the dots apart.
    spec, dots = actual.spec, actual.dots
    region = FeasibleRegion(room_of(spec), dots.diameter, dots.clearance, spec.gap)
    objective, rough = objective_of(spec, actual.setting), rough_of(spec, actual.setting)
    least = actual.certificate.lower_bound
    layouts, count = regular_layouts(region, spec.n)
    values = objective(layouts) if len(layouts) else np.array([np.inf])
    others = {"polygon": values[:count].min(initial=np.inf), "regular": values[count:].min(initial=np.inf)}
    if starts:
        more = search(objective, region, spec.n, np.random.default_rng(10_000), starts, rough=rough)
        others["search"] = more.value
    best = min(others, key=lambda other: others[other])
    ratio, above = float(actual.value / others[best]), f"{actual.value / least:.5f}" if least else "-"
    line = f"{name:<9} {spec.n:>2} {spec.objective:<12} {objective.aggregate:<11} {ratio:>11.5f}"
    return f"{line}  {best:<8} {above:>12} {seconds:>9.1f}", ratio


if __name__ == "__main__":
    main()
