"""What a check comes to, in words and cells."""

from collections.abc import Iterable

import numpy as np

from markergen.presentation.tables import Table
from markergen.verification.check import Check

_CAPTION = (
    "The largest distance of a dot from marker.json, by the best turn and shift. Along x and y: what 1 mm of the "
    "marker is in the file; at 99.9 % a ruler of 200 mm measures 199.8 mm."
)


_HEADER = ("file", "dots", "largest error", "along x", "along y", "page", "")


def table(checks: Iterable[Check]) -> Table:
    """Checks as a table, one row each."""
    return Table("", _HEADER, [_row(check) for check in checks], _CAPTION)


def lines(check: Check) -> list[str]:
    """What there is to say about a file besides its row, one sentence a line."""
    return [f"{check.path}: {said}" for said in (*(each.sentence for each in check.findings), *check.notes)]


def _row(check: Check) -> list[str]:
    papers = {(round(page[0], 2), round(page[1], 2)) for page in check.pages if page}
    paper = " ".join(f"{width:g} x {height:g} mm" for width, height in sorted(papers))
    pages = f"{len(check.pages)} x {paper}" if len(check.pages) > 1 else paper
    return [
        check.path,
        str(check.dots),
        f"{_length(check.largest)} (dot {check.worst})" if check.worst is not None else "-",
        *(f"{100 * scale:.4f} %" if np.isfinite(scale) else "-" for scale in check.scale),
        pages or "-",
        "ok" if check.passed else "WRONG",
    ]


def _length(meters: float) -> str:
    return f"{1e6 * meters:.3g} um" if meters < 1e-5 else f"{1e3 * meters:.4g} mm"
