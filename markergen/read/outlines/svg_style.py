"""What of an element's style decides whether it is seen: attributes, style sheets, style, in rising order."""

import re
from collections.abc import Mapping
from xml.etree.ElementTree import Element

from markergen.errors import brief
from markergen.read.outlines.drawing import OutlineFile

Style = Mapping[str, str]
Sheet = dict[str, dict[str, str]]
"""Declarations by selector."""

LARGEST_SHEET = 300_000
"""Characters of all style sheets; editors write a rule or a few for each look."""

INITIAL: Style = {
    "visibility": "visible", "fill": "black", "stroke": "none", "fill-opacity": "1", "stroke-opacity": "1",
    "stroke-width": "1",
}  # fmt: skip
"""Properties that are inherited, with what they are at first."""

_OWN: Style = {"display": "inline", "opacity": "1", "clip-path": "none", "mask": "none"}
PROPERTIES = (*INITIAL, *_OWN)
"""Properties that matter."""

_DECLARATION = re.compile(r"(?:^|;)\s*+([\w-]++)\s*+:([^;]*+)")
_MOVES = re.compile(r"(?:^|[;{])\s*+transform\s*+:(?!\s*+none)")
_SELECTOR = re.compile(r"\*|[\w-]*(?:[.#][\w-]+)?")
_CLEAR = ("none", "transparent")
_ZERO = re.compile(r"(?:0+\.?0*|\.0+)(?:%|[a-z]+)?")


def sheet_of(root: Element, file: OutlineFile) -> Sheet:
    """Rules of all style sheets in a tree for selectors such as ``.st0``, ``#id`` and ``path``.

    Of two rules for one selector the later wins.

    Raises
    ------
    InputError
        If a sheet has another kind of selector for a property that matters, or moves shapes; no editor writes these.
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
    """Style of an element inside one that has the style `inherited`."""
    own = {name: element.attrib[name].strip() for name in PROPERTIES if name in element.attrib}
    tag, classes, name = str(element.tag), element.get("class", "").split(), element.get("id", "")
    for selector in ("*", tag, *(f".{c}" for c in classes), *(f"{tag}.{c}" for c in classes), f"#{name}"):
        own |= sheet.get(selector, {})
    own |= _declarations(element.get("style", ""))
    passed = {key: inherited[key] for key in INITIAL}
    return {**_OWN, **passed, **{key: value for key, value in own.items() if value != "inherit"}}


def seen(style: Style) -> bool:
    """Tell whether anything of a shape is drawn; whether the groups around it are is not asked."""
    filled = style["fill"] not in _CLEAR and not _zero(style["fill-opacity"])
    stroked = style["stroke"] not in _CLEAR and not _zero(style["stroke-opacity"]) and not _zero(style["stroke-width"])
    return style["visibility"] == "visible" and (filled or stroked)


def gone(style: Style) -> bool:
    """Tell whether an element is not drawn with all that is in it."""
    return style["display"] == "none" or _zero(style["opacity"])


def moved_by_style(element: Element) -> bool:
    """Tell whether a style sheet's kind of transform moves an element."""
    return bool(_MOVES.search(element.get("style", ""))) or "transform-origin" in element.attrib


def _declarations(text: str) -> dict[str, str]:
    """Values of the properties that matter in text such as ``fill:none;stroke:#000``."""
    pairs = (match.groups() for match in _DECLARATION.finditer(text))
    return {name: value.replace("!important", "").strip() for name, value in pairs if name in PROPERTIES}


def _zero(value: str) -> bool:
    return _ZERO.fullmatch(value) is not None
