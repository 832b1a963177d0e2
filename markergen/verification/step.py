"""Read the plan view of the parts of STEP and BREP files, with Open CASCADE in a child process.

Open CASCADE crashes on some broken files and never finishes on others.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

import markergen.solid
from markergen.errors import InputError, MissingLibraryError
from markergen.geometry.contour import area
from markergen.guard import Content, in_child
from markergen.model.marker import Marker
from markergen.solid.kernel import missing_kernel
from markergen.verification.reading import READERS, Reading
from markergen.verification.solids import reading_of
from markergen.verification.surface import Ball, Color, LevelFace, SolidPart, Surface, edge_of

PARSER = Path(markergen.solid.__file__).with_name("step_parser.py")

HUGE = re.compile(rb"'[^']*'|(\d\.?\d*[eE]\+?0*[1-9]\d|\d{12}\.)")
"""Quoted strings, to skip, and numbers beyond 1e10 outside of them, on which Open CASCADE never finishes."""


@READERS.register(".step", ".stp")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Read the parts of a STEP file with names and colors, placed as its assemblies have them."""
    return reading_of("STEP", Surface(read_step(data, name)))


@READERS.register(".brep")
def read_native(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Read the parts of a BREP file."""
    return reading_of("BREP", Surface(read_brep(data, name)))


def read_step(data: bytes, name: str = "the STEP file") -> tuple[SolidPart, ...]:
    """Read the parts of a STEP file in mm, placed as its assemblies have them.

    Raises
    ------
    InputError
        If it is incomplete, has no shapes, or Open CASCADE cannot read it.
    MissingLibraryError
        If the CAD kernel or a system library that it needs is missing.
    """
    # Blanks may follow the end; Open CASCADE would read a truncated file as far as it goes.
    if not data.lstrip().startswith(b"ISO-10303-21") or b"END-ISO-10303-21" not in data[-1000:]:
        raise InputError(f"a complete STEP file in {name}", "no header or no end", "export it again")
    if any(match[1] for match in HUGE.finditer(data)):
        raise InputError(f"lengths below 10 000 km in {name}", "numbers beyond 1e10", "export it again")
    return _parts("STEP", data, name)


def read_brep(data: bytes, name: str = "the BREP file") -> tuple[SolidPart, ...]:
    """Read the parts of an Open CASCADE BREP file, in mm, without names or colors. Raises as `read_step` does."""
    if b"CASCADE Topology" not in data[:1000]:
        raise InputError(f"a BREP file of Open CASCADE in {name}", "something else", "export it again")
    return _parts("BREP", data, name)


def _parts(called: str, data: bytes, name: str) -> tuple[SolidPart, ...]:
    wanted = f"a {called} file that Open CASCADE reads in {name}"
    try:
        reply = in_child(PARSER, called.lower(), Content(name, data), "CAD", wanted)
    except MissingLibraryError as error:
        raise missing_kernel("reading solids needs", str(error)) from None
    parts = tuple(_part(each) for each in reply.values["parts"])
    if not parts:
        raise InputError(f"shapes in {name}", "none", "export it again")
    return parts


def _part(each: dict[str, Any]) -> SolidPart:
    def color(found: list[float] | None) -> Color | None:
        return (found[0], found[1], found[2]) if found else None

    faces = []
    for face in each["faces"]:
        edges = [(np.array(edge["points"], dtype=float).reshape(-1, 2), edge["circle"]) for edge in face["loops"]]
        whole = [(points, about) for points, about in edges if about or len(points) > 2]
        if whole and np.isfinite(face["z"]) and all(np.isfinite(points).all() for points, _ in whole):
            found = sorted((edge_of(points, about) for points, about in whole), key=lambda edge: -abs(area(edge)))
            faces.append(LevelFace(face["z"], tuple(found), color(face["color"])))
    balls = tuple(Ball(**{**ball, "color": color(ball["color"])}) for ball in each["balls"])
    low, high = each["low"], each["high"]
    return SolidPart(
        each["name"], color(each["color"]), each["volume"], each["valid"], each["closed"],
        (low[0], low[1], low[2]), (high[0], high[1], high[2]), tuple(faces), balls,
    )  # fmt: skip
