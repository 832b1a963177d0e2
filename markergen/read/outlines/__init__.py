"""Outlines from drawings: a table of formats, told apart by what is in the file, not by its name."""

from markergen.geometry.outlines import TOLERANCE
from markergen.read.outlines.boundary import is_drawing, parse_boundary
from markergen.read.outlines.drawing import UNITS
from markergen.read.outlines.formats import OUTLINE_FORMATS, OutlineFormat
from markergen.read.outlines.reader import read_contours, read_outline
from markergen.read.outlines.room import drawn_plate, read_room

__all__ = [
    "OUTLINE_FORMATS",
    "TOLERANCE",
    "UNITS",
    "OutlineFormat",
    "drawn_plate",
    "is_drawing",
    "parse_boundary",
    "read_contours",
    "read_outline",
    "read_room",
]
