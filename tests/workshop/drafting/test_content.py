from dataclasses import replace

import numpy as np
import pytest
from workpieces import MARKERS, case, ngon

from markergen.errors import InputError
from markergen.geometry.contour import Contour, circle, placed
from markergen.model.boundary import Circle, Polygon, polygon_from
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker, build_marker
from markergen.model.substrate import Hole, Substrate, parse_dowel, parse_mount
from markergen.model.tag import Tag
from markergen.workshop.drafting.content import workpiece
from markergen.workshop.drafting.drawing import around
from markergen.workshop.drafting.features import ranges
from markergen.workshop.processes import parts_of


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
    points, holes, corners, parts, datums, tolerances, fits = work.tables
    # Coordinates are rounded to a tenth of a micrometer.
    np.testing.assert_allclose(
        [[float(cell) for cell in row[1:4]] for row in points.rows], marker.xyz * 1e3, atol=5.01e-5
    )
    assert [row[4:] for row in points.rows] == [("20", "10"), *[("20", "-")] * 4]
    np.testing.assert_allclose(
        [[float(cell) for cell in row[1:3]] for row in holes.rows],
        [[1e3 * hole.x, 1e3 * hole.y] for hole in marker.substrate.holes],
        atol=5.01e-5,
    )
    assert len(corners.rows) == 4
    assert sum(int(row[0]) for row in parts.rows) == len(made.parts)
    assert set(made.tolerances) <= set(tolerances.rows)
    assert [row[0] for row in datums.rows] == ["A", "B", "C"]
    assert any("dowel" in row[0] and row[2] == "+0.012 / 0" for row in fits.rows)
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
    screws = lines["4x \xd83.4 H13 (+0.180 / 0)"]
    assert screws.lines[1:] == (
        "through, for screw M3",
        "H1 to H4, on a circle [\xd860]",
        "from [45\xb0], evenly spaced",
    )
    assert screws.pitch == pytest.approx(30)
    # Each dowel hole is a datum, and has its own tolerance.
    pins = [callout for callout in work.callouts if callout.lines[0] == "\xd84 H7 (+0.012 / 0)"]
    assert [callout.lines[1] for callout in pins] == ["through, for a 4 mm pin"] * 2
    assert [(callout.datum, callout.controls[0].symbol) for callout in pins] == [
        ("B", "perpendicularity"), ("C", "position")
    ]  # fmt: skip
    assert lines["\xd820 \xb10.1 / \xd810 \xb10.1"].lines[1] == "ring 0"
    assert lines["4x \xd820 \xb10.1"].lines[1] == "dots 1 to 4"
    assert lines["tag apriltag:36h11:3"].lines[1] == "black square 30 x 30"


def test_holes_and_arcs_of_an_outline_are_called_out_and_listed():
    bolts = [circle(4.5, x, y) for x, y in ((90, 0), (0, 90), (-90, 0), (0, -90))]
    slot = Contour(((-5, -80), (5, -80), (5, -74), (-5, -74)), (0, 1, 0, 1))
    outline = polygon_from([placed(item, 1e-3) for item in (circle(100), circle(10), slot, *bolts)])
    marker = make(tag=False, outline=outline)
    work, _ = described(marker)
    lines = {callout.lines[0]: callout for callout in work.callouts}
    assert lines["4x \xd89"].lines[2:] == ("H8 to H11, on a circle [\xd8180]", "from [0\xb0], evenly spaced")
    assert lines["4x \xd89"].pitch == pytest.approx(90)
    assert lines["\xd820"].places == ((0.0, 0.0, 10.0),)
    assert np.array(sorted(lines["2x R3"].places)) == pytest.approx(np.array([(-8, -77, 0), (8, -77, 0)]))
    assert [control.symbol for control in lines["cut-out S1, through"].controls] == ["profile"]
    (table,) = [table for table in work.tables if table.title.startswith("Holes")]
    ours = len(marker.substrate.holes)
    assert [row[3:] for row in table.rows[ours:]] == [
        ("\xd820", "-", "plain"), *[("\xd89", "-", "plain")] * 4
    ]  # fmt: skip
    (corners,) = [table for table in work.tables if table.title == "Cut-out S1, 16 x 6 mm"]
    assert {row[2] for row in corners.rows} == {"line", "arc R3, clockwise"}
    assert work.round


def test_holes_of_one_drill_at_any_angle_have_one_callout():
    angles = np.pi * np.arange(6) / 3
    bolts = [circle(3.3, 90 * np.cos(angle), 90 * np.sin(angle)) for angle in angles]
    work, _ = described(make(tag=False, outline=polygon_from([placed(item, 1e-3) for item in (circle(100), *bolts)])))
    (drilled,) = [callout for callout in work.callouts if "\xd86.6" in callout.lines[0]]
    assert drilled.lines[0] == "6x \xd86.6"
    assert drilled.lines[-1] == "from [0\xb0], evenly spaced"


def test_a_datum_among_evenly_spaced_holes_leaves_their_angles():
    marker = make(tag=False)
    work, _ = described(replace(marker, substrate=Substrate(0.005, holes=parse_mount("4xM3@60mm"))))
    datum, rest = sorted(
        (callout for callout in work.callouts if callout.pitch), key=lambda callout: len(callout.places)
    )
    assert (datum.datum, datum.lines[-2:]) == ("C", ("H1, on a circle [\xd860]", "at [45\xb0]"))
    # Three holes evenly spaced would be 120 degrees apart.
    assert rest.lines[-2:] == ("H2 to H4 of 4 evenly spaced", "from [45\xb0], on a circle [\xd860]")


def pair_of_disks() -> Marker:
    outline = polygon_from([placed(circle(60, x, 0), 1e-3) for x in (-80, 80)])
    points = np.array([(-0.1, 0.02, 0), (-0.06, -0.02, 0), (0.1, 0.02, 0), (0.06, -0.02, 0), (0.08, 0.04, 0)])
    return build_marker(points, outline, 0.01, 0.001)


def test_each_of_several_plates_has_its_outline_described():
    work, _ = described(pair_of_disks())
    tables = {table.title: table.rows for table in work.tables}
    assert tables["Outline of plate 1, mm"] == (("-80.0000", "0.0000", "\xd8120"),)
    assert tables["Outline of plate 2, mm"] == (("80.0000", "0.0000", "\xd8120"),)
    phrase = [item for item in work.callouts if item.lines[0].endswith("all around")]
    assert [item.lines[0] for item in phrase] == ["plate 1, all around", "plate 2, all around"]
    assert all(item.controls[0].symbol == "profile" for item in phrase)
    # The size over both plates is no size of either.
    assert work.listed


def test_every_recess_has_its_size_place_and_depth():
    board = Polygon((((-0.15, -0.07), (0.15, -0.07), (0.15, 0.07), (-0.15, 0.07)),))
    work, _ = described(replace(pair_of_disks(), substrate=Substrate(0.003, outline=board)), process="print")
    recesses = [item for item in work.callouts if item.lines[0].startswith("recess")]
    assert [item.lines[0] for item in recesses] == ["recess 1", "recess 2"]
    assert all("0.2 +0.05 / 0 deep" in item.lines[2] and item.controls[0].symbol == "profile" for item in recesses)
    assert len([table for table in work.tables if table.title.startswith("Recess")]) == 2
    left, right = (((x - 0.05, -0.05), (x + 0.05, -0.05), (x + 0.05, 0.05), (x - 0.05, 0.05)) for x in (-0.08, 0.08))
    halves = Polygon((left, right))
    marker = replace(pair_of_disks(), boundary=halves, substrate=Substrate(0.003, outline=board))
    work, _ = described(marker, process="print")
    recesses = [item for item in work.callouts if item.lines[0].startswith("recess")]
    assert {item.lines[0] for item in recesses} == {"recess 100.4 x 100.4 +0.2 / 0"}
    assert {item.lines[1] for item in recesses} == {f"center at x [{x}], y [0]" for x in (-80, 80)}
    # An inlaid tag fills its pocket.
    assert not [item for item in described(make())[0].callouts if item.lines[0].startswith("recess")]


def test_an_outline_that_is_no_rectangle_has_its_corners_listed():
    skew = Polygon((((-0.2, -0.2), (0.2, -0.2), (0.3, 0.2), (-0.2, 0.2)),))
    work, _ = described(make(tag=False, corner_radius=0.01, outline=skew))
    (table,) = [table for table in work.tables if table.title.startswith("Outline")]
    arcs = [row for row in table.rows if row[2] == "arc R10, counterclockwise"]
    assert (len(arcs), len(table.rows)) == (4, 8)
    (phrase,) = [callout for callout in work.callouts if callout.lines[0] == "outline, all around"]
    assert phrase.controls[0].datums == ("A", "B", "C")
    assert ("4x R10",) in [callout.lines for callout in work.callouts]
    # The sloping side is no datum; the lower and the left one are, where no dowels are.
    work, _ = described(replace(make(tag=False, outline=skew), substrate=Substrate(0.005, outline=skew)))
    assert [(datum.kind, datum.place) for datum in work.datums[1:]] == [("edge", "y = -200"), ("edge", "x = -200")]


DISK, HOLE, DOWELS = Circle(0.09), parse_mount("M3:40mm,0mm"), parse_dowel("2x4mm@90mm")
BOARD = Polygon((((-0.1, -0.09), (0.1, -0.09), (0.1, 0.09), (-0.1, 0.09)),))
TRIANGLE = Polygon((((-0.2, -0.15), (0.2, -0.1), (0.0, 0.22)),))


@pytest.mark.parametrize(
    ("boundary", "holes", "kinds"),
    [
        (DISK, (), ["rim"]), (DISK, HOLE, ["rim", "hole"]), (DISK, (*HOLE, *DOWELS), ["hole", "hole"]),
        (BOARD, HOLE, ["edge", "edge"]), (BOARD, DOWELS, ["hole", "hole"]), (TRIANGLE, (), []),
        (TRIANGLE, parse_mount("4xM3@60mm"), ["hole", "hole"]),
    ],
)  # fmt: skip
def test_datums_are_dowels_edges_or_a_rim(boundary, holes, kinds):
    marker = replace(make(tag=False), boundary=boundary, substrate=Substrate(0.005, holes=holes))
    work, _ = described(marker)
    face, *rest = work.datums
    assert (face.letter, face.kind, face.place) == ("A", "face", "z = 0")
    assert [datum.kind for datum in rest] == kinds
    # Without a datum against turning, the dots are one pattern.
    dots = next(callout for callout in work.callouts if "dots" in callout.lines[-1]).controls
    assert [control.zone for control in dots] == ["\xd80.2" if len(kinds) == 2 else "\xd80.2 CZ"]
    assert [control.datums for control in dots] == [tuple("ABC"[: 1 + len(kinds)])]


def test_the_position_of_a_dot_agrees_with_its_fit():
    for fit, pocket, play in (("slip", 0.04, (0.053 + 0.021) / 2), ("press", 0.04, 0.0)):
        work, made = described(make(tag=False), process="cnc", fit=fit)
        controls = next(callout for callout in work.callouts if callout.lines[-1] == "dots 1 to 4").controls
        zones = {control.of: control.zone for control in controls}
        off = pocket / 2 + play
        assert zones == ({"pockets": "\xd80.04", "dots": "\xd80.114"} if play else {"": "\xd80.04"})
        assert made.accuracy.center == pytest.approx(off)
        (note,) = [note for note in work.notes if "finished dot" in note and "at most" in note]
        assert f"at most {np.ceil(off * 1e3 - 1e-6) / 1e3:g} mm" in note


def test_many_sizes_of_holes_and_arcs_of_an_outline_are_left_to_the_table():
    bores = [circle(1 + k / 10, -35 + 10 * k, 88) for k in range(8)]
    tall = [(x, -90, -89 + x / 50) for x in range(-28, 36, 8)]
    slots = [Contour(((x, low), (x + 3, low), (x + 3, high), (x, high)), (0, 1, 0, 1)) for x, low, high in tall]
    outline = polygon_from([placed(item, 1e-3) for item in (circle(100), *bores, *slots)])
    work, _ = described(make(tag=False, outline=outline))
    lines = [callout.lines for callout in work.callouts]
    # The dowels are datums and told by themselves; screws and drawn holes have zones of the same size.
    (rest,) = [callout for callout in work.callouts if callout.lines == ("12 holes through", "see the table")]
    assert [(control.zone, control.datums) for control in rest.controls] == [("\xd80.2", ("A", "B", "C"))]
    assert ("16 arcs of 8 radii", "see the tables") in lines
    assert len([table for table in work.tables if table.title.startswith("Cut-out")]) == 8


def test_many_kinds_of_dots_and_holes_are_left_to_the_tables():
    marker = make(tag=False)
    points = tuple(replace(p, feature=Feature(0.01 + 0.001 * k)) for k, p in enumerate(marker.control_points))
    more = (ControlPoint(5, 0.0, 0.01, 0.0, Feature(0.005)), ControlPoint(6, 0.0, -0.01, 0.0, Feature(0.006)))
    holes = tuple(Hole(0.02 + 0.007 * k, 0.002, 0.002 + 0.0002 * k) for k in range(7))
    marker = replace(marker, control_points=(*points, *more), substrate=replace(marker.substrate, holes=holes))
    work, _ = described(marker)
    first, second, datum = (callout.lines for callout in work.callouts)
    assert (first, second) == (("7 dots of 7 sizes", "see the table"), ("6 holes through", "see the table"))
    # A hole that keeps the marker from turning is told by itself.
    assert datum[-1] == "H2 at x [27], y [2]"
    assert len(work.sections) == 12


def test_sections_tell_depth_thickness_and_height():
    work, made = described(make((0.0, 0.01, 0.02, 0.0, 0.0), tag=False), process="cnc")
    sections = {section.title: section for section in work.sections}
    flat = sections["Section along x through dot 3"]
    assert [span.text for span in flat.across] == ["\xd820 h7 (0 / -0.021)", "\xd820 F8 (+0.053 / +0.020) pocket"]
    # The thickness stands in the side view, with its tolerance.
    assert [span.text for span in flat.upright] == ["1 +0.03 / 0", "(5)"]
    assert made.depth == 1
    raised = sections["Section along x through dot 2"]
    assert "20 \xb10.03" in [span.text for span in raised.upright]
    assert [span.text for span in work.heights] == ["5 \xb10.1", "20 \xb10.03"]
    (pillars,) = [table for table in work.tables if table.title.startswith("Pillars")]
    assert [row[:2] for row in pillars.rows] == [("1", "10"), ("2", "20")]
    # One for each kind: the ring, a dot in the plane, the highest one, a screw's hole, a pin's.
    assert len(sections) == 5
    materials = {face.material for face in flat.faces}
    assert materials == {"light", "dark"}


def test_a_chamfer_and_a_recess_are_cut_at_the_edge():
    work, _ = described(make(chamfer=0.001, tag=False), process="print")
    edge = work.sections[-1]
    assert edge.title == "Section of the edge"
    assert [span.text for span in edge.across] == ["1 x 45\xb0"]
    assert [span.text for span in edge.upright] == ["0.2 +0.05 / 0", "(5)"]
    (recess,) = [callout for callout in work.callouts if callout.lines[0].startswith("recess")]
    assert recess.lines == ("recess \xd8180.4 +0.2 / 0", "0.2 +0.05 / 0 deep, floor flat")
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


def test_fills_and_hatches_have_one_meaning_each():
    assert dict(described(make())[0].key) == {
        "dark": "dark surface", "cut-light": "light material, cut", "cut-dark": "dark material, cut",
        "engraved": "engraved on the back",
    }  # fmt: skip
    assert dict(described(make(), process="laser", engrave=False)[0].key) == {
        "dark": "dark surface (engraved)", "cut-light": "light material, cut"
    }  # fmt: skip


def test_the_title_block_takes_what_is_given():
    block = described(make())[0].block
    assert (block.material, block.general) == ("", "ISO 2768-mK")
    block = described(make(), material="EN AW-5083", general_tolerance="ASME Y14.5")[0].block
    assert (block.material, block.general) == ("EN AW-5083", "ASME Y14.5")
    for bad in ("", "x" * 61, "two\nlines"):
        with pytest.raises(InputError, match="general tolerance"):
            Fabrication(general_tolerance=bad)


def test_ranges():
    assert ranges([3, 1, 2, 7, 9, 8, 11, 12]) == "1 to 3, 7 to 9, 11, 12"
    assert ranges([]) == ""


def test_the_engraving_is_told_in_words():
    work, made = described(make())
    (note,) = [note for note in work.notes if note.startswith("Engrave the back")]
    title, _ = made.engraved[-1].lines, made.engraved
    assert "their ids" in note
    assert note.endswith("an arrow along x.")
    assert "0.3 mm deep" in note
    assert all(line in note for text in work.engraved for line in text.lines if line.startswith(("markergen", "april")))
    assert len(title) > 0


def test_the_back_of_a_relief_is_its_plate_with_holes_and_letters():
    work, _ = described(make((0.0, 0.01, 0.02, 0.0, 0.0)), process="fdm")
    plate = max(range(len(work.back)), key=lambda k: work.back[k].box[2] - work.back[k].box[0])
    assert (work.back[plate].material, work.back[plate].fine) == ("light", False)
    # What comes after the plate is seen on it: holes, and the arrow along x. Letters are text.
    after = [face.material for face in work.back[plate + 1 :]]
    assert set(after) == {"", "engraved"}
    assert after.count("") == len(make().substrate.holes)
    assert [text.lines for text in work.engraved if text.lines == ("3",)]


def flange(make=make):
    """A plate with a bore, a hole for a pin and four for screws, as a drawing has them."""
    holes = [circle(15), circle(3, 88), *(circle(2.75, x, y) for x in (-92, 92) for y in (-82, 82))]
    corners = Contour(((-100, -90), (100, -90), (100, 90), (-100, 90)))
    outline = polygon_from([placed(item, 1e-3) for item in (corners, *holes)])
    return replace(make(tag=False), substrate=Substrate(outline=outline, thickness=0.006))


def datums(work):
    return {datum.letter: datum.text for datum in work.datums}


def callout(work, label):
    return next(item for item in work.callouts if any(label in line.split() for line in item.lines))


def test_a_bore_and_a_hole_of_its_own_size_are_datums_before_edges():
    work = described(flange(), process="cnc")[0]
    assert datums(work) == {"A": "face with the dots", "B": "hole H1", "C": "hole H2"}
    for label, letter in (("H1", "B"), ("H2", "C")):
        hole = callout(work, label)
        assert hole.datum == letter
        assert "H7" in hole.lines[0]
        # As true as the dots, which relate to what they locate by both.
        assert hole.controls[0].zone == "\xd80.04"
    # A printer makes no fits.
    assert "H7" not in callout(described(flange())[0], "H1").lines[0]


def test_datums_and_fits_are_those_asked_for():
    work = described(flange(), process="cnc", datum="A=face,B=H2,C=H6", hole="H6:H8,H3:H13")[0]
    assert datums(work) == {"A": "face with the dots", "B": "hole H2", "C": "hole H6"}
    assert "H8" in callout(work, "H6").lines[0]
    assert "H13" in callout(work, "H3").lines[0]
    assert callout(work, "H3").controls[0].zone == "\xd80.2"
    edges = described(flange(), process="cnc", datum="B=edge,C=edge")[0]
    assert datums(edges) == {"A": "face with the dots", "B": "lower edge", "C": "left edge"}


@pytest.mark.parametrize(
    "choices",
    [
        {"datum": "B=H9"},
        {"hole": "H9:H7"},
        {"datum": "C=H1"},
        {"datum": "B=rim"},
        {"datum": "H1"},
        {"hole": "H1"},
        {"hole": "H1:K7"},
        {"hole": "H1:H7,H1:H8"},
    ],
)
def test_datums_and_fits_that_the_plate_does_not_have_are_refused(choices):
    with pytest.raises(InputError):
        described(flange(), process="cnc", **choices)


def test_dots_that_are_holes_have_neither_pockets_nor_play():
    work, _ = described(case(ngon(5, 0.04), Circle(0.06), 0.01), process="cnc", through=True)
    ring, dots = work.callouts
    assert dots.lines[0] == "4x \xd810 \xb10.05 through"
    assert [(control.of, control.zone) for control in dots.controls] == [("", "\xd80.04 CZ")]
    assert [(control.of, control.zone) for control in ring.controls] == [("pockets", "\xd80.04"), ("dots", "\xd80.09")]
    assert [span.text for span in work.sections[1].across] == ["\xd810 \xb10.05"]
    rows = dict(row for table in work.tables for row in table.rows if table.title == "Tolerances, mm")
    assert rows["centers of through dots to A, B"] == "position \xd80.04"
    assert rows["finished dots in pockets to A, B"] == "position \xd80.09"


def test_a_cross_alone_on_the_back_has_its_depth():
    work, _ = described(case(ngon(4, 0.005), Circle(0.007), 0.0025), process="cnc", tool=0.0005)
    assert not work.engraved
    assert any(note.startswith("Engrave the back 0.3 mm deep") and "a cross" in note for note in work.notes)
    assert any("engraving" in row[0] for table in work.tables for row in table.rows)


def test_sides_that_are_datums_are_square_to_the_face():
    rows = [row for table in described(MARKERS["many"])[0].tables for row in table.rows]
    assert ("plate's side at B, C", "perpendicularity 0.3 to A") in rows
    rows = [row for table in described(MARKERS["disk"])[0].tables for row in table.rows]
    assert ("plate's side at B", "perpendicularity 0.3 to A") in rows
