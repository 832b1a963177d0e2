"""Tables of text for the terminal and for notebooks; rows of values as CSV and as data frames."""

import csv
import html
import math
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

from markergen.errors import MissingLibraryError

if TYPE_CHECKING:
    from pandas import DataFrame

WIDTH = 100
"""Characters in a line where no terminal says otherwise; no table needs more."""

_AS_IT_IS: dict[str, Any] = {"highlight": False, "markup": False, "emoji": False}
"""Settings of rich's console: a file may be called ``[red].svg``."""


class Table(NamedTuple):
    """Rows of text under a header.

    Attributes
    ----------
    title : str
    header : sequence of str
        Names of the columns.
    rows : sequence of sequences of str
        As many cells each as the header has.
    caption : str
        Explanation below the table.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""

    def text(self, width: int = WIDTH) -> str:
        """Return the table as lines of plain text, nothing cut off; cells that are too long go on in the next line.

        >>> text = Table("", ["dot", "x", "y"], [["0", "1.5", "-2"]]).text()
        >>> [line.strip() for line in text.splitlines() if line.strip()]
        ['dot     x    y', '────────────────', '0     1.5   -2']
        """
        from rich.console import Console

        out = StringIO()
        plain: dict[str, Any] = {"force_terminal": False, "force_jupyter": False, "color_system": None}
        self.print(Console(file=out, width=width, **plain, **_AS_IT_IS))
        return out.getvalue()

    def print(self, console: Any) -> None:
        """Print on a console of rich: the first column to the left, the others, if there are any more, to the right."""
        from rich import box
        from rich.table import Table as Drawn

        drawn = Drawn(
            box=box.SIMPLE_HEAD,
            title=self.title,
            caption=self.caption or None,
            title_justify="left",
            caption_justify="left",
            title_style="bold",
        )
        for index, name in enumerate(self.header):
            justify = "right" if index and len(self.header) > 2 else "left"
            drawn.add_column(name, justify=justify, overflow="fold")  # type: ignore[arg-type]
        for row in self.rows:
            drawn.add_row(*row)
        console.print(drawn)

    def html(self) -> str:
        """Return the table as HTML, everything escaped.

        >>> Table("", ["file"], [["a<b"]]).html()
        '<table><thead><tr><th>file</th></tr></thead><tbody><tr><td>a&lt;b</td></tr></tbody></table>'
        """
        title = f"<caption>{_escaped(self.title)}</caption>" if self.title else ""
        body = "".join(f"<tr>{_cells('td', row)}</tr>" for row in self.rows)
        below = f"<p><small>{_escaped(self.caption)}</small></p>" if self.caption else ""
        return f"<table>{title}<thead><tr>{_cells('th', self.header)}</tr></thead><tbody>{body}</tbody></table>{below}"


def parts_as_text(parts: Iterable[str | Table]) -> str:
    """Return sentences and tables as lines of plain text."""
    return "\n".join(part if isinstance(part, str) else part.text().removesuffix("\n") for part in parts)


def parts_as_html(parts: Iterable[str | Table]) -> str:
    """Return sentences and tables as HTML, everything escaped."""
    shown = (_paragraph(part) if isinstance(part, str) else part.html() for part in parts)
    return f"<div>{''.join(shown)}</div>"


def print_parts(parts: Iterable[str | Table], file: TextIO) -> None:
    """Print sentences and tables; a terminal decides on their width and shows titles in bold."""
    from rich.console import Console

    for part in parts:
        if isinstance(part, str):
            print(part, file=file)
        else:
            # A pipe has no width of its own.
            part.print(Console(file=file, width=None if file.isatty() else WIDTH, **_AS_IT_IS))


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with that many significant digits; a dash where there is none, no digits where it is rounding.

    >>> number(0.12345), number(None), number(3e-9)
    ('0.123', '-', '<1e-6')
    """
    if value is None:
        return "-"
    return "<1e-6" if 0 < abs(value) < 1e-6 else f"{value:#.{digits}g}".rstrip(".")


def percent(share: float | None) -> str:
    """Write a share as a percentage with up to three digits; a dash where there is none.

    >>> percent(0.5), percent(None)
    ('50 %', '-')
    """
    return "-" if share is None else f"{100 * share:.3g} %"


def data_frame(rows: Sequence[Mapping[str, Any]]) -> "DataFrame":
    """Return rows as a data frame of pandas, whose columns are the keys of the first row.

    Raises
    ------
    MissingLibraryError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise MissingLibraryError(
            "expected pandas, which data frames are made with, found none; pip install pandas"
        ) from None
    return pandas.DataFrame(list(rows))


def csv_bytes(rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = (), digits: int = 9) -> bytes:
    """Return rows of values as CSV.

    Parameters
    ----------
    rows : sequence of mappings
        Values by column; a cell is empty where there is none, or a number that is not finite.
    columns : sequence of str
        Names of the columns; without them the keys of the first row.
    digits : int
        Significant digits of numbers that are not whole.

    Raises
    ------
    ValueError
        If a row has a value for a column that is not among them.

    Examples
    --------
    >>> csv_bytes([{"n": 4, "error": 0.1234567}, {"n": 5}], digits=3)
    b'n,error\\n4,0.123\\n5,\\n'
    """
    text = StringIO()
    writer = csv.DictWriter(text, columns or list(rows[0]), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _csv_cell(value, digits) for name, value in row.items()} for row in rows)
    return text.getvalue().encode()


def _csv_cell(value: Any, digits: int) -> str:
    if value is None:
        return ""
    # Also numpy's floats of 32 bits, which are none of Python's.
    if isinstance(value, Real) and not isinstance(value, Integral):
        return f"{value:.{digits}g}" if math.isfinite(value) else ""
    return str(value)


def _escaped(text: str) -> str:
    return html.escape(text, quote=True)


def _cells(tag: str, cells: Sequence[str]) -> str:
    return "".join(f"<{tag}>{_escaped(cell)}</{tag}>" for cell in cells)


def _paragraph(text: str) -> str:
    return f"<p>{_escaped(text)}</p>".replace("\n", "<br>")
