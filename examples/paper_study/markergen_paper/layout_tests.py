"""Tests of the claims about layouts and c(A); each yields its single tests."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from markergen.maths.information import rotation_bound
from markergen.model.camera import PAPER_CAMERA
from markergen.objectives.pose import PoseObjective
from markergen_paper.measurements import images_of
from markergen_paper.options import COORDINATES, NOISE_PX, NUMBERS, QUIET_PX, objective_for, poses_of
from markergen_paper.results import (
    SQUARE_LIKE,
    PaperResults,
    PoseLayouts,
    best_square_misfit,
    least_gap,
    mirror_misfit,
    square_misfit,
)
from markergen_paper.statistics import (
    ClaimTest,
    above,
    as_factor,
    below,
    majority,
    never,
    rank_correlation,
    row_means,
)

Array = NDArray[np.float64]

ANYWHERE = 0.1
"""Maximum relative loss of a layout optimized for another pose that counts as good as the pose's own."""

MODERATE = 0.5
"""Minimum rank correlation at which c(A) distinguishes good layouts from bad ones."""

SETTLED = 0.05
"""Maximum relative excess of c(A) over the best of the pose at the end of a descent that found the stable minimum."""

FEW = 10
"""Number of layouts of a pose where looking at all of them would take minutes."""


def square(study: PaperResults) -> Iterator[ClaimTest]:
    """Four points end at a square more often than not."""
    for name in COORDINATES:
        table = study.table(name, NOISE_PX, 4)
        alike = square_misfit(table[f"{name}.layouts"].astype(float)) < SQUARE_LIKE
        yield ClaimTest(name, None, "share of square-like layouts among all descents", above(alike.mean(axis=1), 0.5))
        c = table[f"{name}.c.{name}"]
        best = alike[np.arange(len(c)), np.argmin(c, axis=1)]
        yield ClaimTest(name, None, "share of poses whose best layout is square-like", majority(best.sum(), len(best)))


def early(study: PaperResults) -> Iterator[ClaimTest]:
    """Most of the gain comes in the first fifth of the steps."""
    for (name, n), result in study.early.items():
        for measure in ("c", "homography_px", "rotation_deg"):
            label = f"share of the gain in {measure} after a fifth of the steps, n = {n}"
            # Descents under the same pose are not independent, so there is one value per pose.
            yield ClaimTest(name, None, label, above(row_means(result[measure]), 0.5))


def any_pose(study: PaperResults) -> Iterator[ClaimTest]:
    """A layout for one pose is as good under the others as their own."""
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
                label = f"{measure} under all poses, of the layout of one pose over the pose's own, n = {n}"
                yield ClaimTest(name, None, label, as_factor(below(loss, np.log1p(ANYWHERE))))


def bounded(study: PaperResults) -> Iterator[ClaimTest]:
    """No error of h is beyond the paper's bounds."""
    for name, noise_px, table in study.everywhere():
        for side in ("upper", "lower"):
            for kind in ("ill", name):
                ratios = np.concatenate([table(n)[f"{kind}.{side}.{name}"].ravel() for n in NUMBERS])
                ratios = ratios[np.isfinite(ratios)]
                label = f"share of errors beyond the {side} bound, {'random' if kind == 'ill' else 'optimized'} layouts"
                # Tolerance of 1e-6 for single precision.
                judged = never(int(np.sum(ratios > 1 + 1e-6)), len(ratios))
                yield ClaimTest(name, noise_px, label, judged, f"median ratio {np.median(ratios):.2g}")


def subset(study: PaperResults) -> Iterator[ClaimTest]:
    """Layouts of five to eight points hold a square-like four more often than random ones."""
    for name in COORDINATES:
        for n in NUMBERS[1:]:
            table = study.table(name, NOISE_PX, n)
            # Five points hold 5 fours, eight hold 70.
            count = None if n == 5 else FEW // 2
            end, begin = (
                best_square_misfit(table[f"{kind}.layouts"][:, :count].astype(float)) < SQUARE_LIKE
                for kind in (name, "ill")
            )
            more = end.mean(axis=1) - begin[:, : end.shape[1]].mean(axis=1)
            label = f"share of layouts of {n} with a square-like 4 in them, less that of random layouts"
            yield ClaimTest(name, None, label, above(more), f"{end.mean():.0%} of optimized ones")


def ranks(study: PaperResults) -> Iterator[ClaimTest]:
    """Random layouts with a smaller c(A) have smaller errors."""
    for noise_px in (NOISE_PX, QUIET_PX):
        tables = study.full if noise_px == NOISE_PX else {n: study.beside[noise_px, n] for n in NUMBERS}
        for name in COORDINATES:
            for n in NUMBERS:
                c = tables[n][f"ill.c.{name}"]
                for estimator, measure in (("dlt", "he_px2"), ("lm", "rotation_deg")):
                    rho = rank_correlation(c, tables[n][f"ill.{estimator}.{measure}.mean"])
                    label = f"rank correlation of c(A) with {estimator} {measure} among random layouts, n = {n}"
                    yield ClaimTest(name, noise_px, label, above(rho, MODERATE))


def apart(study: PaperResults) -> Iterator[ClaimTest]:
    """The two nearest points end farther apart."""
    return _apart(study, "points", lambda table, kind: table[f"{kind}.layouts"].astype(float))


def apart_in_the_image(study: PaperResults) -> Iterator[ClaimTest]:
    """The images of the two nearest points end farther apart."""
    return _apart(study, "images", _images)


def _apart(study: PaperResults, what: str, points_of: Callable[[PoseLayouts, str], Array]) -> Iterator[ClaimTest]:
    for name in COORDINATES:
        for n in NUMBERS:
            table = study.table(name, NOISE_PX, n)
            end, begin = (least_gap(points_of(table, kind)) for kind in (name, "ill"))
            with np.errstate(divide="ignore"):
                farther = np.mean(np.log(end / begin[:, : end.shape[1]]), axis=1)
            label = f"smallest distance of two {what} after over before, n = {n}"
            yield ClaimTest(name, None, label, as_factor(above(farther)))


def _images(table: PoseLayouts, kind: str) -> Array:
    """Images (P, B, n, 2) in px of the layouts of a kind, each under its pose."""
    return images_of(table[f"{kind}.layouts"].astype(float), poses_of(table.poses.tolist()), PAPER_CAMERA)


def symmetric(study: PaperResults) -> Iterator[ClaimTest]:
    """Optimized layouts are their own mirror images, and more nearly so than random ones."""
    for name in COORDINATES:
        for n in NUMBERS:
            table = study.table(name, NOISE_PX, n)
            end, begin = (mirror_misfit(table[f"{kind}.layouts"][:, :FEW].astype(float)) for kind in (name, "ill"))
            share = np.mean(end < SQUARE_LIKE, axis=1)
            yield ClaimTest(name, None, f"share of symmetric layouts among all descents, n = {n}", above(share, 0.5))
            with np.errstate(divide="ignore", invalid="ignore"):
                nearer = row_means(np.log(begin[:, : end.shape[1]] / end))
            label = f"distance from symmetry before over after, n = {n}"
            yield ClaimTest(name, None, label, as_factor(above(nearer)))


def settled(study: PaperResults) -> Iterator[ClaimTest]:
    """Descents under a pose end near the same c(A)."""
    for name in COORDINATES:
        for n in NUMBERS:
            c = np.asarray(study.table(name, NOISE_PX, n)[f"{name}.c.{name}"], dtype=float)
            with np.errstate(invalid="ignore"):
                is_near = c <= np.min(c, axis=1, keepdims=True) * (1 + SETTLED)
            label = f"share of descents that end within {SETTLED:.0%} of the best of their pose, n = {n}"
            yield ClaimTest(name, None, label, above(is_near.mean(axis=1), 0.5))
    for n, ends in study.settling.items():
        least = np.min(np.stack(list(ends.values())), axis=(0, 2))
        for routine, c in ends.items():
            label = f"share of descents that end within {SETTLED:.0%} of the best of their pose, n = {n}, {routine}"
            yield ClaimTest(COORDINATES[0], None, label, above((c <= least[:, None] * (1 + SETTLED)).mean(axis=1), 0.5))


def rectangle(study: PaperResults) -> Iterator[ClaimTest]:
    """Descents in a rectangle move less, and end farther above the best of their pose."""
    metric = COORDINATES[0]
    for n, result in study.limits.items():
        excess = {
            region: row_means(np.log(result[f"{region}.c"] / result[f"{region}.c"].min(axis=1, keepdims=True)))
            for region in ("disk", "rectangle")
        }
        label = f"c(A) at the end over the best of the pose, in the rectangle over in the disk, n = {n}"
        yield ClaimTest(metric, None, label, as_factor(above(excess["rectangle"] - excess["disk"])))
        moved = np.log(row_means(result["disk.moved"]) / row_means(result["rectangle.moved"]))
        label = f"distance of the points from their starts, in the disk over in the rectangle, n = {n}"
        yield ClaimTest(metric, None, label, as_factor(above(moved)))


def normalized_condition(study: PaperResults) -> Iterator[ClaimTest]:
    """c(A) of random layouts is smaller with normalized points than as written."""
    for name in COORDINATES[:-1]:
        for n in NUMBERS:
            table = study.full[n]
            ratio = np.log(table.level(f"ill.c.{name}") / table.level("ill.c.hartley"))
            yield ClaimTest(
                name, None, f"c(A) as written over c(A) normalized, random layouts, n = {n}", as_factor(above(ratio))
            )
