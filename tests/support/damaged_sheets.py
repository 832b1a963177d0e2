"""Kinds of damage to a sheet with five dots of 12 mm, a tag and four holes, and what each must be called.

Each entry of a table is a function from a file's text or bytes to the damaged one, the kinds of findings that name it,
and words that the first sentence of those kinds has.
"""

import ctypes
import re
from io import BytesIO, StringIO

import cv2
import ezdxf
import numpy as np
import pypdfium2
import pypdfium2.raw as raw
from spoiled_files import png, rewritten

DPI = 200
DOT = re.compile(r'<circle id="dot-2"[^>]*/>')
POINTS = 72 / 25.4


def on_dot(change):
    """Change the element of dot 2 of an SVG, given with its center."""

    def changed(text):
        dot = DOT.search(text)[0]
        x, y = (float(re.search(rf'{key}="([^"]+)"', dot)[1]) for key in ("cx", "cy"))
        return text.replace(dot, change(dot, x, y))

    return changed


def painted(old, new):
    return on_dot(lambda dot, x, y: dot.replace(old, new))


def corners(x, y):
    angle = np.pi * np.arange(24) / 12
    return " ".join(
        f"{x + 6 * cos:.5f},{y + 6 * sin:.5f}" for cos, sin in zip(np.cos(angle), np.sin(angle), strict=True)
    )


def with_rectangle(left, width):
    return on_dot(
        lambda dot, x, y: dot + f'<rect x="{x + left}" y="{y - 8}" width="{width}" height="16" fill="#ffffff"/>'
    )


def layer_off(name):
    return lambda text: text.replace(f'<g id="{name}"', f'<g id="{name}" style="display:none"')


def inverted(text):
    return text.replace("#000000", "#x").replace("#ffffff", "#000000").replace("#x", "#ffffff")


def narrower(text):
    return text.replace('width="148mm"', 'width="90mm"').replace('viewBox="0 0 148 210"', 'viewBox="0 0 90 210"')


def line(name, change):
    return lambda text: re.sub(rf'(<(?:poly\w+|circle) id="{name}[-"][^>]*)/>', change, text)


def with_unread(element):
    return on_dot(lambda dot, x, y: dot + element.format(x=x, y=y))


SVG = {
    "text": (with_unread('<text x="{x}" y="{y}" font-size="4">A</text>'), "covered", "the text 'A' is not read"),
    "image": (with_unread('<image id="i" x="{x}" y="{y}" width="9" height="9"/>'), "covered", "image 'i' is not read"),
    "foreign": (with_unread('<foreignObject x="{x}" y="{y}"/>'), "covered", "the foreign object without a name"),
    "ellipse": (
        on_dot(lambda dot, x, y: f'<ellipse cx="{x}" cy="{y}" rx="6.03" ry="5.97"/>'), "diameter", "dot 2 is not round"
    ),
    "line across a dot": (
        on_dot(lambda dot, x, y: dot + f'<path d="M{x - 7} {y}h14" stroke="#fff" stroke-width="0.2"/>'),
        "covered", "% of dot 2 is covered",
    ),
    "hole in a dot": (
        on_dot(lambda dot, x, y: dot + f'<circle cx="{x + 2}" cy="{y}" r="0.5" fill="#fff"/>'),
        "covered", "% of dot 2 is covered",
    ),
    "page filled": (
        lambda text: text.replace('height="210" fill="#ffffff"', 'height="210" fill="#aaaaaa"'),
        "extra", "the page is filled",
    ),
    "polygon": (
        on_dot(lambda dot, x, y: f'<polygon points="{corners(x, y)}"/>'), "diameter", "its edge is up to 0.0513"
    ),
    "grey": (painted("#000000", "#888888"), "pale", "dot 2 is grey: 47 %"),
    "half opaque": (painted("/>", ' opacity="0.5"/>'), "pale", "dot 2 is grey: 50 %"),
    "half covered": (with_rectangle(0, 16), "covered", "50 % of dot 2"),
    "speck": (
        on_dot(lambda dot, x, y: dot + f'<circle cx="{x + 9}" cy="{y}" r="1"/>'), "quiet", "quiet zone of dot 2"
    ),
    "pale speck": (
        on_dot(lambda dot, x, y: dot + f'<circle cx="{x + 9}" cy="{y}" r="1" fill="#d0d0d0"/>'),
        "quiet", "quiet zone of dot 2",
    ),
    "dots off": (layer_off("dots"), "hidden", "some shapes are hidden"),
    "tag off": (layer_off("tag"), "tag", "apriltag:36h11:3"),
    "cut off": (layer_off("cut"), "outline", "the outline is missing"),
    "inverted": (inverted, "inverted", "light and dark are swapped"),
    "cropped": (narrower, "hidden", "the page is cropped"),
    "hole missing": (line("hole-1", ""), "hole", "is missing"),
    # A round line is flattened to 5 um.
    "hole moved": (line("hole-1", r'\1 transform="translate(1 0)"/>'), "hole", "is 0.9999 mm off (x +0.9999 mm"),
    "outline small": (line("boundary", r'\1 transform="translate(1 0) scale(.9866)"/>'), "outline", "the outline "),
}  # fmt: skip


def pages(change):
    """Change every page of a PDF through PDFium."""

    return lambda data: rewritten(data, change)


def objects(page):
    return [raw.FPDFPage_GetObject(page.raw, k) for k in range(raw.FPDFPage_CountObjects(page.raw))]


def box(item):
    sides = [ctypes.c_float() for _ in range(4)]
    raw.FPDFPageObj_GetBounds(item, *sides)
    return [side.value for side in sides]


def dot_two(page):
    sizes = [(item, np.subtract(box(item)[2:], box(item)[:2])) for item in objects(page)]
    return [item for item, size in sizes if np.abs(size - 12 * POINTS).max() < 0.05][2]


def filled(level):
    return pages(lambda page: raw.FPDFPageObj_SetFillColor(dot_two(page), level, level, level, 255))


def stroked(width):
    def change(page):
        item = dot_two(page)
        raw.FPDFPageObj_SetStrokeColor(item, 0, 0, 0, 255)
        raw.FPDFPageObj_SetStrokeWidth(item, width * POINTS)
        raw.FPDFPath_SetDrawMode(item, 1, 1)

    return pages(change)


def under_a_box(page):
    left, bottom, right, top = box(dot_two(page))
    cover = raw.FPDFPageObj_CreateNewRect(left - 3, bottom - 3, right - left + 6, top - bottom + 6)
    raw.FPDFPageObj_SetFillColor(cover, 255, 255, 255, 255)
    raw.FPDFPath_SetDrawMode(cover, 1, 0)
    raw.FPDFPage_InsertObject(page.raw, cover)


def stretched(page):
    item = dot_two(page)
    left, bottom, right, top = box(item)
    x, y = (left + right) / 2, (bottom + top) / 2
    raw.FPDFPageObj_Transform(item, 1.005, 0, 0, 0.995, -0.005 * x, 0.005 * y)


def transformed(*matrix):
    def change(page):
        for item in objects(page):
            raw.FPDFPageObj_Transform(item, *matrix, 0, 0)

    return pages(change)


def group_off(name):
    def changed(data):
        number = re.findall(rb"(\d+) 0 obj", data[: data.index(b"/Name (" + name + b")")])[-1]
        return data.replace(b"/D <<", b"/D <<\n/OFF [" + number + b" 0 R]", 1)

    return changed


def rectangle(level, alpha, left, bottom, width, height):
    """Draw a rectangle, from the corner of dot 2, in points."""

    def change(page):
        x, y, *_ = box(dot_two(page))
        item = raw.FPDFPageObj_CreateNewRect(x + left, y + bottom, width, height)
        raw.FPDFPageObj_SetFillColor(item, level, level, level, alpha)
        raw.FPDFPath_SetDrawMode(item, 1, 0)
        raw.FPDFPage_InsertObject(page.raw, item)

    return pages(change)


def printed_twice(data):
    """The PDF with its page again."""
    document = pypdfium2.PdfDocument(data)
    document.import_pages(pypdfium2.PdfDocument(data), [0])
    document.save(out := BytesIO())
    return out.getvalue()


PDF = {
    "page twice": (printed_twice, "twice", "page 2 is page 1 again"),
    "pale speck": (rectangle(208, 255, 36, 12, 6, 6), "quiet", "quiet zone of dot 2"),
    "line across a dot": (rectangle(255, 255, -3, 12, 45, 0.6), "covered", "% of dot 2 is covered"),
    "speck in a dot": (rectangle(255, 255, 12, 12, 3, 3), "covered", "% of dot 2 is covered"),
    "watermark": (rectangle(0, 40, -900, -900, 2000, 2000), "extra", "the page is filled"),
    "one dot again": (rectangle(0, 255, 14, 14, 3, 3), "twice", "is in a dot of its color"),
    "white": (filled(255), "pale", "dot 2 is invisible"),
    "grey": (filled(128), "pale", "dot 2 is grey: 50 %"),
    "covered": (pages(under_a_box), "pale", "dot 2 is invisible"),
    "stroke": (stroked(0.5), "diameter", "12.5 mm, not 12 mm: its edge has a stroke"),
    "fine stroke": (stroked(0.1), "diameter", "12.1 mm, not 12 mm: its edge has a stroke"),
    "ellipse": (pages(stretched), "diameter", "dot 2 is not round"),
    "dots off": (group_off(b"dots"), "hidden", "no dot shows: their layer is switched off"),
    "tag off": (group_off(b"tag"), "tag", "does not show"),
    "cut off": (group_off(b"cut"), "hidden", "the lines to cut do not show"),
    "crop box": (pages(lambda page: page.set_cropbox(0, 0, 250, 595)), "hidden", "the page is cropped"),
    "media box": (pages(lambda page: page.set_mediabox(0, 0, 250, 595)), "hidden", "the page is cropped"),
    "smaller paper": (transformed(0.7071, 0, 0, 0.7071), "scaled", "scaled by 0.7071 along x and y, perhaps fitted"),
    "inches": (transformed(1 / 25.4, 0, 0, 1 / 25.4), "scaled", "inch taken for mm"),
    "sheared": (transformed(1, 0, 0.03, 1), "sheared", "sheared by 1.72 degrees"),
    "mirrored": (transformed(-1, 0, 0, 1), "mirrored", "mirrored"),
}


def drawn(change):
    """Change a DXF through ezdxf."""

    def changed(data):
        document = ezdxf.read(StringIO(data.decode()))
        change(document, document.modelspace())
        out = StringIO()
        document.write(out)
        return out.getvalue().encode()

    return changed


def circles(space, layer, radius):
    return [c for c in space.query("CIRCLE") if c.dxf.layer == layer and abs(c.dxf.radius - radius) < 1e-6]


def cut_dots(document, space):
    for circle in space.query("CIRCLE"):
        if circle.dxf.layer == "ENGRAVE":
            circle.dxf.layer = "CUT"


def one_cut(document, space):
    circles(space, "ENGRAVE", 6)[2].dxf.layer = "CUT"


def polygon(document, space):
    space.delete_entity(circles(space, "CUT", 50)[0])
    angle = 2 * np.pi * np.arange(24) / 24
    ring = 50 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    space.add_lwpolyline(ring.tolist(), close=True, dxfattribs={"layer": "CUT"})


def without_hole(document, space):
    space.delete_entity(circles(space, "CUT", 1.7)[1])


def moved_hole(document, space):
    circles(space, "CUT", 1.7)[1].translate(1, 0, 0)


def open_outline(document, space):
    outline = max(space.query('CIRCLE[layer=="CUT"]'), key=lambda circle: circle.dxf.radius)
    space.add_arc(outline.dxf.center, outline.dxf.radius, 0, 359, dxfattribs={"layer": "CUT"})
    space.delete_entity(outline)


def smaller(document, space):
    circles(space, "CUT", 50)[0].dxf.radius = 148 / 3


def unit(document, space):
    document.header["$INSUNITS"] = 1


def word(document, space):
    space.add_text("A", dxfattribs={"layer": "CUT"})


def invisible(document, space):
    circles(space, "ENGRAVE", 6)[2].dxf.invisible = 1


def a_little_off(document, space):
    circles(space, "ENGRAVE", 6)[1].translate(0.03, 0, 0)


def oval(document, space):
    dot = circles(space, "ENGRAVE", 6)[2]
    space.add_ellipse(dot.dxf.center, (6.03, 0), 5.97 / 6.03, dxfattribs={"layer": "ENGRAVE"})
    space.delete_entity(dot)


def open_dot(document, space):
    dot = circles(space, "ENGRAVE", 6)[1]
    space.add_arc(dot.dxf.center, 6, 0, 355, dxfattribs={"layer": "ENGRAVE"})
    space.delete_entity(dot)


def in_block(xscale=1.0, again=False):
    def change(document, space):
        block = document.blocks.new("B")
        for entity in list(space):
            space.unlink_entity(entity)
            block.add_entity(entity)
        space.add_blockref("B", (0, 0), dxfattribs={"xscale": xscale})
        if again:
            space.add_blockref("B", (300, 0))

    return drawn(change)


DXF = {
    "dot not closed": (drawn(open_dot), "missing", "dot 1 is missing"),
    "block stretched": (in_block(1.001), "scaled", "scaled by 1.001"),
    "block mirrored": (in_block(-1.0), "mirrored", "mirrored"),
    "block twice": (in_block(again=True), "twice", "the marker is there 2 times"),
    "a little off": (drawn(a_little_off), "shifted", "dot 1 is 0.03 mm off"),
    "ellipse": (drawn(oval), "diameter", "dot 2 is not round"),
    "word to cut": (drawn(word), "covered", "the 'TEXT' on the layer CUT is not read"),
    "invisible": (drawn(invisible), "hidden", "an entity is invisible"),
    "dot on CUT": (drawn(one_cut), "layer", "dot 2 is on the layer CUT and would be cut out"),
    "dots on CUT": (drawn(cut_dots), "layer", "dots 0, 1, 2, 3, 4 are on the layer CUT"),
    "hole missing": (drawn(without_hole), "hole", "is missing"),
    "hole moved": (drawn(moved_hole), "hole", "is 1 mm off"),
    "outline small": (drawn(smaller), "outline", "has a diameter of 98.666"),
    "outline open": (drawn(open_outline), "outline", "the outline is not complete: nothing at x"),
    "polygon": (drawn(polygon), "outline", "is not round: its sides are up to 0.4278 mm off"),
    "layer off": (drawn(lambda document, space: document.layers.get("ENGRAVE").off()), "hidden", "switched off"),
    "inches": (drawn(unit), "scaled", "mm taken for inch"),
}


def grey(change, dpi=DPI):
    """Change the grey levels of a PNG."""
    return lambda data: png(change(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)), dpi)


def warped(matrix):
    return grey(lambda levels: cv2.warpAffine(levels, np.array(matrix), levels.shape[::-1], borderValue=255))


def shrunk(levels):
    return cv2.resize(levels, None, fx=0.7071, fy=0.7071, interpolation=cv2.INTER_AREA)


def specked(levels):
    """A pale speck beside each dot, but not in the others."""
    inked = cv2.dilate(255 - levels, np.ones((5, 5), np.uint8))
    moved = np.roll(inked, inked.shape[1] // 200, axis=1)
    return np.minimum(levels, np.where(moved > 128, 208, 255).astype(np.uint8))


PNG = {
    "pale shadow": (grey(specked), "quiet", "quiet zone of dot"),
    "inverted": (grey(lambda levels: 255 - levels), "inverted", "light and dark are swapped"),
    "resolution": (grey(lambda levels: levels, 72), "scaled", "scaled by 2.77"),
    "smaller paper": (grey(shrunk), "scaled", "scaled by 0.70"),
    "sheared": (warped([[1, 0.03, -20], [0, 1, 0]]), "sheared", "sheared by 1.7"),
    "cropped": (grey(lambda levels: levels[:, : levels.shape[1] * 3 // 5]), "hidden", "the page is cropped"),
    "pale": (grey(lambda levels: 255 - (255 - levels) // 5), "pale", "all dots are pale"),
}

DAMAGE = {".svg": SVG, ".pdf": PDF, ".dxf": DXF, ".png": PNG}
