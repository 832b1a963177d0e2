"""Read all visible closed shapes of an SVG, through groups, uses and nested svg elements."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import count
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from markergen.errors import brief
from markergen.geometry.region import Region
from markergen.read.outlines.curves import MOST_POINTS, Curve
from markergen.read.outlines.formats import (
    MOST_PIECES,
    OUTLINE_FORMATS,
    Drawing,
    Look,
    OutlineFile,
    OutlineFormat,
    Piece,
)
from markergen.read.outlines.svg_shapes import (
    INITIAL,
    PX,
    Shapes,
    Sheet,
    Style,
    fraction,
    gone,
    seen,
    sheet_of,
    style_of,
)

Array = NDArray[np.float64]
Viewport = tuple[float, float]

MOST_ELEMENTS, DEEPEST = 100_000, 100
LONGEST_CLASS = 1000
"""Maximum length of an element's class names in characters; Illustrator writes about ten."""
SVG = "http://www.w3.org/2000/svg"
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
XLINK = "http://www.w3.org/1999/xlink"
_W3C = "-//W3C//DTD SVG "

SHAPES = ("path", "rect", "circle", "ellipse", "line", "polygon", "polyline")
GROUPS = ("g", "a", "switch")
MOST_CLIPS = 16
UNREAD = {"text": "text", "image": "image", "foreignObject": "foreign object"}
OTHERS = {"text": "text", "image": "images", "foreignObject": "foreign objects"}

_PHYSICAL = re.compile(r"\s*([-+.\deE]+?)\s*(mm|cm|in|pt|pc|q)\s*", re.IGNORECASE)
_PIXELS = re.compile(r"\s*+((?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?)\s*+(?:px)?\s*+", re.IGNORECASE)
_SIZE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+))(|px|mm|cm|in|pt|pc)", re.IGNORECASE)
_SHAPED = re.compile(
    r"'(?:dx|dy|rotate|textLength)'|shape-inside|inline-size|text-(?:indent|shadow)|'transform-|font:"
    r"|(?:letter|word)-spacing\W+(?!0|normal)|baseline-shift\W+(?!0|baseline)|writing-mode\W+(?!lr|horizontal)"
)
"""What moves or widens letters."""
_OLD_INKSCAPE = re.compile(r"0\.(?:[0-8]\d|91|9\b)")
_OUTSIDE = re.compile(r"@import[^;]{0,100}|url\(\s*+(?:'\s*+|\"\s*+)?+(?!#|data:)[^)]{0,100}")
_FONTS = re.compile(r"@font-face\s*+\{[^}]*+\}")
_URL = re.compile(r"url\(\s*['\"]?#([^'\")]*)['\"]?\s*\)")


def parse(file: OutlineFile) -> Element:
    """Parse the tree; names are ``namespace name``, without a namespace for SVG itself.

    Raises
    ------
    InputError
        If it is not XML, declares entities or its own document type, or has too many or too deeply nested elements.
    """
    builder = TreeBuilder()
    # A blank, which is valid in neither namespaces nor names, joins the two.
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    depth = count = 0

    def refuse(*_: object) -> NoReturn:
        raise file.unreadable(
            "plain SVG without a document type of its own", "entity declarations or another document type",
            "save it again as plain SVG",
        )  # fmt: skip

    def doctype(_: str, system: str | None, public: str | None, internal: int) -> None:
        # The W3C's own document type adds nothing and is never fetched; Illustrator and matplotlib write it.
        if internal or not (public or "").startswith(_W3C) or not (system or "").startswith("http://www.w3.org/"):
            refuse()

    def instruct(target: str, _: str) -> None:
        if target == "xml-stylesheet":
            raise file.external("a style sheet")

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
        raise file.damaged("XML", brief(str(error))) from None
    root = builder.close()
    if root.tag != "svg":
        raise file.unreadable("an svg element", brief(root.tag), "check the path")
    return root


def _read(file: OutlineFile, layer: str | None) -> Drawing:
    """Drawing in the root's user units."""
    root = parse(file)
    _refuse_references(root, file)
    scale, pixels, stretch, viewport = _frame(root, file)
    if root.get("transform", "").strip():
        raise file.unreadable("transforms inside the drawing", "one on the svg element itself", "put it on a group")
    sheet = sheet_of(root, file)
    reader = _SvgReader(file, sheet, _by_id(root), _layer_elements(root, layer, file))
    style = style_of(root, INITIAL, sheet)
    if not gone(style) or layer is not None:
        reader.children(root, _Place(stretch, style, viewport, reader.layers is None, 0))
    return Drawing(reader.pieces, scale, True, reader.others, reader.unread, pixels)


@dataclass(frozen=True)
class _Place:
    """Inherited state of an element: map to the root's units, style, viewport, whether its layer is wanted, depth,
    opacity, and the names of the groups around it.
    """

    matrix: Array
    style: Style
    viewport: Viewport
    wanted: bool
    depth: int
    opacity: float = 1.0
    layers: tuple[str, ...] = ()


@dataclass
class _SvgReader:
    file: OutlineFile
    sheet: Sheet
    by_id: dict[str, Element]
    layers: set[int] | None
    """Identities of the elements of the wanted layer; None for all."""
    pieces: list[Piece] = field(default_factory=list)
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
            return
        number = next(self._numbers)
        most = MOST_PIECES * min(self.file.patience, 4)
        if number > most:
            raise self.file.too_much(f"at most {most} elements")
        if place.depth > DEEPEST:
            raise self.file.too_much(f"at most {DEEPEST} levels of groups and uses")
        style = style_of(element, place.style, self.sheet)
        chosen = self.layers is not None and id(element) in self.layers
        if gone(style) and place.wanted and not chosen:
            self.others.append("hidden shapes")
            return
        name = f"{kind} {brief(element.get('id'))}" if element.get("id") else f"{kind} number {number}"
        matrix = _times(place.matrix, self._shapes.matrix(element, name))
        opacity = place.opacity * fraction(style["opacity"])
        layers = (*place.layers, *_names(element)[:1]) if kind == "g" else place.layers
        here = _Place(matrix, style, place.viewport, place.wanted or chosen, place.depth + 1, opacity, layers)
        before = len(self.pieces)
        if kind in GROUPS:
            self.children(element, here)
        elif kind == "svg":
            self._framed(element, element, here, name)
        elif kind == "use":
            self._use(element, here, name)
        elif here.wanted and seen(style):
            self._shape(element, here, name)
        self._refuse_cuts(style, self.pieces[before:], here, name)

    def _shape(self, element: Element, place: _Place, name: str) -> None:
        scale = float(np.sqrt(abs(np.linalg.det(place.matrix[:, :2]))))
        look = Look(len(self.pieces), place.style, place.opacity, place.layers, scale)
        for piece in self._shapes.pieces(element, name, place.viewport):
            curves = tuple(curve.mapped(place.matrix) for curve in piece.curves)
            self.pieces.append(Piece(name, curves, piece.closed, look))

    def _unread(self, element: Element, place: _Place, kind: str) -> None:
        """Note where visible text, an image or a foreign object is."""
        style = style_of(element, place.style, self.sheet)
        words = " ".join("".join(element.itertext()).split())
        shown = place.wanted and style["visibility"] == "visible" and not gone(style)
        if not shown or (kind == "text" and not words):
            return
        label = words if kind == "text" else element.get("id")
        name = f"the {UNREAD[kind]} {brief(label)}" if label else f"the {UNREAD[kind]} without a name"
        matrix = _times(place.matrix, self._shapes.matrix(element, name))
        x, y, right, bottom = self._text_box(element, style) if kind == "text" else self._box(element, place, name)
        corners = np.array([[x, y], [right, y], [right, bottom], [x, bottom]])
        self.unread.append((name, corners @ matrix[:, :2].T + matrix[:, 2]))

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
        sizes = [_SIZE.fullmatch(each["font-size"]) for each in (style, *styles)]
        if any(
            line.tag not in ("text", "tspan", "title", "desc") or _SHAPED.search(f"{line.attrib}") or each["font"]
            for line, each in zip(lines, (style, *styles), strict=True)
        ) or not all(sizes):
            return (np.nan,) * 4
        size = max(float(each[1]) * PX[each[2].lower()] for each in sizes if each)
        anchors = [float(line.get(key, "nan")) if _SIZE.fullmatch(line.get(key, "0")) else np.nan
                   for line in lines for key in ("x", "y")]  # fmt: skip
        at = np.array(anchors).reshape(-1, 2)
        at = at[np.isfinite(at).all(axis=1)] if len(lines) > 1 else np.nan_to_num(at)
        if not len(at):
            return (np.nan,) * 4
        # No letter is wider than 1.5 of its size, nor higher, from whichever line it is measured.
        strokes = [each["stroke-width"] for each in (style, *styles) if each["stroke"] != "none"]
        size += max((_pixels(width) or np.nan for width in strokes), default=0.0)
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
            self._element(target, _moved(place, self._lengths(element, place, name)[:2]))

    def _framed(self, element: Element, outer: Element, place: _Place, name: str) -> None:
        """Read the contents of a symbol or a nested svg; `outer` has the position and size."""
        x, y, width, height = self._lengths(outer, place, name)
        if outer is not element:  # A use translates its target; the svg gives the sizes that the use does not.
            place = _moved(place, (x, y))
            inner = self._lengths(element, place, name)
            x, y = inner[:2] if element.tag == "svg" else (0.0, 0.0)
            width = width if "width" in outer.attrib else inner[2]
            height = height if "height" in outer.attrib else inner[3]
        place = _moved(place, (x, y))
        viewport = (width, height)
        box = _view_box(element, self._shapes, name)
        if box is not None and width > 0 and height > 0:
            fit = _fit(box, viewport, element.get("preserveAspectRatio", ""))
            place = replace(place, matrix=_times(place.matrix, fit), viewport=box[2:])
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

    def _refuse_cuts(self, style: Style, pieces: list[Piece], place: _Place, name: str) -> None:
        """Refuse outlines whose visible shape differs because a mask or a clip cuts them."""
        cuts = style["clip-path"] != "none" or style["mask"] != "none"
        if cuts and pieces and not (style["mask"] == "none" and self._holds(style["clip-path"], pieces, place)):
            raise self.file.unreadable(
                "outlines drawn as they are", f"{name} cut by a clip or mask", "cut the shape itself, or release it"
            )

    def _holds(self, url: str, pieces: list[Piece], place: _Place) -> bool:
        """Tell whether a clip leaves pieces uncut; many editors clip everything to the page."""
        match = _URL.fullmatch(url)
        clip = self.by_id.get(match[1]) if match else None
        if clip is None or clip.tag != "clipPath" or clip.get("clipPathUnits") == "objectBoundingBox":
            return False
        points = np.concatenate([curve.sketch() for piece in pieces for curve in piece.curves])
        size = float(np.hypot(*np.ptp(points, axis=0)))
        if not (np.isfinite(size) and size > 0):
            return False
        near = 1e-5 * size
        drawn = np.concatenate([self._clippable(curve, near) for piece in pieces for curve in piece.curves])
        inside = np.zeros(len(drawn), dtype=bool)
        for shape in self._clip(clip, place, near):
            # With a tolerance, since a clip to the page may coincide with the outline.
            inside |= shape.within(drawn, 2 * near)
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
        matrix = _times(place.matrix, self._shapes.matrix(clip, "a clip"))
        reader.children(clip, _Place(matrix, INITIAL, place.viewport, True, place.depth))
        if len(reader.pieces) > MOST_CLIPS:
            return []
        rings = [np.concatenate([curve.flatten(tolerance) for curve in piece.curves]) for piece in reader.pieces]
        return [Region.polygon(ring) for ring in rings if len(ring) >= 3 and np.isfinite(ring).all()]


def _frame(root: Element, file: OutlineFile) -> tuple[float | None, float, Array, Viewport]:
    """Scale in m per user unit or None, px per user unit, map (2, 3) that undoes a stretch, size for percentages.

    A width or height in px has no physical size: only the user knows the size of these pixels.
    """
    shapes = Shapes(file)
    box = _view_box(root, shapes, "svg")
    width, height = (_physical(root.get(key)) for key in ("width", "height"))
    identity = np.eye(3)[:2]
    if box is None:
        sizes = [root.get(key, "100%") for key in ("width", "height")]
        viewport = (shapes.length(sizes[0], "width", (0, 0), "x"), shapes.length(sizes[1], "height", (0, 0), "y"))
        # Without a viewBox, user units are CSS pixels, but 90 per inch in Inkscape before 0.92.
        old = _OLD_INKSCAPE.match(root.get(f"{INKSCAPE} version", ""))
        known = (width is not None or height is not None) and not old
        return (0.0254 / PX["in"] if known else None), 1.0, identity, viewport
    in_pixels = width is None and height is None
    if in_pixels:
        width, height = (_pixels(root.get(key)) for key in ("width", "height"))
    scales = [size / side for size, side in zip((width, height), box[2:], strict=True) if size is not None]
    aspect = root.get("preserveAspectRatio", "")
    stretch = identity
    if len(scales) == 2 and "none" in aspect:
        stretch = np.array([[1.0, 0.0, 0.0], [0.0, scales[1] / scales[0], 0.0]])
        scales = scales[:1]
    choose: Callable[[list[float]], float] = max if "slice" in aspect else min
    scale = choose(scales) if scales else None
    return (None, scale or 1.0, stretch, box[2:]) if in_pixels else (scale, 1.0, stretch, box[2:])


def _physical(text: str | None) -> float | None:
    """Length in m, if it has a physical unit; px does not count, since programs disagree about it."""
    match = _PHYSICAL.fullmatch(text or "")
    try:
        value = float(match[1]) * PX[match[2].lower()] * 0.0254 / 96 if match else 0.0
    except ValueError:
        return None
    return value if 0 < value < np.inf else None


def _pixels(text: str | None) -> float | None:
    """Length in px, if given in px or without a unit."""
    match = _PIXELS.fullmatch(text or "")
    value = float(match[1]) if match else 0.0
    return value if 0 < value < np.inf else None


def _view_box(element: Element, shapes: Shapes, name: str) -> tuple[float, float, float, float] | None:
    text = element.get("viewBox")
    if text is None:
        return None
    numbers = shapes.numbers(text, f"viewBox of {name}")
    if len(numbers) != 4 or not (numbers[2] > 0 and numbers[3] > 0 and np.isfinite(numbers).all()):
        raise shapes.file.unreadable("a viewBox of x y width height", brief(text), "correct the file")
    return numbers[0], numbers[1], numbers[2], numbers[3]


def _fit(box: tuple[float, float, float, float], viewport: Viewport, aspect: str) -> Array:
    """Map (2, 3) from a viewBox to a viewport according to preserveAspectRatio."""
    scale = np.array(viewport) / box[2:]
    if "none" not in aspect:
        scale[:] = scale.max() if "slice" in aspect else scale.min()
    shares = [0.0 if f"{axis}Min" in aspect else 1.0 if f"{axis}Max" in aspect else 0.5 for axis in "xY"]
    offset = shares * (np.array(viewport) - scale * box[2:]) - scale * box[:2]
    return np.column_stack([np.diag(scale), offset])


def _moved(place: _Place, offset: tuple[float, ...]) -> _Place:
    matrix = _times(place.matrix, np.array([[1.0, 0.0, offset[0]], [0.0, 1.0, offset[1]]]))
    return replace(place, matrix=matrix)


def _times(a: Array, b: Array) -> Array:
    return np.column_stack([a[:, :2] @ b[:, :2], a[:, :2] @ b[:, 2] + a[:, 2]])


def _reference(element: Element) -> str:
    return element.get("href", element.get(f"{XLINK} href", "")).strip()


def _refuse_references(root: Element, file: OutlineFile) -> None:
    """Refuse references to other files, except hyperlinks."""
    for element in root.iter():
        link = _reference(element)
        if link and not link.startswith(("#", "data:")) and element.tag != "a":
            raise file.external(f"{brief(link)} in {brief(element.tag)}")
        for text in (element.text or "" if element.tag == "style" else "", *element.attrib.values()):
            found = _OUTSIDE.search(_FONTS.sub("", text)) if "url" in text or "@import" in text else None
            if found:
                raise file.external(f"{brief(found[0])} in {brief(element.tag)}")


def _by_id(root: Element) -> dict[str, Element]:
    return {element.get("id", ""): element for element in reversed(list(root.iter()))}


def _layer_elements(root: Element, layer: str | None, file: OutlineFile) -> set[int] | None:
    """Identities of the groups with that layer name, None without a name.

    A layer is an Inkscape layer, or any named group in the files of other editors.
    """
    if layer is None:
        return None
    groups = list(root.iter("g"))
    found = [group for group in groups if layer in _names(group)]
    if not found:
        labeled = [group for group in groups if group.get(f"{INKSCAPE} groupmode") == "layer"]
        known = [names[0] for group in labeled or groups if (names := _names(group))]
        raise file.unknown_layer(layer, list(dict.fromkeys(known)))
    return {id(group) for group in found}


def _names(group: Element) -> list[str]:
    keys = (f"{INKSCAPE} label", "data-name", "id")
    return [group.attrib[key] for key in keys if group.get(key)]


OUTLINE_FORMATS.register("svg")(
    OutlineFormat(
        "XML with an svg element",
        lambda file: (
            file.data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<" or file.data[:2] in (b"\xff\xfe", b"\xfe\xff")
        ),
        _read,
    )
)
