"""The fabrication sheets of a rig: what they say, and where."""

from dataclasses import replace

import numpy as np
import pypdfium2
import pytest

import markergen as mg
from markergen.drawing.paper import SheetOptions
from markergen.drawing.scene import Line, bounds
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.maths.rotation import exponential
from markergen.model.fabrication import Fabrication
from markergen.model.marker import build_marker
from markergen.model.tag import Tag
from markergen.workshop.assembly import made_of
from markergen.workshop.drafting.drawing import around
from markergen.workshop.drafting.pen import Lettering
from markergen.workshop.drafting.rig_drawing import face_works, rig_page, rig_work
from markergen.workshop.formats import fab_pdf
from tests.support.rigs import cube, mounted, plate, rectangle, wall
from tests.workshop.test_assembly import prism

FDM = Fabrication()


def work_of(rig):
    return rig_work(rig, FDM, made_of(rig, FDM))


@pytest.fixture(scope="module")
def pages():
    document = pypdfium2.PdfDocument(EXPORTERS[".fab.pdf"](cube(0.08), ExportOptions()).data)
    return [page.get_textpage().get_text_range() for page in document]


@pytest.mark.long
def test_the_first_sheets_are_of_the_whole_and_the_others_of_the_faces(pages):
    assert "seen from a corner" in pages[0]
    assert f"1 of {len(pages)}" in pages[0]
    assert "of the faces, mm" in pages[1]
    assert "parallelism 0.3 to R" in pages[1]
    # What is the same of all faces stands once, and then each has one sheet.
    assert "Tolerances, mm, of each face" in "".join(pages[1:-6])
    assert "".join(pages).count("Key") == 1
    for k, page in enumerate(pages[-6:]):
        assert f"plate {k}: Fiducial marker" in page
        assert f"plate {k}: Centers of the dots" in "".join(pages[1:-6])
    assert not any("Print face down" in page or "thickness of" in page for page in pages)


def test_the_six_views_of_a_cube_show_its_faces_and_their_tolerances():
    views = {view.place: view for view in work_of(cube(0.08)).views}
    assert set(views) == {"main", "+u", "-u", "+v", "-v", "rear"}
    seen = [name for view in views.values() for name in view.names]
    assert sorted(name.text for name in seen) == [f"plate {k}" for k in range(6)]
    assert sorted(name.datum for name in seen if name.datum) == ["R", "S", "T"]
    symbols = sorted(name.controls[0].symbol for name in seen)
    assert symbols == ["flatness", "parallelism", *["perpendicularity"] * 4]
    for view in views.values():
        np.testing.assert_allclose(around(view.faces), [-40, -40, 40, 40], atol=1e-9)


def test_a_face_of_a_cube_is_seen_from_where_its_view_says():
    rig = cube(0.08)
    for view in work_of(rig).views:
        sign, axis = view.text[-2:]
        [marker] = [
            marker
            for marker in rig.markers
            if marker.rotation_matrix[:, 2]["xyz".index(axis)] == (1 if sign == "+" else -1)
        ]
        assert [name.text for name in view.names] == [marker.name]
        dots = [face for face in view.faces if face.material == "dark"]
        right, up = (
            (-1 if way.startswith("-") else 1) * np.eye(3)["xyz".index(way[-1])] for way in view.axes
        )  # fmt: skip
        wanted = [(1e3 * marker.to_body(xyz) @ right, 1e3 * marker.to_body(xyz) @ up) for xyz in marker.marker.xyz]
        result = [((face.box[0] + face.box[2]) / 2, (face.box[1] + face.box[3]) / 2) for face in dots]
        np.testing.assert_allclose(result, wanted, atol=1e-9)
        # Seen from the front a face is not mirrored.
        assert np.cross(right, up) @ marker.rotation_matrix[:, 2] == pytest.approx(1)


def test_datums_of_a_prism_are_two_sides_and_an_end():
    work = work_of(prism())
    [datums] = [table for table in work.tables if table.title == "Datums of the whole"]
    assert [row[:2] for row in datums.rows] == [("R", "face plate 0"), ("S", "bare side"), ("T", "face plate 1")]
    [relation] = [table for table in work.tables if table.title.startswith("Relation")]
    assert dict(row[:2] for row in relation.rows)["plate 2"] == "angularity 0.3 to R, [120\xb0]"


def test_the_table_of_faces_is_the_pose_of_each():
    rig = prism()
    for marker, row in zip(rig.markers, work_of(rig).tables[0].rows, strict=True):
        np.testing.assert_allclose([float(word) for word in row[1:4]], 1e3 * marker.translation_vector, atol=6e-5)
        axes = [[float(word) for word in cell.strip("()").split(",")] for cell in row[4:]]
        np.testing.assert_allclose(np.transpose(axes), marker.rotation_matrix, atol=6e-7)


def test_the_face_of_a_block_is_drawn_with_the_block_behind_it():
    rig = prism()
    for work in face_works(rig, FDM, made_of(rig, FDM)):
        left, bottom, right, top = around(work.side)
        assert (right - left, top - bottom) == pytest.approx((120, 60 * np.sqrt(3)))
        assert top == pytest.approx(0, abs=1e-9)
        assert work.size == (60, 100)


def test_a_wall_has_no_tolerances_of_its_own():
    work = work_of(wall(columns=2, rows=1))
    assert len(work.tables) == 1
    assert any("calibrate" in note for note in work.notes)
    assert work.sizes == ("(214)", "(84)", "(3)")


def test_the_command_that_measures_plates_names_the_file_of_the_rig():
    rig = wall(columns=2, rows=1)
    made, commands = made_of(rig, FDM), []
    for record in ("", "my wall.json", "\u677f.json"):
        (note,) = (note for note in rig_work(rig, FDM, made, record).notes if "calibrate" in note)
        commands.append(note.rpartition(" with ")[2])
    assert commands == ["markergen calibrate.", "markergen calibrate 'my wall.json' photos/.", "markergen calibrate."]


def test_exports_of_a_rig_name_its_file(tmp_path, monkeypatch):
    records = []
    monkeypatch.setattr(fab_pdf, "rig_work", lambda *args: records.append(args[3:]) or rig_work(*args))
    rig = wall(columns=2, rows=1)
    rig.save(tmp_path / "panel.json", tmp_path / "first.fab.pdf")
    mg.export(tmp_path / "panel.json", tmp_path / "second.fab.pdf")
    rig.save(tmp_path / "third.fab.pdf")
    assert records == [("panel.json",), ("panel.json",), ("",)]


@pytest.mark.parametrize("make", [cube, prism, wall])
@pytest.mark.parametrize("paper", [None, pytest.param("letter", marks=pytest.mark.long)])
def test_nothing_leaves_the_first_sheet(make, paper):
    page = rig_page(work_of(make()), SheetOptions(paper=paper))
    boxes = np.array([bounds(shape) for shape in page.shapes])
    frame = page.frame
    assert boxes[:, 0].min() > frame.margin
    assert boxes[:, 2].max() < frame.right
    assert boxes[:, 3].max() < frame.top


def test_sizes_and_captions_of_close_views_have_room():
    # A plate between two that are tilted toward it, which fill a sheet of A4 at 1 : 2.
    turns = exponential(np.radians([[0, 0, 0], [0, -30, 0], [0, 30, 0]]))
    markers = [plate(0, 0.1224, 0.1224), plate(1, 0.1, 0.08), plate(2, 0.1, 0.08)]
    work = work_of(mounted(markers, turns, [[0, 0, 0], [-0.12, 0, 0.04], [0.12, 0, 0.04]]))
    page = rig_page(work, SheetOptions(paper="A4"))
    assert max(bounds(shape)[2] for shape in page.shapes) < page.frame.right
    [size] = [bounds(shape) for shape in page.shapes if getattr(shape, "text", "") == "(126.4)"]
    middle = (size[1] + size[3]) / 2
    boxes = [bounds(shape) for shape in page.shapes if isinstance(shape, Line) and shape.closed]
    assert not [box for box in boxes if box[0] < size[2] and size[0] < box[2] and box[1] < middle < box[3]]


def test_names_of_faces_are_beside_tags_and_on_axes():
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [0.04, 0.03]
    marker = build_marker(corners, rectangle(0.1, 0.08), 0.012, 0.002)
    marker = replace(marker, tag=Tag("aruco:DICT_4X4_50", 0, 0.02))
    work = work_of(mounted([marker, marker], [np.eye(3)] * 2, [[0, 0, 0], [0.15, 0, 0]]))
    half = 1e3 * marker.tag.side / 2
    for view in work.views:
        for name in view.names:
            across = abs(name.at[0] - (150 if name.text == "plate 1" else 0))
            assert max(across, abs(name.at[1])) > half + 4
    shapes = rig_page(work, SheetOptions()).shapes
    kinds = [shape.text if isinstance(shape, Lettering) else type(shape).__name__ for shape in shapes]
    assert kinds.index("x") < kinds.index("plate 0")
