import re
import zlib
from dataclasses import replace

import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.drawing.paper import Paper
from markergen.drawing.scene import Disk, Layer, Line, Scene, polygon
from markergen.drawing.sheet_layout import sheet_for
from markergen.errors import InputError
from markergen.exporters.formats.sheets import write_pdf
from markergen.exporters.pdf_canvas import _circle

DPI = 600
MM = 25.4 / DPI


@pytest.fixture(
    scope="module", params=[(5, 0.15, 0.036), (12, 0.08, 0.02), (5, 0.04, 0.012)], ids=["n5", "n12", "small"]
)
def case(make_ngon, request):
    marker = make_ngon(*request.param)
    sheet = sheet_for(marker)
    data = write_pdf([sheet])
    document = pypdfium2.PdfDocument(data)
    page = document[0].render(scale=DPI / 72, grayscale=True).to_numpy().squeeze()
    document.close()
    return marker, sheet, data, 255 - page


def centroid(ink: np.ndarray, height: float, x: float, y: float, half: float) -> tuple[float, float]:
    """Grey-level center of gravity in page mm, y up, of the ink within `half` mm of (x, y)."""
    row, column = (height - y) / MM, x / MM
    rows = np.arange(max(int(row - half / MM), 0), min(int(row + half / MM) + 1, ink.shape[0]))
    columns = np.arange(max(int(column - half / MM), 0), min(int(column + half / MM) + 1, ink.shape[1]))
    patch = ink[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(float)
    total = patch.sum()
    # The middle of a pixel is half a pixel from its edge, and the page is measured from edges.
    return (
        float((patch.sum(axis=0) @ (columns + 0.5)) / total * MM),
        height - float((patch.sum(axis=1) @ (rows + 0.5)) / total * MM),
    )


def stretch(ink: np.ndarray, sheet) -> np.ndarray:
    """By how much (x, y) the raster is larger than the page: pdfium draws it onto a whole number of pixels."""
    factor = np.array(ink.shape[::-1]) * MM / [sheet.paper.width, sheet.paper.height]
    assert np.all(np.abs(factor - 1) < 1 / min(ink.shape))
    return factor


def test_every_dot_is_within_5_um_of_the_marker(case):
    marker, sheet, _, ink = case
    factor = stretch(ink, sheet)
    worst = 0.0
    for point in marker.control_points:
        true = np.array([sheet.origins_mm[0][0] + point.x * 1e3, sheet.origins_mm[0][1] + point.y * 1e3])
        # Half the quiet zone more than the dot: nothing else can be in the window.
        half = 0.7 * point.feature.diameter * 1e3
        result = np.array(centroid(ink, ink.shape[0] * MM, *(true * factor), half)) / factor
        worst = max(worst, float(np.hypot(*(result - true))))
    assert worst < 5e-3


def test_ruler_is_true_to_10_um(case):
    _, sheet, _, ink = case
    factor = stretch(ink, sheet)
    # The outermost ticks that no number stands beside.
    first, last, ends = 10, sheet.rulers_mm[0] - 10, {}
    for mm in (first, last):
        line = next(shape for shape in sheet.scene if shape.name == f"ruler-{mm}")
        (x, y0), (_, y1) = line.points
        # The middle of the tick alone, clear of the base line.
        middle = np.array([x, y0 + 0.6 * (y1 - y0)]) * factor
        ends[mm] = centroid(ink, ink.shape[0] * MM, *middle, 0.3 * (y1 - y0))[0] / factor[0]
    assert abs(ends[last] - ends[first] - (last - first)) < 10e-3


def test_ring_has_a_hole_and_dots_have_none(case):
    marker, sheet, _, ink = case
    for point in marker.control_points:
        x, y = sheet.origins_mm[0][0] + point.x * 1e3, sheet.origins_mm[0][1] + point.y * 1e3
        value = ink[round((sheet.paper.height - y) / MM), round(x / MM)]
        assert value == (0 if point.feature.kind == "ring" else 255)


def test_page_has_the_exact_size_of_the_paper(case):
    _, sheet, data, _ = case
    document = pypdfium2.PdfDocument(data)
    size = document[0].get_size()
    assert len(document) == 1
    document.close()
    # pdfium holds sizes as 32-bit floats.
    assert size == pytest.approx((sheet.paper.width * 72 / 25.4, sheet.paper.height * 72 / 25.4), rel=1e-6)


def test_metadata_and_no_font_at_all(case):
    _, sheet, data, _ = case
    document = pypdfium2.PdfDocument(data)
    info = document.get_metadata_dict()
    document.close()
    assert info["Title"] == sheet.title
    assert info["Subject"] == sheet.description
    assert info["Author"] == "markergen"
    assert "print at 100 %" in info["Keywords"]
    assert b"Helvetica" not in data
    assert b"/BaseFont" not in data
    assert not re.search(r"\b(BT|Tf|Tj|TJ)\b", page_streams(data)[0])


def test_it_is_printed_at_true_size_on_one_side(case):
    """pdfium's print preview, which is Chrome's, goes by these."""
    document = pypdfium2.PdfDocument(case[2])
    assert not pdfium.FPDF_VIEWERREF_GetPrintScaling(document.raw)
    assert pdfium.FPDF_VIEWERREF_GetDuplex(document.raw) == pdfium.Simplex
    document.close()
    assert "/PickTrayByPDFSize true" in objects(case[2])


def objects(data: bytes) -> str:
    """Everything but the streams."""
    return re.sub(rb"stream\r?\n.*?endstream", b"", data, flags=re.DOTALL).decode("latin-1")


def page_streams(data: bytes) -> list[str]:
    results = re.findall(rb"/FlateDecode.*?stream\r?\n(.*?)endstream", data, re.DOTALL)
    return [zlib.decompressobj().decompress(stream).decode() for stream in results]


def test_layers_are_optional_content_in_painting_order(case):
    _, sheet, data, _ = case
    names = [layer.name for layer in sheet.scene.layers]
    (drawing,) = page_streams(data)
    assert re.findall(r"/OC /layer-(\w+) BDC", drawing) == names
    assert drawing.count("BDC") == drawing.count("EMC") == len(names)
    text = objects(data)
    groups = dict(re.findall(r"(\d+) 0 obj\s*<<\s*/Name \((\w+)\) /Type /OCG", text))
    assert list(groups.values()) == names
    listed = " ".join(f"{number} 0 R" for number in groups)
    assert f"/OCGs [ {listed} ]" in text
    assert f"/ON [ {listed} ]" in text
    for number, name in groups.items():
        assert f"/layer-{name} {number} 0 R" in text
    assert data.startswith(b"%PDF-1.7")


def boxed(sheet, paper: Paper, trim, color: str = "#ff0000"):
    square = Line(((20, 20), (60, 20), (60, 50), (20, 50), (20, 20)), 0.5, "edge", color)
    ground = polygon(((0, 0), (80, 0), (80, 80), (0, 80)), "ground", "#ffee00")
    scene = Scene((Layer("ground", (ground,)), Layer("dots", (Disk(40, 35, 5),)), Layer("cut", (square,))))
    return replace(sheet, paper=paper, trim_mm=trim, scene=scene)


def test_pages_have_sizes_and_trim_boxes_of_their_own(case):
    _, sheet, _, _ = case
    sheets = [
        boxed(sheet, Paper("first", 100, 90), (5, 6, 95, 80)),
        boxed(sheet, Paper("second", 120, 200), (0, 0, 120, 200)),
    ]
    document = pypdfium2.PdfDocument(write_pdf(sheets))
    for page, expected in zip(document, sheets, strict=True):
        # reportlab writes boxes with seven digits, pdfium holds them as 32-bit floats.
        size = np.array(page.get_size()) / 72 * 25.4
        np.testing.assert_allclose(size, [expected.paper.width, expected.paper.height], atol=1e-4)
        np.testing.assert_allclose(np.array(page.get_trimbox()) / 72 * 25.4, expected.trim_mm, atol=1e-4)
    document.close()


def test_a_spot_color_is_a_separation_that_overprints(case):
    _, sheet, _, _ = case
    paper, trim = Paper("small", 80, 80), (0, 0, 80, 80)
    data = write_pdf([boxed(sheet, paper, trim, "Thru-cut 1=#ff00ff")])
    text = objects(data)
    assert re.search(r"/Separation /Thru-cut#201 /DeviceCMYK \d+ 0 R", text)
    assert "/OP true" in text
    (drawing,) = page_streams(data)
    assert re.search(r"/Thru-cut#201 CS 1(\.0*)? SCN", drawing)
    plain = write_pdf([boxed(sheet, paper, trim)])
    assert "/Separation" not in objects(plain)
    assert "/OP true" not in objects(plain)
    # pdfium blends nothing: the line looks magenta where it lies.
    document = pypdfium2.PdfDocument(data)
    image = document[0].render(scale=300 / 72).to_numpy()
    document.close()
    blue, green, red = image[-round(20 / 25.4 * 300), round(40 / 25.4 * 300)]
    assert (red > 200, green < 60) == (True, True)
    assert blue > 100


def test_a_closed_line_has_no_notch_at_its_corner(case):
    _, sheet, _, _ = case
    document = pypdfium2.PdfDocument(write_pdf([boxed(sheet, Paper("small", 80, 80), (0, 0, 80, 80))]))
    image = document[0].render(scale=600 / 72).to_numpy()
    document.close()
    outside = 0.15  # of the corner, on its miter: the line is 0.5 mm wide
    blue, green, red = image[-round((20 - outside) / MM), round((20 - outside) / MM)]
    assert (int(red), int(green), int(blue)) == (255, 0, 0)


def test_a_page_beyond_what_readers_hold_is_refused(case):
    _, sheet, _, _ = case
    with pytest.raises(InputError, match="5080 mm"):
        write_pdf([boxed(sheet, Paper("long", 100, 5090), (0, 0, 100, 5090))])


@given(st.floats(-500, 500), st.floats(-500, 500), st.floats(0.1, 400))
def test_circles_of_bezier_arcs_are_round(x, y, radius):
    segments = _circle(x, y, radius)
    here = np.array(segments[0][1][0])
    t = np.linspace(0, 1, 21)[:, None]
    arcs = 0
    for command, points in segments[1:]:
        if command == "C":
            a, b, c = map(np.array, points)
            curve = (1 - t) ** 3 * here + 3 * (1 - t) ** 2 * t * a + 3 * (1 - t) * t**2 * b + t**3 * c
            # 7e-8 of the radius is the largest error of a sixteenth of a circle.
            assert np.max(np.abs(np.hypot(*(curve - [x, y]).T) / radius - 1)) < 1e-7
            here, arcs = c, arcs + 1
    assert arcs >= 8
    np.testing.assert_allclose(here, segments[0][1][0], atol=1e-9)
