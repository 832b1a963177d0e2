"""Criteria of a design as tables: beside those of other layouts, and with dots hidden."""

from collections.abc import Mapping, Sequence

from markergen.objectives.criteria import columns
from markergen.objectives.survive import HiddenDots
from markergen.presentation.tables import Table, number

LAYOUTS = {
    "flat": "best without relief",
    "ngon": "regular n-gon",
    "square": "square, 4 dots",
    "random": "random, median",
}
"""Names of the layouts that a marker is compared with."""


def criteria_table(criteria: Mapping[str, Mapping[str, float]], n: int, noise: str) -> Table:
    """Criteria of a design of n dots beside those of the layouts that it is compared with.

    Parameters
    ----------
    criteria : mapping
        By ``design`` or the key of a layout in `LAYOUTS`, then by criterion, in the units of the objectives.
    noise : str
        What they are for, in words.
    """
    but = " and ".join(each.title for each in columns().values() if not each.proportional)
    names = {"design": "this marker", **LAYOUTS, "ngon": f"regular {n}-gon"}
    return Table(
        f"What the layout allows, for {noise}",
        _header(),
        [[names[name], *_cells(row)] for name, row in criteria.items()],
        f"RMS over the poses; proportional to the noise but for {but}.",
    )


def hidden_table(errors: Sequence[HiddenDots], noise: str) -> Table:
    """Criteria of a marker with none, one and more of its dots hidden."""
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
    return ["", *(each.title for each in columns().values())]


def _cells(row: Mapping[str, float]) -> list[str]:
    """Cells for the columns of criteria; a relief lacks some."""
    return [number(row[each.key] * each.factor, 4) if each.key in row else "-" for each in columns().values()]
