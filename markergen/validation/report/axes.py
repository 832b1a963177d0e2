"""What plots share: logarithmic axes with plain numbers, and legends that hide nothing."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TICKS = (
    (3, (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9)),
    (12, (1, 2, 3, 5, 7)),
    (60, (1, 2, 5)),
    (1000, (1, 3)),
    (np.inf, (1,)),
)
"""Where a logarithmic axis is labeled in each decade, by the ratio of its ends."""


def positive(value: float | None) -> float:
    """A value that a logarithmic axis can show; nan, which leaves a gap, for any other."""
    return float(value) if value and value > 0 and np.isfinite(value) else float("nan")


def ticks(low: float, high: float) -> tuple[float, ...]:
    """Steps within a decade at which a logarithmic scale from low to high is labeled."""
    return next(steps for ratio, steps in _TICKS if high < ratio * low or ratio == np.inf)


def log_axis(ax: "Axes", which: str) -> None:
    """Make the ``x`` or ``y`` axis logarithmic, labeled with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    getattr(ax, f"set_{which}scale")("log")
    axis = getattr(ax, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=ticks(*getattr(ax, f"get_{which}lim")()), numticks=40))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def legend_below(ax: "Axes") -> None:
    """Put the legend under the axes, where it covers no line."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2, columnspacing=1.2)
