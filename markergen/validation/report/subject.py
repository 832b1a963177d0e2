"""What a report is about, and what a section of it holds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.estimators.budget import PoseBudget
from markergen.model.marker import Marker
from markergen.objectives import Setting
from markergen.presentation.plots import Plot
from markergen.presentation.tables import Table
from markergen.validation.report.expected import Cell, Expected, bound, cells, expected, noise_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Results = Mapping[str, Any]

ERRORS = (("rotation_deg", "rotation", "deg"), ("translation_pct", "translation", "% of the distance"))
"""Key in the results, name, and unit of each error."""
GROUPINGS = (("tilt", "by_polar_angle", "tilt, deg"), ("distance", "by_distance", "distance, m"))
"""Name, key in the results (and method of the poses), and axis label of each grouping of the poses."""


@dataclass
class Section:
    """What a section shows, in this order; `missing` says how to get what is not there."""

    sentences: list[str] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    missing: str = ""


@dataclass(frozen=True, eq=False)
class Subject:
    """What a report is about, with what follows from it for several sections."""

    results: Results
    marker: Marker
    setting: Setting
    budget: PoseBudget | None

    @cached_property
    def expected(self) -> Expected:
        """What error to expect in all."""
        return expected(self.results, self.marker, self.setting, self.budget)

    @cached_property
    def cells(self) -> list[Cell]:
        """What error to expect at each distance and tilt."""
        return cells(self.expected)

    @cached_property
    def bound(self) -> Expected:
        """Bound for the noise of the trials."""
        return bound(self.marker, self.setting, noise_of(self.results))

    @property
    def views(self) -> Results:
        """Results of the views; empty if there were none."""
        return self.results.get("views") or {}

    @cached_property
    def predicted(self) -> Expected | None:
        """Errors that the views, if any, should have: of their noise, and of their print if it was made to err."""
        if not self.views:
            return None
        if self.budget is not None:
            printed = self.budget.print if self.views.get("print_sigma_mm") else 0.0
            return Expected(self.budget.image + printed, self.setting.poses, "predicted")
        # The bound of a dot's center is the root of both axes' variances together.
        pixels = self.views.get("image_bound_px")
        return bound(self.marker, self.setting, pixels / np.sqrt(2)) if pixels else None


def labeled(draw: Callable[["Axes"], object], x: str, y: str = "") -> Callable[["Axes"], None]:
    """Draw, and name the axes."""

    def drawn(ax: "Axes") -> None:
        draw(ax)
        ax.set_xlabel(x)
        if y:
            ax.set_ylabel(y)

    return drawn
