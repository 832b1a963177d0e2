"""Text tables for the terminal and notebooks, in lines of any width; rows of values as CSV and as data frames.

rich.table was tried for the rows: where they are too wide it cuts numbers ("0.003…" in 80 characters of nine columns),
and it takes 0.14 s to import, also for a pipe.
"""
# tests: tests/presentation/test_tables.py tests/presentation/test_lines.py

import csv
import html
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import StringIO
from itertools import chain, zip_longest
from numbers import Integral, Real
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO
from unicodedata import east_asian_width

from markergen.errors import MissingLibraryError

if TYPE_CHECKING:
    from pandas import DataFrame

LONG = 1e6
"""Value from which on a number is written with an exponent."""

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


def parts_as_html(parts: Iterable[str | Table]) -> str:
    """Return sentences and tables as HTML with all text escaped."""
    blocks = (
        f"<p>{_escaped(part)}</p>".replace("\n", "<br>") if isinstance(part, str) else part.html() for part in parts
    )
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

    >>> number(0.12345), number(None), number(3e-9), number(343.2, 2)
    ('0.123', '-', '<1e-6', '340')
    """
    if value is None:
        return "-"
    if 0 < abs(value) < 1e-6:
        return "<1e-6"
    text = f"{value:#.{digits}g}".rstrip(".")
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LONG else text


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


SHORT = 60
"""Width of a line, in characters, that is easy to read; what stands beside a narrower table is as wide as this."""

_BETWEEN = "   "
"""Between two columns."""

_SPACE = re.compile(r"(?<!\d) +| +(?=\d|\S{9})")
"""Where a line may break: not between a number and its unit or a short word."""

_PATH = re.compile(r"wrote .*|(?:[A-Za-z]:)?[^:]*\.\w+: ")
"""A path at the beginning of a line, up to the colon behind it: to be copied, so no line breaks at its spaces."""


def cells(text: str) -> int:
    """Return the width of a line in characters of a terminal, where Chinese and others take two.

    >>> cells("dot"), cells("点")
    (3, 2)
    """
    return len(text) if text.isascii() else sum(1 + (east_asian_width(character) in "WF") for character in text)


def wrapped(text: str, width: int) -> list[str]:
    """Return a text as lines of a width, each of its own lines by itself and indented as it is.

    Lines break between words; a number keeps its unit, and a path its spaces.

    >>> wrapped("Plan with 2.8 deg\\n  and 1.5 mm", 12)
    ['Plan with', '2.8 deg', '  and 1.5 mm']
    """
    return [line for unbroken in text.splitlines() for line in _wrapped_line(unbroken, width)]


def _wrapped_line(text: str, width: int) -> Iterator[str]:
    line = text[: len(text) - len(text.lstrip())]
    indent, begun = line, False
    for word in _words(text.strip()):
        if begun and cells(line) + 1 + cells(word) > width:
            yield line
            line, begun = indent, False
        line += f" {word}" if begun else word
        begun = True
    yield line.rstrip()


def _words(text: str) -> list[str]:
    path = _PATH.match(text)
    head = path.group().rstrip() if path else ""
    return [word for word in (head, *_SPACE.split(text[len(head) :].strip())) if word]


def table_lines(header: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Return rows under a header as lines: numbers aligned right, words left, as are two columns alone.

    Where all columns are too wide together, even with their cells broken between words, the lines continue below
    with the columns that are left, beside the first one again. A first column that takes most of the width, such as one
    of paths, has lines of its own above those of the others.
    """
    table = [header, *rows]
    natural = [max(cells(row[k]) for row in table) for k in range(len(header))]
    least = [max(_longest_word(row[k]) for row in table) for k in range(len(header))]
    # Two characters at the left, and the end of the rule at the right.
    room = width - 3
    bands, alone = [list(range(len(header)))], False
    if _total(least) > room and len(header) > 1:
        alone = 2 * least[0] > room or _total([least[0], max(least[1:])]) > room
        first = 0 if alone else max(least[0], min(natural[0], room // 3))
        most = room - first - len(_BETWEEN)
        wishes = [max(low, min(wish, most)) for wish, low in zip(natural, least, strict=True)]
        # As few groups as fit, about equally wide.
        few = len(_groups(widths := [first, *wishes[1:]], room))
        groups = next(groups for least in range(room + 1) if len(groups := _groups(widths, least)) <= few)
        bands = groups if alone else [[0, *group] for group in groups]
    lines: list[str] = []
    for band in bands:
        widths = _widths([natural[k] for k in band], [least[k] for k in band], room)
        right = [len(header) > 2 and k > 0 and not _prose([row[k] for row in rows]) for k in band]
        blocks = [_row([row[k] for k in band], widths, right) for row in table]
        if alone:
            blocks = [[*wrapped(f"  {row[0]}", width), *block] for row, block in zip(table, blocks, strict=True)]
        rule = f" {'─' * (_total(widths) + 2)}"
        lines += [*([""] if lines else []), *blocks[0], rule, *chain.from_iterable(blocks[1:])]
    return lines


def _prose(column: Sequence[str]) -> bool:
    """Whether most cells of a column that are not empty are words rather than numbers."""
    return 2 * sum(cell[:1].isalpha() and " " in cell for cell in column) > sum(map(bool, column))


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + len(_BETWEEN) * (len(widths) - 1)


def _longest_word(text: str) -> int:
    return max(map(cells, _words(text)), default=0) + len(text) - len(text.lstrip())


def _groups(widths: Sequence[int], room: int) -> list[list[int]]:
    groups: list[list[int]] = []
    for k in range(1, len(widths)):
        if not groups or _total([widths[j] for j in (0, *groups[-1], k)]) > room:
            groups.append([])
        groups[-1].append(k)
    return groups


def _widths(natural: Sequence[int], least: Sequence[int], room: int) -> list[int]:
    """Return widths of columns: as wide as their cells, or the widest of them narrower until all fit."""
    widths = list(natural)
    while _total(widths) > room:
        wide = [k for k in range(len(widths)) if widths[k] > least[k]]
        if not wide:
            break
        widths[max(wide, key=lambda k: widths[k])] -= 1
    return widths


def _row(row: Sequence[str], widths: Sequence[int], right: Sequence[bool]) -> list[str]:
    """Return the lines of a row whose cells are wrapped in columns of the given widths."""
    columns = [wrapped(cell, width) for cell, width in zip(row, widths, strict=True)]
    lines = []
    for line in zip_longest(*columns, fillvalue=""):
        blanks = [" " * (width - cells(cell)) for cell, width in zip(line, widths, strict=True)]
        padded = [blank + cell if last else cell + blank for cell, blank, last in zip(line, blanks, right, strict=True)]
        lines.append(f"  {_BETWEEN.join(padded)}".rstrip())
    return lines
