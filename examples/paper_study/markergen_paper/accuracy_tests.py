"""Tests of the claims about the errors of estimators; each yields its single tests."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from markergen_paper.measurements import MEASURES
from markergen_paper.options import COORDINATES, LEAST_PX, NOISE_PX, NUMBERS, QUIET_PX, RANDOM_ONLY
from markergen_paper.results import SQUARE_LIKE, PaperResults, PoseLayouts, square_misfit
from markergen_paper.statistics import NO_A, ClaimTest, above, as_factor, below, falling, majority, within

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MARGIN = 0.05
"""Maximum relative difference of two methods or layouts that count as equally accurate."""

SIMILAR = 0.25
"""Maximum relative difference of two methods that count as similar."""

ALWAYS = 0.95
"""Share of poses from which on a difference counts as always there: noise and random layouts decide in the rest."""

RADICAL = 2.0
"""Minimum factor of a radical improvement."""

POSE = ("rotation_deg", "translation_pct")
METRIC = COORDINATES[0]
NOISES = (NOISE_PX, QUIET_PX, LEAST_PX)
FRONTAL_DEG, TILTED_DEG = 0.0, 35.0
"""Polar angles of the views compared."""


def _errors() -> list[tuple[str, str]]:
    """Estimators and measures: ``dlt``, ``he_px2`` and so on."""
    return [(estimator, measure) for measure, estimators in MEASURES.items() for estimator in estimators]


def _ratio(
    table: PoseLayouts, numerator: str, denominator: str, measure: str, kind: str, alike: Mask | None = None
) -> Array:
    """Logarithm (P,) of one estimator's error over another's, for a kind of layouts."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(
            table.level(f"{kind}.{numerator}.{measure}.mean", chosen=alike)
            / table.level(f"{kind}.{denominator}.{measure}.mean", chosen=alike)
        )


def _of_random(study: PaperResults) -> Iterator[tuple[float, int, PoseLayouts]]:
    """Noise, n and the largest table of random layouts at that noise."""
    for n in NUMBERS:
        yield NOISE_PX, n, study.full[n]
        yield QUIET_PX, n, study.beside[QUIET_PX, n]


def _gain(table: PoseLayouts, name: str, key: str) -> Array:
    """Logarithm (P,) of the factor by which the descents reduce the error, from the same starts."""
    count = table[f"{name}.{key}"].shape[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(table.level(f"ill.{key}", count) / table.level(f"{name}.{key}"))


def better_than_more(study: PaperResults) -> Iterator[ClaimTest]:
    """Four optimized points err less than more random ones on average."""
    for name, noise_px, label, ratio in _four_and_more(study):
        yield ClaimTest(name, noise_px, label, as_factor(above(ratio)))


def always_better(study: PaperResults) -> Iterator[ClaimTest]:
    """Four optimized points err less than more random ones in nearly every pose."""
    for name, noise_px, label, ratio in _four_and_more(study):
        kept = ratio[np.isfinite(ratio)]
        judged = majority(int(np.sum(kept > 0)), len(kept), ALWAYS)
        yield ClaimTest(name, noise_px, f"share of poses, {label}", judged)


def _four_and_more(study: PaperResults) -> Iterator[tuple[str, float, str, Array]]:
    """Setting, label, and logarithm (P,) of the error of random layouts of more points over four optimized ones."""
    for name, noise_px, table in study.everywhere():
        four = table(4)
        for n in (*NUMBERS[1:], RANDOM_ONLY):
            if n == RANDOM_ONLY and noise_px != NOISE_PX:
                continue
            more = (study.full[n] if n == RANDOM_ONLY else table(n)).of(four.poses)
            for estimator, measure in _errors():
                key = f"{estimator}.{measure}.mean"
                ratio = np.log(more.level(f"ill.{key}") / four.of(more.poses).level(f"{name}.{key}"))
                yield name, noise_px, f"{estimator} {measure}, random {n} over optimized 4", ratio


def fewer_gain_more(study: PaperResults) -> Iterator[ClaimTest]:
    """The gain falls with the number of points."""
    for name, noise_px, table in study.everywhere():
        for estimator, measure in _errors():
            gains = np.stack([_gain(table(n), name, f"{estimator}.{measure}.mean") for n in NUMBERS], axis=1)
            label = f"{estimator} {measure}, gain with n = {NUMBERS[0]} over that with n = {NUMBERS[-1]}"
            yield ClaimTest(name, noise_px, label, as_factor(falling(gains)))


def others_gain_more(study: PaperResults) -> Iterator[ClaimTest]:
    """EPnP and IPPE gain more than LM."""
    for name, noise_px, table in study.everywhere():
        for n in NUMBERS:
            for estimator in ("epnp", "ippe"):
                for measure in ("rotation_deg", "translation_pct"):
                    gain, gain_of_lm = (
                        _gain(table(n), name, f"{solver}.{measure}.mean") for solver in (estimator, "lm")
                    )
                    label = f"{measure}, gain of {estimator} over that of lm, n = {n}"
                    yield ClaimTest(name, noise_px, label, as_factor(above(gain - gain_of_lm)))


def steadier(study: PaperResults) -> Iterator[ClaimTest]:
    """Mean and standard deviation of every error fall."""
    for name, noise_px, table in study.everywhere():
        for n in NUMBERS:
            for estimator, measure in _errors():
                for statistic in ("mean", "std"):
                    gain = _gain(table(n), name, f"{estimator}.{measure}.{statistic}")
                    label = f"{estimator} {measure}, {statistic} before over after, n = {n}"
                    yield ClaimTest(name, noise_px, label, as_factor(above(gain)))


def equal(study: PaperResults) -> Iterator[ClaimTest]:
    """IPPE errs as LM does: under all poses, at each polar angle, and for square-like layouts alone."""
    margin = np.log1p(MARGIN)
    for name, noise_px, table in study.everywhere():
        for n in NUMBERS:
            for measure in POSE:
                ratio = _ratio(table(n), "ippe", "lm", measure, name)
                yield ClaimTest(name, noise_px, f"{measure}, ippe over lm, n = {n}", as_factor(within(ratio, margin)))
    for noise_px in NOISES:
        for n in NUMBERS:
            table_of = study.full[n] if noise_px == NOISE_PX else study.methods[noise_px, n]
            for measure in POSE:
                ratio = _ratio(table_of, "ippe", "lm", measure, METRIC)
                label = f"{measure}, ippe over lm, n = {n}"
                if noise_px == LEAST_PX:
                    yield ClaimTest(METRIC, noise_px, label, as_factor(within(ratio, margin)))
                for angle in np.unique(table_of.polar_deg):
                    at = as_factor(within(ratio[table_of.polar_deg == angle], margin))
                    yield ClaimTest(METRIC, noise_px, f"{label}, at {angle:g} deg", at)
        table_of = study.full[4] if noise_px == NOISE_PX else study.methods[noise_px, 4]
        alike = square_misfit(table_of[f"{METRIC}.layouts"].astype(float)) < SQUARE_LIKE
        for measure in POSE:
            ratio = _ratio(table_of, "ippe", "lm", measure, METRIC, alike)
            yield ClaimTest(
                METRIC, noise_px, f"{measure}, ippe over lm, square-like layouts", as_factor(within(ratio, margin))
            )


def most_accurate(study: PaperResults) -> Iterator[ClaimTest]:
    """EPnP and IPPE err more than LM, on random and on optimized layouts."""
    for estimator in ("epnp", "ippe"):
        for measure in POSE:
            for noise_px, n, table in _of_random(study):
                label = f"{measure}, {estimator} over lm, random layouts, n = {n}"
                yield ClaimTest(NO_A, noise_px, label, as_factor(above(_ratio(table, estimator, "lm", measure, "ill"))))
            for name, noise_px, table_of in study.everywhere():
                for n in NUMBERS:
                    label = f"{measure}, {estimator} over lm, optimized layouts, n = {n}"
                    ratio = _ratio(table_of(n), estimator, "lm", measure, name)
                    yield ClaimTest(name, noise_px, label, as_factor(above(ratio)))
    for kind, start, noise_px, n, table in _methods(study, ("lm from the dlt",)):
        for measure in POSE:
            label = f"{measure}, ippe over {start}, {_layouts(kind)}, n = {n}"
            ratio = _ratio(table, "ippe", start, measure, kind)
            yield ClaimTest(_a(kind), noise_px, label, as_factor(above(ratio)))


def converge(study: PaperResults) -> Iterator[ClaimTest]:
    """On optimized layouts EPnP and IPPE err about as much as LM."""
    for name, noise_px, table in study.everywhere():
        for n in NUMBERS:
            for estimator in ("epnp", "ippe"):
                for measure in POSE:
                    ratio = _ratio(table(n), estimator, "lm", measure, name)
                    label = f"{measure}, {estimator} over lm, n = {n}"
                    yield ClaimTest(name, noise_px, label, as_factor(within(ratio, np.log1p(SIMILAR))))


def square_like(study: PaperResults) -> Iterator[ClaimTest]:
    """Square-like layouts err far less than random ones."""
    for name, noise_px, table, label, level, alike in _square_like(study):
        ill = np.log(table.level(f"ill.{label.replace(' ', '.')}.mean", alike.shape[1]))
        radical = as_factor(above(ill - level, np.log(RADICAL)))
        yield ClaimTest(name, noise_px, f"{label}, random layouts over square-like ones", radical)


def perfect_square(study: PaperResults) -> Iterator[ClaimTest]:
    """Square-like layouts err as the perfect square does."""
    for name, noise_px, table, label, level, _ in _square_like(study):
        perfect = level - np.log(table.level(f"ngon.{label.replace(' ', '.')}.mean"))
        same = as_factor(within(perfect, np.log1p(MARGIN)))
        yield ClaimTest(name, noise_px, f"{label}, square-like layouts over the square", same)


def _square_like(study: PaperResults) -> Iterator[tuple[str, float, PoseLayouts, str, Array, Mask]]:
    """Setting and table of four points, each error, its logarithm in square-like layouts (P,), and which are (P, B)."""
    for name, noise_px, table_of in study.everywhere():
        table = table_of(4)
        alike = square_misfit(table[f"{name}.layouts"].astype(float)) < SQUARE_LIKE
        for estimator, measure in _errors():
            level = np.log(table.level(f"{name}.{estimator}.{measure}.mean", chosen=alike))
            yield name, noise_px, table, f"{estimator} {measure}", level, alike


def other_dlts(study: PaperResults) -> Iterator[ClaimTest]:
    """The homographies of Harker & O'Leary and of OpenCV err as the DLT's do."""
    for kind, estimator, noise_px, n, table in _methods(study, ("harker", "opencv")):
        ratio = _ratio(table, estimator, "dlt", "he_px2", kind)
        label = f"he_px2, {estimator} over dlt, {_layouts(kind)}, n = {n}"
        yield ClaimTest(_a(kind), noise_px, label, as_factor(within(ratio, np.log1p(MARGIN))))


def orthogonalized(study: PaperResults) -> Iterator[ClaimTest]:
    """The DLT's homography errs more than that of Harker & O'Leary."""
    for kind, estimator, noise_px, n, table in _methods(study, ("harker",)):
        ratio = _ratio(table, "dlt", estimator, "he_px2", kind)
        label = f"he_px2, dlt over {estimator}, {_layouts(kind)}, n = {n}"
        yield ClaimTest(_a(kind), noise_px, label, as_factor(above(ratio)))


def normalized_dlt(study: PaperResults) -> Iterator[ClaimTest]:
    """The DLT errs more without normalization; four points give the same homography either way."""
    for kind, estimator, noise_px, n, table in _methods(study, ("plain",)):
        if n > 4:
            label = f"he_px2, not normalized over normalized, {_layouts(kind)}, n = {n}"
            ratio = _ratio(table, estimator, "dlt", "he_px2", kind)
            yield ClaimTest(_a(kind), noise_px, label, as_factor(above(ratio)))


def decomposed(study: PaperResults) -> Iterator[ClaimTest]:
    """The pose decomposed from the homography errs more than IPPE and LM."""
    for kind, estimator, noise_px, n, table in _methods(study, ("ippe", "lm")):
        for measure in POSE:
            ratio = _ratio(table, "decomposition", estimator, measure, kind)
            label = f"{measure}, decomposition over {estimator}, {_layouts(kind)}, n = {n}"
            yield ClaimTest(_a(kind), noise_px, label, as_factor(above(ratio)))


def initial_guess(study: PaperResults) -> Iterator[ClaimTest]:
    """LM gains on optimized layouts because its start is better: from the true pose it gains less than half of that."""
    for start, name in (("lm", "lm's gain"), ("lm from the dlt", "lm's gain from the dlt")):
        for noise_px in NOISES:
            for n in NUMBERS:
                table = study.methods[noise_px, n]
                for measure in POSE:
                    guess, truth = (_gain(table, METRIC, f"{by}.{measure}.mean") for by in (start, "lm from the truth"))
                    label = f"{measure}, share of {name} that is left if it starts from the true pose, n = {n}"
                    with np.errstate(divide="ignore", invalid="ignore"):
                        share = np.where(guess > 0, truth / guess, np.nan)
                    yield ClaimTest(METRIC, noise_px, label, below(share, 0.5))


def needs_a_start(study: PaperResults) -> Iterator[ClaimTest]:
    """LM errs more from poor starts than from the DLT's pose."""
    for kind, start, noise_px, n, table in _methods(study, ("lm from poor starts",)):
        for measure in POSE:
            label = f"{measure}, {start} over lm from the dlt, {_layouts(kind)}, n = {n}"
            ratio = _ratio(table, start, "lm from the dlt", measure, kind)
            yield ClaimTest(_a(kind), noise_px, label, as_factor(above(ratio)))


def start_of_the_dlt(study: PaperResults) -> Iterator[ClaimTest]:
    """LM from the DLT's pose errs as from the true pose."""
    for kind, start, noise_px, n, table in _methods(study, ("lm from the dlt",)):
        for measure in POSE:
            label = f"{measure}, {start} over lm from the truth, {_layouts(kind)}, n = {n}"
            ratio = _ratio(table, start, "lm from the truth", measure, kind)
            yield ClaimTest(_a(kind), noise_px, label, as_factor(within(ratio, np.log1p(MARGIN))))


def more_points(study: PaperResults) -> Iterator[ClaimTest]:
    """Errors fall with the number of points, of random and of optimized layouts."""
    for estimator, measure in _errors():
        key = f"{estimator}.{measure}.mean"
        label = f"{estimator} {measure}, n = {NUMBERS[0]} over n = {NUMBERS[-1]}"
        for noise_px in (NOISE_PX, QUIET_PX):
            tables = [study.full[n] if noise_px == NOISE_PX else study.beside[noise_px, n] for n in NUMBERS]
            rows = np.log(np.stack([table.level(f"ill.{key}") for table in tables], axis=1))
            yield ClaimTest(NO_A, noise_px, f"{label}, random layouts", as_factor(falling(rows)))
        for name, noise_px, table in study.everywhere():
            rows = np.log(np.stack([table(n).level(f"{name}.{key}") for n in NUMBERS], axis=1))
            yield ClaimTest(name, noise_px, f"{label}, optimized layouts", as_factor(falling(rows)))


def views(study: PaperResults) -> Iterator[ClaimTest]:
    """LM errs more in rotation in frontal views than in tilted ones from the same distance."""
    for noise_px in NOISES:
        for n in NUMBERS:
            table = study.full[n] if noise_px == NOISE_PX else study.methods[noise_px, n]
            level = np.log(table.level(f"{METRIC}.lm.rotation_deg.mean"))
            # In either, distances and azimuths are in the same order.
            frontal, tilted = (level[table.polar_deg == angle] for angle in (FRONTAL_DEG, TILTED_DEG))
            label = f"lm rotation_deg, frontal over tilted by {TILTED_DEG:g} deg, n = {n}"
            yield ClaimTest(METRIC, noise_px, label, as_factor(above(frontal - tilted)))


def criterion(study: PaperResults) -> Iterator[ClaimTest]:
    """Layouts with the least c(A) err as those with the least first-order error do."""
    for noise_px in (NOISE_PX, QUIET_PX):
        for n in NUMBERS:
            table = study.beside[noise_px, n]
            for name in COORDINATES:
                for key, error in (("dlt.he_px2", "homography"), ("lm.rotation_deg", "pose")):
                    with np.errstate(divide="ignore", invalid="ignore"):
                        ratio = np.log(table.level(f"{name}.{key}.mean") / table.level(f"{error}.{key}.mean"))
                    label = f"{key.replace('.', ' ')}, least c(A) over least first-order {error} error, n = {n}"
                    yield ClaimTest(name, noise_px, label, as_factor(within(ratio, np.log1p(MARGIN))))


def _methods(study: PaperResults, names: tuple[str, ...]) -> Iterator[tuple[str, str, float, int, PoseLayouts]]:
    """Kind of layouts, estimator, noise, n and table of each comparison of further estimators."""
    for (noise_px, n), table in study.methods.items():
        for kind in ("ill", METRIC):
            for name in names:
                yield kind, name, noise_px, n, table


def _layouts(kind: str) -> str:
    return "random layouts" if kind == "ill" else "optimized layouts"


def _a(kind: str) -> str:
    """Coordinates of a test of a kind of layouts."""
    return NO_A if kind == "ill" else kind
