"""The paper's claims, the measurements that test them, and the verdicts."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from markergen.maths.information import rotation_bound
from markergen.objectives.pose import PoseObjective
from markergen_paper.measurements import MEASURES
from markergen_paper.options import (
    COORDINATES,
    NOISE_PX,
    NUMBERS,
    QUIET_PX,
    RANDOM_ONLY,
    objective_for,
    poses_of,
)
from markergen_paper.results import (
    SQUARE_LIKE,
    PaperResults,
    PoseLayouts,
    best_square_misfit,
    least_gap,
    square_misfit,
)
from markergen_paper.statistics import (
    LEVEL,
    Judged,
    above,
    below,
    falling,
    majority,
    never,
    rank_correlation,
    row_means,
    within,
)

Array = NDArray[np.float64]

MARGIN = 0.05
"""Maximum relative difference of two methods that count as equally accurate."""

ANYWHERE = 0.1
"""Maximum relative loss of a layout optimized for another pose that counts as good as the pose's own."""

MODERATE = 0.5
"""Minimum rank correlation at which c(A) distinguishes good layouts from bad ones."""


@dataclass(frozen=True)
class ClaimTest:
    """Test of a claim.

    Attributes
    ----------
    coordinates : str
        Coordinates in which A is written.
    noise_px : float or None
        None if no noise is drawn.
    measure : str
        Compared quantity, in a few words.
    judged : Judged
    note : str
        Remark.
    """

    coordinates: str
    noise_px: float | None
    measure: str
    judged: Judged
    note: str = ""


@dataclass(frozen=True)
class Claim:
    """Claim of the paper, and its test.

    Attributes
    ----------
    name, words, test : str
        Short name, the claim in words, and the criterion.
    find : callable
        Takes the study and yields findings.
    """

    name: str
    words: str
    test: str
    find: Callable[[PaperResults], Iterator[ClaimTest]]


def verdict(findings: list[ClaimTest]) -> str:
    """``holds`` or ``does not hold`` if all tests agree, ``open`` if none is conclusive, otherwise their numbers."""
    held = sum(finding.judged.holds for finding in findings)
    refuted = sum(finding.judged.refuted for finding in findings)
    if len(findings) in (held, refuted):
        return "holds" if held else "does not hold"
    if not held + refuted:
        return "open"
    parts = {"holds": held, "does not": refuted, "open": len(findings) - held - refuted}
    return ", ".join(f"{words} in {count}" for words, count in parts.items() if count)


def _everywhere(study: PaperResults) -> Iterator[tuple[str, float, Callable[[int], PoseLayouts]]]:
    """Coordinates, noise, and the table by n of each setting in which claims are judged."""
    for name, noise_px in study.settings:
        yield name, noise_px, partial(study.table, name, noise_px)


def _errors() -> list[tuple[str, str]]:
    """Estimators and measures: ``dlt``, ``he_px2`` and so on."""
    return [(estimator, measure) for measure, estimators in MEASURES.items() for estimator in estimators]


def _gain(table: PoseLayouts, name: str, key: str) -> Array:
    """Logarithm (P,) of the factor by which the descents reduce the error, from the same starts."""
    count = table[f"{name}.{key}"].shape[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(table.level(f"ill.{key}", count) / table.level(f"{name}.{key}"))


def _factor(judged: Judged) -> Judged:
    """Convert logarithms to factors."""
    value, low, high = np.exp([judged.value, judged.low, judged.high])
    return replace(judged, value=float(value), low=float(low), high=float(high))


def _square(study: PaperResults) -> Iterator[ClaimTest]:
    for name in COORDINATES:
        table = study.table(name, NOISE_PX, 4)
        alike = square_misfit(table[f"{name}.layouts"].astype(float)) < SQUARE_LIKE
        yield ClaimTest(name, None, "share of square-like layouts among all descents", above(alike.mean(axis=1), 0.5))
        c = table[f"{name}.c.{name}"]
        best = alike[np.arange(len(c)), np.argmin(c, axis=1)]
        yield ClaimTest(name, None, "share of poses whose best layout is square-like", majority(best.sum(), len(best)))


def _fewer(study: PaperResults) -> Iterator[ClaimTest]:
    for name, noise_px, table in _everywhere(study):
        four = table(4)
        for n in (*NUMBERS[1:], RANDOM_ONLY):
            if n == RANDOM_ONLY and noise_px != NOISE_PX:
                continue
            more = (study.full[n] if n == RANDOM_ONLY else table(n)).of(four.poses)
            for estimator, measure in _errors():
                key = f"{estimator}.{measure}.mean"
                ratio = np.log(more.level(f"ill.{key}") / four.of(more.poses).level(f"{name}.{key}"))
                share = float(np.mean(ratio[np.isfinite(ratio)] > 0))
                words = f"{estimator} {measure}, random {n} over optimized 4"
                yield ClaimTest(name, noise_px, words, _factor(above(ratio)), f"in {share:.0%} of poses")


def _early(study: PaperResults) -> Iterator[ClaimTest]:
    for (name, n), result in study.early.items():
        for measure in ("c", "homography_px", "rotation_deg"):
            words = f"share of the gain in {measure} after a fifth of the steps, n = {n}"
            # Descents under the same pose are not independent, so there is one value per pose.
            yield ClaimTest(name, None, words, above(row_means(result[measure]), 0.5))


def _small(study: PaperResults) -> Iterator[ClaimTest]:
    for name, noise_px, table in _everywhere(study):
        for estimator, measure in _errors():
            gains = np.stack([_gain(table(n), name, f"{estimator}.{measure}.mean") for n in NUMBERS], axis=1)
            words = f"{estimator} {measure}, gain with n = {NUMBERS[0]} over that with n = {NUMBERS[-1]}"
            yield ClaimTest(name, noise_px, words, _factor(falling(gains)))


def _faster(study: PaperResults) -> Iterator[ClaimTest]:
    for name, noise_px, table in _everywhere(study):
        for n in NUMBERS:
            for estimator in ("epnp", "ippe"):
                for measure in ("rotation_deg", "translation_pct"):
                    one, other = (_gain(table(n), name, f"{each}.{measure}.mean") for each in (estimator, "lm"))
                    words = f"{measure}, gain of {estimator} over that of lm, n = {n}"
                    yield ClaimTest(name, noise_px, words, _factor(above(one - other)))


def _equal(study: PaperResults) -> Iterator[ClaimTest]:
    for name, noise_px, table in _everywhere(study):
        for n in NUMBERS:
            for measure in ("rotation_deg", "translation_pct"):
                one, other = (table(n).level(f"{name}.{each}.{measure}.mean") for each in ("ippe", "lm"))
                words = f"{measure}, ippe over lm, n = {n}"
                yield ClaimTest(name, noise_px, words, _factor(within(np.log(one / other), np.log1p(MARGIN))))


def _steady(study: PaperResults) -> Iterator[ClaimTest]:
    for name, noise_px, table in _everywhere(study):
        for n in NUMBERS:
            for estimator, measure in _errors():
                for statistic in ("mean", "std"):
                    gain = _gain(table(n), name, f"{estimator}.{measure}.{statistic}")
                    words = f"{estimator} {measure}, {statistic} before over after, n = {n}"
                    yield ClaimTest(name, noise_px, words, _factor(above(gain)))


def _anywhere(study: PaperResults) -> Iterator[ClaimTest]:
    for name in COORDINATES:
        for n in (4, 5):
            table = study.table(name, NOISE_PX, n)
            poses = poses_of(table.poses.tolist())
            best = np.argmin(table[f"{name}.c.{name}"], axis=1)
            layouts = table[f"{name}.layouts"][np.arange(len(best)), best].astype(float)
            objective = objective_for(name, poses)
            bound = rotation_bound(PoseObjective(objective.setting).covariance(layouts))
            for measure, values in (("c", objective.linearize(layouts)[0]), ("rotation bound", bound)):
                # Row: the pose it was optimized for; column: the pose under which it is judged.
                with np.errstate(invalid="ignore"):
                    loss = np.mean(np.log(values / np.diag(values)), axis=1)
                words = f"{measure} under all poses, of the layout of one pose over the pose's own, n = {n}"
                yield ClaimTest(name, None, words, _factor(below(loss, np.log1p(ANYWHERE))))


def _bounded(study: PaperResults) -> Iterator[ClaimTest]:
    for name, noise_px, table in _everywhere(study):
        for side in ("upper", "lower"):
            for kind in ("ill", name):
                ratios = np.concatenate([table(n)[f"{kind}.{side}.{name}"].ravel() for n in NUMBERS])
                ratios = ratios[np.isfinite(ratios)]
                words = f"share of errors beyond the {side} bound, {'random' if kind == 'ill' else 'optimized'} layouts"
                # Tolerance of 1e-6 for single precision.
                judged = never(int(np.sum(ratios > 1 + 1e-6)), len(ratios))
                yield ClaimTest(name, noise_px, words, judged, f"median ratio {np.median(ratios):.2g}")


def _five(study: PaperResults) -> Iterator[ClaimTest]:
    for name in COORDINATES:
        table = study.table(name, NOISE_PX, 5)
        end, begin = (
            best_square_misfit(table[f"{kind}.layouts"].astype(float)) < SQUARE_LIKE for kind in (name, "ill")
        )
        more = end.mean(axis=1) - begin[:, : end.shape[1]].mean(axis=1)
        words = "share of layouts of 5 with a square-like 4 in them, less that of random layouts"
        yield ClaimTest(name, None, words, above(more), f"{end.mean():.0%} of optimized ones")


def _ranks(study: PaperResults) -> Iterator[ClaimTest]:
    for noise_px in (NOISE_PX, QUIET_PX):
        tables = study.full if noise_px == NOISE_PX else {n: study.beside[noise_px, n] for n in NUMBERS}
        for name in COORDINATES:
            for n in NUMBERS:
                c = tables[n][f"ill.c.{name}"]
                for estimator, measure in (("dlt", "he_px2"), ("lm", "rotation_deg")):
                    rho = rank_correlation(c, tables[n][f"ill.{estimator}.{measure}.mean"])
                    words = f"rank correlation of c(A) with {estimator} {measure} among random layouts, n = {n}"
                    yield ClaimTest(name, noise_px, words, above(rho, MODERATE))


def _apart(study: PaperResults) -> Iterator[ClaimTest]:
    for name in COORDINATES:
        for n in NUMBERS:
            table = study.table(name, NOISE_PX, n)
            end = least_gap(table[f"{name}.layouts"].astype(float))
            begin = least_gap(table["ill.layouts"].astype(float))[:, : end.shape[1]]
            with np.errstate(divide="ignore"):
                farther = np.mean(np.log(end / begin), axis=1)
            yield ClaimTest(
                name, None, f"smallest distance of two points after over before, n = {n}", _factor(above(farther))
            )


_POSES = f"Wilcoxon's signed-rank test over poses, p < {LEVEL:g}"

CLAIMS = (
    Claim(
        "square",
        "With four points a square is the most common optimum, for all poses.",
        f"Square-like (corners off by less than {SQUARE_LIKE:.0%} of the size, RMS) more often than not: {_POSES} for "
        "all descents of a pose, binomial test for the best of each pose.",
        _square,
    ),
    Claim(
        "better than more",
        "Four optimized points are always better than 5 to 9 random ones.",
        f"Ratio of the mean errors above 1: {_POSES}. The share of poses in which it is so tells about always.",
        _fewer,
    ),
    Claim(
        "early",
        "The gain is largest in the first steps of the descent.",
        "More than half of the fall of the logarithm in the first fifth of the steps, mean of the descents of a pose "
        f"in which it fell: {_POSES}.",
        _early,
    ),
    Claim(
        "small n gains more",
        "The fewer points, the larger the gain.",
        f"Gain (error before over after) falls with n = 4..8: Page's trend test over poses, p < {LEVEL:g}.",
        _small,
    ),
    Claim(
        "EPnP and IPPE gain more",
        "EPnP and IPPE gain more than LM.",
        f"Ratio of the gains above 1: {_POSES}.",
        _faster,
    ),
    Claim(
        "IPPE equals LM",
        "On optimized layouts IPPE is as accurate as LM.",
        f"Ratio of the mean errors within {MARGIN:.0%} of 1: two one-sided signed-rank tests over poses, "
        f"p < {LEVEL:g}.",
        _equal,
    ),
    Claim(
        "steadier",
        "Mean and deviation of all errors fall.",
        f"Ratio of before to after above 1: {_POSES}.",
        _steady,
    ),
    Claim(
        "any pose",
        "Optimized layouts do not depend on the pose.",
        f"Under all poses a layout loses less than {ANYWHERE:.0%}, on average, against those optimized for them: "
        f"{_POSES}.",
        _anywhere,
    ),
    Claim(
        "bounds",
        "c(A) |dA| / |A| is an upper bound of the homography's relative error under a disturbance dA.",
        "No error is beyond it, nor below the paper's lower bound |(A + dA)(h - h')| / (|A + dA| |h'|).",
        _bounded,
    ),
    Claim(
        "five hold a square",
        "With five points the corners of a square-like shape are common.",
        f"More common than in random layouts: {_POSES}.",
        _five,
    ),
    Claim(
        "c tells",
        "c(A) is a good objective: a layout of smaller c(A) is more accurate.",
        f"Spearman's rank correlation among random layouts above {MODERATE:g}: {_POSES}.",
        _ranks,
    ),
    Claim(
        "apart",
        "The points move away from one another.",
        f"Ratio of their smallest distance after to before above 1: {_POSES}.",
        _apart,
    ),
)
"""All claims."""
