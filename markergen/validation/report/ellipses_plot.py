"""Errors in two dimensions at a time: ellipses that the covariance predicts, and the errors that there were."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.presentation.plots import INK, SERIES, legend_below

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

QUANTILE_95 = float(np.sqrt(-2 * np.log(0.05)))
"""Size of the ellipse that holds 95 % of a Gaussian in the plane, in standard deviations."""
_MOST_DRAWN = 1200
_AROUND = np.linspace(0, 2 * np.pi, 121)


@dataclass(frozen=True, eq=False)
class Ellipse:
    """A predicted covariance (2, 2) with its name, and errors (k, 2) measured under it, in the unit of the axes."""

    name: str
    covariance: Array
    errors: Array


def draw_ellipses(ellipses: list[Ellipse], ax: "Axes") -> "Axes":
    """Draw the 95 % ellipses around the truth, each in its own dashes, and the measured errors as marks."""
    reach = np.zeros(2)
    for each, look in zip(ellipses, SERIES, strict=False):
        outline = ellipse(each.covariance)
        errors = each.errors[:: max(1, -(-len(each.errors) // _MOST_DRAWN))]
        style: dict[str, Any] = {key: look[key] for key in ("color", "linestyle")}
        ax.plot(*outline.T, label=each.name, linewidth=1.8, zorder=3, **style)
        if len(errors):
            ax.plot(
                *errors.T, linestyle="none", marker=look["marker"], markersize=3.5, markerfacecolor="none",
                markeredgecolor=look["color"], markeredgewidth=0.7, zorder=2,
            )  # fmt: skip
        reach = np.max([reach, np.abs(outline).max(axis=0), *np.abs(errors)], axis=0)
    ax.axhline(0, color=INK, linewidth=0.5, zorder=1)
    ax.axvline(0, color=INK, linewidth=0.5, zorder=1)
    reach = np.where(reach > 0, 1.08 * reach, 1.0)
    # Equal units on both axes, unless that would leave a line of the narrower one.
    if reach.max() < 4 * reach.min():
        reach[:] = reach.max()
        ax.set_aspect("equal")
    ax.set_xlim(-reach[0], reach[0])
    ax.set_ylim(-reach[1], reach[1])
    ax.locator_params(nbins=5)
    legend_below(ax)
    return ax


def ellipse(covariance: Array) -> Array:
    """Outline (m, 2) of the region that holds 95 % of the errors of a covariance (2, 2)."""
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(_AROUND), np.sin(_AROUND)], axis=-1)
    return np.asarray(QUANTILE_95 * circle * np.sqrt(np.maximum(values, 0)) @ vectors.T)


def share_inside(errors: Array, covariance: Array) -> float:
    """Share of errors (k, 2) that lie inside the 95 % ellipse of a covariance (2, 2)."""
    squared = np.sum(errors * np.linalg.solve(covariance, errors.T).T, axis=-1)
    return float(np.mean(squared <= QUANTILE_95**2))


def carried_over(errors: Array, covariances: Array, target: Array) -> Array:
    """Errors (k, 2), each of a covariance of its own (k, 2, 2), as they would be under the target (2, 2).

    L_target L_k^-1 e with Cholesky factors L: as many standard deviations away, in the same direction of the ellipse.
    """
    if not len(errors):
        return errors
    whitened = np.linalg.solve(np.linalg.cholesky(covariances), errors[..., None])
    return np.asarray((np.linalg.cholesky(target) @ whitened)[..., 0])
