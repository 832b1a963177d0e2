"""What of an element's style decides whether it is seen: attributes, style sheets, style, in rising order."""

import re
from collections.abc import Mapping
from xml.etree.ElementTree import Element

PROPERTIES = ("display", "visibility", "fill", "stroke", "clip-path", "mask")
"""Properties that matter; fill, stroke and visibility are inherited."""

Style = Mapping[str, str]
Sheet = dict[str, dict[str, str]]
"""Declarations by selector."""

INITIAL: Style = {"visibility": "visible", "fill": "black", "stroke": "none"}
_OWN: Style = {"display": "inline", "clip-path": "none", "mask": "none"}
_MOVES = re.compile(r"(?:^|;)\s*transform\s*:(?!\s*none)")


def sheet_of(root: Element) -> Sheet:
    """Rules of all style sheets in a tree for selectors such as ``.st0``, ``#id`` and ``path``.

    Others, which no editor writes, are never looked up; of two rules for one selector the later wins.
    """
    rules: Sheet = {}
    for style in root.iter("style"):
        # What follows /* counts again behind the next */.
        first, *rest = (style.text or "").split("/*")
        text = first + " ".join(part.partition("*/")[2] for part in rest)
        for block in text.split("}"):
            selectors, _, body = block.partition("{")
            values = _declarations(body)
            if values:
                for selector in selectors.split(","):
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
    return style["visibility"] == "visible" and (style["fill"], style["stroke"]) != ("none", "none")


def moved_by_style(element: Element) -> bool:
    """Tell whether a style sheet's kind of transform moves an element."""
    return bool(_MOVES.search(element.get("style", ""))) or "transform-origin" in element.attrib


def _declarations(text: str) -> dict[str, str]:
    """Values of the properties that matter in text such as ``fill:none;stroke:#000``."""
    pairs = (part.partition(":") for part in text.split(";"))
    values = {name.strip(): value.replace("!important", "").strip() for name, _, value in pairs}
    return {name: value for name, value in values.items() if name in PROPERTIES}
