"""The first page of a fabrication sheet, looked at as shapes."""

from itertools import combinations

import numpy as np
import pytest
from workpieces import GRID, MARKERS, case, described, ngon

from markergen.drawing.drafting import DARK, Lettering
from markergen.drawing.fabrication_views import drawing_area, front_page
from markergen.drawing.paper import SheetOptions
from markergen.drawing.scene import FilledPath, Line, bounds
from markergen.errors import InputError
from markergen.model.boundary import Polygon
from markergen.model.substrate import Hole


def front_of(marker, options=None, **choices):
    return front_page(described(marker, **choices), options or SheetOptions())


@pytest.fixture(scope="module", params=list(MARKERS))
def front(request):
    return MARKERS[request.param], front_of(MARKERS[request.param])


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


def test_a_pitch_circle_larger_than_the_plate_ends_at_its_edges():
    corners = tuple(Hole(0.15 * x, 0.09 * y, 0.0043, use="mount", name="M4") for x in (-1, 1) for y in (-1, 1))
    plate = Polygon((((-0.16, -0.1), (0.16, -0.1), (0.16, 0.1), (-0.16, 0.1)),))
    check_inside(front_of(case(ngon(5, 0.05), plate, 0.018, holes=corners)))


def test_no_two_texts_touch(front):
    boxes = [bounds(shape) for shape in texts(front[1]) if shape.segments]
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)


def test_every_dot_has_its_number_and_every_callout_its_words(front):
    marker, page = front
    names = [shape.name for shape in texts(page)]
    numbers = [name for name in names if name.startswith("number-")]
    assert sorted(numbers) == sorted(f"number-{point.id}" for point in marker.control_points)
    kinds = len({(p.feature.diameter, p.feature.inner_diameter) for p in marker.control_points})
    kinds += len({hole.diameter for hole in marker.substrate.holes}) + (marker.tag is not None)
    assert len([name for name in names if name.startswith("callout-") and name.endswith("-0")]) == kinds


def test_words_lie_where_their_outlines_do(front):
    for shape in texts(front[1]):
        if shape.words.strip():
            left, bottom, right, top = bounds(shape)
            (x, y), air = shape.start, 0.35 * shape.height
            assert left - air <= x <= right + air
            assert bottom - air <= y <= top + air
            assert (top - bottom > right - left) == shape.upright or len(shape.words) == 1


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


def test_leaders_keep_off_dots_where_they_can():
    front = front_of(MARKERS["many"])
    words = next(bounds(shape) for shape in front.shapes if shape.name == "callout-1-0")
    runs = [shape.points for shape in front.shapes if isinstance(shape, Line) and len(shape.points) == 2]
    (level,) = [
        (a, b) for a, b in runs if a[1] == b[1] and words[1] < a[1] < words[3] and 0 < words[0] - max(a[0], b[0]) < 2
    ]
    # The ring is at one end of a row of ten: its leader runs level between two rows.
    assert abs(level[1][0] - level[0][0]) > 100
    rows = {front.origin[1] + 500 * y for y in GRID[:, 1].tolist()}
    assert min(abs(row - level[0][1]) for row in rows) > 4.5


def test_the_paper_is_a4_or_a3_or_what_is_asked_for():
    def paper(name, options=None):
        return front_of(MARKERS[name], options).frame.paper.name

    assert paper("small") == "A4-landscape"
    assert paper("disk") == "A3-landscape"
    assert paper("disk", SheetOptions("A4")) in {"A4", "A4-landscape"}
    assert paper("disk", SheetOptions("A2-landscape")) == "A2-landscape"
    assert paper("small", SheetOptions(orientation="portrait")) == "A4"
    with pytest.raises(InputError, match="paper that a fabrication sheet fits on"):
        paper("disk", SheetOptions("100x100mm", margin=0.013))
