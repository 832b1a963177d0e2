"""Results as the cells of the study give them, made up in no time, so that what is made of them can be looked at."""

import numpy as np
import pytest
from markergen_paper.experiments import BOUNDED, GAINED, ROUTINES
from markergen_paper.measurements import ESTIMATORS_FLAT, ESTIMATORS_RELIEF
from markergen_paper.options import BOUNDARY, COORDINATES, REGION, PaperOptions
from markergen_paper.results import gather
from markergen_paper.study import cells_of

from markergen.objectives.criteria import regular_polygon

TINY = PaperOptions(runs=2, scale=0.2)


HOMOGRAPHIES = ("dlt", "harker", "opencv", "plain")
ALL = (*HOMOGRAPHIES, "ippe", "lm", "decomposition", "lm from the dlt", "lm from the truth", "lm from poor starts")


def _errors(before, shape, rng, level, estimators=ESTIMATORS_FLAT):
    made = {}
    for name in estimators:
        keys = ("he_px2",) if name in HOMOGRAPHIES else ("rotation_deg", "translation_pct")
        for key in keys:
            made[f"{before}{name}.{key}.mean"] = level * rng.lognormal(0, 0.1, shape)
            made[f"{before}{name}.{key}.std"] = level * rng.lognormal(-1, 0.1, shape)
        made[f"{before}{name}.failed"] = np.zeros(shape)
        if name not in HOMOGRAPHIES:
            made[f"{before}{name}.flipped"] = np.zeros(shape)
    return made


def _conditioned(settings, rng):
    n, poses = settings["n"], len(settings["poses"])
    made = {}
    sets = {"ill": settings["starts"], **settings["optimized"], "ngon": max(2, settings["starts"] // 5)}
    for name, count in sets.items():
        # Random layouts are ten times as bad with four points, and less so with more.
        level = 10 / (n - 3) if name == "ill" else 1.0
        made |= _errors(f"{name}.", (poses, count), rng, level)
        for coordinates in COORDINATES:
            made[f"{name}.c.{coordinates}"] = level * rng.lognormal(1, 0.1, (poses, count))
            for side in ("upper", "lower"):
                made[f"{name}.{side}.{coordinates}"] = rng.uniform(0, 0.5, (poses, min(count, BOUNDED)))
        if name == "ill":
            made["ill.layouts"] = REGION.sample(poses * count, n, rng).reshape(poses, count, n, 2)
        elif name != "ngon":
            shaken = rng.normal(0, 1e-3, (poses, count, n, 2))
            made[f"{name}.layouts"] = regular_polygon(n, BOUNDARY.radius) + shaken
    return {key: value.astype(np.float32) for key, value in made.items()}


def _methods(settings, rng):
    shape = len(settings["poses"]), settings["starts"]
    made = {"metric.layouts": regular_polygon(settings["n"], BOUNDARY.radius) + rng.normal(0, 1e-3, (*shape, 1, 1))}
    for name in ("ill", "metric", "ngon"):
        made |= _errors(f"{name}.", shape, rng, 10 / (settings["n"] - 3) if name == "ill" else 1.0, ALL)
    return {key: value.astype(np.float32) for key, value in made.items()}


def made_up(cell):
    """Arrays of a cell with the names and shapes of the real ones, in which every claim but those on c(A) holds."""
    settings, rng = cell.settings, cell.rng
    if cell.kind == "conditioned":
        return _conditioned(settings, rng)
    if cell.kind == "methods":
        return _methods(settings, rng)
    if cell.kind == "settling":
        shape = len(settings["poses"]), settings["starts"]
        return {name: rng.lognormal(0, 0.01, shape).astype(np.float32) for name in ROUTINES}
    if cell.kind == "limits":
        shape = len(settings["poses"]), settings["starts"]
        regions = {"disk": (0.02, 2.0), "rectangle": (0.4, 1.0)}
        made = {f"{region}.c": rng.lognormal(0, spread, shape) for region, (spread, _) in regions.items()}
        return made | {
            f"{region}.moved": moved * rng.lognormal(0, 0.1, shape) for region, (_, moved) in regions.items()
        }
    if cell.kind == "descent":
        made = {"layouts": np.linspace(0.2, 1, 6)[:, None, None] * regular_polygon(4, 0.15)}
        for before, count in (("", 6), ("square.", 1)):
            made |= _errors(before, (count,), rng, 1.0)
            made |= {f"{before}c.{name}": rng.lognormal(1, 0.1, count) for name in COORDINATES}
        return made
    if cell.kind == "early":
        shape = (len(settings["poses"]), settings["starts"])
        return {**{key: rng.uniform(0.6, 0.9, shape) for key in GAINED}, "steps": np.full(shape, 50.0)}
    raised = settings["layout"].startswith("relief")
    count = 3 if settings["layout"] == "random" else 1
    layouts = np.broadcast_to(regular_polygon(settings["n"], 0.15), (count, settings["n"], 2))
    made = _errors("", (len(settings["poses"]), count), rng, 1.0, ESTIMATORS_RELIEF if raised else ESTIMATORS_FLAT)
    for key in ("pose_m", "rotation_deg", "translation_pct", *(() if raised else ("homography_px", "condition"))):
        made[key] = rng.lognormal(0, 0.1, count)
    return {"layouts": np.pad(layouts, ((0, 0), (0, 0), (0, int(raised)))), **made}


@pytest.fixture(scope="session")
def tiny():
    return TINY


@pytest.fixture(scope="session")
def fake():
    return made_up


@pytest.fixture(scope="session")
def study():
    """A study of made-up results, of the smallest scale at which every claim is judged by enough of them."""
    return gather(TINY, {cell: made_up(cell) for cell in cells_of(TINY)})
