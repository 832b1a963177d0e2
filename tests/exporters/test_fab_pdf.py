"""The fabrication sheet as whoever makes the marker gets it: looked at as shapes, and read back from the PDF."""

import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium
import pytest

from markergen.drawing.drafting import DARK
from markergen.drawing.paper import SheetOptions
from markergen.drawing.scene import FilledPath, Line, bounds
from markergen.drawing.workshop_pages import fabrication_sheets
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.model.boundary import Circle, Polygon, polygon_from
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import dressed
from markergen.model.marker_json import to_json
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.solid.fabrication_content import workpiece
from markergen.solid.processes import parts_of
from markergen.verification import verify

MM = 25.4 / 72


def ngon(n, radius, heights=0.0):
    angles = 2 * np.pi * np.arange(n) / n + np.pi / 2
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), heights * (np.arange(n) % 3) / 2], axis=-1)


def ring_of_holes(count, radius, diameter, sink=0.0):
    angles = np.pi / count + 2 * np.pi * np.arange(count) / count
    return tuple(Hole(radius * np.cos(a), radius * np.sin(a), diameter, sink, "mount", "M3") for a in angles.tolist())


def case(points, boundary, diameter, tag=None, **substrate):
    marker = dressed(np.asarray(points), boundary, diameter, diameter / 10)
    return replace(
        marker, provenance={"spec_hash": "1a2b3c4d"}, tag=tag, substrate=Substrate(**{"thickness": 0.004, **substrate})
    )


GRID = np.stack(np.meshgrid(np.arange(10) * 0.03 - 0.135, np.arange(6) * 0.03 - 0.075), axis=-1).reshape(-1, 2)
CORNER = [[-0.08, -0.06], [0.08, -0.06], [0.08, -0.02], [-0.04, -0.02], [-0.04, 0.11], [-0.08, 0.11]]
MARKERS = {
    "disk": case(
        ngon(5, 0.13), Circle(0.15), 0.036, Tag("apriltag:36h11", 3, 0.06), holes=ring_of_holes(4, 0.06, 0.0034)
    ),
    "relief": case(
        ngon(12, 0.035, 0.02), Circle(0.045), 0.012, chamfer=0.0005, holes=ring_of_holes(4, 0.02, 0.0034, 0.0067)
    ),
    "many": case(GRID, Polygon((((-0.16, -0.1), (0.16, -0.1), (0.16, 0.1), (-0.16, 0.1)),)), 0.018, corner_radius=0.01),
    "corner": case(
        [[-0.06, -0.04], [0.06, -0.04], [-0.06, 0.09], [-0.02, -0.04]],
        polygon_from([np.array(CORNER)], "file"),
        0.02,
        holes=(Hole(0.03, -0.04, 0.0034, 0.0067, "mount", "M3"),),
    ),
    "small": case(ngon(4, 0.012), Circle(0.015), 0.004),
    "apart": case(
        [[-0.2, 0.0], [0.2, 0.03], [0.2, -0.03], [-0.2, 0.05]],
        Polygon(
            (
                ((-0.25, -0.1), (-0.15, -0.1), (-0.15, 0.1), (-0.25, 0.1)),
                ((0.15, -0.1), (0.25, -0.1), (0.25, 0.1), (0.15, 0.1)),
            )
        ),
        0.02,
    ),
}  # fmt: skip


def sheets_of(marker, options=None, **choices):
    fabrication = Fabrication(**choices)
    made = parts_of(marker, fabrication)
    return fabrication_sheets(workpiece(marker, fabrication, made), options or SheetOptions())


@pytest.fixture(scope="module", params=list(MARKERS))
def sheets(request):
    return MARKERS[request.param], sheets_of(MARKERS[request.param])


def test_all_ink_is_inside_of_the_border(sheets):
    for sheet in sheets[1]:
        boxes = np.array(
            [bounds(shape) for shape in sheet.scene if not (isinstance(shape, FilledPath) and not shape.segments)]
        )
        border = np.array([sheet.paper.width, sheet.paper.height])
        # The border's line is 0.4 mm wide, 12 mm from the edge on A4.
        assert boxes[:, :2].min() > 9.8
        assert (border - boxes[:, 2:]).min() > 9.8


def test_no_two_texts_touch(sheets):
    for sheet in sheets[1]:
        boxes = [(shape, bounds(shape)) for shape in sheet.scene["text"] if shape.segments]
        for (_, a), (_, b) in combinations(boxes, 2):
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)


def test_every_dot_has_its_number_and_every_callout_its_words(sheets):
    marker, (front, *_) = sheets
    names = [shape.name for shape in front.scene["text"]]
    numbers = [name for name in names if name.startswith("number-")]
    assert sorted(numbers) == sorted(f"number-{point.id}" for point in marker.control_points)
    kinds = len({(p.feature.diameter, p.feature.inner_diameter) for p in marker.control_points})
    kinds += len({hole.diameter for hole in marker.substrate.holes}) + (marker.tag is not None)
    assert len([name for name in names if name.startswith("callout-") and name.endswith("-0")]) == kinds


def test_the_front_view_is_true_to_its_scale(sheets):
    marker, (front, *_) = sheets
    scale = float(front.description.split(" on ")[0].rpartition(", ")[2].split(" : ")[0])
    scale /= float(front.description.split(" on ")[0].rpartition(" : ")[2])
    x, y = front.origins_mm[0]
    dark = [
        np.array([p for _, points in shape.segments for p in points])
        for shape in front.scene["drawing"]
        if isinstance(shape, FilledPath) and shape.color == DARK
    ]
    middles = np.array([(points.max(axis=0) + points.min(axis=0)) / 2 for points in dark])
    for point in marker.control_points:
        place = np.array([x + 1e3 * scale * point.x, y + 1e3 * scale * point.y])
        # Polygons within 2 um of their circles.
        assert np.hypot(*(middles - place).T).min() < 4e-3 * max(scale, 1)


def test_leaders_keep_off_dots_where_they_can():
    front = sheets_of(MARKERS["many"])[0]
    words = next(bounds(shape) for shape in front.scene["text"] if shape.name == "callout-1-0")
    runs = [shape.points for shape in front.scene["drawing"] if isinstance(shape, Line) and len(shape.points) == 2]
    (level,) = [
        (a, b) for a, b in runs if a[1] == b[1] and words[1] < a[1] < words[3] and 0 < words[0] - max(a[0], b[0]) < 2
    ]
    # The ring is at one end of a row of ten: its leader runs level between two rows.
    assert abs(level[1][0] - level[0][0]) > 100
    rows = {front.origins_mm[0][1] + 500 * y for y in GRID[:, 1].tolist()}
    assert min(abs(row - level[0][1]) for row in rows) > 4.5


def test_the_paper_is_a4_or_a3_or_what_is_asked_for():
    assert sheets_of(MARKERS["small"])[0].paper.name == "A4-landscape"
    assert sheets_of(MARKERS["disk"])[0].paper.name == "A3-landscape"
    assert {sheet.paper.name for sheet in sheets_of(MARKERS["disk"], SheetOptions("A4"))} <= {"A4", "A4-landscape"}
    assert sheets_of(MARKERS["disk"], SheetOptions("A2-landscape"))[0].paper.name == "A2-landscape"
    assert sheets_of(MARKERS["small"], SheetOptions(orientation="portrait"))[0].paper.name == "A4"
    with pytest.raises(InputError, match="paper that a fabrication sheet fits on"):
        sheets_of(MARKERS["disk"], SheetOptions("100x100mm", margin=0.013))


def test_long_tables_go_on_with_their_headings():
    pages = sheets_of(MARKERS["many"])
    headings = [
        shape.name
        for sheet in pages
        for shape in sheet.scene["text"]
        if shape.name.startswith("heading-Control points")
    ]
    assert len(headings) == 2


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
        assert not list(page.get_objects(filter=[pdfium.FPDF_PAGEOBJ_TEXT])), "text as outlines"
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
    assert int(done.stdout) > 50_000
