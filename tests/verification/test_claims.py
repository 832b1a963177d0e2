"""What belongs to nothing of the marker is reported, wherever it is; what is only written otherwise passes."""

import re
import zipfile
from dataclasses import replace
from io import BytesIO

import numpy as np
import pypdfium2
import pypdfium2.raw as raw
import pytest
from damaged_sheets import POINTS, dot_two, drawn, grey, pages
from damaged_sheets import box as box_of
from PIL import Image
from spoiled_solids import glb, gltf, stl, triangles, with_model

from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.feature import Feature
from markergen.model.tag import Tag
from markergen.verification import verify
from markergen.verification.reading import Settings

COARSE = Fabrication(engrave=False, foot=0.0, tolerance=5e-5)
"""Without text in the back and with a third of the triangles of meshes that pass for round."""


@pytest.fixture(scope="module")
def marker(make_ngon):
    ngon = make_ngon(5, 0.05, 0.012)
    ring = replace(ngon.control_points[0], feature=Feature(0.012, 0.006))
    return replace(ngon, control_points=(ring, *ngon.control_points[1:]), tag=Tag("apriltag:36h11", 3, 0.02))


@pytest.fixture(scope="module")
def files(marker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    options = ExportOptions(fabrication=COARSE)
    suffixes = (".stl", ".dxf", ".glb", ".3mf", ".svg", ".pdf", ".png")
    save(marker, [folder / f"a{suffix}" for suffix in suffixes], replace(options, dpi=150))
    return {suffix: (folder / f"a{suffix}").read_bytes() for suffix in suffixes}


MODEL, VOLUMES = "3D/3dmodel.model", "Metadata/Slic3r_PE_model.config"


def check_of(marker, folder, suffix, data):
    """Check of a file of `COARSE` parts: with the options known, no solid is made with others and compared."""
    (folder / f"b{suffix}").write_bytes(data)
    return verify(marker, folder / f"b{suffix}", Settings(fabrication=COARSE))


def kinds(check):
    return {finding.kind for finding in check.findings}


def box(low, high):
    """Triangles (12, 3, 3) of a box, seen counterclockwise from outside."""
    sides = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, 1):
            square = np.zeros((4, 3))
            square[:, axis], square[:, u], square[:, v] = end, [0, 1, 1, 0], [0, 0, 1, 1]
            square = square if end else square[::-1]
            sides += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return np.array(low) + np.array(sides) * (np.array(high) - low)


BODIES = {
    "block on the face": box((-18, -18, 0), (-15, -15, 3)),
    "block in the air": box((-18, -18, 10), (-15, -15, 12)),
    "block beside the plate": box((80, 0, -3), (90, 10, 0)),
    "post on the back": box((-18, -18, -20), (-15, -15, -3)),
    "block in a dot": box((-1, 31, 0), (1, 33, 1)),
    "grain on the face": box((-18.02, -18.03, 0), (-17.92, -17.93, 0.1)),
    "needle on the face": box((-18.02, -18.03, 0), (-17.97, -17.98, 5)),
    "grain far away": box((1e5, 0, 0), (1e5 + 0.1, 0.1, 0.1)),
    "void": box((-18, -18, -2), (-15, -15, -1))[:, ::-1],
}


@pytest.mark.parametrize("suffix", [".stl", ".glb"])
def test_the_same_files_without_changes_pass(marker, files, tmp_path, suffix):
    data = stl(triangles(files[".stl"])) if suffix == ".stl" else glb(*gltf(files[".glb"]))
    assert check_of(marker, tmp_path, suffix, data).passed


@pytest.mark.parametrize("name", BODIES)
def test_bodies_that_are_not_the_markers_are_extra(marker, files, tmp_path, name):
    corners = triangles(files[".stl"])
    check = check_of(marker, tmp_path, ".stl", stl(np.concatenate([corners, BODIES[name]])))
    assert kinds(check) == {"extra"}, check.findings
    assert check.findings[0].remedy


@pytest.mark.parametrize(("size", "kind"), [(1.1, "diameter"), (0, "kind")])
def test_cores_of_rings_that_are_larger_or_missing_are_named(marker, files, tmp_path, size, kind):
    document, rest = gltf(files[".glb"])
    index = next(k for k, node in enumerate(document["nodes"]) if node.get("name") == "dot-0-core")
    holder = document["nodes"][index]
    if size:
        x, y = marker.control_points[0].x, marker.control_points[0].y
        holder["scale"], holder["translation"] = [size, size, 1], [(1 - size) * x, (1 - size) * y, 0]
    else:
        del holder["mesh"]
    check = check_of(marker, tmp_path, ".glb", glb(document, rest))
    assert kind in kinds(check), check.findings


def entity(space, kind):
    return space.query(f'{kind}[layer=="ENGRAVE"]')[0]


def again(kind):
    def change(document, space):
        space.add_entity(entity(space, kind).copy())

    return change


def engraved_line(document, space):
    space.add_line((-18, -18), (-15, -18), dxfattribs={"layer": "ENGRAVE"})


def other_layer(document, space):
    document.layers.add("LOGO")
    space.add_line((-18, -18), (-15, -18), dxfattribs={"layer": "LOGO"})


def broken_line(document, space):
    document.linetypes.add("GAPS", [2.0, 1.0, -1.0])
    entity(space, "LWPOLYLINE").dxf.linetype = "GAPS"


def twice_as_arcs(document, space):
    circle = entity(space, "CIRCLE")
    for start in (0, 180):
        space.add_arc(circle.dxf.center, circle.dxf.radius, start, start + 180, dxfattribs={"layer": "ENGRAVE"})


def outline_beside(document, space):
    space.add_entity(space.query('CIRCLE[layer=="CUT"]')[0].copy().translate(0.05, 0, 0))


def elsewhere(document, space):
    for part in list(space):
        space.add_entity(part.copy().translate(150, 0, 0))


def small_circle(document, space):
    space.add_circle((20, -20), 1, dxfattribs={"layer": "ENGRAVE"})


def point_to_cut(document, space):
    space.add_point((20, -20), dxfattribs={"layer": "CUT"})


def wide_line(document, space):
    entity(space, "LWPOLYLINE").dxf.const_width = 1.0


def above(document, space):
    entity(space, "CIRCLE").translate(0, 0, 5)


def not_plotted(document, space):
    document.layers.get("ENGRAVE").dxf.plot = 0


def in_paper_space(document, space):
    document.layout("Layout1").add_circle((0, 0), 6)


def line_to_cut(document, space):
    space.add_line((0, 45), (0, 70), dxfattribs={"layer": "CUT"})


def cross_in_a_dot(document, space):
    center = [part for part in space.query("CIRCLE") if abs(part.dxf.radius - 6) < 1e-6][1].dxf.center
    space.add_line(center + (2, 0), center - (2, 0), dxfattribs={"layer": "ENGRAVE"})


def open_tag(document, space):
    entity(space, "LWPOLYLINE").closed = False


ENTITIES = {
    "tag with an open outline": (open_tag, "tag"),
    "line to cut from the outline": (line_to_cut, "outline"),
    "cross in a dot": (cross_in_a_dot, "extra"),
    "circle in paper space": (in_paper_space, "covered"),
    "circle twice, as arcs": (twice_as_arcs, "twice"),
    "outline beside itself": (outline_beside, "twice"),
    "everything elsewhere": (elsewhere, "twice"),
    "small circle to engrave": (small_circle, "extra"),
    "point to cut": (point_to_cut, "covered"),
    "wide line": (wide_line, "covered"),
    "circle above the plane": (above, "covered"),
    "layer that is not plotted": (not_plotted, "hidden"),
    "circle twice": (again("CIRCLE"), "twice"),
    "tag twice": (again("LWPOLYLINE"), "twice"),
    "line to engrave": (engraved_line, "extra"),
    "layer of its own": (other_layer, "covered"),
    "line with gaps": (broken_line, "covered"),
}


@pytest.mark.parametrize("name", ENTITIES)
def test_entities_that_are_not_the_markers_are_extra(marker, files, tmp_path, name):
    change, kind = ENTITIES[name]
    check = check_of(marker, tmp_path, ".dxf", drawn(change)(files[".dxf"]))
    assert kind in kinds(check), check.findings


def two_arcs(document, space):
    circle = entity(space, "CIRCLE")
    for start in (20, 200):
        space.add_arc(circle.dxf.center, circle.dxf.radius, start, start + 180, dxfattribs={"layer": "ENGRAVE"})
    space.delete_entity(circle)


def in_a_block(document, space):
    block = document.blocks.new("PLATE", base_point=(3, 4))
    for part in list(space):
        space.unlink_entity(part)
        block.add_entity(part)
    space.add_blockref("PLATE", (20, -5), dxfattribs={"rotation": 30})


@pytest.mark.parametrize("change", [two_arcs, in_a_block])
def test_drawings_that_are_written_otherwise_pass(marker, files, tmp_path, change):
    check = check_of(marker, tmp_path, ".dxf", drawn(change)(files[".dxf"]))
    assert check.passed, check.findings
    assert check.largest < 1e-6


def test_blocks_that_are_stretched_are_named(marker, files, tmp_path):
    def stretched(document, space):
        in_a_block(document, space)
        space[0].dxf.xscale = 1.01

    assert not check_of(marker, tmp_path, ".dxf", drawn(stretched)(files[".dxf"])).passed


def materials(**changes):
    return lambda document: [material.update(changes) for material in document["materials"]]


def clear(document):
    for material in document["materials"]:
        material["alphaMode"] = "BLEND"
        material["pbrMetallicRoughness"]["baseColorFactor"][3] = 0.0


def again_elsewhere(document):
    mesh = next(node["mesh"] for node in document["nodes"] if node.get("name") == "dot-2")
    document["nodes"].append({"mesh": mesh, "translation": [0.0, 0.0, 0.01]})
    document["nodes"][0]["children"].append(len(document["nodes"]) - 1)


def extension(name, content, kind="materials", index=-1):
    return lambda document: document[kind][index].update(extensions={name: content})


def primitive(**changes):
    """Change what draws dot 2."""

    def change(document):
        mesh = next(node["mesh"] for node in document["nodes"] if node.get("name") == "dot-2")
        entry = document["meshes"][mesh]["primitives"][0]
        entry |= {key: value for key, value in changes.items() if value is not None}
        for key in changes.keys() - {key for key, value in changes.items() if value is not None}:
            del entry[key]

    return change


def painted_by_corner(document):
    for mesh in document["meshes"]:
        attributes = mesh["primitives"][0]["attributes"]
        attributes["COLOR_0"] = attributes["POSITION"]


def textured(document):
    document["materials"][-1]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}


GLTF = {
    "a hidden node": extension("KHR_node_visibility", {"visible": False}, "nodes"),
    "copies of a node": extension("EXT_mesh_gpu_instancing", {"attributes": {"TRANSLATION": 0}}, "nodes"),
    "glass": extension("KHR_materials_transmission", {"transmissionFactor": 1.0}),
    "another color, by an extension": extension("KHR_materials_pbrSpecularGlossiness", {"diffuseFactor": [1, 1, 1, 1]}),
    "a compressed mesh": primitive(extensions={"KHR_draco_mesh_compression": {"bufferView": 0}}),
    "a dot without material": primitive(material=None),
    "a texture": textured,
    "colors of corners": painted_by_corner,
    "a matrix and a scale": lambda document: document["nodes"][0].update(scale=[0.98] * 3),
    "transparent": clear,
    "masked": materials(alphaMode="MASK", alphaCutoff=2.0),
    "glowing": materials(emissiveFactor=[1, 1, 1]),
    "of metal": materials(pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 1], "metallicFactor": 1.0}),
    "moving": lambda document: document.update(animations=[{"channels": [], "samplers": []}]),
    "painted": lambda document: document.update(textures=[{"source": 0}]),
    "a dot again above": again_elsewhere,
}


@pytest.mark.parametrize("name", GLTF)
def test_what_is_drawn_otherwise_in_a_glb_is_named(marker, files, tmp_path, name):
    document, rest = gltf(files[".glb"])
    GLTF[name](document)
    assert not check_of(marker, tmp_path, ".glb", glb(document, rest)).passed


def swapped(text):
    return re.sub(r'(key="extruder" value=")([12])', lambda match: match[1] + "21"[int(match[2]) - 1], text)


def within(namespace, element):
    """A part of an object that other programs read."""
    return lambda text: text.replace("</triangles>", f'</triangles><{element} xmlns="{namespace}"/>')


MICROSOFT = "http://schemas.microsoft.com/3dmanufacturing/"
WHITE = f'<colorgroup id="9" xmlns="{MICROSOFT}material/2015/02"><color color="#FFFFFFFF"/></colorgroup>'

PRINTED = {
    "slices": (within(f"{MICROSOFT}slice/2015/07", "slicestack"), MODEL),
    "beams": (within(f"{MICROSOFT}beamlattice/2017/02", "beamlattice"), MODEL),
    "a texture": (within(f"{MICROSOFT}material/2015/02", "texture2dgroup"), MODEL),
    "triangles painted in a slicer": (
        lambda text: re.sub(r'(<triangle [^>]*p1="1")', r'\1 paint_color="4"', text),
        MODEL,
    ),
    "triangles of two colors": (lambda text: re.sub(r'p1="1"', 'p1="1" p2="0"', text), MODEL),
    "white by a group of colors": (
        lambda text: re.sub(r'pid="1" p1="1"', 'pid="9" p1="0"', text).replace("<basem", f"{WHITE}<basem"),
        MODEL,
    ),
    "not printed": (lambda text: text.replace("<item ", '<item printable="0" '), MODEL),
    "a support": (lambda text: text.replace('type="model"', 'type="support"'), MODEL),
    "transparent": (lambda text: re.sub(r'(displaycolor="#\w{6})\w*', r"\g<1>00", text), MODEL),
    "twice": (lambda text: re.sub(r"(<item [^>]*/>)", r"\1\1", text), MODEL),
    "extruders swapped": (swapped, VOLUMES),
    "a core of the other extruder": (
        lambda text: re.sub(r'(-core"/><meta[^/]*er" value=")1', r"\g<1>2", text),
        VOLUMES,
    ),
    "a modifier": (
        lambda text: text.replace(
            "</volume>", '<metadata type="volume" key="volume_type" value="ParameterModifier"/></volume>', 1
        ),
        VOLUMES,
    ),
    "outlines moved by the slicer": (
        lambda text: text.replace(
            "<volume", '<metadata type="object" key="xy_size_compensation" value="0.3"/><volume', 1
        ),
        VOLUMES,
    ),
}


@pytest.mark.parametrize("name", PRINTED)
def test_what_is_printed_otherwise_in_a_3mf_is_named(marker, files, tmp_path, name):
    change, path = PRINTED[name]
    with zipfile.ZipFile(BytesIO(files[".3mf"])) as package:
        text = package.read(path).decode()
    assert change(text) != text
    assert not check_of(marker, tmp_path, ".3mf", with_model(files[".3mf"], change(text), path)).passed


def test_everything_twice_in_its_place_is_named(marker, files, tmp_path):
    corners = triangles(files[".stl"])
    assert kinds(check_of(marker, tmp_path, ".stl", stl(np.concatenate([corners, corners])))) == {"solid"}
    dots = re.search(r'<g id="dots".*?</g>', files[".svg"].decode(), re.DOTALL)[0]
    more = files[".svg"].decode().replace("</svg>", re.sub(r'id="[^"]*"', "", dots) + "</svg>")
    assert kinds(check_of(marker, tmp_path, ".svg", more.encode())) == {"twice"}


DOT = re.compile(r'<circle id="dot-2" cx="([^"]*)" cy="([^"]*)"[^>]*/>')
AGAIN = {
    "as arcs": "M{0},{1} m6,0 a6,6 0 0 1 -12,0 a6,6 0 0 1 12,0 Z",
    "as halves": "M{0},{1} m6,0 a6,6 0 0 1 -12,0 Z",
    "smaller": "M{0},{1} m5,0 a5,5 0 0 1 -10,0 a5,5 0 0 1 10,0 Z",
    "as a square": "M{0},{1} h3 v3 h-3 Z",
}


@pytest.mark.parametrize("name", AGAIN)
def test_what_is_drawn_in_a_dot_of_its_color_is_named(marker, files, tmp_path, name):
    text = files[".svg"].decode()
    path = f'<path d="{AGAIN[name].format(*DOT.search(text).groups())}" fill="black"/>'
    check = check_of(marker, tmp_path, ".svg", text.replace("</svg>", f"{path}</svg>").encode())
    assert kinds(check) == {"twice"}, check.findings


def test_dots_on_the_layer_of_the_cuts_are_named(marker, files, tmp_path):
    data = files[".svg"].replace(b'inkscape:label="dots"', b'inkscape:label="cut"')
    assert kinds(check_of(marker, tmp_path, ".svg", data)) == {"outline"}


@pytest.mark.parametrize("size", [12, 4])
def test_what_is_drawn_in_a_dot_of_a_pdf_is_named(marker, files, tmp_path, size):
    def draw(page):
        left, bottom, right, top = box_of(dot_two(page))
        x, y, r = (left + right) / 2, (bottom + top) / 2, size / 2 * POINTS
        path = raw.FPDFPageObj_CreateNewPath(x + r, y)
        bend = 0.5523 * r
        raw.FPDFPath_BezierTo(path, x + r, y + bend, x + bend, y + r, x, y + r)
        raw.FPDFPath_BezierTo(path, x - bend, y + r, x - r, y + bend, x - r, y)
        raw.FPDFPath_BezierTo(path, x - r, y - bend, x - bend, y - r, x, y - r)
        raw.FPDFPath_BezierTo(path, x + bend, y - r, x + r, y - bend, x + r, y)
        raw.FPDFPath_SetDrawMode(path, 1, 0)
        raw.FPDFPage_InsertObject(page.raw, path)

    check = check_of(marker, tmp_path, ".pdf", pages(draw)(files[".pdf"]))
    assert "twice" in kinds(check), check.findings


@pytest.mark.parametrize(
    "style",
    [
        "@media print { #dot-2 { display: none } }",
        "#dot-2 { r: 3px }",
        "svg { zoom: 1.1 }",
        "@keyframes a { to { fill: white } } #dot-2 { animation: a 1s forwards }",
        "#cut { marker-end: url(#dot-2) }",
    ],
)
def test_styles_that_programs_draw_differently_are_refused(marker, files, tmp_path, style):
    with pytest.raises(InputError):
        check_of(
            marker, tmp_path, ".svg", files[".svg"].replace(b"<title", f"<style>{style}</style><title".encode(), 1)
        )


def test_a_field_over_a_dot_of_a_pdf_is_named(marker, files, tmp_path):
    left, bottom, right, top = box_of(dot_two(pypdfium2.PdfDocument(files[".pdf"])[0]))
    field = (
        f"90 0 obj << /Type /Annot /Subtype /Widget /FT /Tx /T (name) /F 4 /Rect [{left} {bottom} {right} {top}] "
        "/AP << /N 91 0 R >> >> endobj\n91 0 obj << /Type /XObject /Subtype /Form /BBox [0 0 9 9] /Length 21 >> "
        "stream\n1 1 1 rg 0 0 9 9 re f\nendstream endobj\nxref"
    )
    data = files[".pdf"].replace(b"/Type /Catalog", b"/AcroForm << /Fields [ 90 0 R ] >> /Type /Catalog")
    data = data.replace(b"/TrimBox", b"/Annots [ 90 0 R ] /TrimBox", 1).replace(b"\nxref", b"\n" + field.encode(), 1)
    assert kinds(check_of(marker, tmp_path, ".pdf", data)) == {"pale"}


@pytest.mark.parametrize(
    "event", [b'<svg onload="document.documentElement.remove()" ', b"<svg\n  onbegin = 'f()' ", b"<svg onclick='f()' "]
)
def test_pictures_that_a_script_may_change_are_refused(marker, files, tmp_path, event):
    with pytest.raises(InputError, match="animation or a script"):
        check_of(marker, tmp_path, ".svg", files[".svg"].replace(b"<svg ", event, 1))


def in_black_and_white(levels):
    return np.where(levels < 128, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("choices", "what"),
    [({"transparency": 0}, "transparent color"), ({"transparency": 255}, "transparent color"), ({"exif": 6}, "EXIF")],
)
def test_pixels_that_programs_show_differently_are_refused(marker, files, tmp_path, choices, what):
    if "exif" in choices:
        exif = Image.Exif()
        exif[0x0112] = choices["exif"]
        choices = {"exif": exif}
    with Image.open(BytesIO(files[".png"])) as image:
        image.convert("L").save(out := BytesIO(), "PNG", dpi=image.info["dpi"], **choices)
    with pytest.raises(InputError, match=what):
        check_of(marker, tmp_path, ".png", out.getvalue())


def test_pixels_pass_by_what_they_show(marker, files, tmp_path):
    check = check_of(marker, tmp_path, ".png", grey(in_black_and_white, 150)(files[".png"]))
    assert check.passed, check.findings
    page = pypdfium2.PdfDocument(files[".pdf"])[0]
    stretched = page.render(scale=150 / 72).to_pil().convert("L")
    stretched.save(out := BytesIO(), "PNG", dpi=(150, 150))
    check = check_of(marker, tmp_path, ".png", out.getvalue())
    assert check.passed, check.findings
    assert any("stretched by 0.1 %" in note for note in check.notes)
    stretched.convert("1", dither=0).save(out := BytesIO(), "PNG", dpi=(150, 150))
    check = check_of(marker, tmp_path, ".png", out.getvalue())
    assert check.passed, check.findings
    # As much along both sides and on no usual paper, it is a scale.
    stretched.crop((0, 0, stretched.width - 20, stretched.height)).save(out := BytesIO(), "PNG", dpi=(150, 150))
    assert "scaled" in kinds(check_of(marker, tmp_path, ".png", out.getvalue()))


def test_a_page_of_pixels_in_a_pdf_passes(marker, files, tmp_path):
    page = pypdfium2.PdfDocument(files[".pdf"])[0]
    out = BytesIO()
    page.render(scale=150 / 72).to_pil().convert("L").save(out, "PDF", resolution=150)
    check = check_of(marker, tmp_path, ".pdf", out.getvalue())
    assert check.passed, check.findings
    # A page of whole pixels is larger than the paper by less than one.
    assert check.tolerance == pytest.approx(0.6 * 25.4e-3 / 150, rel=0.01)
    assert check.notes
