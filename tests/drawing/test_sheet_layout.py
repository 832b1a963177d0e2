import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import shapely
from gaps import box_distance, segment_distance
from hypothesis import given, settings
from hypothesis import strategies as st
from sentences import sentence

from markergen.drawing.colors import INVERTED, parse_colors
from markergen.drawing.marker_artwork import CENTROID_PULL
from markergen.drawing.paper import ISO, PAPERS, Frame, SheetOptions
from markergen.drawing.scene import GRAY, WHITE, Disk, FilledPath, Line, Sheet, bounds
from markergen.drawing.sheet_layout import check_paper, pages_for, sheet_for
from markergen.drawing.text import text, text_width
from markergen.errors import InputError
from markergen.model.boundary import Circle, polygon_from
from markergen.model.marker import Marker
from markergen.model.substrate import Substrate, parse_mount

PRINTER_MARGIN = 8.0
QUICK = ("a3-landscape", "a4", "a5", "legal-landscape", "letter")
ROUNDING = 1e-6  # mm; sums of doubles of a few hundred mm


def named(sheet: Sheet) -> dict:
    shapes = {shape.name: shape for shape in sheet.scene}
    assert len(shapes) == len(list(sheet.scene)), "names are unique, for they become ids"
    return shapes


def along(line: Line) -> np.ndarray:
    """Points of a line, at most 1 mm apart."""
    return shapely.get_coordinates(shapely.segmentize(shapely.LineString(line.points), 1.0))


def check_sheet(marker: Marker, sheet: Sheet) -> None:
    """Dots in place and whole, quiet zones blank but for holes, the margin white, numbers apart from all ink."""
    dots = sheet.scene["dots"]
    expected = marker.xyz[:, :2] * 1e3 + sheet.origins_mm[0]
    np.testing.assert_allclose([(d.x, d.y) for d in dots], expected, atol=ROUNDING, rtol=0)
    width, height = sheet.paper.width, sheet.paper.height
    others = [shape for shape in sheet.scene if not shape.name.startswith(("dot-", "hole-"))]
    crosses = [shape for shape in others if shape.name.startswith("center")]
    boxes = {id(shape): bounds(shape) for shape in others}
    for dot in dots:
        center, quiet = np.array([dot.x, dot.y]), 2 * dot.radius
        assert quiet - ROUNDING <= dot.x <= width - quiet + ROUNDING
        assert quiet - ROUNDING <= dot.y <= height - quiet + ROUNDING
        for shape in others:
            gap = box_distance(center, boxes[id(shape)])
            if gap >= quiet or (shape in crosses and np.hypot(*(center - sheet.origins_mm[0])) < dot.radius):
                continue
            if isinstance(shape, Line):
                gap = segment_distance(center, shape) - shape.width / 2
            assert gap >= quiet - ROUNDING, f"{shape.name} is in the quiet zone of {dot.name}"
    for shape in sheet.scene:
        left, bottom, right, top = bounds(shape)
        white = min(left, bottom, width - right, height - top)
        assert white >= PRINTER_MARGIN, f"{shape.name} is {white:.2f} mm from the edge"
    numbers = [shape for shape in others if shape.name.startswith("number-")]
    for number in numbers:
        box = boxes[id(number)]
        for other in others:
            if other is number or other in crosses or apart(box, boxes[id(other)]):
                continue
            if isinstance(other, Line):
                assert box_distance(along(other), box) > other.width / 2, (number.name, other.name)
            else:
                raise AssertionError((number.name, other.name))
    missing = {str(p.id) for p in marker.control_points} - {n.name.removeprefix("number-") for n in numbers}
    assert all(any(f" {name}" in note for note in sheet.notes) for name in missing)


def apart(a: tuple, b: tuple) -> bool:
    return a[2] < b[0] or b[2] < a[0] or a[3] < b[1] or b[3] < a[1]


@pytest.mark.parametrize("n", [4, 5, 8, 12])
@pytest.mark.parametrize(("radius", "diameter"), [(0.15, 0.036), (0.04, 0.01), (0.085, 0.016)])
def test_regular_markers(make_ngon, n, radius, diameter):
    marker = make_ngon(n, radius, diameter)
    sheet = sheet_for(marker)
    check_sheet(marker, sheet)
    assert sum(shape.name.startswith("number-") for shape in sheet.scene) == n


KEEP_OUTS = (Circle(0.02, (0.1, 0.0)), Circle(0.006, (-0.06, -0.06)))


@pytest.mark.parametrize("keep_outs", [(), KEEP_OUTS])
@pytest.mark.parametrize("diameter", [0.006, 0.02])
def test_boundaries_of_any_shape(shape, make_in, diameter, keep_outs):
    marker = make_in(shape, 6, diameter, keep_outs)
    sheet = sheet_for(marker)
    check_sheet(marker, sheet)
    whole = shapely.union_all(
        [shapely.Polygon(ring) for ring in shape.outlines() if shapely.is_ccw(shapely.linearrings(ring))]
    )
    edges = shapely.MultiLineString([shapely.LinearRing(ring) for ring in shape.outlines()])
    drawn = shapely.MultiLineString([
        (np.array(s.points) - sheet.origins_mm[0]) / 1e3 for s in sheet.scene["cut"]
    ])  # fmt: skip
    # The hairline is the outline, but for what quiet zones take and a step of 1 mm on either side.
    assert shapely.hausdorff_distance(drawn, shapely.intersection(edges, drawn.buffer(1e-9))) < 1e-8
    quiet = shapely.union_all([shapely.Point(p).buffer(diameter + 2e-3) for p in marker.xyz[:, :2]])
    assert shapely.length(drawn) <= edges.length + 1e-9
    assert shapely.difference(edges, quiet).difference(drawn.buffer(1e-6)).length < 1e-5
    for line in (s for s in sheet.scene if s.name.startswith(("axis", "center"))):
        mark = shapely.LineString((np.array(line.points) - sheet.origins_mm[0]) / 1e3)
        if line.name.startswith("axis"):
            # A tick may stand on the outline, and points away from it.
            mark = shapely.line_interpolate_point(mark, [1e-4, 1e-3, 1.0])
            assert not shapely.intersects(whole, mark).any()
        assert np.all(shapely.distance(edges, mark) > 0)
    assert not [s for s in sheet.scene["cut"] if s.name.startswith("keep-out-")]
    for line in (s for s in sheet.scene["marks"] if s.name.startswith("keep-out-")):
        assert np.min(shape.depth((along(line) - sheet.origins_mm[0]) / 1e3)) > -1e-3


def test_wide_markers_lie_on_their_side(shapes, make_in):
    sheet = sheet_for(make_in(shapes["two squares"], 6, 0.015))
    assert str(sheet.paper) == "A4-landscape (297 x 210 mm)"
    assert sheet.notes[0] == sentence("needs paper", "A4-landscape (297 x 210 mm)", "outline is 260 x 100 mm")
    with pytest.raises(InputError, match=r"260 x 100 mm, found A4 \(210 x 297 mm\); use --paper A4-land"):
        sheet_for(make_in(shapes["two squares"], 6, 0.015), "A4-portrait")
    # A name that does not say which way round lets the marker decide.
    assert sheet_for(make_in(shapes["two squares"], 6, 0.015), "A4").paper.name == "A4-landscape"


def test_a_kept_origin_has_ticks_only_where_the_marker_is(make_in):
    # The origin is in the lower left corner: from there the axes run along the edges.
    boundary = polygon_from([np.array([[0, 0], [0.12, 0], [0.1, 0.08], [0, 0.08]])], origin="file")
    marker = make_in(boundary, 5, 0.01)
    sheet = sheet_for(marker)
    check_sheet(marker, sheet)
    shapes = named(sheet)
    assert {name for name in shapes if name.startswith("axis")} <= {"axis+x", "axis+y"}
    assert not any(name.startswith("center") for name in shapes)
    left, right = sheet.origins_mm[0][0], sheet.paper.width - sheet.origins_mm[0][0] - 120
    assert left == pytest.approx(right, abs=ROUNDING)


def test_an_origin_far_away_needs_no_paper(make_in):
    boundary = polygon_from([0.7 + np.array([[0, 0], [0.12, 0], [0.1, 0.08], [0, 0.08]])], origin="file")
    check_paper(boundary, SheetOptions())
    sheet = sheet_for(make_in(boundary, 5, 0.01))
    assert sheet.paper.name == "A5"
    check_sheet(make_in(boundary, 5, 0.01), sheet)
    assert not any(name.startswith("center") for name in named(sheet))
    assert "origin is not" in sheet.notes[-1]
    at_hand = polygon_from([np.array([[0, 0], [0.12, 0], [0.1, 0.08], [0, 0.08]])], origin="file")
    assert not any("origin" in note for note in sheet_for(make_in(at_hand, 5, 0.01)).notes)


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(
    count=st.integers(4, 14),
    seed=st.integers(0, 2**32 - 1),
    radius=st.floats(0.02, 0.3),
    share=st.floats(0.02, 0.3),
    scatter=st.floats(0.2, 1.0),
    paper=st.sampled_from([None, "A0", "A0-landscape"]),
)
def test_random_layouts_keep_every_quiet_zone(make_marker, count, seed, radius, share, scatter, paper):
    diameter = share * radius
    rng = np.random.default_rng(seed)
    points: list[np.ndarray] = []
    for _ in range(200):
        r, phi = scatter * (radius - 0.6 * diameter) * np.sqrt(rng.random()), 2 * np.pi * rng.random()
        candidate = r * np.array([np.cos(phi), np.sin(phi)])
        if len(points) < count and all(np.hypot(*(candidate - p)) > 1.1 * diameter for p in points):
            points.append(candidate)
    marker = make_marker(np.array(points), radius, diameter)
    check_sheet(marker, sheet_for(marker, paper))


@pytest.mark.parametrize(
    ("radius", "paper"), [(0.04, "A5"), (0.085, "A4"), (0.1, "A3"), (0.15, "A2"), (0.25, "A1"), (0.38, "A0")]
)
def test_smallest_iso_paper_that_holds_the_marker(make_ngon, radius, paper):
    marker = make_ngon(5, radius, radius / 8)
    sheet = sheet_for(marker)
    assert sheet.paper == PAPERS[paper.lower()]
    smaller = [p.name for p in ISO[: [p.name for p in ISO].index(paper)]]
    for name in smaller:
        with pytest.raises(InputError, match=f"found {name} .*use --paper {paper}"):
            sheet_for(marker, name)


def test_unknown_paper_and_bare_points(make_ngon):
    with pytest.raises(InputError, match="did you mean 'A4'"):
        sheet_for(make_ngon(5, 0.05, 0.01), "A44")
    with pytest.raises(InputError, match="diameter 0"):
        sheet_for(make_ngon(5, 0.05, 0.0))


def test_caption_says_what_size_means(make_ngon, make_in, shapes):
    for marker, phrase in (
        (make_ngon(5, 0.15, 0.036), "size: diameter of the outline"),
        (make_in(shapes["rectangle"], 6, 0.01), "size: width x height of the outline"),
    ):
        sheet = sheet_for(marker)
        heading = named(sheet)["block-size-heading"]
        x = heading.segments[0][1][0][0] - text(phrase, 0, 0, 1.35 * Frame(sheet.paper).scale).segments[0][1][0][0]
        expected = text(
            phrase, x, Frame(sheet.paper).margin + 4.4 * Frame(sheet.paper).scale, 1.35 * Frame(sheet.paper).scale
        )
        assert np.allclose(heading.path_points, expected.path_points, atol=1e-9)


@pytest.mark.parametrize("paper", sorted(PAPERS))
def test_every_paper_has_a_whole_ruler_and_words_to_check_it_by(make_ngon, paper):
    sheet = sheet_for(make_ngon(4, 0.03, 0.008), paper)
    shapes = named(sheet)
    check_sheet(make_ngon(4, 0.03, 0.008), sheet)
    length = sheet.rulers_mm[0]
    frame = Frame(sheet.paper)
    assert length % 50 == 0
    assert 50 <= length <= 200
    ticks = {mm: shapes[f"ruler-{mm}"].points[0][0] for mm in range(0, int(length) + 1, 10)}
    assert f"ruler-{int(length) + 10}" not in shapes
    assert all(x - ticks[0] == pytest.approx(mm, abs=1e-9) for mm, x in ticks.items())
    assert [name for name in shapes if name.startswith("ruler-number")] == [
        f"ruler-number-{mm}" for mm in range(50, int(length) + 1, 50)
    ]
    # The longest that fits: 50 mm more would run into the axes.
    assert length == 200 or ticks[0] + length + 50 > bounds(shapes["axes-y-label"])[0] - 10 * frame.scale
    for axis, measured in enumerate(sheet.rulers_mm):
        assert measured in (100, 150, 200)
        ends = [shapes[f"{'ruler-y' if axis else 'ruler'}-{mm}"].points[0] for mm in (0, measured)]
        assert np.subtract(ends[1], ends[0]) == pytest.approx([measured, 0] if axis == 0 else [0, measured], abs=1e-9)
    assert {"remedy-0-0", "remedy-1-0", "check-x-0", "check-y-0", "check-rulers-0"} <= set(shapes)


@pytest.mark.parametrize(
    "paper", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in sorted(PAPERS)]
)
def test_nothing_around_the_marker_overlaps(make_ngon, paper):
    sheet = sheet_for(make_ngon(4, 0.03, 0.008), paper)
    furniture = [s for s in sheet.scene["text"] if not s.name.startswith("number-")]
    furniture += [s for s in sheet.scene["marks"] if s.name in {"rule", "axes-x", "axes-y", "ruler"}]
    furniture += [s for s in sheet.scene["marks"] if s.name == "ruler-y"]
    joined = [{"axes-x", "axes-y"}, {"ruler", "ruler-y"}]
    for a, b in combinations(furniture, 2):
        assert {a.name, b.name} in joined or apart(bounds(a), bounds(b)), (a.name, b.name)


def test_caption_holds_the_facts(make_ngon):
    marker = make_ngon(5, 0.15, 0.036)
    sheet = sheet_for(marker)
    shapes, frame = named(sheet), Frame(sheet.paper)
    for name, phrase in {
        "block-dots": "5",
        "block-dot-diameter": "36 mm",
        "block-size": "300 mm across",
        "block-scale": "1 : 1, print at 100 %",
    }.items():
        x = shapes[name].segments[0][1][0][0] - text(phrase, 0, 0, 1.9 * frame.scale).segments[0][1][0][0]
        assert shapes[name] == text(phrase, x, frame.margin, 1.9 * frame.scale, name=name) or np.allclose(
            shapes[name].path_points, text(phrase, x, frame.margin, 1.9 * frame.scale).path_points, atol=1e-9
        )
    right = bounds(shapes["block-made-with"])[2]
    assert frame.right - 1 < right <= frame.right + 1e-9
    assert text_width("markergen", 1.9 * frame.scale) > 0


def test_axes_point_right_and_up(make_ngon):
    shapes = named(sheet_for(make_ngon(5, 0.15, 0.036)))
    (x0, y0), (x1, y1) = shapes["axes-x"].points
    assert x1 > x0
    assert y1 == y0
    (x0, y0), (x1, y1) = shapes["axes-y"].points
    assert y1 > y0
    assert x1 == x0
    assert isinstance(shapes["axes-x-head"], FilledPath)
    assert bounds(shapes["axes-x-label"])[0] > bounds(shapes["axes-x-head"])[2]
    assert bounds(shapes["axes-y-label"])[1] > bounds(shapes["axes-y-head"])[3]


def test_axis_ticks_start_on_the_boundary_where_it_is_free(make_ngon):
    sheet = sheet_for(make_ngon(5, 0.15, 0.036))
    shapes, (x, y) = named(sheet), sheet.origins_mm[0]
    assert shapes["axis+x"].points[0] == pytest.approx((x + 150, y), abs=1e-9)
    assert shapes["axis-x"].points[0] == pytest.approx((x - 150, y), abs=1e-9)
    assert shapes["axis-y"].points[0] == pytest.approx((x, y - 150), abs=1e-9)
    # The key dot stands at the top: the tick moves out of its quiet zone and stays on the axis.
    assert shapes["axis+y"].points[0][0] == pytest.approx(x, abs=1e-9)
    assert shapes["axis+y"].points[0][1] > y + 128.4 + 36


def test_center_cross_is_black_on_paper_white_on_a_dot_and_left_out_beside_one(make_marker):
    far = np.array([[0.1, 0], [-0.1, 0], [0, 0.1], [0, -0.1]])

    def crosses(points: np.ndarray) -> list:
        scene = sheet_for(make_marker(points, 0.15, 0.03)).scene
        return [shape for shape in scene if shape.name.startswith("center")]

    assert [cross.color for cross in crosses(far)] == ["#000000"] * 2
    assert [cross.color for cross in crosses(np.concatenate([far, [[0, 0]]]))] == [WHITE] * 2
    assert crosses(np.concatenate([far, [[0.02, 0]]])) == []
    # In the hole of the ring it is black again.
    in_hole = crosses(np.concatenate([[[0, 0]], far]))
    assert [cross.color for cross in in_hole] == ["#000000"] * 2
    assert all(bounds(cross)[2] - bounds(cross)[0] < 15 for cross in in_hole)


@pytest.mark.parametrize("offset", [0.001, 0.003, 0.006, 0.009, 0.0149])
def test_white_cross_leaves_the_center_of_gravity_alone(make_marker, offset):
    points = np.array([[0.1, 0], [-0.1, 0], [0, 0.1], [0, -0.1], [offset, 0]])
    sheet = sheet_for(make_marker(points, 0.15, 0.03))
    crosses = [shape for shape in sheet.scene if shape.name.startswith("center")]
    area = sum(np.hypot(*np.subtract(c.points[1], c.points[0])) * c.width for c in crosses)
    assert area * offset * 1e3 / (np.pi * 15**2) <= CENTROID_PULL * (1 + 1e-9)
    disk = next(d for d in sheet.scene["dots"] if d.name == "dot-4")
    assert all(segment_distance(np.array([disk.x, disk.y]), c) < disk.radius for c in crosses)


def test_same_marker_gives_an_equal_sheet(make_ngon):
    assert sheet_for(make_ngon(7, 0.1, 0.02)) == sheet_for(make_ngon(7, 0.1, 0.02))


def test_dots_that_have_no_room_for_a_number_are_named(make_marker):
    # Seven dots packed like coins: the middle one's surroundings are all quiet zone.
    angles = np.arange(6) * np.pi / 3
    ring = 0.022 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    sheet = sheet_for(make_marker(np.concatenate([ring, [[0, 0]]]), 0.1, 0.02))
    assert isinstance(sheet.scene["dots"][6], Disk)
    assert sheet.notes[-1].startswith("Dot 6 has no room")


@pytest.mark.parametrize("margin", [0.0, 0.003, 0.025])
def test_nothing_is_nearer_to_the_edge_than_the_margin(make_ngon, check_page, margin):
    for markers, paper in (
        ([make_ngon(5, 0.05, 0.01)], "A4"),
        ([make_ngon(5, 0.03, 0.006)] * 3, None),
        ([make_ngon(5, 0.15, 0.036)], "A4"),
    ):
        for sheet in pages_for(markers, SheetOptions(paper, margin=margin)):
            check_page(sheet, margin * 1e3)


def test_margins_that_leave_nothing(make_ngon):
    with pytest.raises(InputError, match=r"70 x 70 mm of A5 \(148 x 210 mm\), found 50 mm;"):
        pages_for([make_ngon(5, 0.02, 0.005)], SheetOptions("A5", margin=0.05))
    with pytest.raises(InputError, match=r"from 0, found overlap=-0\.01"):
        SheetOptions(overlap=-0.01)
    with pytest.raises(InputError, match=r"a margin from 0, found margin=-0\.01"):
        SheetOptions(margin=-0.01)
    with pytest.raises(InputError, match="or landscape, found 'sideways'"):
        SheetOptions(orientation="sideways")  # type: ignore[arg-type]


def test_narrow_margins_hold_a_larger_marker(make_ngon):
    marker = make_ngon(5, 0.094, 0.01)
    assert pages_for([marker], SheetOptions("A4", margin=0.004, tile=False))[0].paper.name == "A4"
    with pytest.raises(InputError, match="found A4"):
        pages_for([marker], SheetOptions("A4", tile=False))


def test_paper_that_the_margin_leaves_nothing_of_is_no_choice(make_ngon):
    sheet = pages_for([make_ngon(5, 0.02, 0.005)], SheetOptions(margin=0.05))[0]
    assert sheet.paper.name == "A4"
    with pytest.raises(InputError, match=r"leaves 70 x 70 mm of A0-landscape"):
        pages_for([make_ngon(5, 0.02, 0.005)], SheetOptions(margin=0.4))


def test_orientation_turns_named_and_chosen_paper(make_ngon):
    marker = make_ngon(5, 0.05, 0.01)
    for paper, orientation, name in (
        ("letter", "landscape", "letter-landscape"),
        ("A4", "portrait", "A4"),
        (None, "landscape", "A4-landscape"),
        ("200x300mm", "landscape", "300x200mm"),
        ("300x200mm", "", "300x200mm"),
    ):
        sheet = pages_for([marker], SheetOptions(paper, orientation, tile=False))[0]
        assert sheet.paper.name == name
        check_sheet(marker, sheet)
    with pytest.raises(InputError, match=r"portrait, .* found 'A4-landscape'"):
        pages_for([marker], SheetOptions("A4-landscape", "portrait"))


@pytest.mark.parametrize("marker", [(5, 0.07, 0.016), (5, 0.15, 0.036)], ids=["whole", "tiles"])
def test_a_compensated_sheet_is_larger_where_the_printer_shrinks(make_ngon, marker):
    designed = make_ngon(*marker)
    sx, sy = 0.993, 0.9955
    measured = replace(
        designed,
        control_points=tuple(replace(p, x=p.x * sx, y=p.y * sy) for p in designed.control_points),
        print_scale=(sx, sy),
    )
    plain = pages_for([measured], SheetOptions("A4"))
    assert plain == pages_for([designed], SheetOptions("A4"))
    sheets = pages_for([measured], SheetOptions("A4", compensate=True))
    assert "scaled by 1.00705 along x and 1.00452 along y" in " ".join(sheets[0].notes)
    count = 0
    for sheet in (sheet for sheet in sheets if sheet.origins_mm):
        for dot in sheet.scene["dots"]:
            point = designed.control_points[int(dot.name.removeprefix("dot-"))]
            count += 1
            # From the printer the dots are where they were designed.
            result = (dot.x - sheet.origins_mm[0][0]) * sx, (dot.y - sheet.origins_mm[0][1]) * sy
            assert result == pytest.approx((point.x * 1e3, point.y * 1e3), abs=1e-8)
        shapes = named(sheet)
        for axis, (name, scale) in enumerate((("ruler", sx), ("ruler-y", sy))):
            length = sheet.rulers_mm[axis]
            ends = [shapes[f"{name}-{mm}"].points[0][axis] for mm in (0, length)]
            assert (ends[1] - ends[0]) * scale == pytest.approx(length, abs=1e-9)
        assert any("scale" in name for name in shapes)
    assert count == len(designed)
    with pytest.raises(InputError, match="rescale with --measured-x"):
        pages_for([designed], SheetOptions("A4", compensate=True))


def test_inverted_markers_lie_on_a_printed_ground(make_ngon, check_page):
    marker = make_ngon(5, 0.07, 0.016)
    sheet = pages_for([marker], SheetOptions("A4", colors=INVERTED))[0]
    check_page(sheet)
    assert min(sheet.rulers_mm) >= 150, "the ground leaves room for both"
    assert [layer.name for layer in sheet.scene.layers] == ["ground", "dots", "cut", "marks", "text"]
    ground = sheet.scene["ground"][0]
    left, bottom, right, top = bounds(ground)
    assert ground.color == "#000000"
    for dot in sheet.scene["dots"]:
        assert dot.color == "#ffffff"
        assert left < dot.x - 2 * dot.radius
        assert right > dot.x + 2 * dot.radius
        assert bottom < dot.y - 2 * dot.radius
        assert top > dot.y + 2 * dot.radius
    for shape in sheet.scene:
        box = bounds(shape)
        on_ground = left <= box[0] and right >= box[2] and bottom <= box[1] and top >= box[3]
        if shape.name.startswith(("number-", "axis", "center", "boundary")):
            assert on_ground
            assert shape.color not in ("#000000", GRAY)
        elif not shape.name.startswith(("dot-", "ground")):
            assert apart(box, bounds(ground))


def test_lines_for_a_cutter_are_closed(make_in, shapes):
    marker = make_in(shapes["plate"], 6, 0.02, (Circle(0.012),))
    colors = parse_colors("black,cut:CutContour")
    marker = replace(marker, substrate=Substrate(holes=parse_mount("24mm:0mm,0mm")))
    (sheet,) = pages_for([marker], SheetOptions(colors=colors))
    lines = sheet.scene["cut"]
    assert [line.name for line in lines] == ["boundary-0", *(f"hole-{k}" for k in range(5))]
    assert all(line.closed and line.color == colors.cut for line in lines)
    assert not any("gaps" in note for note in sheet.notes)
    hairlines = sheet_for(marker).scene["cut"]
    assert {line.color for line in hairlines} == {"#9a9a9a"}
    assert all(line.closed for line in hairlines if line.name.startswith("hole"))
    # Around a hole of 12 mm: chords are within 0.5 um of the circle.
    hole = np.array(lines[1].points) - sheet.origins_mm[0]
    assert np.min(np.hypot(*(hole[:-1] + hole[1:]).T / 2)) == pytest.approx(12, abs=1e-3)


def test_a_layout_takes_few_calls(make_ngon):
    for markers, paper in (
        ([make_ngon(5, 0.15, 0.036)], None),
        ([make_ngon(5, 0.15, 0.036)], "A4"),
        ([make_ngon(5, 0.03, 0.008)] * 4, None),
    ):
        calls = 0

        def count(frame, event, argument):
            nonlocal calls
            calls += event == "call"

        sys.setprofile(count)
        try:
            pages_for(markers, SheetOptions(paper))
        finally:
            sys.setprofile(None)
        # 71,000 to 118,000, most of them for points of letters; one more layout on trial would double them.
        assert calls < 180_000


def ring_of_dots(count, radius, dot, boundary):
    angle = np.arange(count) * 2 * np.pi / count
    marker = Marker.from_points(radius * np.column_stack([np.cos(angle), np.sin(angle)]), dot)
    return replace(marker, boundary=Circle(boundary))


def test_a_line_along_the_boundary_leaves_no_specks():
    # Between the quiet zones, 1.5 to 2.3 mm are left of it, and 6.1 mm or more if it is farther out.
    crowded, free = (sheet_for(ring_of_dots(46, 0.14, "9.7mm", boundary)) for boundary in (0.146, 0.148))
    lengths = [np.hypot(*np.diff(line.points, axis=0).T).sum() for line in crowded.scene["cut"]]
    assert 0 < len(lengths) < 46
    assert min(lengths) > 2
    assert len(free.scene["cut"]) == 46


def test_a_small_boundary_is_cut_whole():
    (sheet,) = pages_for(
        [ring_of_dots(5, 2e-4, "0.08mm", 2.5e-4)], SheetOptions(colors=parse_colors("black,cut:CutContour"))
    )
    assert [line.closed for line in sheet.scene["cut"]] == [True]
