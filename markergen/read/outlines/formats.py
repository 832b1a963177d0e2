"""The table of outline formats."""

from collections.abc import Callable
from dataclasses import dataclass

from markergen.read.outlines.drawing import Drawing, OutlineFile
from markergen.registry import Registry


@dataclass(frozen=True)
class OutlineFormat:
    """One kind of drawing.

    Attributes
    ----------
    signs : str
        What a file of this kind holds, for the message that no format fits.
    fits : callable
        Tell whether a file is of this kind; at most one format says so of any file.
    read : callable
        Make the drawing of a file; the second argument names one layer, or is None for all that is visible.
    """

    signs: str
    fits: Callable[[OutlineFile], bool]
    read: Callable[[OutlineFile, str | None], Drawing]


OUTLINE_FORMATS: Registry[OutlineFormat] = Registry(
    "outline format", "markergen.read.outlines", "markergen.outline_formats", OutlineFormat
)
"""Formats by name."""
