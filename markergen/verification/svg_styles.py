"""Styles of an SVG in the forms that all programs read alike, and the refusal of those that have none.

resvg draws colors in forms that it does not know in black, such as ``rgb(255 255 255 / 1)``.
So does svgelements; tinycss2 1.5 takes ``rgb(none, 1, 2)`` and ``hwb(1, 2%, 3%)``, and refuses ``rgb(51 40% 153)``.
"""

# tests: tests/verification/test_svg_styles.py

import colorsys
import re
from math import pi
from typing import NoReturn
from xml.etree.ElementTree import Element, tostring

from markergen.errors import InputError, brief
from markergen.read.outlines.formats import OutlineFile
from markergen.read.outlines.svg import SVG, parse_svg

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
    "marker overflow paint-order shape image mix-blend isolation enable-background background solid direction "
    "writing-mode baseline dominant-baseline alignment unicode white-space vector-effect inline-size pointer-events "
    "cursor block-progression -inkscape -moz -webkit src tab-size unset"
)
"""Beginnings of the properties that change no place and no size, or that the reader has."""


def plain(file: OutlineFile) -> OutlineFile:
    """Rewrite a file with its colors as ``#rrggbbaa``, its variables by their values, and without rules for all media.

    Raises
    ------
    InputError
        If it has styles that programs draw differently.
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
    for key in (part.partition(":")[0].strip().lower() for part in declarations.split(";") if ":" in part):
        if not key.startswith(tuple(_ALIKE.split())) and key != "transform":
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
