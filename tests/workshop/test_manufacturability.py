"""Each limit: just within it is made, just beyond it is refused in one line that names the part and what would fit."""

import re
from collections.abc import Sequence
from dataclasses import replace

import pytest
from sentences import sentence

from markergen.errors import InputError
from markergen.model.boundary import Circle, polygon_from
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.solid.plate import Footprint, gaps, plate_of
from markergen.workshop.manufacturability import depth_of
from markergen.workshop.processes import Made


def make(marker: Marker, fabrication: Fabrication) -> Made:
    return PROCESSES[fabrication.process](marker, fabrication)


def refusal(marker: Marker, fabrication: Fabrication) -> str:
    with pytest.raises(InputError) as caught:
        make(marker, fabrication)
    (line,) = str(caught.value).splitlines()
    return line


@pytest.fixture
def at(make_ngon):
    """Marker of 20 mm dots, the first a ring, at places in mm, on a disk of 150 mm radius; clearance 2 mm."""

    def made(*places: Sequence[float]) -> Marker:
        marker = make_ngon(len(places), 0.15, 0.02)
        points = tuple(
            replace(point, x=x / 1e3, y=y / 1e3, z=(z[0] if z else 0.0) / 1e3)
            for point, (x, y, *z) in zip(marker.control_points, places, strict=True)
        )
        return replace(marker, control_points=points)

    return made


def test_a_pocket_leaves_a_floor(pentagon):
    assert make(pentagon, Fabrication(depth=0.0028)).depth == 2.8
    line = refusal(pentagon, Fabrication(depth=0.0029))
    assert line.startswith(f"expected {sentence('thin plate', '3.1mm', '2.9 mm')}, found one of 3 mm;")
    assert line.endswith("--thickness 3.1mm, or --depth 2.8mm or less")
    thin = replace(pentagon, substrate=Substrate(thickness=0.0003))
    assert sentence("thin plate", "0.35mm", "0.15 mm") in refusal(thin, Fabrication())
    # What the line says would fit does.
    assert make(thin, Fabrication(depth=0.0001)).depth == 0.1


@pytest.mark.parametrize("name", ["fdm", "cnc", "laser", "print", "dome"])
@pytest.mark.parametrize("thickness", [1e-5, 2e-4, 2.9e-4])
def test_the_thickness_that_a_message_names_is_enough(pentagon, name, thickness):
    line = refusal(replace(pentagon, substrate=Substrate(thickness=thickness)), Fabrication(name))
    enough = float(re.search(r"use --thickness ([\d.]+)mm", line)[1])
    make(replace(pentagon, substrate=Substrate(thickness=enough / 1e3)), Fabrication(name))


def test_every_process_says_what_is_deep(pentagon):
    phrase = {"fdm": "inlays", "cnc": "pockets", "laser": "engraving", "print": "recess", "dome": "plugs"}
    for name, what in phrase.items():
        assert what in refusal(pentagon, Fabrication(name, depth=0.0029))


def test_a_gap_leaves_a_core(pentagon):
    assert len(make(pentagon, Fabrication(gap=0.0018)).parts) == 6
    assert "at most 1.8mm around the inlays of dot-0, found 1.9 mm" in refusal(pentagon, Fabrication(gap=0.0019))
    with pytest.raises(InputError, match="gap of 0"):
        Fabrication(gap=-1e-4)


@pytest.mark.parametrize(("name", "diameter"), [("fdm", 0.0016), ("laser", 0.0004), ("cnc", 0.002), ("dome", 0.002)])
def test_dots_are_no_smaller_than_the_tool_makes_them(make_ngon, name, diameter):
    make(make_ngon(5, 0.05, diameter), Fabrication(name))
    line = refusal(make_ngon(5, 0.05, 0.98 * diameter), Fabrication(name))
    assert "ring's width" in line
    assert "dot-0" in line
    # What the line says would fit does.
    least = re.search(r"--dot ([\d.]+)mm", line)
    assert least is not None
    assert float(least[1]) == pytest.approx(diameter * 1e3, abs=0.02)


def test_without_a_ring_the_dot_itself_is_measured(make_ngon):
    marker = make_ngon(5, 0.05, 0.0003)
    points = tuple(replace(p, feature=marker.control_points[1].feature) for p in marker.control_points)
    plain = replace(marker, control_points=points, clearance=0.01)
    assert sentence("small", "0.4 mm", "dot-0", "nozzle", "0.4 mm") in refusal(plain, Fabrication())
    make(plain, Fabrication(tool=0.0003))


def test_a_mill_fits_into_the_rings_bore(make_ngon):
    marker = make_ngon(5, 0.05, 0.008)
    make(marker, Fabrication("cnc", tool=0.0039))
    assert "dot-0-core, made with a mill of 4.1 mm" in refusal(marker, Fabrication("cnc", tool=0.0041))
    lines = make(marker, Fabrication("cnc")).lines
    assert lines[0].startswith("End mill of 3 mm")


@pytest.mark.parametrize(
    ("fabrication", "least"),
    [
        # Two corners that meet others, each rounded by 1.207 times the wall: two gaps make it wider.
        (Fabrication(), 0.9657),
        (Fabrication(gap=5e-5), 1.2071),
        # Here the mill's diameter counts, and there the wall of 0.5 mm with a press fit.
        (Fabrication("cnc", tool=0.002, fit="press"), 2.0),
        (Fabrication("cnc", tool=0.0005, fit="press"), 1.2071),
    ],
)
def test_cells_of_tags_are_as_wide_as_their_corners(make_ngon, fabrication, least):
    marker = make_ngon(5, 0.15, 0.02)
    for share in (0.999, 1.001):
        tagged = replace(marker, tag=Tag("aruco:DICT_4X4_50", 3, share * 6 * least * 1e-3))
        if share > 1:
            make(tagged, fabrication)
        else:
            assert f"least {least:.4g} mm in the tag" in refusal(tagged, fabrication)


def test_dots_keep_a_wall_between_them(at):
    rest = [(-50, 50), (-50, -50)]
    make(at((0, 0), (20.4, 0), *rest), Fabrication())
    line = refusal(at((0, 0), (20.3, 0), *rest), Fabrication())
    assert line == sentence(
        "thin wall", "0.4 mm", "dot-0 and dot-1", "0.3 mm", "design it with --clearance 2.1mm or more"
    )
    assert "they touch" in refusal(at((0, 0), (20, 0), *rest), Fabrication())
    assert "1 mm in common" in refusal(at((0, 0), (19, 0), *rest), Fabrication())
    # A gap on both sides takes 0.2 mm of the wall.
    assert "found 0.3 mm" in refusal(at((0, 0), (20.5, 0), *rest), Fabrication(gap=1e-4))


def test_dots_keep_a_wall_to_the_plates_edge_and_to_holes(at):
    square = polygon_from([[[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]])
    marker = replace(at((0, 0), (89.7, 0), (-50, 50), (-50, -50)), boundary=square)
    make(replace(marker, substrate=Substrate(edge=0.0002)), Fabrication())
    line = refusal(replace(marker, substrate=Substrate(edge=0.0)), Fabrication())
    assert "dot-1 and the plate's edge, found 0.3 mm; use --edge 0.1mm" in line
    outline = replace(marker, substrate=Substrate(outline=square))
    assert "use a larger --outline" in refusal(outline, Fabrication())
    beside = replace(marker, substrate=Substrate(holes=(Hole(0.0, 0.0118, 0.003, name="M3"),)))
    line = refusal(beside, Fabrication())
    assert "dot-0 and hole M3 at 0 mm, 11.8 mm, found 0.3 mm; move the hole by 0.1mm" in line


def test_the_recess_for_a_sheet_leaves_a_rim_and_holes_are_in_it_or_out(at):
    marker = at((0, 60), (60, 0), (-60, 0), (0, -60))
    make(replace(marker, substrate=Substrate(edge=0.0007)), Fabrication("print"))
    line = refusal(replace(marker, substrate=Substrate(edge=0.0005)), Fabrication("print"))
    assert "0.5 mm of the plate" in line
    assert "use --edge 0.7mm or more" in line or "use --edge 0.71mm or more" in line
    for x, within in ((0.140, True), (0.160, False)):
        plate = Substrate(edge=0.02, holes=(Hole(x, 0.0, 0.004),))
        (recess,) = make(replace(marker, substrate=plate), Fabrication("print")).cut
        assert bool(recess.holes) == within
    plate = Substrate(edge=0.02, holes=(Hole(0.149, 0.0, 0.004),))
    line = refusal(replace(marker, substrate=plate), Fabrication("print"))
    assert "hole 4 mm at 149 mm, 0 mm inside" in line
    assert "move the hole by 2.3" in line


def test_a_fit_and_a_gap_are_two_answers(pentagon):
    line = refusal(pentagon, Fabrication("cnc", fit="press", gap=1e-4))
    assert line.endswith("found --fit press and --gap 0.1 mm; leave one of them out")


def test_control_points_below_the_face_or_without_a_dot_are_refused(at, make_ngon):
    assert "point 1 at z = -1 mm" in refusal(at((0, 0), (50, 0, -1), (-50, 50), (-50, -50)), Fabrication())
    assert "without a dot (diameter 0)" in refusal(make_ngon(4, 0.1, 0.0), Fabrication("dome"))


def test_rooms_are_measured_exactly(at):
    marker = replace(at((0, 0), (50, 0), (-50, 0), (0, 50)), boundary=Circle(0.1), substrate=Substrate(edge=0.002))
    plate = plate_of(marker)
    point, tag = Footprint("a", ((60.0, 0.0),), 10.0), Footprint("b", ((0, 0), (20, 0), (20, 20), (0, 20)), 1.0)
    # The circle is a polygon that is 2 um off.
    assert plate.room([point, tag]) == pytest.approx([32.0, 102 - 800**0.5 - 1], abs=3e-3)
    assert plate.room([Footprint("out", ((110.0, 0.0),))]) < 0
    assert gaps([point, tag], [tag]).ravel() == pytest.approx([29.0, float("inf")])
    assert depth_of(marker, Fabrication(), 0.6, "inlays") == 0.6


def test_a_hole_is_no_narrower_than_the_nozzle_unless_it_is_drilled(pentagon):
    def holed(diameter: float) -> Marker:
        return replace(pentagon, substrate=Substrate(holes=(Hole(0.0, 0.0, diameter),)))

    make(holed(0.0004), Fabrication())
    assert sentence("small", "0.4 mm", sentence("hole", "0.39 mm", "0 mm, 0 mm"), "nozzle", "0.4 mm") in refusal(
        holed(0.00039), Fabrication()
    )
    make(holed(0.00039), Fabrication(tool=0.00039))
    make(holed(0.00039), Fabrication("cnc"))


def test_holes_in_the_recess_for_a_sheet_have_land_around_each(pentagon):
    def holed(gap: float) -> Marker:
        return replace(pentagon, substrate=Substrate(holes=(Hole(0.0, 0.0, 0.003), Hole(0.003 + gap, 0.0, 0.003))))

    (recess,) = make(holed(0.0025), Fabrication("print")).cut
    assert len(recess.holes) == 2
    line = refusal(holed(0.0015), Fabrication("print"))
    assert "least 2.5 mm between holes" in line
    assert "1.5 mm; move one by 1mm" in line


def test_pillars_keep_off_the_recess_for_a_printed_tag(at):
    """The quiet zone of this tag reaches to x = 20 mm, and its recess 0.05 mm farther."""

    def tagged(x: float) -> Marker:
        return replace(at((0, 60), (x, 0, 10)), tag=Tag("aruco:DICT_4X4_50", 3, 0.03))

    make(tagged(31.3), Fabrication("print"))
    assert sentence("pillar and", 1, "recess for the tag") in refusal(tagged(30.3), Fabrication("print"))


def test_the_size_of_dots_is_no_limit_to_the_room_around_one_sheet(make_ngon):
    assert make(make_ngon(4, 0.005, 0.002), Fabrication("print")).depth == 0.2


def test_a_recess_over_a_rounded_corner_is_not_answered_with_a_wrong_edge(shapes, make_in):
    """An edge of 2.5 mm, which a straight side would need, does not help a corner rounded by 20 mm."""
    marker = replace(make_in(shapes["rectangle"], 5, 0.012), substrate=Substrate(corner_radius=0.02))
    line = refusal(marker, Fabrication("print"))
    assert sentence("larger plate", "--edge, or a").removesuffix(" and --chamfer") in line
    make(replace(marker, substrate=Substrate(edge=0.0125, corner_radius=0.003)), Fabrication("print"))
    # An outline is the plate, which has no edge around its sheet.
    line = refusal(make_in(shapes["star"], 5, 0.012), Fabrication("print"))
    assert line.endswith("use a larger --outline")
