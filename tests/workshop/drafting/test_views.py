"""The first page of a fabrication sheet, looked at as shapes."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from workpieces import GRID, MARKERS, case, described, ngon

from markergen.drawing.paper import SheetOptions
from markergen.drawing.scene import FilledPath, Line, bounds
from markergen.errors import InputError
from markergen.model.boundary import Circle, Polygon
from markergen.model.feature import Feature
from markergen.model.substrate import Hole
from markergen.model.tag import Tag
from markergen.workshop.drafting.details import back_view, stacked
from markergen.workshop.drafting.drawing import Dimension
from markergen.workshop.drafting.pen import CLOSE, DARK, DrawingView, Lettering, Style
from markergen.workshop.drafting.symbols import projection_symbol
from markergen.workshop.drafting.views import drawing_area, front_page


def front_of(marker, options=None, **choices):
    return front_page(described(marker, **choices), options or SheetOptions())


@cache
def usual_front(name):
    return front_of(MARKERS[name])


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=[pytest.mark.long] * (name == "disk")) for name in MARKERS]
)
def front(request):
    return MARKERS[request.param], usual_front(request.param)


def texts(front):
    return [shape for shape in front.shapes if isinstance(shape, Lettering)]


def check_inside(front):
    boxes = np.array([bounds(s) for s in front.shapes if not (isinstance(s, FilledPath) and not s.segments)])
    left, bottom, right, top = drawing_area(front.frame)
    # The border and the title block are 3 mm away, on A4.
    air = 2.5 * front.frame.scale
    assert np.all(boxes[:, :2] > (left - air, bottom - air))
    assert np.all(boxes[:, 2:] < (right + air, top + air))


def test_all_ink_is_inside_of_the_border(front):
    check_inside(front[1])


RECTANGLE = Polygon((((-0.16, -0.1), (0.16, -0.1), (0.16, 0.1), (-0.16, 0.1)),))


def test_holes_by_place_have_places_and_no_circle_off_the_page():
    corners = tuple(Hole(0.15 * x, 0.09 * y, 0.0043, use="mount", name="M4") for x in (-1, 1) for y in (-1, 1))
    pair = tuple(Hole(0.15 * x, 0.0, 0.004, use="dowel", name="4 mm pin") for x in (-1, 1))
    for holes in (corners, pair):
        front = front_of(case(ngon(5, 0.05), RECTANGLE, 0.018, holes=holes))
        check_inside(front)
        written = " ".join(shape.text for shape in texts(front))
        assert "circle" not in written
        assert "in the table" in written or "H1 at x -150 , y 0" in " ".join(written.split())


def test_no_two_texts_touch(front):
    boxes = [bounds(shape) for shape in texts(front[1]) if shape.segments]
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)


def test_every_dot_has_its_number_and_every_callout_its_words(front):
    marker, page = front
    names = [shape.name for shape in texts(page)]
    numbers = [name for name in names if name.startswith("number-")]
    holes = [f"number-H{number}" for number, _ in enumerate(marker.substrate.holes, 1)]
    assert sorted(numbers) == sorted([*(f"number-{point.id}" for point in marker.control_points), *holes])
    work = described(marker)
    assert len([name for name in names if name.startswith("callout-") and name.endswith("-0")]) == len(work.callouts)
    assert [name for name in names if name.startswith("datum-")] != []


def test_words_lie_where_their_outlines_do(front):
    for shape in texts(front[1]):
        if shape.text.strip():
            left, bottom, right, top = bounds(shape)
            (x, y), air = shape.start, 0.35 * shape.height
            assert left - air <= x <= right + air
            assert bottom - air <= y <= top + air
            assert (top - bottom > right - left) == shape.upright or len(shape.text) == 1


def test_the_front_view_is_true_to_its_scale(front):
    marker, page = front
    x, y = page.origin
    dark = [
        np.array([p for _, points in shape.segments for p in points])
        for shape in page.shapes
        if isinstance(shape, FilledPath) and shape.color == DARK
    ]
    middles = np.array([(points.max(axis=0) + points.min(axis=0)) / 2 for points in dark])
    for point in marker.control_points:
        place = np.array([x + 1e3 * page.scale * point.x, y + 1e3 * page.scale * point.y])
        # Polygons within 2 um of their circles.
        assert np.hypot(*(middles - place).T).min() < 4e-3 * max(page.scale, 1)


def test_sizes_on_the_drawing_are_those_of_the_plate():
    page = front_of(case(ngon(5, 0.05), RECTANGLE, 0.018, edge=0.003))
    written = [shape.text for shape in texts(page)]
    # 320 x 200 mm with an edge of 3 mm; the origin is in the middle, in boxes, from the edges B and C.
    assert {"326", "206", "163", "103", "4 \xb10.2"} <= set(written)
    view = {shape.text: bounds(shape) for shape in texts(page)}
    boxes = [bounds(shape) for shape in page.shapes if isinstance(shape, Line) and len(shape.points) == 5]
    for phrase in ("163", "103"):
        around = [b for b in boxes if np.all(np.abs(np.subtract(b, view[phrase])) < 1.5)]
        assert around, f"{phrase} is theoretically exact, and in a box"
    for phrase in ("326", "206"):
        assert not [b for b in boxes if np.all(np.abs(np.subtract(b, view[phrase])) < 1.5)]
    # From dowels the distances of the edges are sizes like others.
    pins = tuple(Hole(0.15 * x, 0.0, 0.004, use="dowel", name="4 mm pin") for x in (-1, 1))
    other = front_of(case(ngon(5, 0.05), RECTANGLE, 0.018, edge=0.003, holes=pins))
    assert {"326", "206", "163", "103"} <= {shape.text for shape in texts(other)}
    # An arrow at either end of the overall width, as far apart as the plate is wide at this scale.
    x, _ = page.origin
    ends = [x + sign * 163 * page.scale for sign in (-1, 1)]
    paths = [shape for shape in page.shapes if isinstance(shape, FilledPath) and not isinstance(shape, Lettering)]
    tips = [shape.segments[0][1][0][0] for shape in paths if len(shape.segments) == 4]
    assert all(min(abs(tip - end) for tip in tips) < 1e-6 for end in ends)


@pytest.mark.parametrize(
    ("paper", "above"), [("A3-landscape", True), pytest.param("tabloid-landscape", False, marks=pytest.mark.long)]
)
def test_the_view_from_below_is_above_in_first_angle_projection(paper, above):
    page = front_of(MARKERS["disk"], SheetOptions(paper))
    (side,) = [bounds(shape) for shape in page.shapes if shape.name == "side-words"]
    assert (side[1] > page.origin[1] + 166 * page.scale) == above


def test_center_lines_end_at_numbers(front):
    _, page = front
    numbers = [bounds(shape) for shape in page.shapes if shape.name.startswith("number-")]
    lines = [shape for shape in page.shapes if isinstance(shape, Line) and len(shape.points) == 2]
    for left, bottom, right, top in numbers:
        for line in lines:
            points = np.linspace(*line.points, 50)
            within = np.all((points > (left, bottom)) & (points < (right, top)), axis=-1)
            assert not within.any()


@pytest.mark.long
def test_too_many_callouts_are_smaller_and_all_there():
    points = [(0.03 * k - 0.105, 0.02 * (-1) ** k) for k in range(8)]
    marker = case(points, RECTANGLE, 0.01, corner_radius=0.004)
    kinds = tuple(Hole(0.03 * k - 0.09, 0.06, 0.003 + k / 2000, use="mount", name="") for k in range(6))
    places = [replace(p, feature=Feature(0.01 + k % 6 / 1000)) for k, p in enumerate(marker.control_points)]
    plate = replace(marker.substrate, holes=kinds)
    front = front_of(replace(marker, control_points=tuple(places), substrate=plate), SheetOptions("A4"), process="cnc")
    check_inside(front)
    names = {shape.name for shape in front.shapes}
    assert {f"callout-{number}-0" for number in range(1, 13)} <= names


def test_leaders_keep_off_dots_where_they_can():
    front = usual_front("many")
    phrase = next(bounds(shape) for shape in front.shapes if shape.name == "callout-1-0")
    runs = [shape.points for shape in front.shapes if isinstance(shape, Line) and len(shape.points) == 2]
    (level,) = [
        (a, b) for a, b in runs if a[1] == b[1] and phrase[1] < a[1] < phrase[3] and 0 < phrase[0] - max(a[0], b[0]) < 2
    ]
    # The ring is at one end of a row of ten: its leader runs level between two rows.
    assert abs(level[1][0] - level[0][0]) > 100
    rows = {front.origin[1] + 500 * y for y in GRID[:, 1].tolist()}
    assert min(abs(row - level[0][1]) for row in rows) > 4.5


def leaders(front):
    """Both legs of each leader: the level one ends beside the words."""
    phrase = [
        bounds(shape) for shape in texts(front) if shape.name.endswith("-0") and shape.name[:4] in ("call", "left")
    ]
    runs = [shape.points for shape in front.shapes if isinstance(shape, Line) and len(shape.points) == 2]
    level = [run for run in runs if run[0][1] == run[1][1]]
    ends = []
    for start, end in level:
        west, east = sorted((start[0], end[0]))
        heights = [(left - east, west - right) for left, low, right, high in phrase if low < start[1] < high]
        if any(0 < apart < 2 for pair in heights for apart in pair):
            ends.append((start, end))
    return [(next(run for run in runs if run not in level and start in run), (start, end)) for start, end in ends]


def test_leaders_cross_dimensions_rather_than_the_tag():
    holes = (Hole(-0.022, -0.008, 0.0034, name="M3"), Hole(0.016, -0.024, 0.0034, 0.0065, name="M3"))
    points = [(0.03, 0.02), (-0.035, 0.018), (-0.01, -0.03), (0.036, -0.012), (0.0, 0.035)]
    outline = Polygon((((-0.06, -0.055), (0.06, -0.055), (0.06, 0.055), (-0.06, 0.055)),))
    tag = Tag("aruco:DICT_4X4_50", 7, 0.02)
    marker = case(points, Circle(0.05), 0.012, tag, holes=holes, outline=outline)
    front = front_of(marker, SheetOptions("A3-landscape"), process="cnc")
    legs = np.array([leg for run in leaders(front) for leg in run]) - front.origin
    assert len(legs) == 10
    share = np.linspace(0, 1, 200)[:, None, None]
    places = legs[:, 0] + share * (legs[:, 1] - legs[:, 0])
    assert (np.abs(places).max(axis=2) > 9.9).all()
    for (a, b), (c, d) in combinations(legs, 2):
        sides = np.linalg.det([b - a, c - a]) * np.linalg.det([b - a, d - a])
        assert sides >= -1e-6 or np.linalg.det([d - c, a - c]) * np.linalg.det([d - c, b - c]) >= -1e-6


def test_words_about_features_on_the_left_stand_there_where_there_is_room():
    pins = tuple(Hole(0.03 * x, 0.0, 0.004, use="dowel", name="4 mm pin") for x in (-1, 1))
    marker = case(ngon(6, 0.05), Circle(0.06), 0.012, holes=pins)
    front = front_of(marker, SheetOptions("A3-landscape"), process="cnc")
    check_inside(front)
    named = {shape.name: bounds(shape) for shape in front.shapes if isinstance(shape, Lettering)}
    assert named["left-1-0"][2] < front.origin[0] - 60


def test_the_back_is_parallel_to_the_face(front):
    work = described(front[0])
    assert (work.parallelism.symbol, work.parallelism.datums) == ("parallelism", ("A",))
    _, bottom, right, _ = bounds(next(s for s in front[1].shapes if getattr(s, "name", "") == "side-words"))
    below = [bounds(s) for s in texts(front[1]) if s.text == work.parallelism.zone and bounds(s)[0] > right]
    assert any(box[1] < bottom for box in below)


@pytest.mark.long
def test_the_paper_is_a4_or_a3_or_what_is_asked_for():
    def paper(name, options=None):
        return front_of(MARKERS[name], options).frame.paper.name

    assert paper("small") == "A4-landscape"
    assert paper("disk") == "A3-landscape"
    assert paper("disk", SheetOptions("A4")) in {"A4", "A4-landscape"}
    assert paper("disk", SheetOptions("A2-landscape")) == "A2-landscape"
    assert paper("small", SheetOptions(orientation="portrait")) == "A4"
    with pytest.raises(InputError, match="paper that a fabrication"):
        paper("disk", SheetOptions("100x100mm", margin=0.013))


@pytest.mark.parametrize("first", [True, False])
def test_the_symbol_of_projection_is_that_of_its_name(first):
    # Both rings show from the narrow end, the left one; in first-angle projection what is on the left is on the right.
    cone, ring, *_ = projection_symbol(0.0, 0.0, 8.0, first)
    (left, *_), (right, *_) = min(cone.path_points), max(cone.path_points)
    heights = {x: max(v for u, v in cone.path_points if u == x) for x in (left, right)}
    assert heights[left] < heights[right]
    assert (bounds(ring)[0] > right) == first
    assert (bounds(ring)[2] < left) != first


def test_numbers_are_nearest_to_their_dots():
    # The middle one of three dots in a row has no room for its number.
    points = [[-0.09, 0.05], [0.08, 0.05], [0.0862, 0.05], [0.0924, 0.05], [-0.09, -0.05]]
    marker = case(points, Polygon((((-0.1, -0.06), (0.1, -0.06), (0.1, 0.06), (-0.1, 0.06)),)), 0.005)
    page = front_page(described(marker), SheetOptions())
    places = {shape.name: shape for shape in page.shapes if shape.name.startswith("number-")}
    for k in range(5):
        left, bottom, right, top = bounds(places[f"number-{k}"])
        center = np.array([(left + right) / 2, (bottom + top) / 2]) - page.origin
        away = np.linalg.norm(1e3 * page.scale * np.array(points) - center, axis=1)
        assert np.argmin(away) == k


def test_the_back_is_as_large_as_its_place_allows():
    # 1084 mm with lines: 218 mm high at 1 : 5, of 240 mm.
    view = back_view(described(case(ngon(12, 0.48), Circle(0.54), 0.01)), 260.0, 240.0)
    assert view.title.startswith("Seen from the back, 1 : 5")
    assert view.height == pytest.approx(1084 / 5 + 1)


@pytest.mark.parametrize("height", np.arange(4.0, 30.0, 1.0))
def test_no_extension_line_runs_through_words_of_another_dimension(height):
    """What is left of one before the words looks like a minus."""
    style = Style(1.4)
    spans = [Dimension(-3.0, 0.0, "3 \xb10.1"), Dimension(0.0, height, f"{height:g} \xb10.03")]
    shapes = stacked(spans, DrawingView(0.0, 0.0, 0.5), 0.0, CLOSE * style.scale, CLOSE * style.scale, style)
    phrase = [bounds(shape) for shape in shapes if isinstance(shape, Lettering)]
    lines = [bounds(shape) for shape in shapes if isinstance(shape, Line)]
    assert len(phrase) == 2
    for left, low, right, high in phrase:
        assert not any(low < y < high and x0 < left and right < x1 for x0, y, x1, y1 in lines if y1 - y < 0.5)
