"""Comparison layouts for a design, in the same feasible region, and tables of their criteria."""

from collections.abc import Mapping, Sequence

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.model.goal import NGON, parse_goal
from markergen.model.planned_error import LINEAR_DEG
from markergen.model.spec import Spec
from markergen.objectives import Setting
from markergen.objectives.base import Criterion
from markergen.objectives.criteria import RANDOM_LAYOUTS, Criteria, columns, criteria, median_criteria
from markergen.objectives.pose import PoseObjective
from markergen.objectives.survive import HiddenDots
from markergen.optimize.layouts import polygons
from markergen.optimize.problem import FeasibleRegion
from markergen.presentation.tables import Table, number

LAYOUTS = {
    "flat": "best without relief",
    "ngon": "regular n-gon",
    "square": "square, 4 dots",
    "random": "random, median",
}
"""Names of the comparison layouts."""

UNDETERMINED = "undetermined"
"""What a cell has in place of a rotation error for which first order does not hold."""

NOTICEABLE = 1e-3
"""Relative gain that justifies rotating a polygon away from having a corner straight up."""


def compare(
    points: Array, region: FeasibleRegion, setting: Setting, seed: int = 0, others: Mapping[str, Array] | None = None
) -> dict[str, Criteria]:
    """Criteria of a layout (n, 2 or 3) and of the n-gon, the square and the median random layout of the same region.

    Other layouts (n, 2 or 3) follow under their names, after the design.
    """
    table: dict[str, Criteria] = {"design": criteria(points[None], setting)[0]}
    table |= {name: criteria(layout[None], setting)[0] for name, layout in (others or {}).items()}
    if setting.sight:  # Others have dots of one size, which other poses see.
        return table
    for name, layouts in comparison_layouts(region, len(points), seed, setting).items():
        table[name] = median_criteria(criteria(layouts, setting))
    return table


def comparison_layouts(
    region: FeasibleRegion, n: int, seed: int = 0, setting: Setting | None = None
) -> dict[str, Array]:
    """Layouts (B, m, 2) in m by name: ``ngon`` and ``square``, regular and as large as possible, and ``random``.

    Regular polygons are centered on the marker or on the largest circle in the region, whichever is better.
    Infeasible layouts (dots would touch) are omitted.

    Parameters
    ----------
    setting : Setting or None
        Setting in which the orientation of regular polygons is optimized, by the pose objective; None takes the
        largest ones, with a corner straight up if that is as good.
    """
    polygons = {"ngon": _polygon(region, n, setting), "square": _polygon(region, 4, setting)}
    layouts = {**polygons, "random": region.sample(RANDOM_LAYOUTS, n, np.random.default_rng(seed))}
    # Drop random layouts that stayed jammed, and infeasible regular ones.
    return {name: kept for name, batch in layouts.items() if len(kept := batch[region.holds(batch)])}


def reference(spec: Spec, region: FeasibleRegion, setting: Setting) -> Array | None:
    """Regular polygon (1, n, 2) in m that the spec's objective refers to, as in `comparison_layouts`; None if to none.

    Raises
    ------
    InputError
        If it refers to one, but none fits.
    """
    if not parse_goal(spec.objective).relative:
        return None
    polygon = _polygon(region, spec.n, setting)
    if not region.holds(polygon)[0]:
        raise InputError(
            f"room for a regular polygon of {spec.n} dots, which weights and {NGON} refer to",
            f"objective={spec.objective!r}",
            "give bounds as numbers, or use smaller dots",
        )
    return polygon


def _polygon(region: FeasibleRegion, n: int, setting: Setting | None) -> Array:
    """Best regular n-gon (1, n, 2) in m, infeasible if there is none."""
    layouts = polygons(region, n)
    held = layouts[region.holds(layouts)]
    if not len(held):
        return layouts[:1]
    if setting is None:
        worth = -np.linalg.norm(held[:, 0] - held.mean(axis=1), axis=-1)
    else:
        worth = np.log(PoseObjective(setting)(held))
    # The first is upright.
    return held[:1] if worth[0] <= worth.min() + NOTICEABLE * abs(worth.min()) else held[[np.argmin(worth)]]


def criteria_table(criteria: Mapping[str, Mapping[str, float]], n: int, noise: str) -> Table:
    """Table of the criteria of a design of n dots and of its comparison layouts.

    Parameters
    ----------
    criteria : mapping
        By ``design`` or the key of a layout in `LAYOUTS`, then by criterion, in the units of the objectives.
    noise : str
        Noise that the criteria are for, in words.
    """
    but = " and ".join(
        f"{criterion.title}, {criterion.noiseless}" for criterion in columns().values() if criterion.noiseless
    )
    names = {"design": "this marker", **LAYOUTS, "ngon": f"regular {n}-gon"}
    return Table(
        f"What the layout allows, for {noise}",
        _header(),
        [[names[name], *_cells(row)] for name, row in criteria.items()],
        f"RMS over the poses; proportional to the noise but for {but}. "
        f"Beyond {LINEAR_DEG:g} deg, first order does not hold.",
    )


def hidden_table(errors: Sequence[HiddenDots], noise: str) -> Table:
    """Table of the criteria of a marker with none, one and more of its dots hidden."""
    rows = []
    for row in errors:
        worst = f"dot{'s' * (row.hidden > 1)} {', '.join(map(str, row.worst_dots))}"
        dots = f"worst: {worst} hidden" if row.hidden else "none hidden"
        rows.append([dots, *_cells(row.worst)])
        if row.hidden:
            rows.append([f"mean of any {row.hidden} hidden", *_cells(row.mean)])
    return Table(
        f"With dots hidden, for {noise}",
        _header(),
        rows,
        "Each criterion after the loss that is worst for it; dots named are those whose loss is worst for the pose.",
    )


def _header() -> list[str]:
    return ["", *(criterion.title for criterion in columns().values())]


def cell(criterion: Criterion, value: float) -> str:
    """Value of a criterion in the unit of its column, with four digits, unless first order does not hold for it."""
    beyond = criterion.title.endswith(" deg") and value * criterion.factor > LINEAR_DEG
    return UNDETERMINED if beyond else number(value * criterion.factor, 4)


def _cells(row: Mapping[str, float]) -> list[str]:
    """Cells for the columns of criteria, some of which a relief lacks."""
    return [cell(criterion, row[criterion.key]) if criterion.key in row else "-" for criterion in columns().values()]
