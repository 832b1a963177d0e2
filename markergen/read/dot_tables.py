"""Read tables of dots: a layout to design with (also as text or rows of numbers), and centers measured on a print."""
# tests: tests/read/test_spec_file.py tests/read/test_dot_tables.py

import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.guard import Content, read, text_of
from markergen.model.rescale import MeasuredDot
from markergen.model.spec import MOST_POINTS
from markergen.read.poses.rows import RowsFile, check_count
from markergen.units import METERS, parse_length

MOST_ROWS = 10_000
"""Maximum number of rows; a marker typically has a dozen dots."""

WANTED = "id, x, y and, if known, sigma or sx, sy, rho"
UNITS = {unit: float(size) for unit, size in METERS.items() if unit}

COLUMN = re.compile(r"([a-z]+)(?:[\s_]*[\[(/]?\s*(um|mm|cm|m|in|ft)\s*[\])]?)?", re.IGNORECASE)
_FORMS = (
    {"id", "x", "y"},
    {"id", "x", "y", "sigma"},
    {"id", "x", "y", "sx", "sy"},
    {"id", "x", "y", "sx", "sy", "rho"},
)


def read_measured(path: Path) -> tuple[MeasuredDot, ...]:
    """Read measured dots from a table with a line of column names, separated by commas, semicolons, tabs or blanks.

    A unit may follow each name, as in ``x_mm``, ``sigma [um]`` or ``y (in)``; the default is meters. `sigma` is the
    standard deviation along each axis; `sx`, `sy` and their correlation `rho` give the full covariance. Lines that
    begin with # are comments.

    Raises InputError if the file cannot be read, a column is missing or unknown, a row is not numbers, or a sigma is
    negative.
    """
    content = read(path, "measured")
    name, rows = content.name, rows_of(content)
    if not rows:
        raise InputError(f"the columns {WANTED} in {name}", "an empty file", "check the path")
    (line, first), *body = rows
    columns = _columns(first, f"line {line} of {name}")
    if not body:
        raise InputError(f"measured dots in {name}", "only the names of columns", "add a row for each dot")
    return tuple(_dot(cells, columns, f"line {line} of {name}") for line, cells in body)


def rows_of(content: Content) -> list[tuple[int, list[str]]]:
    """Return the lines of a table that are not empty and no comments, with their numbers, as words."""
    if content.data.count(b"\n") > MOST_ROWS:
        raise InputError(f"at most {MOST_ROWS} rows in {content.name}", "more", "give one row for each dot")
    table = RowsFile(content.name, text_of(content).encode()).table()
    return [(number, [word.strip() for word in words]) for number, words in table]


def _columns(cells: Sequence[str], place: str) -> dict[str, tuple[int, float]]:
    """Index and unit size in m of each column by name; 1 without a unit, and for id and rho."""
    columns, remedy = _named(cells), "name them, as in id,x_mm,y_mm"
    if columns.keys().isdisjoint(_FORMS[1] | _FORMS[3]):
        raise InputError(f"the columns {WANTED} at {place}", "others", remedy)
    for index, word in enumerate(cells):
        match = COLUMN.fullmatch(word)
        name = match[1].lower() if match else ""
        if match is None or name not in _FORMS[1] | _FORMS[3]:
            raise InputError(f"the columns {WANTED} at {place}", brief(word), remedy)
        if columns[name][0] != index:
            raise InputError(f"every column once at {place}", f"{name} twice", "correct the names")
        if match[2] and name in ("id", "rho"):
            raise InputError(f"no unit for {name} at {place}", brief(word), "leave the unit out")
    if set(columns) not in _FORMS:
        raise InputError(f"the columns {WANTED} at {place}", ", ".join(columns), "add the missing ones")
    return columns


def _named(cells: Sequence[str]) -> dict[str, tuple[int, float]]:
    """Index and unit size in m of the columns whose names are words, perhaps with a unit."""
    matches = [(index, match) for index, word in enumerate(cells) if (match := COLUMN.fullmatch(word))]
    return {match[1].lower(): (index, UNITS[match[2].lower()] if match[2] else 1.0) for index, match in matches}


def _dot(cells: Sequence[str], columns: dict[str, tuple[int, float]], place: str) -> MeasuredDot:
    check_count(list(columns), cells, place)
    values = {}
    for name, (index, unit) in columns.items():
        try:
            # float would read 1_0 as 10, and accept digits of all scripts.
            value = float(cells[index]) * unit if cells[index].isascii() and "_" not in cells[index] else np.nan
        except ValueError:
            value = np.nan
        if not abs(value) < 2**31:
            raise InputError(f"a number for {name} at {place}", brief(cells[index]), "correct the line")
        values[name] = value
    if values["id"] != int(values["id"]) or values["id"] < 0:
        raise InputError(f"a whole number for id at {place}", brief(cells[columns["id"][0]]), "correct the line")
    sx, sy = (values.get(key, values.get("sigma", np.nan)) for key in ("sx", "sy"))
    rho = values.get("rho", 0.0)
    if min(sx, sy) < 0 or abs(rho) > 1:
        raise InputError(f"a sigma of 0 or more, and rho of -1 to 1 at {place}", " ".join(cells)[:80], "correct it")
    covariance = None if np.isnan(sx) else (float(sx * sx), float(rho * sx * sy), float(sy * sy))
    return MeasuredDot(int(values["id"]), float(values["x"]), float(values["y"]), covariance)


Rows = tuple[tuple[float, ...], ...]

AXES = ("x", "y", "z")


def is_table(value: object) -> bool:
    """True for what names a file with a layout."""
    return isinstance(value, PathLike) or (isinstance(value, str) and value.strip().lower().endswith(".csv"))


def read_layout(path: Any) -> Rows:
    """Read control points in m from a table with columns x, y and perhaps z; others are ignored.

    A unit may follow each name, as in ``x_mm``; the default is meters. The export of a marker to .csv is such a table.

    Raises InputError if the file cannot be read, a column is missing, or a value is not a number.
    """
    content = read(Path(str(path).strip()), "layout")
    (line, names), *body = rows_of(content) or [(1, [""])]
    columns = {name: column for name, column in _named(names).items() if name in AXES}
    if not {"x", "y"} <= set(columns):
        expected = f"the columns x, y and perhaps z at line {line} of {content.name}"
        raise InputError(expected, "others", "name them, with their unit, as in x_mm,y_mm")
    used = [columns[axis] for axis in AXES if axis in columns]
    points = []
    for number, cells in body:
        check_count(names, cells, f"line {number} of {content.name}")
        try:
            points.append([float(cells[index]) * unit for index, unit in used])
        except ValueError:
            place = f"line {number} of {content.name}"
            expected = f"numbers for {', '.join(columns)} at {place}"
            raise InputError(expected, brief(",".join(cells)), "correct it") from None
    # A flat marker's own table has z = 0.
    flat = len(used) == 3 and not any(row[2] for row in points)
    try:
        return parsed_layout([row[:2] for row in points] if flat else points)
    except ValueError as error:
        raise InputError(f"a layout in {content.name}", f"{len(points)} rows", str(error)) from None


def parsed_layout(value: object) -> Rows:
    """Return control points in m from text such as ``0mm,50mm; -40mm,-30mm`` or rows of numbers or lengths.

    Raises ValueError if it is none, or has fewer than 4 or more than 200 points.

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
