"""XML of an SVG as a tree that cannot grow beyond its file: no entities, no document types of its own, no depth."""

from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from markergen.errors import brief
from markergen.read.outlines.drawing import OutlineFile

MOST_ELEMENTS, DEEPEST = 100_000, 100
LONGEST_CLASS = 1000
"""Characters of an element's class names; Illustrator writes some ten."""
SVG = "http://www.w3.org/2000/svg"
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
XLINK = "http://www.w3.org/1999/xlink"
_W3C = "-//W3C//DTD SVG "


def parse(file: OutlineFile) -> Element:
    """Root of the tree; names are ``namespace name``, those of SVG itself have no namespace.

    Raises
    ------
    InputError
        If it is no XML, declares entities or a document type of its own, or has too many elements or too deep ones.
    """
    builder = TreeBuilder()
    # Namespaces are joined to names by a blank, which neither can hold.
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    depth = count = 0

    def refuse(*_: object) -> NoReturn:
        raise file.unreadable(
            "plain SVG without a document type of its own", "declarations of entities or another document's",
            "save it again as plain SVG",
        )  # fmt: skip

    def doctype(_: str, system: str | None, public: str | None, internal: int) -> None:
        # The W3C's own says nothing and is never fetched; Illustrator and matplotlib write it.
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
