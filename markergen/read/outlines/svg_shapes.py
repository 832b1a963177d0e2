"""Evaluate one SVG element: visibility, numbers, lengths, transforms, and the curves of its shape."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi, remainder, sqrt
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from markergen.errors import brief
from markergen.read.outlines.curves import Arc, Bezier, Curve, Polyline
from markergen.read.outlines.formats import MOST_PIECES, OutlineFile, Piece

Array = NDArray[np.float64]

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

LARGEST_PATH = 300_000
"""Maximum length of all path data in characters, ample for the maximum number of corners of an outline."""

MOST_CLOSES = 20

PX = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6, "pt": 96 / 72, "pc": 16.0}
"""CSS units in user units (px)."""

# Atomic groups prevent backtracking, which would take forever on a long text.
_NUMBER = r"(?>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_LENGTH = re.compile(rf"\s*+({_NUMBER})\s*+([a-zA-Z]*+|%)\s*+")
_NO_NUMBERS = re.compile(r"[^\s,]")
_NO_PATH = re.compile(r"[^\s,MmZzLlHhVvCcSsQqTtAa]")
_PLAIN = re.compile(r"\s*+M[MLQCZ\s,\d.eE+-]*+")
_STEP = re.compile(r"([MLQCZ])([^MLQCZ]*+)")
_NUMBERS = re.compile(_NUMBER)
_TRANSFORMS = re.compile(r"[\s,]*+(?:(?:matrix|translate|scale|rotate|skewX|skewY)\s*+\([^()]*+\)[\s,]*+)*+")
_TRANSFORM = re.compile(r"(\w+)\s*\(([^)]*)\)")


@dataclass
class Shapes:
    """Converts the shapes of one file to pieces, and limits their number."""

    file: OutlineFile
    path_data: int = 0
    segments: int = 0

    def pieces(self, element: Element, name: str, viewport: tuple[float, float]) -> list[Piece]:
        """Pieces of a basic shape in its own coordinates; percentages refer to `viewport`."""
        kind = str(element.tag)
        if kind == "path":
            return self._path(element.get("d", ""), name)
        if kind in ("polygon", "polyline"):
            points = self.numbers(element.get("points", ""), f"points of {name}")
            if len(points) % 2:
                raise self.file.unreadable("pairs of numbers", f"an odd number in points of {name}", "correct it")
            line = Polyline(np.array(points).reshape(-1, 2))
            return [Piece(name, (line,), kind == "polygon")] if points else []

        def length(key: str, default: float = 0.0) -> float:
            return self.length(element.get(key), f"{key} of {name}", viewport, key, default)

        if kind == "line":
            return [Piece(name, (Polyline(np.array([[length(f"x{i}"), length(f"y{i}")] for i in (1, 2)])),), False)]
        if kind == "rect":
            x, y, width, height = (length(key) for key in ("x", "y", "width", "height"))
            rx, ry = (length(key, -1.0) for key in ("rx", "ry"))
            if width <= 0 or height <= 0:
                return []
            return [Piece(name, _rectangle(x, y, width, height, rx if rx >= 0 else ry, ry if ry >= 0 else rx), True)]
        center = np.array([length("cx"), length("cy")])
        if kind == "circle":
            rx = ry = length("r")
            if rx < 0:
                raise self.file.unreadable("a radius above 0", f"{rx:g} for {name}", "correct it, or remove it")
        else:
            rx, ry = length("rx", -1.0), length("ry", -1.0)
            rx, ry = rx if rx >= 0 else ry, ry if ry >= 0 else rx
        if rx <= 0 or ry <= 0:
            return []
        return [Piece(name, (Arc(center, np.array([rx, 0.0]), np.array([0.0, ry])),), True)]

    def length(
        self,
        text: str | None,
        name: str,
        viewport: tuple[float, float],
        key: str,
        default: float = 0.0,
    ) -> float:
        """Length in user units; percentages refer to the viewport's width, height or, for other keys, diagonal."""
        if text is None or text.strip() in ("", "auto"):
            return default
        match = _LENGTH.fullmatch(text)
        if match and match[2] == "%":
            width, height = viewport
            whole = width if "x" in key or key == "width" else height
            return float(match[1]) / 100 * (whole if key != "r" else float(np.hypot(width, height)) / 2**0.5)
        if match is None or match[2].lower() not in PX:
            raise self.file.unreadable("a length", f"{brief(text)} as {name}", f"known units: {', '.join(PX)[2:]}")
        return float(match[1]) * PX[match[2].lower()]

    def numbers(self, text: str, name: str) -> list[float]:
        """Numbers separated by blanks or commas."""
        self._count(text)
        odd = _NO_NUMBERS.search(re.sub(_NUMBER, "", text))
        if odd:
            raise self.file.unreadable("numbers", f"{odd[0]!r} in {name}", "correct the file")
        return [float(number) for number in re.findall(_NUMBER, text)]

    def matrix(self, element: Element, name: str) -> Array:
        """Affine map (2, 3) from the transform attribute."""
        text = element.get("transform", "")
        if moved_by_style(element):
            raise self.file.unreadable(
                "transforms as attributes", f"one in the style of {name}", "save it as plain SVG"
            )
        self._count(text)
        if not _TRANSFORMS.fullmatch(text):
            raise self.file.unreadable("a transform", f"{brief(text)} at {name}", "correct the file")
        matrix = np.eye(3)
        for kind, values in _TRANSFORM.findall(text):
            numbers = self.numbers(values, f"transform of {name}")
            if len(numbers) not in _COUNTS[kind]:
                raise self.file.unreadable("a transform", f"{kind} of {len(numbers)} numbers at {name}", "correct it")
            matrix = matrix @ np.vstack([_MATRICES[kind](*numbers), [0.0, 0.0, 1.0]])
        return matrix[:2]

    def _count(self, data: str) -> None:
        self.path_data += len(data)
        most = LARGEST_PATH * self.file.patience
        if self.path_data > most:
            raise self.file.too_much(f"at most {most // 1000} kB of path data and other numbers")

    def _path(self, data: str, name: str) -> list[Piece]:
        """Pieces of path data, one per subpath."""
        from svgelements import Close, Move, Path

        self._count(data)
        if not data.strip() or data.strip() == "none":
            return []
        # svgelements accepts nan, ignores unknown commands, and stops silently at errors.
        commands, numbers = re.subn(_NUMBER, "", data)
        odd = _NO_PATH.search(commands)
        if odd or data.lstrip()[0] not in "Mm":
            found = repr(odd[0]) if odd else "no move to start from"
            raise self.file.unreadable("path data", f"{found} in {name}", "correct the path")
        most = MOST_PIECES * self.file.patience
        # A command makes at least one segment and takes at most seven numbers per segment.
        if self.segments + max(sum(map(str.isalpha, commands)), numbers / 7) > most:
            raise self.file.too_much(f"at most {most} lines and curves")
        # svgelements searches back to the last move at each close.
        if any(part.lower().count("z") > MOST_CLOSES for part in re.split("[Mm]", data)):
            raise self.file.unreadable(
                f"path data with at most {MOST_CLOSES} closes after a move", f"more in {name}", "correct the path"
            )
        if (plain := _plain_path(data, name)) is not None:
            self.segments += sum(len(piece.curves) for piece in plain)
            return plain
        try:
            segments = list(Path(data))
        except Exception:  # The parser raises errors of all kinds.
            raise self.file.unreadable("path data", f"{brief(data)} of {name}", "correct the path") from None
        self.segments += len(segments)
        if self.segments > most:
            raise self.file.too_much(f"at most {most} lines and curves")
        pieces: list[Piece] = []
        curves: list[Curve] = []
        for segment in segments:
            if isinstance(segment, Move | Close):
                # After a close without a move the next piece starts at the start of the closed one.
                if curves:
                    pieces.append(Piece(name, tuple(curves), isinstance(segment, Close)))
                curves = []
            else:
                curves.append(_curve(segment))
        if curves:
            pieces.append(Piece(name, tuple(curves), False))
        return pieces


def _plain_path(data: str, name: str) -> list[Piece] | None:
    """Pieces of path data of absolute lines and curves, as of text; None for all others.

    svgelements takes ten times as long, and a sheet has thousands of curves.
    """
    if not _PLAIN.fullmatch(data):
        return None
    pieces: list[Piece] = []
    curves: list[Curve] = []
    start = here = np.zeros(2)
    for command, text in _STEP.findall(data):
        if command == "Z":
            pieces += [Piece(name, tuple(curves), True)] if curves else []
            curves, here = [], start
            continue
        points = np.array(_NUMBERS.findall(text), dtype=float)
        degree = {"M": 1, "L": 1, "Q": 2, "C": 3}[command]
        if not len(points) or len(points) % (2 * degree):
            return None
        points = points.reshape(-1, 2)
        if command == "M":
            pieces += [Piece(name, tuple(curves), False)] if curves else []
            start, curves = points[0], []
            if len(points) > 1:
                curves.append(Polyline(points))
        elif command == "L":
            curves.append(Polyline(np.concatenate([here[None], points])))
        else:
            ends = np.concatenate([here[None], points[degree - 1 :: degree]])
            for k in range(len(points) // degree):
                curves.append(Bezier(np.concatenate([ends[k : k + 1], points[degree * k : degree * (k + 1)]])))
        here = points[-1]
    return pieces + ([Piece(name, tuple(curves), False)] if curves else [])


def _curve(segment: Any) -> Curve:
    from svgelements import Arc as SvgArc
    from svgelements import CubicBezier, QuadraticBezier

    start, end = _point(segment.start), _point(segment.end)
    if isinstance(segment, QuadraticBezier):
        return Bezier(np.array([start, _point(segment.control), end]))
    if isinstance(segment, CubicBezier):
        return Bezier(np.array([start, _point(segment.control1), _point(segment.control2), end]))
    if isinstance(segment, SvgArc) and segment.sweep and segment.rx and segment.ry:
        center = _point(segment.center)
        axes = np.column_stack([_point(segment.prx) - center, _point(segment.pry) - center])
        return _arc(start, end, center, axes, float(segment.sweep))
    return Polyline(np.stack([start, end]))


def _arc(start: Array, end: Array, center: Array, axes: Array, sweep: float) -> Curve:
    """Arc about nearly this center with exact end points: those of svgelements are off by some 1e-7 of its size."""
    # In coordinates along the semi-axes, where the ellipse is the unit circle.
    a, b = np.linalg.solve(axes, np.stack([start - center, end - center]).T).T
    half = (b - a) / 2
    reach = float(np.hypot(*half))
    if reach > 1 or not np.isfinite(reach):
        a, b, half, axes, reach = a / reach, b / reach, half / reach, axes * reach, 1.0
    across = np.array([-half[1], half[0]]) * (sqrt(1 - reach**2) / max(reach, np.finfo(float).tiny))
    middle = (a + b) / 2
    shift = min(middle + across, middle - across, key=lambda point: float(np.hypot(*point)))
    first, last = (float(np.arctan2(*(point - shift)[::-1])) for point in (a, b))
    exact = sweep + remainder(last - first - sweep, 2 * pi)
    return Arc(center + axes @ shift, axes[:, 0], axes[:, 1], first, exact)


def _point(value: Any) -> Array:
    return np.array([float(value.x), float(value.y)])


def _rectangle(x: float, y: float, width: float, height: float, rx: float, ry: float) -> tuple[Curve, ...]:
    """Outline of a rectangle, with quarter ellipses as corners if both radii are above 0."""
    corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
    if rx <= 0 or ry <= 0:
        return (Polyline(corners),)
    u, v = np.array([min(rx, width / 2), 0.0]), np.array([0.0, min(ry, height / 2)])
    centers = corners + [u + v, v - u, -u - v, u - v]
    arcs = [Arc(center, u, v, np.pi + i * np.pi / 2, np.pi / 2) for i, center in enumerate(centers)]
    return tuple(arcs)


def _rotate(degrees: float, x: float = 0.0, y: float = 0.0) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, x - c * x + s * y], [s, c, y - s * x - c * y]])


_COUNTS = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}
_MATRICES: dict[str, Callable[..., Array]] = {
    "matrix": lambda a, b, c, d, e, f: np.array([[a, c, e], [b, d, f]]),
    "translate": lambda x, y=0.0: np.array([[1.0, 0.0, x], [0.0, 1.0, y]]),
    "scale": lambda x, y=None: np.array([[x, 0.0, 0.0], [0.0, x if y is None else y, 0.0]]),
    "rotate": _rotate,
    "skewX": lambda a: np.array([[1.0, np.tan(np.radians(a)), 0.0], [0.0, 1.0, 0.0]]),
    "skewY": lambda a: np.array([[1.0, 0.0, 0.0], [np.tan(np.radians(a)), 1.0, 0.0]]),
}


def sheet_of(root: Element, file: OutlineFile) -> Sheet:
    """Collect the rules of all style sheets in a tree for selectors such as ``.st0``, ``#id`` and ``path``.

    The later of two rules for one selector wins.

    Raises
    ------
    InputError
        If a sheet uses another kind of selector for an evaluated property, or moves shapes; no editor writes these.
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
                    raise file.unreadable(
                        "style sheets for .class, #id or a kind of shape", brief(selector.strip()),
                        "save it as plain SVG",
                    )  # fmt: skip
                rules.setdefault(selector.strip(), {}).update(values)
    return rules


def style_of(element: Element, inherited: Style, sheet: Sheet) -> Style:
    """Style of an element inside a parent with the style `inherited`."""
    own = {name: element.attrib[name].strip() for name in PROPERTIES if name in element.attrib}
    tag, classes, name = str(element.tag), element.get("class", "").split(), element.get("id", "")
    for selector in ("*", tag, *(f".{c}" for c in classes), *(f"{tag}.{c}" for c in classes), f"#{name}"):
        own |= sheet.get(selector, {})
    own |= _declarations(element.get("style", ""))
    passed = {key: inherited[key] for key in INITIAL}
    return {**_OWN, **passed, **{key: value for key, value in own.items() if value != "inherit"}}


def seen(style: Style) -> bool:
    """Tell whether a shape is painted, regardless of the groups around it."""
    filled = style["fill"] not in _CLEAR and not _zero(style["fill-opacity"])
    stroked = style["stroke"] not in _CLEAR and not _zero(style["stroke-opacity"]) and not _zero(style["stroke-width"])
    return style["visibility"] == "visible" and (filled or stroked)


def fraction(value: str) -> float:
    """Opacity as a number from 0 to 1; 1 for what is none."""
    try:
        found = float(value.removesuffix("%")) / (100 if value.endswith("%") else 1)
    except ValueError:
        return 1.0
    return min(max(found, 0.0), 1.0)


def gone(style: Style) -> bool:
    """Tell whether an element is omitted together with its contents."""
    return style["display"] == "none" or _zero(style["opacity"])


def moved_by_style(element: Element) -> bool:
    """Tell whether an element is moved by a CSS transform."""
    return bool(_MOVES.search(element.get("style", ""))) or "transform-origin" in element.attrib


def _declarations(text: str) -> dict[str, str]:
    """Values of the evaluated properties in text such as ``fill:none;stroke:#000``."""
    pairs = (match.groups() for match in _DECLARATION.finditer(text))
    return {name: value.replace("!important", "").strip() for name, value in pairs if name in PROPERTIES}


def _zero(value: str) -> bool:
    return _ZERO.fullmatch(value) is not None
