"""Read outlines from drawings, in formats that are recognized by content, not by name."""

from markergen.geometry.outlines import TOLERANCE
from markergen.read.outlines.boundary import drawn_plate, is_drawing, parse_boundary, read_room
from markergen.read.outlines.formats import OUTLINE_FORMATS, UNITS, OutlineFormat
from markergen.read.outlines.reader import read_contours, read_outline

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
