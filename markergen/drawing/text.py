"""Text as filled outlines: sheets use no live fonts, so text looks and measures the same everywhere.

The face is Bitstream Vera Sans, which reportlab ships and whose license allows this use.
"""

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from markergen.drawing.scene import BLACK, FilledPath, Segment
from markergen.errors import MissingLibraryError

FACES = {"regular": "Vera.ttf", "bold": "VeraBd.ttf"}
SHIFT = {"left": 0.0, "center": 0.5, "right": 1.0}


@dataclass(frozen=True)
class _Glyph:
    width: float
    segments: tuple[Segment, ...]


def text(
    string: str,
    x: float,
    y: float,
    height: float,
    align: str = "left",
    face: str = "regular",
    color: str = BLACK,
    name: str = "",
) -> FilledPath:
    """Outline of one line of Latin-1 text; other characters are replaced by ``?``.

    Parameters
    ----------
    x, y : float
        Start, middle or end of the baseline, as given by `align`; mm.
    height : float
        Cap height, mm.
    align : {"left", "center", "right"}
    face : {"regular", "bold"}
    """
    glyphs, cap = _glyphs(string, face)
    scale = height / cap
    pen = x - SHIFT[align] * text_width(string, height, face)
    segments: list[Segment] = []
    for glyph in glyphs:
        segments += [
            (command, tuple([(pen + scale * px, y + scale * py) for px, py in points]))
            for command, points in glyph.segments
        ]
        pen += scale * glyph.width
    return FilledPath(tuple(segments), name, color)


def text_width(string: str, height: float, face: str = "regular") -> float:
    """Advance width in mm of a line of text with the given cap height in mm."""
    glyphs, cap = _glyphs(string, face)
    return height / cap * sum(glyph.width for glyph in glyphs)


def font_size(height: float, face: str = "regular") -> float:
    """Font size in mm for a cap height in mm."""
    _, cap, em = _face(face)
    return height * em / cap


def written(string: str, face: str = "regular") -> str:
    """Text as drawn by `text`: characters missing in the face are replaced by ``?``."""
    table, _, _ = _face(face)
    return "".join(character if character in table else "?" for character in string)


def wrap(string: str, width: float, height: float) -> list[str]:
    """Lines of words at most `width` mm wide; a single wider word gets a line of its own."""
    lines = [""]
    for word in string.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and text_width(longer, height) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _glyphs(string: str, face: str) -> tuple[list[_Glyph], float]:
    table, cap, _ = _face(face)
    return [table.get(character, table["?"]) for character in string], cap


@cache
def _face(face: str) -> tuple[dict[str, _Glyph], float, float]:
    """Glyphs of Latin-1 by character, the cap height, and the font size, in font units."""
    from fontTools.ttLib import TTFont

    with TTFont(_font_file(FACES[face]), lazy=True) as font:
        shapes, names, em = font.getGlyphSet(), font.getBestCmap(), float(font["head"].unitsPerEm)
        table = {
            chr(code): _Glyph(shapes[names[code]].width, _segments(shapes[names[code]], shapes))
            for code in range(0x20, 0x100)
            if code in names
        }
    # An H has flat ends; the font's own capHeight is optional.
    return table, max(y for _, points in table["H"].segments for _, y in points), em


def _segments(glyph: Any, shapes: Any) -> tuple[Segment, ...]:
    """Path of a glyph, with composite glyphs decomposed and chains of quadratic curves split into single curves."""
    from fontTools.pens.basePen import decomposeQuadraticSegment
    from fontTools.pens.recordingPen import DecomposingRecordingPen

    pen = DecomposingRecordingPen(shapes)
    glyph.draw(pen)
    segments: list[Segment] = []
    for command, points in pen.value:
        if command == "qCurveTo":
            segments += [("Q", curve) for curve in decomposeQuadraticSegment(points)]
        else:
            segments.append(({"moveTo": "M", "lineTo": "L", "curveTo": "C", "closePath": "Z"}[command], points))
    return tuple(segments)


def _font_file(name: str) -> Path:
    # Found, not imported: reportlab is slow to load and only the PDF writer needs it.
    spec = find_spec("reportlab")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        path = Path(folder) / "fonts" / name
        if path.is_file():
            return path
    raise MissingLibraryError(
        f"sheets take their typeface from the library reportlab, found no reportlab/fonts/{name}; "
        "install it with: pip install --force-reinstall reportlab"
    )
