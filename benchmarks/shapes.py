"""How reliably the search finds the best known optimum in a disk and in shapes that trap a descent.

    python -m benchmarks.shapes --dot 0.01                        the pose objective, n = 4..12, 10 seeds
    python -m benchmarks.shapes condition --shapes L star --n 12
    python -m benchmarks.shapes --aggregate max --n 7             dots as large as `design` takes them
    python -m benchmarks.shapes --beside rotation homography --shapes disk L --n 10 16 --starts 0
    python -m benchmarks.shapes --random 50                       specs at random, beside ten times the starts

Each row is as of `benchmarks.optima`. At least 9 of 10 seeds are to end within 0.5 % of the best of all, and no
constraint is to be broken by more than 1e-9 m.

With --beside and --random, each row is one design beside the best of the regular layouts and of a search with another
seed and --starts starts, and beside the lower bound on all layouts; the last line counts the designs more than 0.1 %
above the best of these.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from benchmarks.optima import BESIDE, HEADINGS, add_options, beside, row
from markergen.arrays import Array
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.model.camera import Camera
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES
from markergen.optimize.search import RANDOM, STARTS


def main() -> None:
    """Run the search for every shape, n and seed, and print how the results spread."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, seeds=10, starts=60)
    parser.add_argument("--shapes", nargs="*", choices=list(shapes()), default=list(shapes()))
    parser.add_argument("--dot", type=float, help="diameter in m; default what design takes")
    parser.add_argument("--beside", nargs="+", choices=list(OBJECTIVES), help="objectives of designs to compare")
    parser.add_argument("--random", type=int, default=0, metavar="K", help="compare designs for K random specs")
    options = parser.parse_args()
    if options.beside or options.random:
        compare(random_specs(options.random) if options.random else chosen_specs(options))
        return
    print(f"{options.objective}, {options.seeds} seeds\n{HEADINGS}")
    for name in options.shapes:
        boundary, keep_outs = shapes()[name]
        for n in options.n:
            spec = Spec(
                n=n, objective=options.objective, aggregate=options.aggregate, dot=options.dot,
                boundary=boundary, keep_outs=keep_outs,
            )  # fmt: skip
            print(row(name, spec, options.seeds, options.starts), flush=True)


def compare(specs: Iterator[tuple[str, Spec, int]]) -> None:
    """Print designs of named specs beside other layouts, among them those of a search with so many starts."""
    print(BESIDE)
    ratios = []
    for name, spec, starts in specs:
        line, ratio = beside(name, spec, starts)
        ratios.append(ratio)
        print(line, flush=True)
    print(f"{sum(not ratio <= 1.001 for ratio in ratios)} of {len(ratios)} above 1.001, at most {max(ratios):.5f}")


def chosen_specs(options: argparse.Namespace) -> Iterator[tuple[str, Spec, int]]:
    """Every shape, n and objective asked for."""
    for name, n, objective in product(options.shapes, options.n, options.beside):
        boundary, keep_outs = shapes()[name]
        spec = Spec(n=n, objective=objective, aggregate=options.aggregate, dot=options.dot, boundary=boundary)
        yield name, replace(spec, keep_outs=keep_outs), options.starts


def random_specs(count: int) -> Iterator[tuple[str, Spec, int]]:
    """Shape, number and size of dots, objective, camera and poses at random, and ten times the starts of the search."""
    rng = np.random.default_rng(0)
    names = [name for name in OBJECTIVES if name != "blunder"]  # of which a search takes minutes
    for _ in range(count):
        name = str(rng.choice(list(shapes())))
        boundary, keep_outs = shapes()[name]
        n, objective = int(np.exp(rng.uniform(np.log(4), np.log(13)))), str(rng.choice(names))
        width, focal = int(rng.choice([640, 1280, 1920])), rng.uniform(0.6, 2.0)
        camera = Camera(width, width * 3 // 4, focal * width, focal * width, width / 2 - 0.5, width * 3 / 8 - 0.5)
        nearby = boundary.radius * focal * rng.uniform(4, 8)
        span = f"{nearby:.3f}..{nearby * rng.uniform(1.2, 3):.3f}"
        poses = f"cone:distance={span},tilt=0..{rng.uniform(20, 65):.0f},count=100"
        dot = None if rng.random() < 0.5 else float(rng.uniform(0.02, 0.3) * boundary.radius / np.sqrt(n))
        spec = Spec(n=n, objective=objective, dot=dot, boundary=boundary, camera=camera, poses=poses)
        nonsmooth = objective == "condition"
        starts = 10 * (OBJECTIVES[objective].default_restarts if nonsmooth else RANDOM if name == "disk" else STARTS)
        yield name, replace(spec, keep_outs=keep_outs), starts


def shapes() -> dict[str, tuple[Boundary, tuple[Boundary, ...]]]:
    """Boundaries and keep-outs by name, all about as large as the paper's disk."""
    corners = [(x, y) for x in (-0.075, 0.075) for y in (-0.075, 0.075)]
    arms = np.array([[0, 0], [0.22, 0], [0.22, 0.09], [0.09, 0.09], [0.09, 0.22], [0, 0.22]])
    screws = [0.031 * np.array([np.cos(angle), np.sin(angle)]) for angle in np.pi / 3 * np.arange(6)]
    return {
        "disk": (Circle(0.15), ()),
        "flange": (Circle(0.05), (Circle(0.016), *(Circle(0.005, (float(x), float(y))) for x, y in screws))),
        "rectangle": (polygon_from([_box(0, 0, 0.134, 0.067)]), ()),
        "L": (polygon_from([arms]), ()),
        "annulus": (Circle(0.15), (Circle(0.08),)),
        "star": (polygon_from([_star(0.15, 0.067)]), ()),
        "squares": (polygon_from([_box(-0.09, 0, 0.05, 0.05), _box(0.09, 0, 0.05, 0.05)]), ()),
        "plate": (polygon_from([_box(0, 0, 0.105, 0.105)]), tuple(Circle(0.013, corner) for corner in corners)),
    }


def _box(x: float, y: float, half_width: float, half_height: float) -> Array:
    return np.array([x, y]) + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [half_width, half_height]


def _star(outer: float, inner: float) -> Array:
    angles = np.pi / 2 + np.pi * np.arange(10) / 5
    return np.where(np.arange(10) % 2, inner, outer)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


if __name__ == "__main__":
    main()
