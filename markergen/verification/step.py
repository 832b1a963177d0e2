"""STEP and BREP: what their parts look like from above, by Open CASCADE in a process of its own.

Open CASCADE ends its whole process on some broken files, and never ends with others.
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
"""Words, and numbers beyond 1e10 between them, with which Open CASCADE never ends."""


@READERS.register(".step", ".stp")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Parts of a STEP file, with their names and colors, moved to where assemblies have them."""
    return reading_of("STEP", Surface(read_step(data, name)))


@READERS.register(".brep")
def read_native(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Parts of a BREP file."""
    return reading_of("BREP", Surface(read_brep(data, name)))


def read_step(data: bytes, name: str = "the STEP file") -> tuple[SolidPart, ...]:
    """Parts of a STEP file, moved to where its assemblies have them, in mm.

    Raises
    ------
    InputError
        If it is incomplete, has no shapes, or Open CASCADE cannot read it.
    MissingLibraryError
        If the CAD kernel or a system library that it needs is missing.
    """
    # The end may be followed by blanks; what is cut off would be read as far as it goes.
    if not data.lstrip().startswith(b"ISO-10303-21") or b"END-ISO-10303-21" not in data[-1000:]:
        raise InputError(f"a complete STEP file in {name}", "no beginning or end of one", "export it again")
    if any(match[1] for match in HUGE.finditer(data)):
        raise InputError(f"lengths below 10 000 km in {name}", "numbers beyond 1e10", "export it again")
    return _parts("STEP", data, name)


def read_brep(data: bytes, name: str = "the BREP file") -> tuple[SolidPart, ...]:
    """Parts of a BREP file of Open CASCADE, in mm; they have neither names nor colors. Raises as `read_step` does."""
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
