"""Read an SVG with all transforms and units, by the outline reader, which shares no code with the writer.

What shows of it is decided by the picture that resvg makes, as browsers do.
"""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

import re
import zlib
from pathlib import Path

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.guard import KINDS, Content, check_size, in_child
from markergen.model.body import Body
from markergen.read.outlines.formats import OUTLINE_FORMATS, OutlineFile
from markergen.read.outlines.svg import is_filled, parse_svg
from markergen.verification.picture import PagePicture
from markergen.verification.reading import READERS, Page, Reading, Settings, circles_of, round_shape
from markergen.verification.svg_styles import plain
from markergen.verification.words import MOST_LISTED

PATIENCE = 10
"""Factor by which path data may exceed that of an outline: sheets contain text converted to outlines."""

PARSER = Path(__file__).with_name("svg_picture.py")

CUT = "cut"
"""Name of the layer of lines to be cut; that of a spot color may follow."""

OFF = 5e-4
"""Maximum distance in mm of the polygons that stand for curves."""

ROUGH = 0.6
"""Minimum ratio of the sides of the box around the control points of an outline that may be round."""

MOST_ROUGH = 10_000
"""Maximum number of such outlines, each of which takes a fraction of a millisecond."""

FINE = 200
"""Ratio of the size of an outline to the distance of points on it from each other's chords, to tell if it is round."""

_MOVING = re.compile(rb"<(?:\w+:)?(?:animate\w*|set|script)\b")
"""Elements by which a browser shows something else than a picture of the file."""
_AT_ENDS = re.compile(rb"\bmarker(?:-start|-mid|-end)?\s*[=:]\s*[\"']?\s*url\b")
"""Shapes at the ends of lines, which browsers draw and the reader does not."""


@READERS.register(".svg", ".svgz")
def read_svg(data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read the circles, corners and lines of an SVG, and what shows of it."""
    check_size(Content(name, data), "SVG")
    if data.startswith(b"\x1f\x8b"):
        data = _unpacked(data, name)
    if _MOVING.search(data):
        raise InputError(f"an SVG that stays as it is in {name}", "animation or a script", "save it without them")
    if _AT_ENDS.search(data):
        raise InputError(f"an SVG without shapes at the ends of its lines in {name}", "marker", "convert them to paths")
    file = plain(OutlineFile(name, data, PATIENCE))
    wanted = f"an SVG that browsers draw in {name}"
    with np.errstate(all="ignore"):
        grey = in_child(PARSER, "render", Content(name, file.data), "SVG", wanted).arrays["picture"]
        drawing = OUTLINE_FORMATS["svg"].read(file, None)
        if drawing.scale is None:
            raise InputError(f"a width and height with units in {name}", "none", "save it with its size in mm")
        scale = 1e3 * drawing.scale
        factor = np.array([scale, -scale])
        circles, corners, lines, cut, rough = [], [], [np.zeros((0, 2, 2))], [], 0
        painted = set[tuple[object, ...]]()
        twice = list[str]()
        for piece in drawing.pieces:
            assert piece.look is not None
            filled = is_filled(piece.look.style)
            if not filled:
                points = np.concatenate([curve.flatten(OFF / scale) for curve in piece.curves]) * factor
                ends = np.concatenate([points[1:], points[:1]])
                pieces = np.stack([points, ends], axis=1)
                lines.append(pieces if piece.closed else pieces[:-1])
                on_cut = any(layer.split(" (")[0] == CUT for layer in piece.look.layers)
                cut += [on_cut] * len(lines[-1])
            points = np.concatenate([curve.sketch() for curve in piece.curves]) * factor
            sides = np.ptp(points, axis=0)
            circle = None
            if sides.min() > ROUGH * sides.max():
                rough += 1
                if rough > MOST_ROUGH:
                    raise InputError(f"at most {MOST_ROUGH} shapes as wide as high in {name}", "more", "verify the PDF")
                fine = float(sides.max()) / FINE / scale
                points = np.concatenate([curve.flatten(fine) for curve in piece.curves]) * factor
                circle = round_shape(points)
            key = (*np.round([*points.min(axis=0), *sides], 3).tolist(), piece.look.style["fill"], len(piece.curves))
            if key in painted and sides.max() > 1:
                x, y = points.min(axis=0) + sides / 2
                twice.append(f"the {brief(piece.name)} around x {x:.4g}, y {-y:.4g} mm of the page is there twice")
            painted.add(key)
            if circle and (filled or not any(cut[-1:])):
                circles.append(circle)
            elif len(points) >= 3:
                corners.append(points)
    root = parse_svg(file)
    size = _size(root.get("width"), root.get("height"))
    box = _shown(root.get("viewBox"), size, scale)
    is_cut = np.array(cut, dtype=np.bool_)
    page = Page(
        circles_of(circles, name), size, _joined(corners), lines=np.concatenate(lines),
        cut=is_cut if is_cut.any() else None,
        picture=PagePicture.of_page(grey, box.tolist(), 0) if np.isfinite(box).all() and grey.size else None,
        hidden=("some shapes are hidden",) if "hidden shapes" in drawing.others else (),
        unread=tuple((label, corners * factor) for label, corners in drawing.unread),
    )  # fmt: skip
    return Reading("SVG", (page,), twice=tuple(twice[:MOST_LISTED]))


def _unpacked(data: bytes, name: str) -> bytes:
    most = KINDS["SVG"].largest
    try:
        text = zlib.decompressobj(31).decompress(data, most + 1)
    except zlib.error as error:
        raise InputError(f"a complete SVG in {name}", brief(str(error)), "save it again") from None
    check_size(Content(name, text), "SVG")
    return text


def _joined(corners: list[Array]) -> Array:
    points = np.concatenate(corners) if corners else np.zeros((0, 2))
    return points[np.isfinite(points).all(axis=-1)]


def _size(width: str | None, height: str | None) -> tuple[float, float] | None:
    from svgelements import Length

    try:
        # At 25.4 px per inch, 1 px is 1 mm.
        sides = tuple(float(Length(text or "").value(ppi=25.4)) for text in (width, height))
    except (ValueError, TypeError, AttributeError):
        return None
    return (sides[0], sides[1]) if np.isfinite(sides).all() else None


def _shown(view_box: str | None, size: tuple[float, float] | None, scale: float) -> Array:
    """Left, bottom, right and top in mm of the visible part, y up."""
    everything = np.array([-np.inf, -np.inf, np.inf, np.inf])
    if size is None:
        return everything
    try:
        x, y, width, height = (float(text) * scale for text in (view_box or "").replace(",", " ").split())
    except ValueError:
        x, y, (width, height) = 0.0, 0.0, size
    # A page of another shape shows more on both sides.
    wide, high = (max(both) - inner for both, inner in zip(zip((width, height), size, strict=True), (width, height),
                                                       strict=True))  # fmt: skip
    return np.array([x - wide / 2, -y - height - high / 2, x + width + wide / 2, -y + high / 2])
