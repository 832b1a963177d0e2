"""Read all visible closed shapes of an SVG: through groups, uses and nested svg elements, with styles and transforms.

svgelements was tried for the whole file, and does not serve: without a word it draws what a clip cuts off or
`visibility` hides, reads a path, a polygon or a transform with an error as far as it goes, takes a missing size for
pixels, and accepts entities, negative radii, references to other files and selectors that it does not know. All of this
is refused in one line or left out here. For path data alone its checks and those of what it makes are as long as a
parser, it takes ten times as long, and its arcs are off by 1e-7 of their size; it is what the tests compare with.
"""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from math import asin, pi, remainder, sqrt
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from markergen.arrays import Array
from markergen.errors import brief, reason_of
from markergen.geometry.contour import Contour, box, mirrored, placed, radius_of
from markergen.geometry.region import Region
from markergen.read.outlines.curves import MOST_POINTS, Arc, Bezier, Curve, Polyline
from markergen.read.outlines.formats import (
    MOST_PIECES,
    OUTLINE_FORMATS,
    PIXELS_PER_INCH,
    Drawing,
    OutlineFile,
    OutlineFormat,
    OutlinePiece,
    Paint,
)

Viewport = tuple[float, float]

MOST_ELEMENTS, DEEPEST = 100_000, 100
"""Maximum number of elements, counted as often as they are used, and maximum depth of groups and uses."""
LONGEST_CLASS = 1000
"""Maximum length of an element's class names in characters; Illustrator writes about ten."""
SVG = "http://www.w3.org/2000/svg"
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
XLINK = "http://www.w3.org/1999/xlink"
_W3C = "-//W3C//DTD SVG "

SHAPES = ("path", "rect", "circle", "ellipse", "line", "polygon", "polyline")
GROUPS = ("g", "a", "switch")
MOST_CLIPS = 16
"""Maximum number of shapes in a clip path, which are intersected with each shape that it clips."""
OTHERS = {"text": "text", "image": "images", "foreignObject": "foreign objects"}

_SHAPED = re.compile(
    r"'(?:dx|dy|rotate|textLength)'|shape-inside|inline-size|text-(?:indent|shadow)|'transform-|font:"
    r"|(?:letter|word)-spacing\W+(?!0|normal)|baseline-shift\W+(?!0|baseline)|writing-mode\W+(?!lr|horizontal)"
)
"""What moves or widens letters."""
_OLD_INKSCAPE = re.compile(r"0\.(?:[0-8]\d|91|9\b)")
_OUTSIDE = re.compile(r"@import[^;]{0,100}|url\(\s*+(?:'\s*+|\"\s*+)?+(?!#|data:)[^)]{0,100}")
_FONTS = re.compile(r"@font-face\s*+\{[^}]*+\}")
_URL = re.compile(r"url\(\s*['\"]?#([^'\")]*)['\"]?\s*\)")

Style = Mapping[str, str]
Sheet = dict[str, dict[str, str]]
"""Declarations of a style sheet by selector."""

LARGEST_SHEET = 300_000
"""Maximum length of all style sheets in characters; editors write a rule or a few per style."""

INITIAL: Style = {
    "visibility": "visible", "fill": "black", "stroke": "none", "fill-opacity": "1", "stroke-opacity": "1",
    "stroke-width": "1", "fill-rule": "nonzero", "font-size": "", "font": "",
}  # fmt: skip
"""Inherited properties and their initial values."""

_OWN: Style = {"display": "inline", "opacity": "1", "clip-path": "none", "mask": "none"}
PROPERTIES = (*INITIAL, *_OWN)
"""Properties that are evaluated."""

_DECLARATION = re.compile(r"(?:^|;)\s*+([\w-]++)\s*+:([^;]*+)")
_MOVES = re.compile(r"(?:^|[;{])\s*+transform\s*+:(?!\s*+none)")
_SELECTOR = re.compile(r"\*|[\w-]*(?:[.#][\w-]+)?")
_CLEAR = ("none", "transparent")
_ZERO = re.compile(r"(?:0+\.?0*|\.0+)(?:%|[a-z]+)?")

KNOWN = re.compile(
    r"[xyrd]|[xyr][12xy]|c[xy]|points|width|height|viewBox|transform|preserveAspectRatio|href|id|class|style|name|title|"
    r"opacity|display|visibility|overflow|version|baseProfile|lang|space|type|units|filter|cursor|direction|isolation|zoom\w*|"
    r"(fill|stroke|clip|mask|marker|font|text|color|letter|word|paint|vector|pointer|shape|image|mix|stop|background|"
    r"enable|flood|lighting|unicode|alignment|baseline|dominant|data|aria|content|require|system|on|tab|role|focus|path|"
    r"xml|writing|glyph|kerning|solid|white|line|inkscape|sodipodi)[\w:-]*"
)
"""Attributes of shapes and groups: those that are evaluated, and those of paint, text and metadata."""
PLAIN = re.compile(
    r"defs|title|desc|metadata|style|clipPath|mask|\w*Gradient|marker|filter|fe[A-Z]\w*|symbol|pattern|script|stop|view|cursor|"
    r"color-profile|font[\w-]*|glyph|animate\w*|set|solidcolor|hatch|mesh\w*|path-effect|switch|a"
)
"""Elements without a shape of their own."""

LARGEST_PATH = 300_000
"""Maximum length of all path data in characters, ample for the maximum number of corners of an outline."""

PX = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6, "pt": 96 / 72, "pc": 16.0}
SCREEN = ("", "px")
"""CSS units in user units (px), and those without a physical size."""

# Atomic groups prevent backtracking, which would take forever on a long text.
_NUMBER = r"(?>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_LENGTH = re.compile(rf"\s*+({_NUMBER})\s*+([a-zA-Z]*+|%)\s*+")
_NO_NUMBERS = re.compile(r"[^\s,]")
_COMMAND = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])([^MmLlHhVvCcSsQqTtAaZz]*+)")
_ROW = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
"""Numbers after each command of path data, which may repeat them."""
_GAP = r"[\s,]*+"
# The flags of an arc need nothing between them.
_ARC = re.compile(_GAP.join([_GAP, *[f"({_NUMBER})"] * 3, "([01])", "([01])", *[f"({_NUMBER})"] * 2]))
_TRANSFORMS = re.compile(r"[\s,]*+(?:(?:matrix|translate|scale|rotate|skewX|skewY)\s*+\([^()]*+\)[\s,]*+)*+")
_TRANSFORM = re.compile(r"(\w+)\s*\(([^)]*)\)")


# --- One element ------------------------------------------------------------------------------------------------------


@dataclass
class Shapes:
    """Converts the shapes of one file to pieces, and limits their number."""

    file: OutlineFile
    path_data: int = 0
    segments: int = 0

    def pieces(self, element: Element, name: str, viewport: tuple[float, float]) -> list[OutlinePiece]:
        """Pieces of a basic shape in its own coordinates; percentages refer to `viewport`."""
        kind = str(element.tag)
        if kind == "path":
            return self._path(element.get("d", ""), name)
        if kind in ("polygon", "polyline"):
            points = self.numbers(element.get("points", ""), f"points of {name}")
            if len(points) % 2:
                raise self.file.unreadable("pairs of numbers", f"an odd number in points of {name}", "correct it")
            line = Polyline(np.array(points).reshape(-1, 2))
            return [OutlinePiece(name, (line,), kind == "polygon")] if points else []

        def length(key: str, default: float = 0.0) -> float:
            return self.length(element.get(key), f"{key} of {name}", viewport, key, default)

        if kind == "line":
            ends = np.array([[length(f"x{i}"), length(f"y{i}")] for i in (1, 2)])
            return [OutlinePiece(name, (Polyline(ends),), False)]
        rx, ry = (length("r") if kind == "circle" else length(key, -1.0) for key in ("rx", "ry"))
        if kind == "circle" and rx < 0:
            raise self.file.unreadable("a radius above 0", f"{rx:g} for {name}", "correct it, or remove it")
        # One that is missing is as the other.
        rx, ry = rx if rx >= 0 else ry, ry if ry >= 0 else rx
        if kind == "rect":
            x, y, width, height = (length(key) for key in ("x", "y", "width", "height"))
            sides = _rectangle(x, y, width, height, rx, ry)
            return [OutlinePiece(name, sides, True)] if width > 0 and height > 0 else []
        arc = Arc(np.array([length("cx"), length("cy")]), np.array([rx, 0.0]), np.array([0.0, ry]))
        return [OutlinePiece(name, (arc,), True)] if rx > 0 and ry > 0 else []

    def length(
        self, text: str | None, name: str, viewport: tuple[float, float], key: str, default: float = 0.0
    ) -> float:
        """Length in user units; percentages refer to the viewport's width, height or, for other keys, diagonal."""
        if text is None or text.strip() in ("", "auto"):
            return default
        value, unit = _measure(text) or (0.0, text)
        if unit == "%":
            width, height = viewport
            whole = width if "x" in key or key == "width" else height
            return value / 100 * (whole if key != "r" else float(np.hypot(width, height)) / 2**0.5)
        if unit not in PX:
            raise self.file.unreadable("a length", f"{brief(text)} as {name}", f"known units: {', '.join(PX)[2:]}")
        return value * PX[unit]

    def numbers(self, text: str, name: str) -> list[float]:
        """Numbers separated by blanks or commas."""
        self._count(text)
        odd = _NO_NUMBERS.search(re.sub(_NUMBER, "", text))
        if odd:
            raise self.file.unreadable("numbers", f"{odd[0]!r} in {name}", "correct the file")
        return [float(number) for number in re.findall(_NUMBER, text)]

    def matrix(self, element: Element, name: str) -> Array:
        """Affine map (3, 3) from the transform attribute."""
        text = element.get("transform", "")
        if _MOVES.search(element.get("style", "")) or "transform-origin" in element.attrib:
            problem = f"one in the style of {name}"
            raise self.file.unreadable("transforms as attributes", problem, "save it as plain SVG")
        self._count(text)
        if not _TRANSFORMS.fullmatch(text):
            raise self.file.unreadable("a transform", f"{brief(text)} at {name}", "correct the file")
        matrix = np.eye(3)
        for kind, values in _TRANSFORM.findall(text):
            numbers = self.numbers(values, f"transform of {name}")
            if len(numbers) not in _COUNTS[kind]:
                raise self.file.unreadable("a transform", f"{kind} of {len(numbers)} numbers at {name}", "correct it")
            matrix = matrix @ _MATRICES[kind](*numbers)
        return matrix

    def _count(self, data: str) -> None:
        self.path_data += len(data)
        most = LARGEST_PATH * self.file.patience
        if self.path_data > most:
            raise self.file.too_much(f"at most {most // 1000} kB of path data and other numbers")

    def _path(self, data: str, name: str) -> list[OutlinePiece]:
        """Pieces of path data, one per subpath."""
        self._count(data)
        if not data.strip() or data.strip() == "none":
            return []
        odd = _NO_NUMBERS.search(re.sub(_NUMBER, "", _COMMAND.sub(r" \2", data)))
        if odd or data.lstrip()[0] not in "Mm":
            problem = repr(odd[0]) if odd else "no move to start from"
            raise self.file.unreadable("path data", f"{problem} in {name}", "correct the path")
        try:
            pieces = [OutlinePiece(name, tuple(curves), closed) for curves, closed in _subpaths(data) if curves]
        except ValueError as error:
            raise self.file.unreadable("path data", f"{error} in {name}", "correct the path") from None
        curves = [curve for piece in pieces for curve in piece.curves]
        self.segments += sum(len(curve.points) - 1 if isinstance(curve, Polyline) else 1 for curve in curves)
        if self.segments > (most := MOST_PIECES * self.file.patience):
            raise self.file.too_much(f"at most {most} lines and curves")
        return pieces


def _subpaths(data: str) -> Iterator[tuple[list[Curve], bool]]:
    """Yield the curves of each subpath, and whether it is closed; ValueError where numbers are missing."""
    curves: list[Curve] = []
    start = here = control = np.zeros(2)
    before = ""
    for letter, text in _COMMAND.findall(data):
        command, is_relative = letter.upper(), letter.islower()
        rows = _rows(command, text)
        if command in "MZ":
            yield curves, command == "Z"
            curves = []
        if command == "Z":
            here = start
        elif command in "MLHV":
            if command in "HV":  # The other coordinate stays.
                other = np.full(len(rows), 0.0 if is_relative else here[int(command == "H")])
                rows = np.column_stack([rows[:, 0], other] if command == "H" else [other, rows[:, 0]])
            points = np.cumsum([here, *rows], axis=0) if is_relative else np.vstack([here, rows])
            if command == "M":
                start, points = points[1], points[1:]
            curves += [Polyline(points)] if len(points) > 1 else []
            here = points[-1]
        elif command == "A":
            for *radii, angle, is_large, is_positive, x, y in rows.tolist():
                end = np.array([x, y]) + (here if is_relative else 0.0)
                curves.append(_arc(here, end, np.abs(radii), angle, is_large != is_positive, bool(is_positive)))
                here = end
        else:
            for row in rows.reshape(len(rows), -1, 2):
                points = row + here if is_relative else row
                if command in "ST":  # The first control point is the last one, mirrored.
                    is_smooth = before in {"S": "CS", "T": "QT"}[command]
                    points = np.vstack([2 * here - control if is_smooth else here, points])
                curves.append(Bezier(np.vstack([here, points])))
                control, here, before = points[-2], points[-1], command
        before = command
    yield curves, False


def _rows(command: str, text: str) -> Array:
    """Numbers (k, n) after a command, a row for each time that it is repeated."""
    width = _ROW[command]
    if command == "A":
        numbers: list[str] = []
        position = 0
        while match := _ARC.match(text, position):  # One after the other: a search would try every digit.
            numbers += match.groups()
            position = match.end()
        complete = not text[position:].strip(" ,\t\r\n\f")
    else:
        numbers = re.findall(_NUMBER, text)
        complete = not width or len(numbers) % width == 0
    if not complete or bool(numbers) != bool(width):
        raise ValueError(f"{command} of {len(numbers)} numbers")
    return np.array(numbers, dtype=float).reshape(-1, width or 1)


def _arc(start: Array, end: Array, radii: Array, angle: float, is_left: bool, is_positive: bool) -> Curve:
    """Arc of an ellipse between points, whose center is to the left of the chord or to its right."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    axes = np.array([[c, -s], [s, c]]) * radii
    if not radii.all() or (start == end).all():
        return Polyline(np.stack([start, end]))
    # In coordinates along the semi-axes, where the ellipse is the unit circle.
    a, b = np.linalg.solve(axes, np.stack([start, end]).T).T
    half = (b - a) / 2
    reach = float(np.hypot(*half))
    if reach > 1:  # It is enlarged until it reaches both.
        a, b, half, axes, reach = a / reach, b / reach, half / reach, axes * reach, 1.0
    across = np.array([-half[1], half[0]]) * (sqrt(1 - reach**2) / max(reach, np.finfo(float).tiny))
    center = (a + b) / 2 + (across if is_left else -across)
    first, last = (float(np.arctan2(*(point - center)[::-1])) for point in (a, b))
    sweep = 2 * asin(reach) if is_left == is_positive else 2 * pi - 2 * asin(reach)
    sweep = sweep if is_positive else -sweep
    return Arc(axes @ center, axes[:, 0], axes[:, 1], first, sweep + remainder(last - first - sweep, 2 * pi))


def _rectangle(x: float, y: float, width: float, height: float, rx: float, ry: float) -> tuple[Curve, ...]:
    """Outline of a rectangle, with quarter ellipses as corners if both radii are above 0."""
    corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
    if rx <= 0 or ry <= 0:
        return (Polyline(corners),)
    u, v = np.array([min(rx, width / 2), 0.0]), np.array([0.0, min(ry, height / 2)])
    centers = corners + [u + v, v - u, -u - v, u - v]
    arcs = [Arc(center, u, v, np.pi + i * np.pi / 2, np.pi / 2) for i, center in enumerate(centers)]
    return tuple(arcs)


def _affine(a: float, b: float, c: float, d: float, e: float, f: float) -> Array:
    return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])


def _rotate(degrees: float, x: float = 0.0, y: float = 0.0) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return _affine(c, s, -s, c, x - c * x + s * y, y - s * x - c * y)


_COUNTS = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}
_MATRICES: dict[str, Callable[..., Array]] = {
    "matrix": _affine,
    "translate": lambda x, y=0.0: _affine(1.0, 0.0, 0.0, 1.0, x, y),
    "scale": lambda x, y=None: _affine(x, 0.0, 0.0, x if y is None else y, 0.0, 0.0),
    "rotate": _rotate,
    "skewX": lambda a: _affine(1.0, 0.0, np.tan(np.radians(a)), 1.0, 0.0, 0.0),
    "skewY": lambda a: _affine(1.0, np.tan(np.radians(a)), 0.0, 1.0, 0.0, 0.0),
}


def sheet_of(root: Element, file: OutlineFile) -> Sheet:
    """Collect the rules of all style sheets in a tree for selectors such as ``.st0``, ``#id`` and ``path``.

    The later of two rules for one selector wins.

    Raises InputError if a sheet uses another kind of selector for an evaluated property, or moves shapes; no editor
    writes these.
    """
    rules: Sheet = {}
    if sum(len(style.text or "") for style in root.iter("style")) > LARGEST_SHEET:
        raise file.too_much(f"at most {LARGEST_SHEET // 1000} kB of style sheets")
    for style in root.iter("style"):
        # What follows /* counts again behind the next */.
        first, *rest = (style.text or "").split("/*")
        text = first + " ".join(part.partition("*/")[2] for part in rest)
        if _MOVES.search(text):
            raise file.unreadable("transforms as attributes", "some in a style sheet", "save it as plain SVG")
        for block in text.split("}"):
            selectors, _, body = block.partition("{")
            values = _declarations(body)
            for selector in selectors.split(",") if values else []:
                if not _SELECTOR.fullmatch(selector.strip()):
                    expected = "style sheets for .class, #id or a kind of shape"
                    raise file.unreadable(expected, brief(selector.strip()), "save it as plain SVG")
                rules.setdefault(selector.strip(), {}).update(values)
    return rules


def style_of(element: Element, inherited: Style, sheet: Sheet) -> Style:
    """Style of an element inside a parent with the style `inherited`."""
    declared = {name: element.attrib[name].strip() for name in PROPERTIES if name in element.attrib}
    tag, classes, name = str(element.tag), element.get("class", "").split(), element.get("id", "")
    for selector in ("*", tag, *(f".{c}" for c in classes), *(f"{tag}.{c}" for c in classes), f"#{name}"):
        declared |= sheet.get(selector, {})
    declared |= _declarations(element.get("style", ""))
    passed = {key: inherited[key] for key in INITIAL}
    return {**_OWN, **passed, **{key: value for key, value in declared.items() if value != "inherit"}}


def is_filled(style: Style) -> bool:
    """Tell whether the inside of a shape is painted."""
    return style["fill"] not in _CLEAR and not _zero(style["fill-opacity"])


def is_painted(style: Style) -> bool:
    """Tell whether a shape is painted, regardless of the groups around it."""
    stroked = style["stroke"] not in _CLEAR and not _zero(style["stroke-opacity"]) and not _zero(style["stroke-width"])
    return style["visibility"] == "visible" and (is_filled(style) or stroked)


def gone(style: Style) -> bool:
    """Tell whether an element is omitted together with its contents."""
    return style["display"] == "none" or _zero(style["opacity"])


def _declarations(text: str) -> dict[str, str]:
    """Values of the evaluated properties in text such as ``fill:none;stroke:#000``."""
    pairs = (match.groups() for match in _DECLARATION.finditer(text))
    return {name: value.replace("!important", "").strip() for name, value in pairs if name in PROPERTIES}


def _zero(value: str) -> bool:
    return _ZERO.fullmatch(value) is not None


# --- The file ---------------------------------------------------------------------------------------------------------


def parse_svg(file: OutlineFile) -> Element:
    """Parse the tree; names are ``namespace name``, without a namespace for SVG itself.

    Raises InputError if it is not XML, declares entities or its own document type, or has too many or too deeply nested
    elements.
    """
    builder = TreeBuilder()
    # A blank, which is valid in neither namespaces nor names, joins the two.
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    depth = count = 0

    def refuse(*_: object) -> NoReturn:
        expected = "plain SVG without a document type of its own"
        raise file.unreadable(expected, "entity declarations or another document type", "save it again as plain SVG")

    def doctype(_: str, system: str | None, public: str | None, internal: int) -> None:
        # The W3C's own document type adds nothing and is never fetched; Illustrator and matplotlib write it.
        if internal or not (public or "").startswith(_W3C) or not (system or "").startswith("http://www.w3.org/"):
            refuse()

    def instruct(target: str, _: str) -> None:
        if target == "xml-stylesheet":
            raise file.unreadable("no references to other files", "a style sheet", "embed it, or remove it")

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > DEEPEST:
            raise file.too_much(f"at most {DEEPEST} levels of groups")
        if count > MOST_ELEMENTS:
            raise file.too_much(f"at most {MOST_ELEMENTS} elements")
        if len(attributes.get("class", "")) > LONGEST_CLASS:
            raise file.too_much(f"at most {LONGEST_CLASS} characters of class names")
        builder.start(name.removeprefix(f"{SVG} "), attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    parser.StartDoctypeDeclHandler = doctype
    parser.EntityDeclHandler = refuse
    parser.ExternalEntityRefHandler = refuse
    parser.SkippedEntityHandler = refuse
    parser.ProcessingInstructionHandler = instruct
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(file.data, True)
    except expat.ExpatError as error:
        raise file.damaged("complete XML", f"line {error.lineno}: {expat.ErrorString(error.code)}") from None
    except (ValueError, LookupError) as error:  # An encoding that Python does not know.
        raise file.damaged("XML", reason_of(error)) from None
    root = builder.close()
    if root.tag != "svg":
        raise file.unreadable("an svg element", brief(root.tag), "check the path")
    return root


def _read(file: OutlineFile, layer: str | None) -> Drawing:
    """Drawing in the root's user units."""
    root = parse_svg(file)
    _refuse_references(root, file)
    scale, pixels, stretch, viewport = _frame(root, file)
    if root.get("transform", "").strip():
        raise file.unreadable("transforms inside the drawing", "one on the svg element itself", "put it on a group")
    sheet = sheet_of(root, file)
    by_id = {element.get("id", ""): element for element in reversed(list(root.iter()))}
    reader = _SvgReader(file, sheet, by_id, _layer_elements(root, layer, file), others=odd_attributes(root))
    style = style_of(root, INITIAL, sheet)
    if not gone(style) or layer is not None:
        reader.children(root, _Place(stretch, style, viewport, reader.layers is None, 0))
    is_illustrator = b"Adobe Illustrator" in file.data[:2000]
    width = _LENGTH.fullmatch(root.get("width", ""))
    hint = ""
    if width and width[2] in SCREEN:
        hint = f"; a width of {width[0].strip()} is no length: px takes {PIXELS_PER_INCH:g} for an inch"
    if is_illustrator:
        hint = "; Adobe Illustrator, which wrote it, means pt by px"
    return Drawing(
        reader.pieces,
        scale,
        True,
        reader.others,
        reader.unread,
        pixels,
        hint,
        72.0 if is_illustrator else PIXELS_PER_INCH,
    )


@dataclass(frozen=True)
class _Place:
    """Inherited state of an element: map to the root's units, style, viewport, whether its layer is wanted, depth, and
    the names of the groups around it.
    """

    matrix: Array
    style: Style
    viewport: Viewport
    wanted: bool
    depth: int
    layers: tuple[str, ...] = ()


@dataclass
class _SvgReader:
    file: OutlineFile
    sheet: Sheet
    by_id: dict[str, Element]
    layers: set[int] | None
    """Identities of the elements of the wanted layer; None for all."""
    pieces: list[OutlinePiece] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    unread: list[tuple[str, Array]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._shapes = Shapes(self.file)
        self._numbers = count(1)
        self._clipped = self._clipped_points = 0

    def children(self, element: Element, place: _Place) -> None:
        """Read the contents of an element."""
        for child in element:
            self._element(child, place)

    def _element(self, element: Element, place: _Place) -> None:
        kind = str(element.tag)
        if kind in OTHERS:
            self.others.append(OTHERS[kind])
            self._unread(element, place, kind)
        if kind not in (*SHAPES, *GROUPS, "svg", "use"):
            if kind not in OTHERS and " " not in kind and not PLAIN.fullmatch(kind):
                self.others.append(f"the element {kind}")
            return
        self.others += odd_attributes(element)
        number = next(self._numbers)
        most = MOST_PIECES * min(self.file.patience, 4)
        if number > most:
            raise self.file.too_much(f"at most {most} elements")
        if place.depth > DEEPEST:
            raise self.file.too_much(f"at most {DEEPEST} levels of groups and uses")
        style = style_of(element, place.style, self.sheet)
        chosen = self.layers is not None and id(element) in self.layers
        if (gone(style) or element.get("requiredExtensions")) and place.wanted and not chosen:
            self.others.append("hidden shapes")
            return
        name = f"{kind} {brief(element.get('id'))}" if element.get("id") else f"{kind} number {number}"
        matrix = place.matrix @ self._shapes.matrix(element, name)
        layers = (*place.layers, *_names(element)[:1]) if kind == "g" else place.layers
        here = _Place(matrix, style, place.viewport, place.wanted or chosen, place.depth + 1, layers)
        before = len(self.pieces)
        if kind == "switch":
            self._switch(element, here)
        elif kind in GROUPS:
            self.children(element, here)
        elif kind == "svg":
            self._framed(element, element, here, name)
        elif kind == "use":
            self._use(element, here, name)
        elif here.wanted and is_painted(style):
            look = Paint(style, layers)
            for piece in self._shapes.pieces(element, name, place.viewport):
                curves = tuple(curve.mapped(matrix[:2]) for curve in piece.curves)
                self.pieces.append(OutlinePiece(name, curves, piece.closed, look))
        elif here.wanted and element.get("class") != "BoundingBox":  # LibreOffice has one around each shape.
            self.others.append("shapes without fill and stroke")
        self._refuse_cuts(style, self.pieces[before:], here, name)

    def _switch(self, element: Element, place: _Place) -> None:
        """Read the first child that is drawn everywhere; what is before it and no shape is noted."""
        for child in element:
            is_shape = child.tag in (*SHAPES, *GROUPS, "svg", "use")
            if not is_shape or child.attrib.keys().isdisjoint(("requiredExtensions", "systemLanguage")):
                self._element(child, place)
                if is_shape:
                    break
        if len(element) > 1:
            self.others.append("other branches of a switch")

    def _unread(self, element: Element, place: _Place, kind: str) -> None:
        """Note where visible text, an image or a foreign object is."""
        style = style_of(element, place.style, self.sheet)
        content = " ".join("".join(element.itertext()).split())
        is_visible = place.wanted and style["visibility"] == "visible" and not gone(style)
        if not is_visible or (kind == "text" and not content):
            return
        label = content if kind == "text" else element.get("id")
        name = f"the {OTHERS[kind].removesuffix('s')} {brief(label) if label else 'without a name'}"
        matrix = place.matrix @ self._shapes.matrix(element, name)
        x, y, right, bottom = self._text_box(element, style) if kind == "text" else self._box(element, place, name)
        corners = np.array([[x, y], [right, y], [right, bottom], [x, bottom]])
        self.unread.append((name, corners @ matrix[:2, :2].T + matrix[:2, 2]))

    def _box(self, element: Element, place: _Place, name: str) -> tuple[float, ...]:
        """Left, top, right and bottom of an image or a foreign object; nan if its contents give its size."""
        if "overflow" in str(element.attrib) or not {"width", "height"} <= element.attrib.keys():
            return (np.nan,) * 4
        x, y, width, height = self._lengths(element, place, name)
        return x, y, x + width, y + height

    def _text_box(self, element: Element, style: Style) -> tuple[float, ...]:
        """Left, top, right and bottom of a box that holds the lines of a text; nan if more than sizes shapes them."""
        lines = list(element.iter())
        styles = [style_of(line, style, self.sheet) for line in lines[1:]]
        sizes = [pixels_of(line_style["font-size"]) for line_style in (style, *styles)]
        if any(
            line.tag not in ("text", "tspan", "title", "desc") or _SHAPED.search(f"{line.attrib}") or line_style["font"]
            for line, line_style in zip(lines, (style, *styles), strict=True)
        ) or not all(sizes):
            return (np.nan,) * 4
        size = max(filter(None, sizes))
        measures = [_measure(line.get(key)) or (np.nan, "") for line in lines for key in ("x", "y")]
        at = np.array([value * PX.get(unit, np.nan) for value, unit in measures]).reshape(-1, 2)
        at = at[np.isfinite(at).all(axis=1)] if len(lines) > 1 else np.nan_to_num(at)
        if not len(at):
            return (np.nan,) * 4
        # No letter is wider than 1.5 of its size, nor higher, from whichever line it is measured.
        strokes = [line_style["stroke-width"] for line_style in (style, *styles) if line_style["stroke"] != "none"]
        size += max((pixels_of(width, SCREEN) or np.nan for width in strokes), default=0.0)
        wide = 1.5 * size * max(len("".join(line.itertext())) for line in lines)
        (left, top), (right, bottom) = at.min(axis=0), at.max(axis=0)
        return left - wide, top - 1.5 * size, right + wide, bottom + 1.5 * size

    def _use(self, element: Element, place: _Place, name: str) -> None:
        target = self.by_id.get(_reference(element).removeprefix("#"))
        if target is None:
            raise self.file.unreadable("a shape that is used", f"none for {name}", "save it as plain SVG")
        if target.tag in ("symbol", "svg"):
            self._framed(target, element, place, name)
        else:
            self._element(target, _moved(place, *self._lengths(element, place, name)[:2]))

    def _framed(self, element: Element, outer: Element, place: _Place, name: str) -> None:
        """Read the contents of a symbol or a nested svg; `outer` has the position and size."""
        x, y, width, height = self._lengths(outer, place, name)
        if outer is not element:  # A use translates its target; the svg gives the sizes that the use does not.
            place = _moved(place, x, y)
            inner = self._lengths(element, place, name)
            x, y = inner[:2] if element.tag == "svg" else (0.0, 0.0)
            width = width if "width" in outer.attrib else inner[2]
            height = height if "height" in outer.attrib else inner[3]
        place = _moved(place, x, y)
        viewport = (width, height)
        box = _view_box(element, self._shapes, name)
        if box is not None and width > 0 and height > 0:
            fit = _fit(box, viewport, element.get("preserveAspectRatio", ""))
            place = replace(place, matrix=place.matrix @ fit, viewport=box[2:])
        else:
            place = replace(place, viewport=viewport)
        if width > 0 and height > 0:
            self.children(element, place)

    def _lengths(self, element: Element, place: _Place, name: str) -> tuple[float, float, float, float]:
        whole = (0.0, 0.0, *place.viewport)
        x, y, width, height = (
            self._shapes.length(element.get(key), f"{key} of {name}", place.viewport, key, default)
            for key, default in zip(("x", "y", "width", "height"), whole, strict=True)
        )
        return x, y, width, height

    def _refuse_cuts(self, style: Style, pieces: list[OutlinePiece], place: _Place, name: str) -> None:
        """Refuse outlines whose visible shape differs because a mask or a clip cuts them."""
        cuts = style["clip-path"] != "none" or style["mask"] != "none"
        if cuts and pieces and not (style["mask"] == "none" and self._holds(style["clip-path"], pieces, place)):
            remedy = "cut the shape itself, or release it"
            raise self.file.unreadable("outlines drawn as they are", f"{name} cut by a clip or mask", remedy)

    def _holds(self, url: str, pieces: list[OutlinePiece], place: _Place) -> bool:
        """Tell whether a clip leaves pieces uncut; many editors clip everything to the page."""
        match = _URL.fullmatch(url)
        clip = self.by_id.get(match[1]) if match else None
        if clip is None or clip.tag != "clipPath" or clip.get("clipPathUnits") == "objectBoundingBox":
            return False
        points = np.concatenate([curve.sketch() for piece in pieces for curve in piece.curves])
        size = float(np.hypot(*np.ptp(points, axis=0)))
        if not (np.isfinite(size) and size > 0):
            return False
        tolerance = 1e-5 * size
        drawn = np.concatenate([self._clippable(curve, tolerance) for piece in pieces for curve in piece.curves])
        inside = np.zeros(len(drawn), dtype=bool)
        for shape in self._clip(clip, place, tolerance):
            # With a tolerance, since a clip to the page may coincide with the outline.
            inside |= shape.within(drawn, 2 * tolerance)
        return bool(inside.all())

    def _clippable(self, curve: Curve, tolerance: float) -> Array:
        """Sample points (m, 2) along a curve, limited in number since clips may be nested without end."""
        points = curve.flatten(tolerance)
        self._clipped += 1
        self._clipped_points += len(points)
        if self._clipped > 2 * MOST_PIECES or self._clipped_points > 2 * MOST_POINTS:
            raise self.file.too_much(f"at most {2 * MOST_PIECES} curves in clips")
        return points

    def _clip(self, clip: Element, place: _Place, tolerance: float) -> list[Region]:
        """Regions of a clip's shapes; empty if there are too many."""
        reader = _SvgReader(self.file, {}, {}, None)
        reader._numbers, reader._shapes = self._numbers, self._shapes
        matrix = place.matrix @ self._shapes.matrix(clip, "a clip")
        reader.children(clip, _Place(matrix, INITIAL, place.viewport, True, place.depth))
        if len(reader.pieces) > MOST_CLIPS:
            return []
        rings = [np.concatenate([curve.flatten(tolerance) for curve in piece.curves]) for piece in reader.pieces]
        return [Region.polygon(ring) for ring in rings if len(ring) >= 3 and np.isfinite(ring).all()]


def _frame(root: Element, file: OutlineFile) -> tuple[float | None, float, Array, Viewport]:
    """Scale in m per user unit or None, px per user unit, map (3, 3) that undoes a stretch, size for percentages.

    A width or height in px has no physical size: only the user knows the size of these pixels.
    """
    shapes = Shapes(file)
    box = _view_box(root, shapes, "svg")
    sides = [root.get(key) for key in ("width", "height")]
    # In px does not count as physical, since programs disagree about it.
    physical = [pixels_of(side, PX.keys() - SCREEN) for side in sides]
    width, height = (size and size * 0.0254 / PX["in"] for size in physical)
    identity = np.eye(3)
    if box is None:
        wide, high = (shapes.length(side or "100%", key, (0, 0), key) for side, key in zip(sides, "xy", strict=True))
        # Without a viewBox, user units are CSS pixels, but 90 per inch in Inkscape before 0.92.
        old = _OLD_INKSCAPE.match(root.get(f"{INKSCAPE} version", ""))
        is_physical = (width is not None or height is not None) and not old
        return (0.0254 / PX["in"] if is_physical else None), 1.0, identity, (wide, high)
    in_pixels = width is None and height is None
    if in_pixels:
        width, height = (pixels_of(side, SCREEN) for side in sides)
    scales = [size / side for size, side in zip((width, height), box[2:], strict=True) if size is not None]
    aspect = root.get("preserveAspectRatio", "")
    stretch = identity
    if len(scales) == 2 and "none" in aspect:
        stretch = np.diag([1.0, scales[1] / scales[0], 1.0])
        scales = scales[:1]
    choose: Callable[[list[float]], float] = max if "slice" in aspect else min
    scale = choose(scales) if scales else None
    return (None, scale or 1.0, stretch, box[2:]) if in_pixels else (scale, 1.0, stretch, box[2:])


def _measure(text: str | None) -> tuple[float, str] | None:
    """Number and unit, in lower case, of a length."""
    match = _LENGTH.fullmatch(text or "")
    return (float(match[1]), match[2].lower()) if match else None


def pixels_of(text: str | None, units: Collection[str] = PX) -> float | None:
    """Length in px, if it is above 0 and in one of the units."""
    value, unit = _measure(text) or (0.0, "")
    return value * PX[unit] if unit in units and 0 < value < np.inf else None


def _view_box(element: Element, shapes: Shapes, name: str) -> tuple[float, float, float, float] | None:
    text = element.get("viewBox")
    if text is None:
        return None
    numbers = shapes.numbers(text, f"viewBox of {name}")
    if len(numbers) != 4 or not (numbers[2] > 0 and numbers[3] > 0 and np.isfinite(numbers).all()):
        raise shapes.file.unreadable("a viewBox of x y width height", brief(text), "correct the file")
    return numbers[0], numbers[1], numbers[2], numbers[3]


def _fit(box: tuple[float, float, float, float], viewport: Viewport, aspect: str) -> Array:
    """Map (3, 3) from a viewBox to a viewport according to preserveAspectRatio."""
    scale = np.array(viewport) / box[2:]
    if "none" not in aspect:
        scale[:] = scale.max() if "slice" in aspect else scale.min()
    shares = [0.0 if f"{axis}Min" in aspect else 1.0 if f"{axis}Max" in aspect else 0.5 for axis in "xY"]
    offset = shares * (np.array(viewport) - scale * box[2:]) - scale * box[:2]
    return _affine(scale[0], 0.0, 0.0, scale[1], *offset)


def _moved(place: _Place, x: float, y: float) -> _Place:
    return replace(place, matrix=place.matrix @ _affine(1.0, 0.0, 0.0, 1.0, x, y))


def _reference(element: Element) -> str:
    return element.get("href", element.get(f"{XLINK} href", "")).strip()


def _refuse_references(root: Element, file: OutlineFile) -> None:
    """Refuse references to other files, except hyperlinks."""
    for element in root.iter():
        link = _reference(element)
        outside = [link] if link and not link.startswith(("#", "data:")) and element.tag != "a" else []
        for text in (element.text or "" if element.tag == "style" else "", *element.attrib.values()):
            if "url" in text or "@import" in text:
                outside += _OUTSIDE.findall(_FONTS.sub("", text))
        if outside:
            problem = f"{brief(outside[0])} in {brief(element.tag)}"
            raise file.unreadable("no references to other files", problem, "embed it, or remove it")


def _layer_elements(root: Element, layer: str | None, file: OutlineFile) -> set[int] | None:
    """Identities of the groups with that layer name, None without a name.

    A layer is an Inkscape layer, or any named group in the files of other editors.
    """
    if layer is None:
        return None
    groups = list(root.iter("g"))
    chosen = [group for group in groups if layer in _names(group)]
    if not chosen:
        labeled = [group for group in groups if group.get(f"{INKSCAPE} groupmode") == "layer"]
        names_of_layers = [names[0] for group in labeled or groups if (names := _names(group))]
        raise file.unknown_layer(layer, list(dict.fromkeys(names_of_layers)))
    return {id(group) for group in chosen}


def odd_attributes(element: Element) -> list[str]:
    """Attributes without a namespace that are not known."""
    odd = [key for key in element.attrib if " " not in key and ":" not in key and not KNOWN.fullmatch(key)]
    odd += ["r"] if "r" in element.attrib and element.tag != "circle" else []
    return [f"the attribute {key}" for key in odd]


def _names(group: Element) -> list[str]:
    keys = (f"{INKSCAPE} label", "data-name", "id")
    return [group.attrib[key] for key in keys if group.get(key)]


def _write(contours: Sequence[Contour], _: str) -> str:
    # Mirrored, since y is down.
    drawn = [placed(mirrored(contour), 1000.0, (0.0, 0.0), 9) for contour in contours]
    boxes = np.array([box(contour) for contour in drawn])
    (left, top), (right, low) = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
    size = f"{right - left!r} {low - top!r}"
    width, height = (f"{side}mm" for side in size.split())
    paths = "".join(f'<path d="{_data(contour)}"/>\n' for contour in drawn)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="{left!r} {top!r} {size}">\n'
        f'<g fill="none" stroke="#000000" stroke-width="0.1">\n{paths}</g>\n</svg>\n'
    )


def _data(contour: Contour) -> str:
    (x, y), commands = contour.points[0], []
    for side in contour.sides:
        (u, v), bulge = side[1], side[2]
        arc = f"A{radius_of(side)!r} {radius_of(side)!r} 0 0 {int(bulge > 0)} {u!r} {v!r}"
        commands.append(arc if bulge else f"L{u!r} {v!r}")
    return f"M{x!r} {y!r}{''.join(commands)}Z"


OUTLINE_FORMATS.register("svg")(
    OutlineFormat(
        "XML with an svg element",
        lambda file: (
            file.data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<" or file.data[:2] in (b"\xff\xfe", b"\xfe\xff")
        ),
        _read,
        (".svg",),
        _write,
    )
)
