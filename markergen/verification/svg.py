"""Read an SVG with all transforms and units, by the outline reader, which shares no code with the writer.

What shows of it is decided by the picture that resvg makes, as browsers do. Before, its styles are put into the forms
that all programs read alike: resvg draws colors in forms that it does not know in black, such as
``rgb(255 255 255 / 1)``; tinycss2 1.5 takes ``rgb(none, 1, 2)`` and ``hwb(1, 2%, 3%)``, and refuses
``rgb(51 40% 153)``.
"""

# tests: tests/verification/test_svg.py tests/verification/test_check.py tests/verification/test_flat.py

import colorsys
import re
import zlib
from math import pi
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, tostring

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief, reason_of
from markergen.guard import KINDS, Content, check_size, in_child
from markergen.model.body import Body
from markergen.read.outlines.formats import OUTLINE_FORMATS, PIXELS_PER_INCH, OutlineFile
from markergen.read.outlines.svg import SVG, Style, is_filled, parse_svg, pixels_of
from markergen.verification.reading import (
    READERS,
    Page,
    PagePicture,
    Painted,
    Reading,
    Settings,
    circles_of,
    of_painted_again,
    painted_again,
    round_shape,
)

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

FINE, FINEST = 200, 100_000
"""Ratios of the size of an outline to the distance of its points from each other's chords, to tell if it is round."""

CHORDS = 2e-3
"""This distance in mm between these ratios: less than what is tolerated of a circle."""

CSS_PIXEL = 25.4 / PIXELS_PER_INCH
"""Size in mm of a pixel of CSS."""

_MOVING = re.compile(rb"<(?:\w+:)?(?:animate\w*|set|script)\b|<[^<>]*\son[a-z]+\s*=")
"""Elements and attributes by which a browser shows something else than a picture of the file."""
_AT_ENDS = re.compile(rb"\bmarker(?:-start|-mid|-end)?\s*[=:]\s*[\"']?\s*url\b")
"""Shapes at the ends of lines, which browsers draw and the reader does not."""


@READERS.register(".svg", ".svgz")
def read_svg(data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read the circles, corners and lines of an SVG, and what shows of it."""
    check_size(Content(name, data), "SVG")
    if data.startswith(b"\x1f\x8b"):
        try:
            data = zlib.decompressobj(31).decompress(data, KINDS["SVG"].largest + 1)
        except zlib.error as error:
            raise InputError(f"a complete SVG in {name}", reason_of(error), "save it again") from None
        check_size(Content(name, data), "SVG")
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
            width = brief(parse_svg(file).get("width") or "none")
            remedy = "export it again, or set width and height in mm and leave the viewBox: pixels are no length"
            raise InputError(f"a width and height in mm, cm or in of {name}", f"a width of {width}", remedy)
        scale = 1e3 * drawing.scale
        factor = np.array([scale, -scale])
        circles, corners, painted, rough = [], [np.zeros((0, 2))], list[Painted](), 0
        lines: dict[bool, list[Array]] = {True: [], False: [np.zeros((0, 2, 2))]}
        for piece in drawing.pieces:
            assert piece.look is not None
            filled = is_filled(piece.look.style)
            on_cut = any(layer.split(" (")[0] == CUT for layer in piece.look.layers)
            if on_cut or not filled:
                points = np.concatenate([curve.flatten(OFF / scale) for curve in piece.curves]) * factor
                ends = np.concatenate([points[1:], points[:1]])
                pieces = np.stack([points, ends], axis=1)
                lines[on_cut].append(pieces if piece.closed else pieces[:-1])
            points = np.concatenate([curve.sketch() for curve in piece.curves]) * factor
            sides = np.ptp(points, axis=0)
            circle = None
            if sides.min() > ROUGH * sides.max():
                rough += 1
                if rough > MOST_ROUGH:
                    raise InputError(f"at most {MOST_ROUGH} shapes as wide as high in {name}", "more", "verify the PDF")
                fine = max(min(float(sides.max()) / FINE, CHORDS), float(sides.max()) / FINEST) / scale
                points = np.concatenate([curve.flatten(fine) for curve in piece.curves]) * factor
                circle = round_shape(points)
            # Pieces of one shape have the same look.
            painted.append(Painted(points, id(piece.look), _paint_of(piece.look.style, filled), circle))
            if circle and (filled or not on_cut):
                circles.append(circle)
            elif len(points) >= 3:
                corners.append(points[np.isfinite(points).all(axis=1)])
    root = parse_svg(file)
    sides = [pixels_of(root.get(key)) for key in ("width", "height")]
    size = None if sides[0] is None or sides[1] is None else (sides[0] * CSS_PIXEL, sides[1] * CSS_PIXEL)
    box = _drawn(root.get("viewBox"), size, scale)
    page = Page(
        circles_of(circles, name), size, np.concatenate(corners),
        lines=np.concatenate(lines[True] or lines[False]), are_cut=bool(lines[True]),
        picture=PagePicture.of_pixels(grey, box.tolist()) if np.isfinite(box).all() and grey.size else None,
        hidden=("some shapes are hidden",) if "hidden shapes" in drawing.others else (),
        unread=tuple((label, corners * factor) for label, corners in drawing.unread),
    )  # fmt: skip
    return Reading("SVG", (page,), findings=of_painted_again(painted_again(painted), body))


def _paint_of(style: Style, filled: bool) -> str:
    """What a shape is painted with, however its color is written."""
    from PIL import ImageColor

    text = style["fill" if filled else "stroke"]
    is_color = text.startswith("#") or text in ImageColor.colormap
    return str(("fill" if filled else "stroke", ImageColor.getcolor(text, "RGBA") if is_color else text))


def _drawn(view_box: str | None, size: tuple[float, float] | None, scale: float) -> Array:
    """Left, bottom, right and top in mm, y up, of what a picture by resvg shows; nan or infinite if that is unknown."""
    if size is None:
        return np.full(4, np.nan)
    try:
        x, y, width, height = (float(text) * scale for text in (view_box or "").replace(",", " ").split())
    except ValueError:
        x, y, (width, height) = 0.0, 0.0, size
    # A page of another shape shows more on both sides.
    sides = np.maximum((width, height), size)
    left, top = x - (sides[0] - width) / 2, -y + (sides[1] - height) / 2
    # It has a whole number of pixels of CSS.
    across, down = np.round(sides / CSS_PIXEL) * CSS_PIXEL
    return np.array([left, top - down, left + across, top])


# --- Styles -----------------------------------------------------------------------------------------------------------

_PAINT = "fill|stroke|color|stop-color|flood-color|lighting-color|solid-color"
"""Properties that are colors."""

_PAINTED = re.compile(rf"(?<![\w-])({_PAINT})(\s*:\s*)([^;{{}}]*)", re.IGNORECASE)
_WORDS = {
    "none": "none", "inherit": "inherit", "unset": "inherit", "currentcolor": "currentColor",
    "context-fill": "context-fill", "context-stroke": "context-stroke", "transparent": "#00000000",
}  # fmt: skip
_HEX = re.compile(r"#(?:[0-9a-f]{3,4}|[0-9a-f]{6}|[0-9a-f]{8})")
_FUNCTION = re.compile(r"(rgb|hsl|hwb)a?\(\s*([^()]*?)\s*\)")
_COMMAS, _BLANKS = re.compile(r"\s*,\s*"), re.compile(r"\s+")
_VALUE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)(%|deg|rad|grad|turn)?")
_FULL = {"rad": 2 * pi, "grad": 400.0, "turn": 1.0, "deg": 360.0, None: 360.0}
"""Units of angles in a full turn."""

_RULE = re.compile(r"@(?!charset|namespace|font-face)|\b(?:var|calc|env|attr)\(")
_EVERYWHERE = re.compile(r"@media\s+(?:all|screen\s*,\s*print|print\s*,\s*screen)\s*\{((?:[^{}]*\{[^{}]*\})*[^{}]*)\}")
_ROOT = re.compile(r"(?:\*|:root|svg)\s*\{[^{}]*\}")
_CUSTOM = re.compile(r"(?:^|(?<=[;{\s]))(--[\w-]+)\s*:\s*([^;{}]*)(?:;|(?=\})|$)")
_VARIABLE = re.compile(r"\bvar\(\s*(--[\w-]+)\s*(?:,\s*((?:[^()]|\([^()]*\))*))?\)")
_ALIKE = (
    "fill stroke opacity display visibility font text letter word line color stop clip mask filter flood lighting "
    "marker overflow paint-order shape image enable-background background solid direction "
    "writing-mode baseline dominant-baseline alignment unicode white-space vector-effect inline-size pointer-events "
    "cursor block-progression -inkscape -moz -webkit src tab-size unset"
)
"""Beginnings of the properties that change no place and no size, or that the reader has."""

_UNSET = {"mix-blend-mode": ("normal", "inherit"), "isolation": ("auto", "inherit", "isolate")}
"""Values that change nothing of properties that programs for print and laser ignore, and browsers do not."""


def plain(file: OutlineFile) -> OutlineFile:
    """Rewrite a file with its colors as ``#rrggbbaa``, its variables by their values, and without rules for all media.

    Raises InputError if it has styles that programs draw differently.
    """
    root = parse_svg(file)
    elements = list(root.iter())
    sheets = [element for element in elements if element.tag == "style"]
    texts = [_EVERYWHERE.sub(r"\1", re.sub(r"/\*.*?\*/", "", sheet.text or "", flags=re.DOTALL)) for sheet in sheets]
    variables = _variables(root, texts)
    for sheet, text in zip(sheets, texts, strict=True):
        sheet.text = _written(text, variables, file.name)
        for block in re.findall(r"\{([^{}]*)\}", sheet.text):
            _check_properties(block, file.name)
    for element in elements:
        for key in _PAINT.split("|"):
            if key in element.attrib:
                element.set(key, _paint(key, _VARIABLE.sub(variables.value, element.attrib[key]), file.name))
        if "style" in element.attrib:
            element.set("style", _written(element.attrib["style"], variables, file.name))
            _check_properties(element.attrib["style"], file.name)
    for element in elements:
        element.tag = _qualified(str(element.tag), SVG)
        element.attrib = {_qualified(key): value for key, value in element.attrib.items()}
    return OutlineFile(file.name, tostring(root), file.patience)


def _qualified(name: str, namespace: str = "") -> str:
    """Name with its namespace in braces."""
    space, _, local = name.rpartition(" ")
    space = space or namespace
    return f"{{{space}}}{local}" if space else local


def _refuse(name: str, problem: str) -> NoReturn:
    raise InputError(f"styles that all programs draw alike in {name}", brief(problem), "save it as a plain SVG")


class _Variables(dict[str, str]):
    def value(self, match: re.Match[str]) -> str:
        """Value of a variable, or what stands for it where it has none; the text as it is without either."""
        return self.get(match[1], match[2] or match[0])


def _variables(root: Element, texts: list[str]) -> _Variables:
    """Variables with one value in the whole file."""
    of_root = [*(rule for text in texts for rule in _ROOT.findall(text)), root.get("style", "")]
    declared = [{match.groups() for text in styles for match in _CUSTOM.finditer(text)} for styles in (of_root, texts)]
    inner = {match.groups() for element in root.iter() for match in _CUSTOM.finditer(element.get("style", ""))}
    every = declared[0] | declared[1] | inner
    names = [key for key, _ in every]
    return _Variables({key: value.strip() for key, value in declared[0] if names.count(key) == 1})


def _written(text: str, variables: _Variables, name: str) -> str:
    """A style or a style sheet in plain forms."""
    text = _VARIABLE.sub(variables.value, _CUSTOM.sub(lambda match: "" if match[1] in variables else match[0], text))
    if match := _RULE.search(text):
        _refuse(name, match[0])
    return _PAINTED.sub(lambda match: f"{match[1]}{match[2]}{_paint(match[1].lower(), match[3], name)}", text)


def _check_properties(declarations: str, name: str) -> None:
    """Refuse properties by which a browser shows something else than a picture of the file."""
    for part in declarations.lower().split(";"):
        key, colon, value = (text.strip() for text in part.partition(":"))
        alike = key.startswith(tuple(_ALIKE.split())) or key == "transform" or value in _UNSET.get(key, ())
        if colon and not alike:
            _refuse(name, key)


def _paint(key: str, text: str, name: str) -> str:
    """A value of a property that is a color."""
    value, important, _ = text.strip().lower().partition("!important")
    link = re.match(r"url\([^()]*\)", text.strip(), re.IGNORECASE)
    rest = value[len(link[0]) :] if link else value
    color = _color(rest.strip()) if rest.strip() or not link else ""
    if color is None:
        _refuse(name, f"{key}: {text.strip()}")
    if key in ("fill", "stroke") and re.fullmatch(r"#(?:...0|.{6}00)", color):
        color = "none"
    return " ".join(filter(None, (link and link[0], color, important)))


def _color(text: str) -> str | None:
    """A color as CSS has it in lower case, as resvg reads it; None if it is in no form of sRGB."""
    from PIL import ImageColor

    if text in _WORDS or _HEX.fullmatch(text):
        return _WORDS.get(text, text)
    if text in ImageColor.colormap:
        red, green, blue = ImageColor.getrgb(text)[:3]
        return f"#{red:02x}{green:02x}{blue:02x}"
    match = _FUNCTION.fullmatch(text)
    if not match:
        return None
    kind, body = match[1], match[2]
    if "," in body:
        parts = _COMMAS.split(body)
    else:
        colors, slash, alpha = body.partition("/")
        parts = [*_BLANKS.split(colors.strip(), 2), *([alpha.strip()] if slash else [])]
    values = [_VALUE.fullmatch("0" if part == "none" and "," not in body else part) for part in parts]
    if len(values) not in (3, 4) or None in values or (kind == "hwb" and "," in body):
        return None
    numbers = [(float(value[1]), value[2]) for value in values if value]
    is_turned = kind != "rgb"
    units = [unit for _, unit in numbers[is_turned:3]]
    # With commas, all are shares or none, and those of hsl() all are.
    if any(unit not in (None, "%") for _, unit in numbers[is_turned:]) or (is_turned and numbers[0][1] == "%"):
        return None
    if "," in body and (len(set(units)) > 1 or (is_turned and units[0] is None)):
        return None
    shares = [number / (100 if unit or is_turned else 255) for number, unit in numbers[is_turned:3]]
    if is_turned:
        angle = numbers[0][0] / _FULL[numbers[0][1]] % 1
        shares = list(_of_angle(kind, angle, *(min(max(share, 0.0), 1.0) for share in shares)))
    opacity = numbers[3][0] / (100 if numbers[3][1] else 1) if len(numbers) == 4 else 1.0
    levels = [round(255 * min(max(share, 0.0), 1.0)) for share in (*shares, opacity)]
    return "#" + "".join(f"{level:02x}" for level in (levels if levels[3] < 255 else levels[:3]))


def _of_angle(kind: str, angle: float, first: float, second: float) -> tuple[float, float, float]:
    """Red, green and blue of hue, saturation and lightness, or of hue, white and black."""
    if kind == "hsl":
        return colorsys.hls_to_rgb(angle, second, first)
    white, black = (share / max(first + second, 1.0) for share in (first, second))
    red, green, blue = (share * (1 - white - black) + white for share in colorsys.hls_to_rgb(angle, 0.5, 1.0))
    return red, green, blue
