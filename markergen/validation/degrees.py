"""Errors of a pose by its six degrees of freedom, and against them: bias, spread, cells, correlations."""
# tests: tests/validation/test_degrees.py

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.arrays import Array, Indices
from markergen.maths.rotation import exponential
from markergen.presentation.plots import INK, MUTED, SERIES
from markergen.presentation.results import plain
from markergen.validation.metrics import CONFIDENCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

DEGREES = ("X, mm", "Y, mm", "Z, mm", "tilt X, deg", "tilt Y, deg", "roll, deg")
"""Position of the marker's origin in the camera frame; components of the tilt, the shortest rotation of a marker that
faces the camera to the marker's normal; and the rotation about the normal before it."""
ERRORS = ("X, mm", "Y, mm", "Z, mm", "about X, deg", "about Y, deg", "about Z, deg")
"""Errors t_hat - t and log(R_hat R') in the camera frame."""
BINS = 8
"""Parts of equal numbers of views into which each degree of freedom is cut: 288 cells."""
LEAST = 0.1
"""Least rank correlation that stands out: of 10,000 views 0.04 is significant, and 0.1 explains 1 % of the variance."""
SCATTERED = 600
"""Maximum number of views that a plot shows as points."""
DRAWN = 100
"""The same where each is a path of its own."""


def pose_degrees(rotation: Array, translation: Array) -> Array:
    """Degrees of freedom (P, 6) of poses (P, 3, 3) and (P, 3), m, see `DEGREES`.

    With R0 = diag(1, -1, -1), R = exp(tilt) Rz(roll) R0, and the tilt has no component along z.

    Examples
    --------
    >>> facing = np.diag([1.0, -1.0, -1.0])
    >>> (pose_degrees(facing[None], np.array([[0.0, 0.1, 1.0]])).round(9) + 0.0).tolist()
    [[0.0, 100.0, 1000.0, 0.0, 0.0, 0.0]]
    """
    flipped = rotation * [1.0, -1.0, -1.0]
    x, y, z = flipped[:, :, 2].T
    sine = np.hypot(x, y)
    # Where the sine vanishes, so do x and y.
    tilt = np.stack([-y, x, np.zeros(len(x))], axis=-1) * (np.arctan2(sine, z) / np.maximum(sine, 1e-300))[:, None]
    rolled = exponential(tilt).swapaxes(-1, -2) @ flipped
    roll = np.arctan2(rolled[:, 1, 0], rolled[:, 0, 0])
    return np.column_stack([1e3 * translation, np.rad2deg(tilt[:, :2]), np.rad2deg(roll)])


def in_units(error: Array) -> Array:
    """Pose errors (P, 6), `ERRORS`, of steps (w, dt) (P, 6) in rad and m, or of their standard deviations."""
    return np.column_stack([1e3 * error[:, 3:], np.rad2deg(error[:, :3])])


@dataclass(frozen=True, eq=False)
class DegreeErrors:
    """Errors of poses beside the poses themselves.

    Attributes
    ----------
    degrees, errors : arrays (P, 6)
        See `DEGREES` and `ERRORS`.
    sigma : array (P, 6)
        Standard deviations of the errors that the detector's covariances claim; nan if it has none.
    """

    degrees: Array
    errors: Array
    sigma: Array

    def summary(self) -> dict[str, Any]:
        """Plain values: each error's bias and spread, the cells, and correlations that stand out; None if undefined."""
        chi = self.errors / self.sigma
        correlations = rank_correlations(self.degrees, self.errors)
        cells = self.cells() if len(chi) >= BINS and np.isfinite(chi).any() else None
        return {
            "errors": {
                name: {
                    "bias": plain(np.mean(column)),
                    "bias_sigma": plain(np.std(column) / np.sqrt(max(len(column) - 1, 1))),
                    "std": plain(np.std(column)),
                    "median": plain(np.median(np.abs(column))) if len(column) else None,
                    "expected": plain(np.sqrt(np.mean(square))),
                }
                for name, column, square in zip(ERRORS, self.errors.T, (self.sigma**2).T, strict=True)
            },
            "cells": cells,
            "standing_out": standing_out(correlations, len(self.errors)),
            "chi_standing_out": standing_out(rank_correlations(self.degrees, np.abs(chi)), len(chi)),
        }

    def cells(self) -> dict[str, Any]:
        """Spread over claimed spread in each cell: bins of each degree of freedom, for each error.

        The root of the mean of (error/sigma)^2, which is 1 +- 1/sqrt(2 n) for n views whose covariance is right.
        """
        from scipy.special import chdtri

        ratio, count, tail = [], [], (1 - CONFIDENCE) / 2
        for column in self.degrees.T:
            for rows in parts(column):
                ratio.append(np.sqrt(np.mean((self.errors[rows] / self.sigma[rows]) ** 2, axis=0)))
                count.append(len(rows))
        every, views = np.array(ratio), np.array(count)[:, None]
        low, high = (np.sqrt(chdtri(views, share) / views) for share in (1 - tail, tail))
        return {
            "count": every.size,
            "least": plain(every.min()),
            "median": plain(np.median(every)),
            "greatest": plain(every.max()),
            "above": int(np.sum(every > high)),
            "below": int(np.sum(every < low)),
        }

    def bins(self) -> list[list[dict[str, Any]]]:
        """Median of a degree of freedom in each of its bins, and mean, spread and claimed spread (6,) of the errors."""
        return [
            [
                {
                    "at": float(np.median(column[rows])),
                    "mean": self.errors[rows].mean(axis=0).tolist(),
                    "std": self.errors[rows].std(axis=0).tolist(),
                    "claimed": [plain(value) for value in np.sqrt(np.mean(self.sigma[rows] ** 2, axis=0))],
                }
                for rows in parts(column)
            ]
            for column in self.degrees.T
        ]


def parts(values: Array) -> list[Indices]:
    """Indices of values (P,) in `BINS` parts of nearly equal numbers, by their order; fewer if they hardly differ."""
    order = np.argsort(values, kind="stable")
    if not len(values) or np.ptp(values) < 1e-6:
        return []
    return [rows for rows in np.array_split(order, BINS) if len(rows)]


def rank_correlations(degrees: Array, errors: Array) -> Array:
    """Spearman's correlations (6, 6) of errors (P, 6), in rows, with degrees of freedom (P, 6); 0 if constant."""
    rows = np.isfinite(errors).all(axis=1)
    if rows.sum() < 3:
        return np.zeros((errors.shape[1], degrees.shape[1]))
    first, second = (np.apply_along_axis(_ranks, 0, np.round(values[rows], 9)) for values in (errors, degrees))
    first, second = (ranks - ranks.mean(axis=0) for ranks in (first, second))
    norm = np.outer(np.linalg.norm(first, axis=0), np.linalg.norm(second, axis=0))
    return np.asarray(np.divide(first.T @ second, norm, out=np.zeros_like(norm), where=norm > 0))


def _ranks(values: Array) -> Array:
    """Ranks (P,) of values (P,), their mean for equal ones."""
    # As of scipy.stats.rankdata, whose import takes 0.4 s, a tenth of a validation.
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - (count - 1) / 2)[place]


def standing_out(correlations: Array, count: int) -> list[dict[str, Any]]:
    """Correlations (6, 6) that chance gives with a probability below 1 % in any of the 36, strongest first.

    Those of independent ranks have a standard deviation of 1/sqrt(n - 1); also, they are at least `LEAST`.
    """
    from scipy.special import ndtri

    if count < BINS:
        return []
    limit = max(LEAST, float(ndtri(1 - (1 - CONFIDENCE) / correlations.size / 2)) / np.sqrt(count - 1))
    pairs = [
        {"error": ERRORS[row], "pose": DEGREES[column], "correlation": float(correlations[row, column])}
        for row, column in np.argwhere(np.abs(correlations) > limit)
    ]
    return sorted(pairs, key=lambda pair: -abs(pair["correlation"]))


def draw_degrees(
    figure: "Figure | SubFigure",
    entry: DegreeErrors,
    bins: Sequence[Sequence[Mapping[str, Any]]] | None = None,
    as_pixels: bool = True,
) -> None:
    """Draw the 36 plots of pose against error: views, and of each bin mean, spread, and the spread that is claimed.

    Limits are at the 99th percentile of each error, so that the largest do not flatten everything.

    Parameters
    ----------
    bins : sequence
        See `DegreeErrors.bins`; by default, of the views themselves.
    as_pixels : bool
        Views are pixels of a picture inside the drawing, or else a few of them drawn.
    """
    axes = figure.subplots(6, 6, sharex="col", sharey="row")
    drawn = np.arange(len(entry.errors))[:: max(1, len(entry.errors) // (SCATTERED if as_pixels else DRAWN))]
    limits = [float(np.quantile(np.abs(column), 0.99)) * 1.15 or 1.0 for column in entry.errors.T]
    for j, (column, parts_of) in enumerate(zip(entry.degrees.T, bins or entry.bins(), strict=True)):
        at = [part["at"] for part in parts_of]
        mean, std, claimed = (
            np.array([part[key] for part in parts_of], dtype=float).reshape(-1, 6) for key in ("mean", "std", "claimed")
        )
        for i, limit in enumerate(limits):
            ax = axes[i, j]
            ax.plot(column[drawn], entry.errors[drawn, i], ".", markersize=1, color="#9db4cc", rasterized=as_pixels)
            ax.plot(at, mean[:, i], color=INK, linewidth=0.9)
            for sign in (-1, 1):
                ax.plot(at, mean[:, i] + sign * std[:, i], color=SERIES[0]["color"], linewidth=0.8)
                ax.plot(at, sign * claimed[:, i], color=SERIES[1]["color"], linewidth=0.8, linestyle="--")
            ax.set_ylim(-limit, limit)
            ax.tick_params(labelsize=5, length=2, color=MUTED)
            ax.grid(visible=True, linewidth=0.3)
            if j == 0:
                ax.set_ylabel(ERRORS[i], fontsize=6)
            if i == 5:
                ax.set_xlabel(DEGREES[j], fontsize=6)


def correlation_sentence(pairs: Sequence[dict[str, Any]], count: int) -> str:
    """State which errors go with which degree of freedom of the pose in `count` views."""
    if not pairs:
        return f"In {count} views no error goes with a degree of freedom of the pose beyond chance."
    return f"In {count} views errors go with the pose beyond chance: {correlation_words(pairs)}."


def correlation_words(pairs: Sequence[dict[str, Any]]) -> str:
    """Name correlations, such as ``Z, mm with X, mm (0.31)``."""
    return "; ".join(
        f"{pair['error'].partition(',')[0]} with {pair['pose'].partition(',')[0]} ({pair['correlation']:+.2f})"
        for pair in pairs
    )
