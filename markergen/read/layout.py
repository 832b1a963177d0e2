"""Read a layout: the positions of control points, as text, rows of numbers, or a table in a CSV file."""

# tests: tests/read/test_spec_file.py

from os import PathLike
from pathlib import Path
from typing import Any

from markergen.errors import InputError, brief
from markergen.guard import read
from markergen.model.spec import MOST_POINTS
from markergen.read.measured import COLUMN, UNITS, rows_of
from markergen.units import parse_length

Rows = tuple[tuple[float, ...], ...]

AXES = ("x", "y", "z")


def is_table(value: object) -> bool:
    """True for what names a file with a layout."""
    return isinstance(value, PathLike) or (isinstance(value, str) and value.strip().lower().endswith(".csv"))


def read_layout(path: Any) -> Rows:
    """Read control points in m from a table with columns x, y and perhaps z; others are ignored.

    A unit may follow each name, as in ``x_mm``; the default is meters. The export of a marker to .csv is such a table.

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing, or a value is not a number.
    """
    content = read(Path(str(path).strip()), "layout")
    (line, names), *body = rows_of(content) or [(1, [""])]
    columns = {}
    for index, word in enumerate(names):
        match = COLUMN.fullmatch(word)
        if match and match[1].lower() in AXES:
            columns[match[1].lower()] = index, UNITS[match[2].lower()] if match[2] else 1.0
    if not {"x", "y"} <= set(columns):
        raise InputError(
            f"the columns x, y and perhaps z at line {line} of {content.name}",
            brief(",".join(names)),
            "name them, with their unit, as in x_mm,y_mm",
        )
    used = [columns[axis] for axis in AXES if axis in columns]
    points = []
    for number, cells in body:
        try:
            points.append([float(cells[index]) * unit for index, unit in used])
        except (ValueError, IndexError):
            place = f"line {number} of {content.name}"
            raise InputError(
                f"numbers for {', '.join(columns)} at {place}", brief(",".join(cells)), "correct it"
            ) from None
    # A flat marker's own table has z = 0.
    flat = len(used) == 3 and not any(row[2] for row in points)
    return parsed_layout([row[:2] for row in points] if flat else points)


def parsed_layout(value: object) -> Rows:
    """Return control points in m from text such as ``0mm,50mm; -40mm,-30mm`` or rows of numbers or lengths.

    Raises
    ------
    ValueError
        If it is none, or has fewer than 4 or more than 200 points.

    Examples
    --------
    >>> parsed_layout("0mm,50mm; -40mm,-30mm; 40mm,-30mm; 0,0.01")
    ((0.0, 0.05), (-0.04, -0.03), (0.04, -0.03), (0.0, 0.01))
    """
    if value is None or (isinstance(value, str | list | tuple) and not value):
        return ()
    rows = [part.split(",") for part in value.strip(" ;").split(";")] if isinstance(value, str) else value
    if not isinstance(rows, list | tuple) or not all(isinstance(row, list | tuple) for row in rows):
        raise ValueError("write x,y; x,y; ... with a unit, such as 0mm,50mm; -40mm,-30mm")
    try:
        lengths = tuple(tuple(parse_length(cell) for cell in row) for row in rows)
    except (InputError, TypeError) as error:
        raise ValueError(error.args[2] if isinstance(error, InputError) else "write lengths such as 50mm") from None
    if any(len(row) not in (2, 3) for row in lengths):
        raise ValueError("give x and y of every dot, and z of those of a relief")
    if not 4 <= len(lengths) <= MOST_POINTS:
        raise ValueError(f"give 4 to {MOST_POINTS} dots, not {len(lengths)}")
    return lengths
