"""Read the plan view of the parts of STEP and BREP files, with Open CASCADE in a child process.

Open CASCADE crashes on some broken files and never finishes on others.
"""

# tests: tests/verification/test_solid_readers.py

import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import markergen.read.meshes
from markergen.errors import InputError, MissingLibraryError
from markergen.guard import Content, in_child
from markergen.model.body import Body
from markergen.occt import missing_kernel
from markergen.verification.reading import READERS, Reading, Settings
from markergen.verification.solids import level_face, reading_of
from markergen.verification.surface import Ball, Color, LevelFace, SolidPart, Surface

PARSER = Path(markergen.read.meshes.__file__).with_name("step_parser.py")

HUGE = re.compile(rb"'[^']*'|(\d\.?\d*[eE]\+?0*[1-9]\d|\d{12}\.)")
"""Quoted strings, to skip, and numbers beyond 1e10 outside of them, on which Open CASCADE never finishes."""


def _read(kind: str, data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read the parts of a STEP file with names and colors, placed as its assemblies have them, or of a BREP file."""
    views = partial(_views, kind, data, name)
    if body.frame != "marker":
        CHECKS[kind](data, name)
        return reading_of(kind, views("sides"), body)
    CHECKS[kind](data, name)
    values = _asked(kind, kind.lower(), data, name)
    triangles = np.array(values["triangles"], dtype=float).reshape(-1, 3, 3)
    surface = Surface(_parts(values["parts"], name), partial(views, "turned"), triangles=triangles)
    return reading_of(kind, [surface], body)


for _suffix, _kind in ((".step", "STEP"), (".stp", "STEP"), (".brep", "BREP")):
    READERS.register(_suffix)(partial(_read, _kind))


def read_step(data: bytes, name: str = "the STEP file") -> tuple[SolidPart, ...]:
    """Read the parts of a STEP file in mm, placed as its assemblies have them.

    Raises
    ------
    InputError
        If it is incomplete, has no shapes, or Open CASCADE cannot read it.
    MissingLibraryError
        If the CAD kernel or a system library that it needs is missing.
    """
    _check_step(data, name)
    return _parts(_asked("STEP", "step", data, name)["parts"], name)


def _check_step(data: bytes, name: str) -> None:
    # Blanks may follow the end; Open CASCADE would read a truncated file as far as it goes.
    if not data.lstrip().startswith(b"ISO-10303-21") or b"END-ISO-10303-21" not in data[-1000:]:
        raise InputError(f"a complete STEP file in {name}", "no header or no end", "export it again")
    if any(match[1] for match in HUGE.finditer(data)):
        raise InputError(f"lengths below 10 000 km in {name}", "numbers beyond 1e10", "export it again")


def read_brep(data: bytes, name: str = "the BREP file") -> tuple[SolidPart, ...]:
    """Read the parts of an Open CASCADE BREP file, in mm, without names or colors. Raises as `read_step` does."""
    _check_brep(data, name)
    return _parts(_asked("BREP", "brep", data, name)["parts"], name)


def _check_brep(data: bytes, name: str) -> None:
    if b"CASCADE Topology" not in data[:1000]:
        raise InputError(f"a BREP file of Open CASCADE in {name}", "something else", "export it again")


CHECKS = {"STEP": _check_step, "BREP": _check_brep}


def _views(kind: str, data: bytes, name: str, which: str) -> list[Surface]:
    """Views of the solids: ``turned`` with their largest level area up and down, ``sides`` with each larger one up."""
    views = _asked(kind, f"{kind.lower()}_{which}", data, name)["views"]
    return [Surface(_parts(view["parts"], name), rotation=np.array(view["turn"])) for view in views]


def _asked(kind: str, function: str, data: bytes, name: str) -> dict[str, Any]:
    wanted = f"a {kind} file that Open CASCADE reads in {name}"
    try:
        return in_child(PARSER, function, Content(name, data), "CAD", wanted).values
    except MissingLibraryError as error:
        raise missing_kernel("reading solids needs", str(error)) from None


def _parts(rows: list[dict[str, Any]], name: str) -> tuple[SolidPart, ...]:
    if not rows:
        raise InputError(f"shapes in {name}", "none", "export it again")
    return tuple(_part(row) for row in rows)


def _part(row: dict[str, Any]) -> SolidPart:
    faces, backs = (
        tuple(level for face in row[side] if (level := _level(face)) is not None) for side in ("faces", "backs")
    )
    balls = tuple(Ball(**{**ball, "color": _color(ball["color"])}) for ball in row["balls"])
    low, high = row["low"], row["high"]
    return SolidPart(
        row["name"], _color(row["color"]), row["volume"], row["valid"], row["closed"],
        (low[0], low[1], low[2]), (high[0], high[1], high[2]), faces, balls, backs,
    )  # fmt: skip


def _level(face: dict[str, Any]) -> LevelFace | None:
    """Level face of finite numbers; None without any edge of them."""
    loops = [
        (np.array(loop["points"], dtype=float).reshape(-1, 2), loop["circle"], loop["straight"])
        for loop in face["loops"]
        if loop["circle"] or len(loop["points"]) > 2
    ]
    if not loops or not np.isfinite(face["z"]) or not all(np.isfinite(points).all() for points, _, _ in loops):
        return None
    return level_face(face["z"], loops, _color(face["color"]))


def _color(rgb: list[float] | None) -> Color | None:
    return (rgb[0], rgb[1], rgb[2]) if rgb else None
