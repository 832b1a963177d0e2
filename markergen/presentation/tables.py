"""Text tables for the terminal and notebooks; rows of values as CSV and as data frames."""

import csv
import html
import math
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from numbers import Integral, Real
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

from markergen.errors import MissingLibraryError
from markergen.presentation.lines import SHORT, cells, table_lines, wrapped

if TYPE_CHECKING:
    from pandas import DataFrame

WIDTH = 100
"""Line width in characters if there is no terminal to set it; no table needs more."""


class Table(NamedTuple):
    """Table of text under a header.

    Attributes
    ----------
    title : str
    header : sequence of str
        Names of the columns.
    rows : sequence of sequences of str
        Rows of as many cells as the header has.
    caption : str
        Explanation below the table.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""

    def text(self, width: int = WIDTH) -> str:
        """Return the table as lines of plain text that break between words alone.

        Where the words of all columns are too wide together, the table continues below with the columns that are left.
        A word that is wider than a line by itself, such as a path, is longer than the others.

        >>> print(Table("", ["dot", "x", "y"], [["0", "1.5", "-2"]]).text(), end="")
        <BLANKLINE>
          dot     x    y
         ────────────────
          0     1.5   -2
        <BLANKLINE>
        """
        body = table_lines(self.header, self.rows, width)
        # No narrower than a short line of text.
        room = min(width, max(SHORT, *map(cells, body)))
        lines = [*wrapped(self.title, room), "", *body, "", *wrapped(self.caption, room)]
        return "\n".join(lines) + "\n"

    def html(self) -> str:
        """Return the table as HTML with all text escaped.

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
    """Return sentences and tables as HTML with all text escaped."""
    blocks = (_paragraph(part) if isinstance(part, str) else part.html() for part in parts)
    return f"<div>{''.join(blocks)}</div>"


def print_parts(parts: Iterable[object], file: TextIO) -> None:
    """Print sentences, tables and written files; a terminal sets their width and shows titles in bold."""
    # A pipe has no width, and sentences of any length.
    width = get_terminal_size((WIDTH, 0)).columns if file.isatty() else None
    for part in parts:
        if isinstance(part, Table):
            title = wrapped(part.title, width or WIDTH) if width else []
            if title:
                _print_bold(title, file)
            print((part._replace(title="") if title else part).text(width or WIDTH), end="", file=file)
        else:
            print("\n".join(wrapped(str(part), width)) if width else part, file=file)


def _print_bold(lines: Iterable[str], file: TextIO) -> None:
    from rich.console import Console
    from rich.text import Text

    for line in lines:
        Console(file=file).print(Text(line, "bold"), soft_wrap=True)


def number(value: float | None, digits: int = 3) -> str:
    """Format a number with the given significant digits; a dash for None, ``<1e-6`` for rounding errors.

    >>> number(0.12345), number(None), number(3e-9)
    ('0.123', '-', '<1e-6')
    """
    if value is None:
        return "-"
    return "<1e-6" if 0 < abs(value) < 1e-6 else f"{value:#.{digits}g}".rstrip(".")


def percent(share: float | None) -> str:
    """Format a share as a percentage with up to three digits; a dash for None.

    >>> percent(0.5), percent(None)
    ('50 %', '-')
    """
    return "-" if share is None else f"{100 * share:.3g} %"


def data_frame(rows: Sequence[Mapping[str, Any]]) -> "DataFrame":
    """Return rows as a pandas data frame whose columns are the keys of the first row.

    Raises
    ------
    MissingLibraryError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise MissingLibraryError(
            "expected pandas, which data frames require, found none; pip install pandas"
        ) from None
    return pandas.DataFrame(list(rows))


def csv_bytes(rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = (), digits: int = 9) -> bytes:
    """Return rows of values as CSV.

    Parameters
    ----------
    rows : sequence of mappings
        Values by column; a cell is empty if its value is missing or not finite.
    columns : sequence of str
        Names of the columns; the keys of the first row by default.
    digits : int
        Significant digits of non-integer numbers.

    Raises
    ------
    ValueError
        If a row has a value for a column that is not in `columns`.

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
    # Also numpy's 32-bit floats, which are not instances of float.
    if isinstance(value, Real) and not isinstance(value, Integral):
        return f"{value:.{digits}g}" if math.isfinite(value) else ""
    return str(value)


def _escaped(text: str) -> str:
    return html.escape(text, quote=True)


def _cells(tag: str, cells: Sequence[str]) -> str:
    return "".join(f"<{tag}>{_escaped(cell)}</{tag}>" for cell in cells)


def _paragraph(text: str) -> str:
    return f"<p>{_escaped(text)}</p>".replace("\n", "<br>")
