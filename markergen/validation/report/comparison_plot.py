"""The marker beside other layouts."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.presentation.plots import INK
from markergen.validation.report.words import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def compared(bounds: Mapping[str, float], measured: Mapping[str, float | None], ax: "Axes") -> "Axes":
    """Draw the bound of each layout as a bar, the first one dark, with what was measured as a mark beside it."""
    finite = {name: value if np.isfinite(value) else 0.0 for name, value in bounds.items()}
    for y, (name, value) in enumerate(bounds.items()):
        look: dict[str, Any] = {"facecolor": "#d9e2ec", "hatch": "///"} if y else {"facecolor": "#0b5394", "hatch": ""}
        ax.barh(y, finite[name], height=0.6, edgecolor=INK, linewidth=0.7, **look)
        ahead = max(finite[name], measured.get(name) or 0.0)
        ax.annotate(number(value), (ahead, y), (8, 0), textcoords="offset points", va="center_baseline")
    shown = {y: found for y, name in enumerate(bounds) if (found := measured.get(name))}
    if shown:
        ax.plot(
            list(shown.values()), list(shown), linestyle="none", marker="D", markersize=7, markerfacecolor="#ffffff",
            markeredgecolor=INK, label="measured (LM)",
        )  # fmt: skip
        ax.legend(loc="lower right", bbox_to_anchor=(1, 1))
    ax.set_yticks(range(len(bounds)), list(bounds))
    ax.set_ylim(len(bounds) - 0.4, -0.6)
    ax.set_xlim(0, 1.18 * max([*finite.values(), *shown.values(), 1e-12]))
    ax.grid(visible=False, axis="y")
    return ax
