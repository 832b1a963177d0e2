"""Outline formats, the file that their readers take, and the drawing that they return."""

# tests: tests/read/outlines/test_files.py

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.geometry.contour import Contour
from markergen.read.formats import Format
from markergen.read.outlines.curves import Curve
from markergen.read.remarks import MOST_LISTED
from markergen.registry import Registry
from markergen.units import METERS

PIXELS_PER_INCH = 96.0
"""As browsers, Inkscape and Figma have."""

UNITS = {unit: float(size) for unit, size in METERS.items() if unit}
UNITS |= {"px": 0.0254 / PIXELS_PER_INCH, "pt": 0.0254 / 72}
"""Units that a drawing may be in, in m; Inkscape, Figma and browsers have 96 px per inch."""

MOST_PIECES = 10_000
"""Maximum number of lines, curves and steps to find them in one file, as of corners of a boundary."""

_WHOLE = "export the outline alone, simplified"


@dataclass(frozen=True)
class OutlinePiece:
    """Consecutive curves, each starting at the end of the previous one.

    Attributes
    ----------
    name : str
        Name that the user recognizes: kind, and id or layer.
    closed : bool
        True if the last end is joined to the first start, by a line if they are apart.
    look : Paint or None
        How it is painted, in formats that say it.
    """

    name: str
    curves: tuple[Curve, ...]
    closed: bool
    look: "Paint | None" = None


@dataclass(frozen=True)
class Paint:
    """How the pieces of one shape are painted.

    Attributes
    ----------
    style : mapping
        Values of properties such as ``fill``.
    layers : tuple of str
        Names of the groups around it, outermost first.
    """

    style: Mapping[str, str]
    layers: tuple[str, ...]


@dataclass(frozen=True)
class Drawing:
    """All outlines of a file.

    Attributes
    ----------
    scale : float or None
        m per unit of the coordinates; None if the file does not state it.
    others : list of str
        Kinds of contents that are not outlines (text, images), which are reported as not used.
    unread : list of (name, corners (4, 2))
        Visible contents that are not outlines, and boxes that hold them; nan if their extent is unknown.
    pixels : float
        px per unit of the coordinates, for a file in px.
    hint : str
        Advice on choosing a unit, for the message that there is none.
    pixels_per_inch : float
        px per inch of the program that wrote the file.
    """

    pieces: list[OutlinePiece]
    scale: float | None
    y_down: bool = False
    others: list[str] = field(default_factory=list)
    unread: list[tuple[str, NDArray[np.float64]]] = field(default_factory=list)
    pixels: float = 1.0
    hint: str = ""
    pixels_per_inch: float = PIXELS_PER_INCH


@dataclass(frozen=True)
class OutlineFile:
    """A file's name and bytes; limits on its contents are multiplied by `patience`."""

    name: str
    data: bytes
    patience: int = 1

    @property
    def text(self) -> str:
        """Entire text; raises InputError if the file is not text."""
        try:
            text = self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = self.data.decode("cp1252", "replace")
        if "\0" in text:
            raise InputError(f"text in {self.name}", "null characters", "check the path")
        return text

    def damaged(self, syntax: str, problem: str) -> InputError:
        """Return the error that the file is incomplete."""
        return InputError(f"{syntax} in {self.name}", problem, "the file is cut off or damaged: write it again")

    def unreadable(self, expected: str, problem: str, remedy: str) -> InputError:
        """Return an error about a detail of the file."""
        return InputError(f"{expected} in {self.name}", problem, remedy)

    def too_much(self, what: str) -> InputError:
        """Return the error that reading would take too long; `what` is a limit such as ``at most 5 layers``."""
        return self.unreadable(what, "more", _WHOLE)

    def unknown_layer(self, layer: str, layers: list[str]) -> InputError:
        """Return the error that a layer does not exist, listing those that do."""
        names = [brief(name) for name in layers[:MOST_LISTED]]
        more = f" and {len(layers) - MOST_LISTED} more" if len(layers) > MOST_LISTED else ""
        remedy = f"known layers: {', '.join(names)}{more}" if layers else "leave out --layer: the file has no layers"
        return self.unreadable("a known layer", brief(layer), remedy)


class OutlineFormat(Format[OutlineFile, Drawing, Sequence[Contour]]):
    """A drawing format, which is read as a drawing of one layer or of all visible ones, and written from contours in m.

    Written in mm with its unit; GeoJSON, which has none, in m and without arcs, which raises InputError.
    """


OUTLINE_FORMATS: Registry[OutlineFormat] = Registry(
    "outline format", "markergen.read.outlines", "markergen.outline_formats", OutlineFormat
)
"""Formats by name."""
