"""The fabrication sheet as whoever makes the marker gets it, read back from the PDF by another program."""

import re
import subprocess
import sys
from itertools import combinations

import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium
import pytest
from workpieces import MARKERS, described

from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.exporters.fab_pdf import write_fabrication_sheet
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker_json import to_json
from markergen.verification import verify

MM = 25.4 / 72


def plain(words):
    """Words without the blanks between them, which lines that break do not keep."""
    return re.sub(r"\s", "", words)


@pytest.fixture(scope="module", params=list(MARKERS))
def sheet(request):
    work = described(MARKERS[request.param])
    data, _ = write_fabrication_sheet(work, SheetOptions())
    document = pypdfium2.PdfDocument(data)
    yield work, data, document
    document.close()


def said(document):
    return plain("".join(page.get_textpage().get_text_range() for page in document))


def test_all_ink_is_inside_of_the_border(sheet):
    for page in sheet[2]:
        boxes = MM * np.array([each.get_bounds() for each in page.get_objects()])
        # The border's line is 0.4 mm wide, 12 mm from the edge on A4.
        assert boxes[:, :2].min() > 9.8
        assert (MM * np.array(page.get_size()) - boxes[:, 2:]).min() > 9.8


def test_it_is_printed_to_scale(sheet):
    assert not pdfium.FPDF_VIEWERREF_GetPrintScaling(sheet[2].raw)


def test_no_two_texts_touch(sheet):
    for page in sheet[2]:
        boxes = [each.get_bounds() for each in page.get_objects(filter=[pdfium.FPDF_PAGEOBJ_TEXT])]
        assert len(boxes) > 10
        for a, b in combinations(boxes, 2):
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)


def test_all_that_the_drawing_says_can_be_searched(sheet):
    work, _, document = sheet
    found = said(document)
    spans = [*work.heights, *(span for section in work.sections for span in (*section.across, *section.upright))]
    words = [
        work.name, work.title, work.process, work.materials, *work.notes, *(span.words for span in spans),
        *(line for callout in work.callouts for line in callout.lines), *(label.words for label in work.labels),
        *(section.title for section in work.sections),
    ]  # fmt: skip
    assert [each for each in words if plain(each) not in found] == []
    for table in work.tables:
        assert plain(table.title + "".join(table.headings)) in found
        narrow = [row for row in table.rows if plain("".join(row)) not in found]
        # Only words that are too wide for their column are on several lines.
        assert all(plain(cell)[:9] in found for row in narrow for cell in row)
        assert len(narrow) <= 1
    assert f"1of{len(document)}" in found
    assert f"{len(document)}of{len(document)}" in found


def test_no_title_stands_without_what_it_is_of(sheet):
    work, _, document = sheet
    for page in document:
        found = plain(page.get_textpage().get_text_range())
        for table in work.tables:
            head = plain(table.title + "".join(table.headings))
            assert found.count(plain(table.title)) == found.count(head)
            rows = [plain(row[0]) for row in table.rows]
            for begin in (match.end() for match in re.finditer(re.escape(head), found)):
                assert any(found[begin:].startswith(row) for row in rows), table.title
    for table in work.tables:
        if len(table.rows) <= 12:
            assert said(document).count(plain(table.title)) == 1


def test_long_tables_go_on_with_their_headings():
    document = pypdfium2.PdfDocument(write_fabrication_sheet(described(MARKERS["many"]), SheetOptions())[0])
    found = said(document)
    document.close()
    assert found.count("Controlpoints:centersofthedots,mm" + "idxyzdiameterinner") == 2


def test_fonts_are_embedded(sheet):
    data = sheet[1]
    assert b"Helvetica" not in data
    fonts = re.findall(rb"/BaseFont /(\S+)", data)
    assert {font.partition(b"+")[2] for font in fonts} == {b"BitstreamVeraSans-Roman", b"BitstreamVeraSans-Bold"}
    assert data.count(b"/FontFile2") == len(fonts)


def test_the_bytes_are_the_same_every_time():
    script = (
        "import sys\n"
        "from markergen.exporters import EXPORTERS, ExportOptions\n"
        "from markergen.model.marker_json import from_json\n"
        "sys.stdout.buffer.write(EXPORTERS['.fab.pdf']([from_json(sys.stdin.read())], ExportOptions()).data)\n"
    )
    command, text = [sys.executable, "-c", script], to_json(MARKERS["small"])
    again = subprocess.run(command, input=text, capture_output=True, check=True).stdout
    assert EXPORTERS[".fab.pdf"]([MARKERS["small"]], ExportOptions()).data == again


@pytest.mark.parametrize("process", list(PROCESSES))
def test_pages_are_read_by_another_program(process):
    marker = MARKERS["disk"]
    output = EXPORTERS[".fab.pdf"]([marker], ExportOptions(fabrication=Fabrication(process=process)))
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
    with pytest.raises(InputError, match="a drawing to scale; verify the solid"):
        verify(MARKERS["small"], path)


def test_no_cad_kernel_is_needed():
    script = (
        "import sys\n"
        "sys.modules['cadquery'] = sys.modules['OCP'] = None\n"
        "from markergen.exporters import EXPORTERS, ExportOptions\n"
        "from markergen.model.marker_json import from_json\n"
        "data = EXPORTERS['.fab.pdf']([from_json(sys.stdin.read())], ExportOptions()).data\n"
        "sys.stdout.write(str(len(data)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], input=to_json(MARKERS["small"]), capture_output=True, check=True
    )
    assert int(done.stdout) > 30_000
