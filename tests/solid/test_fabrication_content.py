from dataclasses import replace

import numpy as np
import pytest

from markergen.drawing.fabrication_drawing import around
from markergen.geometry.contour import Contour, circle, placed
from markergen.model.boundary import Circle, Polygon, polygon_from
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker, build_marker
from markergen.model.substrate import Hole, Substrate, parse_dowel, parse_mount
from markergen.model.tag import Tag
from markergen.solid.fabrication_content import ranges, workpiece
from markergen.solid.processes import parts_of


def make(heights=(0.0,) * 5, tag=True, **substrate) -> Marker:
    angles = 2 * np.pi * np.arange(5) / 5 + np.pi / 2
    points = np.stack([0.07 * np.cos(angles), 0.07 * np.sin(angles), heights], axis=-1)
    marker = build_marker(points, Circle(0.09), 0.02, 0.002)
    plate = Substrate(0.005, holes=(*parse_mount("4xM3@60mm"), *parse_dowel("2x4mm@90mm")), **substrate)
    return replace(marker, tag=Tag("apriltag:36h11", 3, 0.03) if tag else None, substrate=plate)


def described(marker, **choices):
    fabrication = Fabrication(**choices)
    made = parts_of(marker, fabrication)
    return workpiece(marker, fabrication, made), made


@pytest.mark.parametrize("process", list(PROCESSES))
def test_tables_say_what_the_marker_says(process):
    marker = make()
    work, made = described(marker, process=process)
    points, holes, corners, parts, tolerances = work.tables
    # Coordinates are rounded to a tenth of a micrometer.
    np.testing.assert_allclose(
        [[float(cell) for cell in row[1:4]] for row in points.rows], marker.xyz * 1e3, atol=5.01e-5
    )
    assert [row[4:] for row in points.rows] == [("20", "10"), *[("20", "-")] * 4]
    np.testing.assert_allclose(
        [[float(cell) for cell in row[:2]] for row in holes.rows],
        [[1e3 * hole.x, 1e3 * hole.y] for hole in marker.substrate.holes],
        atol=5.01e-5,
    )
    assert len(corners.rows) == 4
    assert sum(int(row[0]) for row in parts.rows) == len(made.parts)
    assert tolerances.rows == made.tolerances
    assert set(made.lines) <= set(work.notes)


@pytest.mark.parametrize("process", list(PROCESSES))
@pytest.mark.parametrize("heights", [(0.0,) * 5, (0.0, 0.01, 0.02, 0.0, 0.0)], ids=["flat", "relief"])
def test_the_front_shows_every_dot_whatever_it_is_made_of(process, heights):
    work, _ = described(make(heights), process=process)
    dark = [face.box for face in work.front if face.material == "dark"]
    for label in work.labels:
        assert any(
            np.allclose(((a + c) / 2, (b + d) / 2), (label.x, label.y), atol=5e-3)
            and c - a == pytest.approx(20, abs=0.01)
            for a, b, c, d in dark
        ), label


def test_dots_that_are_holes_are_seen_through():
    work, _ = described(make(tag=False), process="cnc", through=True)
    holes = [face for face in work.front if not face.material and face.box[2] - face.box[0] > 15]
    assert len(holes) == 4
    # The ring stays an inlay.
    assert sum(face.material == "dark" for face in work.front) == 1


def test_holes_that_are_alike_are_called_out_once_with_their_pitch_circle():
    work, _ = described(make())
    lines = {callout.lines[0]: callout for callout in work.callouts}
    assert lines["4x \xd83.4 through"].lines[1:] == ("for screw M3", "on a pitch circle \xd860")
    assert lines["4x \xd83.4 through"].pitch == pytest.approx(30)
    assert lines["2x \xd84 through"].lines[1] == "for a 4 mm pin"
    assert lines["\xd820 / \xd810"].lines[1] == "ring 0"
    assert lines["4x \xd820"].lines[1] == "dots 1 to 4"
    assert lines["tag apriltag:36h11:3"].lines[1] == "black square 30 x 30"


def test_holes_and_arcs_of_an_outline_are_called_out_and_listed():
    bolts = [circle(4.5, x, y) for x, y in ((90, 0), (0, 90), (-90, 0), (0, -90))]
    slot = Contour(((-5, -80), (5, -80), (5, -74), (-5, -74)), (0, 1, 0, 1))
    outline = polygon_from([placed(each, 1e-3) for each in (circle(100), circle(10), slot, *bolts)])
    marker = make(tag=False, outline=outline)
    work, _ = described(marker)
    lines = {callout.lines[0]: callout for callout in work.callouts}
    assert lines["4x \xd89 through"].lines[1:] == ("on a pitch circle \xd8180",)
    assert lines["4x \xd89 through"].pitch == pytest.approx(90)
    assert lines["\xd820 through"].places == ((0.0, 0.0, 10.0),)
    assert np.array(sorted(lines["2x R3"].places)) == pytest.approx(np.array([(-8, -77, 0), (8, -77, 0)]))
    (table,) = [table for table in work.tables if table.title.startswith("Holes")]
    own = len(marker.substrate.holes)
    assert [row[2:] for row in table.rows[own:]] == [("20", "-", "in the outline")] + [("9", "-", "in the outline")] * 4
    assert work.round
    # What is rounded by an option is told in the notes, as it was.
    work, _ = described(
        make(corner_radius=0.01, outline=Polygon((((-0.2, -0.2), (0.2, -0.2), (0.3, 0.2), (-0.2, 0.2)),)))
    )
    assert not any("R10" in line for callout in work.callouts for line in callout.lines)


def test_many_sizes_of_holes_and_arcs_of_an_outline_are_left_to_the_table():
    bores = [circle(1 + k / 10, -35 + 10 * k, 88) for k in range(8)]
    tall = [(x, -90, -89 + x / 50) for x in range(-28, 36, 8)]
    slots = [Contour(((x, low), (x + 3, low), (x + 3, high), (x, high)), (0, 1, 0, 1)) for x, low, high in tall]
    outline = polygon_from([placed(each, 1e-3) for each in (circle(100), *bores, *slots)])
    work, _ = described(make(tag=False, outline=outline))
    lines = [callout.lines for callout in work.callouts]
    assert ("8 holes of the outline", "see the table") in lines
    assert ("16 arcs of 8 radii", "see the STEP file") in lines


def test_many_kinds_of_dots_and_holes_are_left_to_the_tables():
    marker = make(tag=False)
    points = tuple(replace(p, feature=Feature(0.01 + 0.001 * k)) for k, p in enumerate(marker.control_points))
    more = (ControlPoint(5, 0.0, 0.01, 0.0, Feature(0.005)), ControlPoint(6, 0.0, -0.01, 0.0, Feature(0.006)))
    holes = tuple(Hole(0.02 + 0.007 * k, 0.002, 0.002 + 0.0002 * k) for k in range(7))
    marker = replace(marker, control_points=(*points, *more), substrate=replace(marker.substrate, holes=holes))
    work, _ = described(marker)
    assert [callout.lines for callout in work.callouts] == [
        ("7 dots of 7 sizes", "see the table"), ("7 holes through", "see the table")
    ]  # fmt: skip
    assert len(work.sections) == 12


def test_sections_tell_depth_thickness_and_height():
    work, made = described(make((0.0, 0.01, 0.02, 0.0, 0.0), tag=False), process="cnc")
    sections = {section.title: section for section in work.sections}
    flat = sections["Section along x through dot 3"]
    assert [span.words for span in flat.across] == ["\xd820", "\xd820.02 pocket"]
    assert [span.words for span in flat.upright] == ["1", "5"]
    assert made.depth == 1
    raised = sections["Section along x through dot 2"]
    assert "20" in [span.words for span in raised.upright]
    assert [span.words for span in work.heights] == ["5", "20"]
    # One for each kind: the ring, a dot in the plane, the highest one, a screw's hole, a pin's.
    assert len(sections) == 5
    materials = {face.material for face in flat.faces}
    assert materials == {"light", "dark"}


def test_a_chamfer_and_a_recess_are_cut_at_the_edge():
    work, _ = described(make(chamfer=0.001, tag=False), process="print")
    edge = work.sections[-1]
    assert edge.title == "Section of the edge"
    assert [span.words for span in edge.across] == ["1 x 45\xb0"]
    assert [span.words for span in edge.upright] == ["0.2", "5"]
    assert "Chamfer around the face 1 x 45\xb0." in work.notes


def test_the_size_is_that_of_the_plate_and_a_disk_has_a_diameter():
    work, _ = described(make(edge=0.004))
    assert work.round
    assert work.size == pytest.approx((188, 188))
    square = Polygon((((-0.1, -0.09), (0.1, -0.09), (0.1, 0.09), (-0.1, 0.09)),))
    work, _ = described(replace(make(corner_radius=0.01), boundary=square))
    assert not work.round
    assert work.size == pytest.approx((204, 184))
    assert around(work.front) == pytest.approx((-102, -92, 102, 92))


def test_the_back_is_shown_where_it_is_engraved():
    assert described(make(), engrave=True)[0].back
    assert not described(make(), engrave=False)[0].back


def test_materials_name_cores_and_what_is_engraved():
    assert described(make())[0].materials == "light: plate, core of the ring; dark: dots, tag"
    assert described(make(), process="laser")[0].materials == "light: plate; dark: engraving"


def test_ranges():
    assert ranges([3, 1, 2, 7, 9, 8, 11, 12]) == "1 to 3, 7 to 9, 11, 12"
    assert ranges([]) == ""


def test_notes_keep_the_capital_of_a_radius():
    work, _ = described(make(corner_radius=0.01, chamfer=0.0005))
    assert "Corners of the plate seen from above R10, chamfer around the face 0.5 x 45\xb0." in work.notes


def test_the_back_of_a_relief_is_its_plate_with_dark_letters():
    work, _ = described(make((0.0, 0.01, 0.02, 0.0, 0.0)), process="fdm")
    plate = max(range(len(work.back)), key=lambda k: work.back[k].box[2] - work.back[k].box[0])
    assert (work.back[plate].material, work.back[plate].fine) == ("light", False)
    # What comes after the plate is seen on it.
    letters = [face for face in work.back[plate + 1 :] if face.material]
    assert letters
    assert all((face.material, face.fine) == ("dark", True) for face in letters)
