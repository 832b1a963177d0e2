"""The fabrication sheet as whoever makes the marker gets it, read back from the PDF by another program."""

import re
import subprocess
import sys
from itertools import combinations

import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium
import pytest
from workpieces import MARKERS, case, described, ngon

from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.model.body_json import to_json
from markergen.model.boundary import Circle, Polygon
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Hole, parse_dowel
from markergen.model.tag import Tag
from markergen.verification import verify
from markergen.workshop.formats.fab_pdf import write_fabrication_sheet
from tests.support.rigs import cube

MM = 25.4 / 72


def plain(phrase):
    """Words without the blanks between them, which lines that break do not keep."""
    return re.sub(r"\s", "", phrase)


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=[pytest.mark.long] * (name in ("relief", "many"))) for name in MARKERS],
)
def sheet(request):
    work = described(MARKERS[request.param])
    data, _ = write_fabrication_sheet(work, SheetOptions())
    document = pypdfium2.PdfDocument(data)
    yield work, data, document
    document.close()


def said(document):
    return plain("".join(page.get_textpage().get_text_range() for page in document))


def assert_apart(page):
    boxes = [text.get_bounds() for text in page.get_objects(filter=[pdfium.FPDF_PAGEOBJ_TEXT])]
    assert len(boxes) > 10
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)


def test_all_ink_is_inside_of_the_border(sheet):
    for page in sheet[2]:
        boxes = MM * np.array([get_object.get_bounds() for get_object in page.get_objects()])
        # The border's line is 0.4 mm wide, 12 mm from the edge on A4.
        assert boxes[:, :2].min() > 9.8
        assert (MM * np.array(page.get_size()) - boxes[:, 2:]).min() > 9.8


def test_it_is_printed_to_scale(sheet):
    assert not pdfium.FPDF_VIEWERREF_GetPrintScaling(sheet[2].raw)


def test_no_two_texts_touch(sheet):
    for page in sheet[2]:
        assert_apart(page)


def test_all_that_the_drawing_says_can_be_searched(sheet):
    work, _, document = sheet
    result = said(document)
    spans = [*work.heights, *(span for section in work.sections for span in (*section.across, *section.upright))]
    phrase = [
        work.block.name, work.block.title, work.block.process, work.block.general, work.block.finish, *work.notes,
        *(span.text for span in spans), *(label.name for label in work.labels), *(phrase for _, phrase in work.key),
        *(part for callout in work.callouts for line in callout.lines for part in re.split(r"[\[\]]", line)),
        *(section.title for section in work.sections), *(line for text in work.engraved for line in text.lines),
        *(control.zone for callout in work.callouts for control in callout.controls),
    ]  # fmt: skip
    assert [word for word in phrase if plain(word) not in result] == []
    for table in work.tables:
        assert plain(table.title) in result
        assert plain("".join(table.headings)) in result
        narrow = [row for row in table.rows if plain("".join(row)) not in result]
        # Only words that are too wide for their column are on several lines.
        assert all(plain(cell)[:9] in result for row in narrow for cell in row)
        assert len(narrow) <= 1
    assert f"1of{len(document)}" in result
    assert f"{len(document)}of{len(document)}" in result


def test_no_title_stands_without_what_it_is_of(sheet):
    work, _, document = sheet
    for page in document:
        results = plain(page.get_textpage().get_text_range())
        for table in work.tables:
            # PDFium reads a row of the next column between the two if it is as high on the page.
            head = re.escape(plain(table.title)) + r"(\(\dof\d\))?.{0,60}?" + re.escape(plain("".join(table.headings)))
            assert results.count(plain(table.title)) == len(re.findall(head, results))
            rows = [plain(row[0]) for row in table.rows]
            for begin in (match.end() for match in re.finditer(head, results)):
                assert any(results[begin:].startswith(row) for row in rows), table.title
    for table in work.tables:
        if len(table.rows) <= 12:
            assert said(document).count(plain(table.title)) == 1


@pytest.mark.parametrize(("radius", "beside"), [(0.08, True), (0.14, False)])
def test_the_first_page_has_tables_where_there_is_room_beside_its_views(radius, beside):
    # On A3 at 1 : 2, the views of 0.32 m leave less than a column, those of 0.2 m more.
    work = described(case(ngon(8, radius), Circle(radius + 0.02), 0.03))
    document = pypdfium2.PdfDocument(write_fabrication_sheet(work, SheetOptions())[0])
    pages = [plain(page.get_textpage().get_text_range()) for page in document]
    assert ["Centersofthedots" in page for page in pages] == [beside, not beside]
    assert ["Notes" in page for page in pages] == [False, True]
    document.close()


UPRIGHT = Polygon((((-0.089, -0.105), (0.089, -0.105), (0.089, 0.105), (-0.089, 0.105)),))


@pytest.mark.parametrize(
    ("boundary", "radius"),
    [(Circle(0.06), 0.04), (Circle(0.1), 0.08), (Circle(0.16), 0.14), (UPRIGHT, 0.07)],
    ids=["small", "middle", "large", "upright"],
)
def test_the_last_page_is_not_half_empty(boundary, radius):
    # Of 24 parts above the title block, three across, more than 15 have ink.
    data, _ = write_fabrication_sheet(described(case(ngon(5, radius), boundary, 0.03)), SheetOptions())
    document = pypdfium2.PdfDocument(data)
    dark = np.asarray(document[len(document) - 1].render(scale=0.5, grayscale=True).to_pil()) < 128
    inside = dark[int(0.06 * len(dark)) : int(0.88 * len(dark)), int(0.05 * dark.shape[1]) : int(0.95 * dark.shape[1])]
    parts = [part for row in np.array_split(inside, 8) for part in np.array_split(row, 3, axis=1)]
    assert sum(bool(part.any()) for part in parts) > 15
    document.close()


def test_a_title_that_is_wider_than_its_column_wraps():
    marker = case(FLAT, RECT, 0.01, Tag("aruco:DICT_ARUCO_MIP_36H12", 0, 0.03))
    document = pypdfium2.PdfDocument(write_fabrication_sheet(described(marker), SheetOptions())[0])
    assert "Cornersoftheblacksquareofaruco:DICT_ARUCO_MIP_36H12:0,mm" in said(document)
    for page in document:
        assert_apart(page)
    document.close()


def test_no_two_texts_of_a_rigs_tables_touch():
    document = pypdfium2.PdfDocument(EXPORTERS[".fab.pdf"](cube(0.08), ExportOptions()).data)
    for page in list(document)[1:]:
        assert_apart(page)
    document.close()


@pytest.mark.long
def test_a_long_table_is_in_even_pieces_and_no_page_is_nearly_empty():
    work = described(MARKERS["many"])
    document = pypdfium2.PdfDocument(write_fabrication_sheet(work, SheetOptions())[0])
    result = said(document)
    for number in (1, 2):
        assert f"Centersofthedots,mm,theoreticallyexact({number}of2)idxyzdiameterinner" in result
    for page in document:
        boxes = [get_object.get_bounds() for get_object in page.get_objects(filter=[pdfium.FPDF_PAGEOBJ_TEXT])]
        # Above the title block: words over more than a third of the height.
        lows = [box[1] for box in boxes if box[1] > 0.15 * page.get_height()]
        assert max(lows) - min(lows) > page.get_height() / 3
    document.close()


RECT = Polygon((((-0.1, -0.05), (0.1, -0.05), (0.1, 0.05), (-0.1, 0.05)),))
FLAT, HIGH = ngon(5, 0.04), ngon(5, 0.04, 0.02)
SCREWS, PINS = (Hole(0.02, -0.02, 0.0034, 0.00672, "mount", "M3"),), parse_dowel("2x4mm@60mm")
EVERYWHERE = (
    "legal owner", "identification number", "revision", "date of issue", "approved by", "checked by", "material",
    "ISO 2768-mK", "surface finish", "edges", "first angle", "sheet", "Datums", "flatness", "thickness of the plate",
    "theoretically exact", "face with the dots", "Key", "Engrave the back 0.3 mm deep",
)  # fmt: skip
SAID = [
    (RECT, FLAT, SCREWS, {"process": "fdm"},
     ("204", "104", "[102]", "[52]", "lower edge", "y=-52", "left edge", "x=-102", "4 \xb10.2", "\xd80.2ABC",
      "H1 at x[20], y[-20]", "\xd83.4 H13 (+0.180 / 0)", "countersunk \xd86.72 x 90\xb0", "as printed, matte")),
    (RECT, FLAT, PINS, {"process": "cnc"},
     ("\xd84 H7 (+0.012 / 0)", "\xd80.04AB", "\xd80.04A", "h7 (0 / -0.015)", "F8 (+0.035 / +0.013)", "Ra 1.6",
      "position \xd80.04", "finished dots to A, B, C", "1 +0.03 / 0", "thickness of inlays", "\xd810 h7", "f7", "9.985",
      "off by at most", "Ream or bore")),
    (Circle(0.06), HIGH, SCREWS, {"process": "cnc", "draft": 0.05, "foot": 0.002},
     ("\xd8124", "rim \xd8124", "20 \xb10.03", "tops of pillars above A", "Pillars, mm", "2.865\xb0", "R2", "hole H1")),
    (Circle(0.06), FLAT, (), {"process": "cnc", "fit": "press"},
     ("\xd810 P7/h6", "P7", ["-0.024", "-0.009"][0], "p6", "CZ", "one pattern")),
    (Circle(0.06), FLAT, (), {"process": "cnc", "through": True}, ("4x \xd810 \xb10.05 through", "rim \xd8124")),
    (RECT, FLAT, SCREWS, {"process": "laser"}, ("0.1 max.", "\xd80.1ABC", "\xd810 \xb10.1", "dark surface (engraved)")),
    (RECT, FLAT, SCREWS, {"process": "print"},
     ("recess 200.4 x 100.4 +0.2 / 0", "0.2 +0.05 / 0 deep", "0.2ABC", "4x \xd810 printed")),
    (Circle(0.06), FLAT, (), {"process": "dome"}, ("4x S\xd810 \xb10.02", "S\xd80.04 CZ", "\xd85 \xb10.02 pocket")),
    (Circle(0.06), FLAT, (), {"process": "dome", "dome": "ball"}, ("7.5 \xb10.03", "z = -7.5")),
    (Circle(0.06), FLAT, (), {"material": "EN AW-5083", "general_tolerance": "ISO 22081"}, ("EN AW-5083", "ISO 22081")),
]  # fmt: skip


@pytest.mark.parametrize(("boundary", "points", "holes", "choices", "phrase"), SAID)
def test_whoever_makes_it_need_not_ask(boundary, points, holes, choices, phrase):
    marker = case(points, boundary, 0.01, holes=holes)
    output = EXPORTERS[".fab.pdf"]([marker], ExportOptions(fabrication=Fabrication(**choices)))
    document = pypdfium2.PdfDocument(output.data)
    result = said(document)
    document.close()
    wanted = (*EVERYWHERE, *phrase)
    if "general_tolerance" in choices:
        wanted = tuple(item for item in wanted if item != "ISO 2768-mK")
    assert [item for item in wanted if re.sub(r"[\s\[\]]", "", item) not in result] == []
    # Dots are where the table says.
    for point in marker.control_points:
        assert (
            plain(f"{point.x * 1e3 + 0:.4f} {point.y * 1e3 + 0:.4f} {point.z * 1e3:.4f}").replace("-0.0000", "0.0000")
            in result
        )


def test_fonts_are_embedded(sheet):
    data = sheet[1]
    assert b"Helvetica" not in data
    fonts = re.findall(rb"/BaseFont /(\S+)", data)
    assert {font.partition(b"+")[2] for font in fonts} == {b"BitstreamVeraSans-Roman", b"BitstreamVeraSans-Bold"}
    assert data.count(b"/FontFile2") == len(fonts)


def test_the_bytes_are_the_same_every_time_and_without_a_cad_kernel():
    script = (
        "import sys\n"
        "sys.modules['cadquery'] = sys.modules['OCP'] = None\n"
        "from markergen.exporters import EXPORTERS, ExportOptions\n"
        "from markergen.model.body_json import from_json\n"
        "sys.stdout.buffer.write(EXPORTERS['.fab.pdf']([from_json(sys.stdin.read())], ExportOptions()).data)\n"
    )
    command, text = [sys.executable, "-c", script], to_json(MARKERS["small"])
    again = subprocess.run(command, input=text, capture_output=True, check=True).stdout
    assert EXPORTERS[".fab.pdf"]([MARKERS["small"]], ExportOptions()).data == again


@pytest.mark.long
def test_pages_are_read_by_another_program():
    marker = MARKERS["disk"]
    output = EXPORTERS[".fab.pdf"]([marker], ExportOptions())
    document = pypdfium2.PdfDocument(output.data)
    assert document.get_metadata_dict()["Title"] == "markergen-1a2b3c4d"
    assert "1 : 2" in document.get_metadata_dict()["Subject"]
    assert f"{len(document)} pages" in output.notes[0]
    for page in document:
        width, height = page.get_size()
        assert (width * MM, height * MM) == pytest.approx((420, 297), abs=1e-3)
        grey = page.render(scale=0.5, grayscale=True).to_numpy()
        assert 0.001 < np.mean(grey < 128) < 0.2
    document.close()


def test_verify_says_that_it_is_no_artefact(tmp_path):
    path = tmp_path / "m.fab.pdf"
    path.write_bytes(EXPORTERS[".fab.pdf"]([MARKERS["small"]], ExportOptions()).data)
    with pytest.raises(InputError, match="drawing to scale"):
        verify(MARKERS["small"], path)
