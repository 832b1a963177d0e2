"""Lines of text for a terminal of any width: sentences, and rows in columns, broken between words alone.

rich.table was tried for the rows: where they are too wide it cuts numbers ("0.003…" in 80 characters of nine columns),
and it takes 0.14 s to import, also for a pipe.
"""

import re
from collections.abc import Iterator, Sequence
from itertools import chain, zip_longest
from unicodedata import east_asian_width

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
        groups = _in_few_groups([first, *wishes[1:]], room)
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
    """Whether most cells of a column are words rather than numbers."""
    return 2 * sum(cell[:1].isalpha() and " " in cell for cell in column) > len(column)


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + len(_BETWEEN) * (len(widths) - 1)


def _longest_word(text: str) -> int:
    return max(map(cells, _words(text)), default=0) + len(text) - len(text.lstrip())


def _in_few_groups(widths: Sequence[int], room: int) -> list[list[int]]:
    """Return the columns after the first one in as few groups as fit beside it, about equally wide."""
    few = _groups(widths, room)
    return next(groups for least in range(room + 1) if len(groups := _groups(widths, least)) <= len(few))


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
