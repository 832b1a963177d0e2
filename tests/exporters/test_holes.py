"""What is cut, a hole, or only kept free is the same in every file, as other programs read it: docs/conventions.md."""

import ctypes
import io
from dataclasses import replace
from typing import NamedTuple
from xml.etree import ElementTree

import ezdxf
import ezdxf.path
import numpy as np
import pypdfium2 as pdfium
import pytest
import shapely

from markergen.drawing.colors import parse_colors
from markergen.drawing.paper import SheetOptions
from markergen.drawing.sheet_layout import pages_for
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.geometry.contour import Contour, circle
from markergen.model.boundary import Circle, polygon_from
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Substrate, parse_dowel, parse_mount
from markergen.model.tag import Tag
from markergen.verification.check import verify

MM = 25.4 / 72

Shape = tuple[float, ...]
"""Area, left, lower, right and upper end, mm: enough to tell all contours here apart."""


class Case(NamedTuple):
    """A marker, and what must be in its files by the rule: mm, marker frame."""

    marker: object
    sheet: list[Shape]
    plate: list[Shape]
    holes: list[Shape]
    told: list[Shape]


def disk(x: float, y: float, radius: float) -> Shape:
    return np.pi * radius**2, x - radius, y - radius, x + radius, y + radius


def box(left: float, low: float, right: float, high: float) -> Shape:
    return (right - left) * (high - low), left, low, right, high


SLOT = Contour(((-0.05, 0.032), (-0.03, 0.032), (-0.03, 0.038), (-0.05, 0.038)), (0.0, 1.0, 0.0, 1.0))
SLOTTED = (20 * 6 + np.pi * 9, -53.0, 32.0, -27.0, 38.0)
MOUNTS = [disk(0, -30, 2.25), disk(0, 58, 1.7), disk(-40, -20, 2)]
BORED = parse_mount("M4c:0mm,-30mm") + parse_mount("M3:0mm,58mm") + parse_dowel("4mm:-40mm,-20mm")
FREE = [disk(0, -30, 4.48), disk(20, 25, 5), box(-38, 2, -30, 8)]


def drawn(half: float, *holes: Contour):
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    return polygon_from([Contour(corners), *holes], "file")


@pytest.fixture(scope="module")
def cases(make_ngon) -> dict[str, Case]:
    """A disk with an edge, a hole of which is beyond the boundary; a drawing; and both on a drawn plate."""
    keep_outs = (Circle(0.005, (0.02, 0.025)), polygon_from([np.array(
        [[-0.038, 0.002], [-0.03, 0.002], [-0.03, 0.008], [-0.038, 0.008]])], "file"))  # fmt: skip
    plain = replace(make_ngon(5, 0.055, 0.008), keep_outs=keep_outs, tag=Tag("aruco:DICT_4X4_50", 3, 0.012))
    plates = {"edge": Substrate(edge=0.02, holes=BORED), "drawing": Substrate(edge=0.0, holes=BORED)}
    # The hole of 8 mm is wider in the outline, that of 3 mm is within a hole of the drawing.
    rough = drawn(0.07, SLOT, circle(0.004, 0.06, -0.05, hole=True), circle(0.003, -0.06, -0.06, hole=True))
    outline = drawn(0.09, circle(0.005, 0.06, -0.05, hole=True), circle(0.002, -0.06, -0.06, hole=True),
                    circle(0.0045, 0.08, 0.0, hole=True))  # fmt: skip
    on_plate = Substrate(outline=outline, holes=BORED)
    ours = [SLOTTED, disk(60, -50, 4), disk(-60, -60, 3)]
    both = [SLOTTED, disk(60, -50, 5), disk(-60, -60, 3), disk(80, 0, 4.5)]
    of_outline = [disk(60, -50, 5), disk(-60, -60, 2), disk(80, 0, 4.5)]
    return {
        "edge": Case(replace(plain, substrate=plates["edge"]), [disk(0, 0, 55)], [disk(0, 0, 75)], MOUNTS, FREE),
        "drawing": Case(
            replace(plain, boundary=rough, substrate=plates["drawing"]),
            [box(-70, -70, 70, 70)], [box(-70, -70, 70, 70)], MOUNTS + ours, FREE,
        ),
        "outline": Case(
            replace(plain, substrate=on_plate), [disk(0, 0, 55)], [box(-90, -90, 90, 90)], MOUNTS + of_outline, FREE,
        ),
        "drawing on outline": Case(
            replace(plain, boundary=rough, substrate=on_plate),
            [box(-70, -70, 70, 70)], [box(-90, -90, 90, 90)], MOUNTS + both, FREE,
        ),
    }  # fmt: skip


NAMES = ["edge", "drawing", "outline", "drawing on outline"]
CUTTER = SheetOptions("A2", colors=parse_colors("black,cut:#ff0000"))


def shape_of(ring: np.ndarray) -> Shape:
    return (shapely.Polygon(ring).area, *shapely.LinearRing(ring).bounds)


def same(results: list[Shape], wanted: list[Shape], off: float = 2e-3) -> None:
    """Contours agree one by one, `off` in mm, and areas accordingly."""
    assert len(results) == len(wanted)
    results, wanted = (np.array(sorted(shapes, key=lambda s: np.round(s, 1).tolist())) for shapes in (results, wanted))
    np.testing.assert_allclose(results[:, 1:], wanted[:, 1:], rtol=0, atol=off)
    np.testing.assert_allclose(results[:, 0], wanted[:, 0], rtol=2 * off)


def of_dxf(data: bytes) -> dict[str, list[Shape]]:
    layers: dict[str, list[Shape]] = {}
    space = ezdxf.read(io.StringIO(data.decode())).modelspace()
    for entity in space.query("CIRCLE LWPOLYLINE"):
        path = ezdxf.path.make_path(entity)
        ring = np.array([(p.x, p.y) for p in path.flattening(1e-4, segments=64)])
        layers.setdefault(entity.dxf.layer, []).append(shape_of(ring))
    return layers


@pytest.mark.parametrize("process", ["fdm", "print", "laser"])
@pytest.mark.parametrize("name", NAMES)
def test_dxf(cases, name, process, tmp_path):
    case = cases[name]
    output = EXPORTERS[".dxf"]([case.marker], ExportOptions(fabrication=Fabrication(process)))
    layers = of_dxf(output.data)
    same(layers["CUT"], case.holes + (case.plate if process == "laser" else case.sheet))
    same(layers["INFO"], case.told)
    assert set(layers) == {"CUT", "ENGRAVE", "INFO"}
    (_, left, low, right, high), message = case.sheet[0], " ".join(output.notes)
    beyond = [hole for hole in case.holes if hole[1] < left or hole[2] < low or hole[3] > right or hole[4] > high]
    assert ("beyond the boundary" in message) == bool(beyond and process != "laser")
    # Holes and keep-outs as large as dots are no dots.
    (tmp_path / "m.dxf").write_bytes(output.data)
    assert verify(case.marker, tmp_path / "m.dxf").findings == ()


ROUND = np.stack([np.cos(ANGLES := np.linspace(0, 2 * np.pi, 2000, endpoint=False)), np.sin(ANGLES)], axis=-1)


def of_svg(data: bytes) -> dict[str, list[tuple[bool, np.ndarray]]]:
    """Lines of each group, y up from the page's top, and whether they are closed."""
    layers: dict[str, list[tuple[bool, np.ndarray]]] = {}
    for group in ElementTree.fromstring(data).iter("{http://www.w3.org/2000/svg}g"):
        for line in group:
            if points := line.get("points"):
                ring = np.array([pair.split(",") for pair in points.split()], dtype=float) * [1, -1]
                layers.setdefault(group.get("id"), []).append((line.tag.endswith("polygon"), ring))
            elif line.get("r") and line.get("fill") == "none":
                x, y, radius = (float(line.get(key)) for key in ("cx", "cy", "r"))
                layers.setdefault(group.get("id"), []).append((True, np.array([x, -y]) + radius * ROUND))
    return layers


def of_pdf(data: bytes) -> dict[str, list[tuple[bool, np.ndarray]]]:
    """Stroked paths of each layer as pdfium reads them, mm, y down from 0 at the page's top."""
    layers: dict[str, list[tuple[bool, np.ndarray]]] = {}
    page = pdfium.PdfDocument(data)[0]
    for thing in page.get_objects(filter=[pdfium.raw.FPDF_PAGEOBJ_PATH]):
        fill, stroke, close = (ctypes.c_int() for _ in range(3))
        pdfium.raw.FPDFPath_GetDrawMode(thing.raw, fill, stroke)
        if not stroke.value:
            continue
        points = []
        for index in range(pdfium.raw.FPDFPath_CountSegments(thing.raw)):
            segment, x, y = pdfium.raw.FPDFPath_GetPathSegment(thing.raw, index), ctypes.c_float(), ctypes.c_float()
            pdfium.raw.FPDFPathSegment_GetPoint(segment, x, y)
            points.append((x.value * MM, y.value * MM - page.get_height() * MM))
            close.value = pdfium.raw.FPDFPathSegment_GetClose(segment)
        layers.setdefault(layer_of(thing), []).append((bool(close.value), np.array(points)))
    return layers


def layer_of(thing) -> str:
    mark, phrase, size = pdfium.raw.FPDFPageObj_GetMark(thing.raw, 0), (ctypes.c_ushort * 40)(), ctypes.c_ulong()
    pdfium.raw.FPDFPageObjMark_GetParamStringValue(mark, b"Name", phrase, 80, size)
    return bytes(phrase)[: size.value - 2].decode("utf-16-le")


@pytest.mark.parametrize(
    ("name", "suffix", "read"),
    [
        pytest.param(name, suffix, read, marks=() if k % 2 == j else pytest.mark.long)
        for k, name in enumerate(NAMES)
        for j, (suffix, read) in enumerate([(".pdf", of_pdf), (".svg", of_svg)])
    ],
)
def test_sheets(cases, name, suffix, read):
    case = cases[name]
    (sheet,) = pages_for([case.marker], CUTTER)
    origin = sheet.origins_mm[0] - np.array([0, sheet.paper.height])
    for options in (CUTTER, replace(CUTTER, colors=parse_colors("black")))[: 1 + (name == NAMES[-1])]:
        layers = read(EXPORTERS[suffix]([case.marker], ExportOptions(options)).data)
        rings = [ring - origin for closed, ring in layers["cut"] if closed]
        # In a cutter's color all lines are whole; hairlines of holes always, that of the boundary outside quiet zones.
        assert len(layers["cut"]) == len(rings) or options is not CUTTER
        same([shape_of(ring) for ring in rings][-len(case.holes) :], case.holes)
        if options is CUTTER:
            same([shape_of(ring) for ring in rings], case.holes + case.sheet)
        # Nothing else is on this layer but the boundary.
        lines = shapely.union_all([shapely.LinearRing(ring) for ring in rings] + [edge_of(case)])
        for _, line in layers["cut"]:
            assert shapely.distance(lines, shapely.points(line - origin)).max() < 2e-3
        # Dashes are on what is kept free and told, all around.
        dashes = [line - origin for closed, line in layers["marks"] if not closed]
        for shape in case.told:
            on = [line for line in dashes if on_edge(line, shape)]
            length = sum(shapely.LineString(line).length for line in on)
            around = np.sqrt(4 * np.pi * shape[0]) if shape is not FREE[2] else 28
            assert 0.5 < length / around < 0.7


def edge_of(case: Case) -> shapely.Geometry:
    area, left, low, right, high = case.sheet[0]
    whole = shapely.box(left, low, right, high)
    return (whole if area > 3.9 * right**2 else shapely.Point(0, 0).buffer(right, quad_segs=4000)).exterior


def on_edge(line: np.ndarray, shape: Shape) -> bool:
    area, left, low, right, high = shape
    if area > 0.9 * (right - left) * (high - low):
        return float(shapely.distance(shapely.box(*shape[1:]).exterior, shapely.points(line)).max()) < 1e-3
    center = (left + right) / 2, (low + high) / 2
    return bool(np.abs(np.hypot(*(line - center).T) - (right - left) / 2).max() < 1e-3)


@pytest.mark.parametrize("name", ["drawing on outline"])
def test_png(cases, name):
    import cv2

    case, per_mm, options = cases[name], 5, replace(CUTTER, paper="A3")
    (sheet,) = pages_for([case.marker], options)
    data = EXPORTERS[".png"]([case.marker], ExportOptions(options, dpi=per_mm * 25.4)).data
    blue, green, red = np.moveaxis(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).astype(int), -1, 0)
    rows, columns = np.nonzero(red - (blue + green) / 2 > 20)
    x, y = sheet.origins_mm[0]
    ink = np.stack([(columns + 0.5) / per_mm - x, sheet.paper.height - y - (rows + 0.5) / per_mm], axis=-1)
    # Of each contour some ink is at its four ends, and all ink is near one of them.
    for _, left, low, right, high in case.holes + case.sheet:
        inside = ink[(ink > [left - 0.3, low - 0.3]).all(axis=1) & (ink < [right + 0.3, high + 0.3]).all(axis=1)]
        assert inside.min(axis=0) == pytest.approx([left, low], abs=0.3)
        assert inside.max(axis=0) == pytest.approx([right, high], abs=0.3)
        ink = ink if right > 60 and left < -60 else ink[~np.isin(ink, inside).all(axis=1)]
    assert (np.abs(np.abs(ink).max(axis=1) - 70) < 0.3).all()


@pytest.mark.parametrize(
    ("suffix", "name"), [*((".stl", name) for name in NAMES), (".3mf", NAMES[-1]), (".glb", NAMES[-1])]
)
def test_meshes(cases, suffix, name):
    """A section of the plate below all pockets, by trimesh."""
    import trimesh

    case = cases[name]
    data = EXPORTERS[suffix]([case.marker], ExportOptions(fabrication=Fabrication(engrave=False))).data
    scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:])
    if suffix == ".glb":  # in m, with y up
        scene.apply_transform(1e3 * np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1e-3]]))
    whole = trimesh.util.concatenate(scene.dump())
    section = whole.section([0, 0, 1], [0, 0, whole.bounds[0, 2] + 0.5])
    same([shape_of(ring[:, :2]) for ring in section.discrete], case.holes + case.plate, 0.02)


@pytest.mark.parametrize(
    ("name", "process"),
    [
        *(pytest.param(name, "fdm", marks=pytest.mark.long) for name in NAMES[:-1]),
        (NAMES[-1], "fdm"),
        (NAMES[-1], "print"),
    ],
)
def test_step(cases, name, process, tmp_path):
    """The lower face of the plate, as Open CASCADE reads the file: its area and the boxes of its wires."""
    from cadquery import Face, importers

    case = cases[name]
    data = EXPORTERS[".step"]([case.marker], ExportOptions(fabrication=Fabrication(process, engrave=False))).data
    (tmp_path / "m.step").write_bytes(data)
    assert process == "print" or verify(case.marker, tmp_path / "m.step").findings == ()
    solids = importers.importStep(str(tmp_path / "m.step")).solids().vals()
    plate = max(solids, key=lambda solid: solid.BoundingBox().xlen)
    (face,) = [face for face in plate.Faces() if face.BoundingBox().zmax < plate.BoundingBox().zmin + 1e-6]
    result = []
    for wire in (face.outerWire(), *face.innerWires()):
        around = wire.BoundingBox(1e-4)
        result.append((Face.makeFromWires(wire).Area(), around.xmin, around.ymin, around.xmax, around.ymax))
    same(result, case.holes + case.plate)
