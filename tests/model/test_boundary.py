import json
import pickle
from itertools import pairwise

import numpy as np
import pytest
import shapely
from cpu import cpu_seconds
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter
from sentences import sentence

from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, circle, flattened, placed, reversed_contour
from markergen.model.boundary import Boundary, Circle, Polygon, area_without, polygon_from
from markergen.model.shape_file import BoundaryFile

SQUARE = ((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))
ROUNDING = 1e-12
"""m; what `project` promises. Doubles at 0.2 m carry 3e-17 m."""


BOUNDARY: TypeAdapter[Boundary] = TypeAdapter(BoundaryFile)


def geometry(boundary: Boundary, fine: int = 20_000) -> shapely.Geometry:
    """Boundary by other means than its own: circles as fine polygons, 4e-9 m off at most, all else by shapely."""
    if isinstance(boundary, Circle):
        angle = 2 * np.pi * np.arange(fine) / fine
        return shapely.Polygon(boundary.size * np.stack([np.cos(angle), np.sin(angle)], axis=-1) + boundary.center)
    if isinstance(boundary, Polygon):
        shape = shapely.Polygon()
        for contour in boundary.contours():
            shape = shapely.symmetric_difference(shape, shapely.Polygon(flattened(contour, 4e-9)))
        return shape
    return shapely.difference(geometry(boundary.boundary), shapely.union_all([geometry(k) for k in boundary.keep_outs]))


def around(boundary: Boundary, count: int, seed: int = 0) -> np.ndarray:
    """Points in and around a boundary, some on its corners and edges."""
    rng = np.random.default_rng(seed)
    corners = np.concatenate(boundary.outlines())
    low, high = corners.min(axis=0), corners.max(axis=0)
    wild = low + (rng.random((count, 2)) * 1.6 - 0.3) * (high - low)
    return np.concatenate([wild, corners[:50], boundary.rim(50)])


def cut(name: str) -> Boundary:
    keep_outs = {
        "a square": (Circle(0.15), [Polygon((tuple((x * 0.3 + 0.05, y * 0.3) for x, y in SQUARE),))]),
        "holes": (Circle(0.15), [Circle(0.02, (0.07, 0.0)), Circle(0.02, (-0.07, 0.0)), Circle(0.03, (0.0, 0.14))]),
        "overlapping": (
            Polygon((SQUARE,)), [Circle(0.03, (0.02, 0.0)), Circle(0.03, (0.05, 0.01)), Circle(0.05, (-0.12, 0.0))]
        ),
        "all but a ring": (Circle(0.15), [Circle(0.1)]),
    }  # fmt: skip
    return area_without(*keep_outs[name])


def shrunk(boundary: Boundary, inset: float) -> shapely.Geometry:
    if isinstance(boundary, Circle):
        return geometry(Circle(boundary.size - inset, boundary.center))
    return shapely.buffer(geometry(boundary), -inset, quad_segs=4000)


CUTS = ("a square", "holes", "overlapping", "all but a ring")


def test_depth_is_the_signed_distance_to_the_outline(shape):
    points, whole = around(shape, 2000), geometry(shape)
    distance = shapely.distance(shapely.boundary(whole), shapely.points(points))
    sign = np.where(shapely.contains_xy(whole, *points.T), 1, -1)
    np.testing.assert_allclose(shape.depth(points), sign * distance, rtol=0, atol=1e-15)
    assert shape.depth(points.reshape(-1, 1, 2)).shape == (len(points), 1)
    # One point at a time takes another way through the code than many.
    np.testing.assert_array_equal([shape.depth(point) for point in points[:50]], shape.depth(points)[:50])


def test_depth_gradient_is_that_of_depth(shape):
    points = around(shape, 300)[:300]
    step = 1e-7
    by_difference = np.stack(
        [(shape.depth(points + offset) - shape.depth(points - offset)) / (2 * step) for offset in step * np.eye(2)],
        axis=-1,
    )
    gradient = shape.depth_gradient(points)
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=-1), 1, atol=1e-12)
    # A difference quotient is wrong where a kink is within its step: 1e-7 m of 0.2 m, so next to nowhere.
    assert np.mean(np.abs(gradient - by_difference).max(axis=-1) < 1e-6) > 0.99


def test_depth_gradient_on_the_outline_points_inside(shape):
    rim = np.concatenate([shape.rim(97), *shape.outlines()])
    assert np.all(shape.depth(rim + 1e-6 * shape.depth_gradient(rim)) > 0)


@pytest.mark.parametrize("inset", [0.0, 0.004, 0.02])
def test_project_finds_the_nearest_point_deep_enough(shape, inset):
    points = around(shape, 1000)
    projected = shape.project(points, inset)
    assert np.max(inset - shape.depth(projected)) <= ROUNDING
    # The arcs of shapely's buffer are polygons, here within 1e-9 m of the arcs.
    inner = shapely.buffer(geometry(shape), -inset, quad_segs=4000)
    best = shapely.distance(inner, shapely.points(points))
    np.testing.assert_allclose(np.hypot(*(projected - points).T), best, rtol=0, atol=2e-9)
    deep = shape.depth(points) >= inset
    np.testing.assert_array_equal(projected[deep], points[deep])
    again = shape.project(projected, inset)
    np.testing.assert_allclose(again, projected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("inset", [0.0, 0.004, 0.018])
@pytest.mark.parametrize("name", CUTS)
def test_project_keeps_off_keep_outs(name, inset):
    boundary = cut(name)
    points = around(boundary, 500)
    projected = boundary.project(points, inset)
    assert np.max(inset - boundary.depth(projected)) <= ROUNDING
    for keep_out in boundary.keep_outs:
        assert np.max(keep_out.depth(projected) + inset) <= ROUNDING
    # Part by part: of the whole GEOS's buffer is wrong by 14 mm where two such fine circles meet.
    inner = shrunk(boundary.boundary, inset)
    for keep_out in boundary.keep_outs:
        inner = shapely.difference(inner, shrunk(keep_out, -inset))
    best = shapely.distance(inner, shapely.points(points))
    np.testing.assert_allclose(np.hypot(*(projected - points).T), best, rtol=0, atol=1e-7)


@given(
    st.lists(st.tuples(st.integers(-40, 40), st.integers(-40, 40)), min_size=3, max_size=9),
    st.integers(0, 8),
    st.integers(0, 2**32 - 1),
)
@example([(0, 0), (11, 40), (-19, 4), (-24, -2)], 0, 0)
@settings(max_examples=60)
def test_any_polygon_agrees_with_brute_force(corners, inset_mm, seed):
    # Whole millimeters, so that edges on one line, parallel ones and insets that fit just so come up.
    # By angle about a corner: next to no order that is drawn at random is free of crossings.
    first, *others = corners
    ordered = [first, *sorted(others, key=lambda corner: np.arctan2(corner[1] - first[1], corner[0] - first[0]))]
    try:
        polygon = Polygon((tuple((x / 1e3, y / 1e3) for x, y in ordered),))
    except InputError:
        return
    inset, points, whole = inset_mm / 1e3, around(polygon, 40, seed), geometry(polygon)
    depth = polygon.depth(points)
    distance = shapely.distance(shapely.boundary(whole), shapely.points(points))
    np.testing.assert_allclose(np.abs(depth), distance, rtol=0, atol=1e-15)
    beside = distance > ROUNDING
    np.testing.assert_array_equal(depth[beside] > 0, shapely.contains_xy(whole, *points[beside].T))
    projected = polygon.project(points, inset)
    # A fine grid, and a finer one around what was found.
    low, high = points.min(axis=0), points.max(axis=0)
    grid = low + np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 60)]), axis=-1).reshape(-1, 2) * (high - low)
    nearby = np.stack(np.meshgrid(*2 * [np.linspace(-1e-4, 1e-4, 9)]), axis=-1).reshape(-1, 2)
    others = np.concatenate([grid, (projected[:, None] + nearby).reshape(-1, 2)])
    if np.min(polygon.depth(projected)) < inset - ROUNDING:
        # Then nothing is so deep, and this is the deepest there is.
        assert np.max(polygon.depth(others)) <= np.min(polygon.depth(projected)) + 1e-9
        return
    others = others[polygon.depth(others) >= inset]
    reach = np.hypot(*(projected - points).T)
    for point, distance in zip(points, reach, strict=True):
        assert distance <= np.hypot(*(others - point).T).min(initial=np.inf) + ROUNDING


def test_an_inset_that_leaves_a_point_or_nothing():
    square = Polygon((SQUARE,))
    points = around(square, 20)
    np.testing.assert_allclose(square.project(points, 0.1), 0, atol=1e-12)
    # Nothing is deeper than 0.1 m; the deepest point is found to a billionth.
    np.testing.assert_allclose(square.project(points, 0.3), 0, atol=1e-9)
    assert np.all(square.depth(square.sample(5, 0.3, np.random.default_rng(0))) > 0.1 - 1e-9)


@pytest.mark.parametrize("inset", [0.0, 0.015])
def test_samples_are_uniform(shape, inset):
    samples = shape.sample(4000, inset, np.random.default_rng(1))
    assert samples.shape == (4000, 2)
    assert np.min(shape.depth(samples)) >= inset
    inner = shapely.buffer(geometry(shape), -inset, quad_segs=50)
    # Counts in slices against their areas: chi-squared of 7 degrees of freedom, beyond 30 once in 10,000 times.
    edges = np.linspace(*inner.bounds[0::2], 9)
    areas = [inner.intersection(shapely.box(a, -1, b, 1)).area for a, b in pairwise(edges)]
    expected = 4000 * np.array(areas) / inner.area
    counts, _ = np.histogram(samples[:, 0], edges)
    full = expected > 0
    assert np.sum((counts - expected)[full] ** 2 / expected[full]) < 30
    assert not counts[~full].any()
    np.testing.assert_array_equal(samples, shape.sample(4000, inset, np.random.default_rng(1)))


@pytest.mark.parametrize("name", CUTS)
def test_samples_avoid_keep_outs(name):
    boundary = cut(name)
    samples = boundary.sample(500, 0.01, np.random.default_rng(0))
    assert np.min(boundary.depth(samples)) >= 0.01


def test_the_rim_is_even_over_all_outer_outlines(shapes):
    rim = shapes["two squares"].rim(16)
    # Eight on each, every 5 cm of 80 cm.
    assert np.sum(rim[:, 0] < 0) == np.sum(rim[:, 0] > 0) == 8
    middles = sorted(np.round(rim[:8] + [0.08, 0], 9).tolist())
    assert middles == sorted([x, y] for a in (-0.025, 0.025) for b in (-0.05, 0.05) for x, y in ((a, b), (b, a)))
    plate = shapes["plate"]
    np.testing.assert_allclose(np.abs(plate.rim(100)).max(axis=1), 0.1, atol=1e-12)
    np.testing.assert_allclose(plate.depth(plate.rim(100)), 0, atol=1e-12)


def test_size_area_and_frame(shapes):
    assert shapes["rectangle"].area == pytest.approx(0.02, rel=1e-12)
    assert shapes["rectangle"].radius == pytest.approx(np.hypot(0.1, 0.05), rel=1e-12)
    assert shapes["L"].area == pytest.approx(0.2 * 0.08 * 2 - 0.08**2, rel=1e-12)
    hole = 32 * 0.008**2 * np.sin(2 * np.pi / 64)
    assert shapes["plate"].area == pytest.approx(0.04 - 4 * hole, rel=1e-12)
    for shape in shapes.values():
        # Corners are whole picometers.
        np.testing.assert_allclose(shape.center, 0, atol=1e-12)
    moved = polygon_from([np.array(SQUARE) + [1.0, 2.0]], origin="file")
    np.testing.assert_allclose(moved.center, [1, 2], atol=1e-12)
    assert moved.radius == pytest.approx(polygon_from([np.array(SQUARE)]).radius, rel=1e-12)


def test_what_an_outline_is_follows_from_what_it_is_in():
    island = [np.array(SQUARE) * scale for scale in (1, 0.5, 0.25)]
    polygon = polygon_from(island)
    assert polygon == polygon_from([np.roll(ring[::-1], 1, axis=0) for ring in island])
    np.testing.assert_array_equal(polygon.depth(np.array([[0, 0], [0.04, 0], [0.085, 0], [0.2, 0]])) > 0, [1, 0, 1, 0])
    assert [shapely.is_ccw(shapely.linearrings(ring)) for ring in polygon.outlines()] == [True, False, True]
    assert str(polygon) == sentence("polygon", "200 mm x 200 mm", "2 regions and 1 hole")


def test_repeated_corners_are_dropped():
    assert Polygon(((*SQUARE, SQUARE[3], SQUARE[0]),)) == Polygon((SQUARE,))


def test_outlines_may_touch_at_a_corner():
    both = Polygon((SQUARE, tuple((x + 0.2, y + 0.2) for x, y in SQUARE)))
    points = np.array([[0.05, 0.05], [0.15, 0.15], [0.05, 0.15], [0.15, 0.05], [0.09, 0.11], [0.11, 0.11]])
    np.testing.assert_array_equal(both.depth(points) > 0, [1, 1, 0, 0, 0, 1])
    # A hole that touches the outline around it, seen from beyond.
    plate = Polygon((SQUARE, ((0.1, 0.0), (0.05, 0.02), (0.05, -0.02))))
    np.testing.assert_array_equal(plate.depth(np.array([[0.12, 0.0], [0.07, 0.0], [0.04, 0.0]])) > 0, [0, 0, 1])


@pytest.mark.parametrize(
    ("rings", "phrase"),
    [
        ((), "at least one outline, found none"),
        ((((0, 0), (1, 1), (1, 0), (0, 1)),), "outline 1 crossing or touching itself at (500 mm, 500 mm)"),
        (
            (SQUARE, ((0, 0), (1, 0), (1, 1), (0.5, 0), (0, 1))),
            "outline 2 crossing or touching itself at (500 mm, 0 mm)",
        ),
        (
            (((0, 0), (0.1, 0), (0.1, 0.08), (0.1 + 1e-12, 0.2), (0.1, 0.09), (0, 0.09)),),
            "outline 1 less than 1 nm from itself at (100 mm, ",
        ),
        (
            (((0, 0), (0.1, 0), (0.1, 0.1), (0.05, 1e-10), (0, 0.1)),),
            "outline 1 less than 1 nm from itself at (50 mm, ",
        ),
        ((SQUARE, tuple((x + 0.1, y + 0.1) for x, y in SQUARE)), "outlines 1 and 2 crossing or sharing a line at (0"),
        ((SQUARE, tuple((x + 0.2, y) for x, y in SQUARE)), "outlines 1 and 2 crossing or sharing a line at (100 mm, "),
        ((SQUARE, SQUARE), "outlines 1 and 2 crossing or sharing a line"),
        ((SQUARE, ((0, 0), (1, 1))), "an area in outline 2, found 2 corners on a line"),
        ((((0, 0), (1, 1), (2, 2)),), "an area in outline 1, found 3 corners on a line"),
        ((((0, 0), (1, float("nan")), (2, 2)),), "finite coordinates in outline 1"),
        ((((0, 0, 1), (1, 0, 2), (2, 2, 3)),), "pairs x, y for outline 1, found an array of shape (3, 3)"),
        ((tuple((float(i), float(i % 2)) for i in range(10_001)),), "at most 10000 corners, found 10001"),
    ],
)
def test_an_outline_that_is_none_is_refused_and_says_where(rings, phrase):
    with pytest.raises(InputError) as caught:
        Polygon(rings)
    assert phrase in str(caught.value)


def test_keep_outs_leave_the_very_boundary_alone_if_there_are_none():
    disk = Circle(0.15)
    assert area_without(disk, ()) is disk
    assert str(area_without(disk, (Circle(0.01),))) == sentence("disk", "150 mm with 1 keep-out")


def test_keep_outs_that_leave_nothing_are_refused():
    with pytest.raises(InputError, match="2 keep-outs and nothing"):
        area_without(Polygon((SQUARE,)), [Circle(0.2), Circle(0.01)])


def test_area_and_gradient_without_keep_outs():
    ring = cut("all but a ring")
    assert ring.area == pytest.approx(np.pi * (0.15**2 - 0.1**2), rel=1e-4)
    points = np.array([[0.11, 0.0], [0.0, 0.14], [0.0, 0.05]])
    np.testing.assert_allclose(ring.depth(points), [0.01, 0.01, -0.05], atol=1e-15)
    np.testing.assert_allclose(ring.depth_gradient(points), [[1, 0], [0, -1], [0, 1]], atol=1e-15)


def test_a_copy_carries_the_corners_alone(shape):
    plain = len(pickle.dumps(Polygon(shape.rings)))
    shape.project(around(shape, 500), 0.01)
    data = pickle.dumps(shape)
    assert len(data) == plain
    assert pickle.loads(data) == shape
    assert hash(pickle.loads(data)) == hash(shape)


def test_many_points_come_to_one():
    # Enough for the grid, which then has no extent of its own.
    points = np.random.default_rng(0).uniform(-0.2, 0.2, (20_000, 2))
    np.testing.assert_allclose(Polygon((SQUARE,)).project(points, 0.1), 0, atol=1e-12)


def test_a_circle_off_the_origin():
    circle = Circle(0.02, (0.05, -0.01))
    points = around(circle, 50)
    centered = Circle(0.02)
    np.testing.assert_allclose(circle.depth(points), centered.depth(points - circle.center), atol=1e-15)
    np.testing.assert_allclose(
        circle.project(points, 0.005), centered.project(points - circle.center, 0.005) + circle.center, atol=1e-15
    )
    assert circle.as_dict() == {"kind": "circle", "radius": 0.02, "center": [0.05, -0.01]}
    with pytest.raises(InputError, match="a finite center"):
        Circle(0.02, (0.0, float("inf")))


def test_many_points_do_not_take_long():
    # 5000 points and 464 edges are 2.3 million pairs: half of what one distance for each pair takes; 16 operations
    # on each would take seven times as long.
    shape = polygon_from([regular(272, 0.15), regular(192, 0.075)])
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (5000, 2))
    floor = cpu_seconds(lambda: np.hypot(points[:, :1] - np.arange(464), points[:, 1:]))
    assert cpu_seconds(lambda: shape.project(points, 0.01)) < 3 * floor


def regular(count: int, radius: float) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def d_and_slot():
    """A plate of 200 x 120 mm with fillets, a D, a slot and a hole."""
    q, rotation = np.tan(np.pi / 8), 2 * np.pi - 2 * np.arccos(0.6)
    corners = [(-85, -60), (85, -60), (100, -45), (100, 45), (85, 60), (-85, 60), (-100, 45), (-100, -45)]
    plate = Contour(tuple(corners), (0.0, float(q)) * 4)
    slot = Contour(((-60, -40), (-20, -40), (-20, -30), (-60, -30)), (0.0, 1.0, 0.0, 1.0))
    d = Contour(((56, 8), (40, 0), (56, -8)), (float(np.tan(rotation / 8)), float(np.tan(rotation / 8)), 0.0))
    return [placed(contour, 1e-3) for contour in (plate, slot, d, circle(4.5, -80.0, 40.0))]


def exact_depth(contours, points):
    """Signed distance by the nearest point of fine polygons; a tenth of a micrometer off at most."""
    rings = [np.array(flattened(contour, 1e-7)) for contour in contours]
    shape = shapely.Polygon(rings[0], rings[1:])
    inside = shapely.contains_xy(shape, *points.T)
    return np.where(inside, 1, -1) * shapely.distance(shape.boundary, shapely.points(points))


def test_a_polygon_of_arcs_is_never_deeper_than_it_is():
    polygon = polygon_from(d_and_slot(), "file")
    points = np.random.default_rng(0).uniform([-0.11, -0.07], [0.11, 0.07], (4000, 2))
    lost = exact_depth(polygon.contours(), points) - polygon.depth(points)
    assert -2e-7 <= lost.min() < lost.max() <= 4.5e-6 + 2e-7
    inner = polygon.project(points, 0.004)
    assert exact_depth(polygon.contours(), inner).min() >= 0.004 - 2e-7


def test_a_polygon_of_arcs_knows_its_measures():
    polygon = polygon_from(d_and_slot())
    rotation = 2 * np.pi - 2 * np.arccos(0.6)
    lost = [(4 - np.pi) * 225, 400 + np.pi * 25, 100 * rotation / 2 + 48, np.pi * 4.5**2]
    assert polygon.area == pytest.approx((200 * 120 - sum(lost)) * 1e-6, rel=1e-12)
    assert polygon.area == pytest.approx(geometry(polygon).area, rel=1e-4)
    assert str(polygon) == sentence("polygon", "200 mm x 120 mm", "3 holes")
    assert polygon.has_arcs
    # The corners are the arcs' middles, farthest from the origin.
    assert polygon.radius == pytest.approx(np.hypot(85, 45) * 1e-3 + 0.015, abs=5e-6)
    disk = polygon_from([circle(0.125, 3.0, 4.0)])
    assert (disk.radius, disk.center) == (pytest.approx(0.125), pytest.approx((0, 0), abs=1e-12))


def test_arcs_come_back_from_their_dict_and_from_other_processes():
    polygon = polygon_from(d_and_slot())
    again = BOUNDARY.validate_python(json.loads(json.dumps(polygon.as_dict()))).build()
    assert again == polygon
    assert hash(again) == hash(polygon)
    assert again.as_dict() == polygon.as_dict()
    assert pickle.loads(pickle.dumps(polygon)) == polygon
    assert [len(row) for row in polygon.as_dict()["bulges"]] == [len(ring) for ring in polygon.as_dict()["outlines"]]
    straight = polygon_from([np.array([[0, 0], [0.1, 0], [0.1, 0.1]])])
    assert "bulges" not in straight.as_dict()
    assert not straight.has_arcs
    # What has no arcs is equal however that was said.
    assert Polygon(straight.rings, ((0.0, 0.0, 0.0),)) == straight


def test_which_way_arcs_are_drawn_does_not_matter():
    contours = d_and_slot()
    there = polygon_from(contours, "file")
    back = polygon_from([reversed_contour(contour) for contour in contours], "file")
    assert back == there
    assert [area(contour) > 0 for contour in there.contours()] == [True, False, False, False]


@pytest.mark.parametrize(
    ("rings", "bulges", "phrase"),
    [
        ((((0, 0), (0.1, 0)),), ((0.0, 0.0),), "3 corners|an area"),
        ((((0, 0), (0.1, 0)),), ((2.0, 0.0),), "bulges of 1e-06 to 1 to either side in outline 1, or 0, found 2"),
        ((((0, 0), (0.1, 0)),), ((1e-9, 1.0),), "bulges of 1e-06 to 1"),
        ((((0, 0), (0.1, 0)),), ((float("nan"), 1.0),), "finite numbers in outline 1"),
        ((((0, 0), (1e300, 0)),), ((1.0, 1.0),), r"arcs within 1e\+09 m in outline 1, found 1e\+300 m"),
        ((((0, 0), (1e8, 0)),), ((1.0, 1.0),), "arcs that 100000 chords can follow|at most 10000 corners"),
        ((((0, 0), (0.1, 0)),), ((1.0,),), "a bulge for each"),
        ((((0, 0), (0.1, 0)),), ((1.0, 1.0), (1.0, 1.0)), "bulges for each outline, found 2 for 1"),
        # Two circles that cross, and a half disk whose arc runs through its own hole.
        ((((0, 0), (0.1, 0)), ((0.05, 0), (0.15, 0))), ((1.0, 1.0),) * 2, "outlines 1 and 2 crossing"),
        ((((0, 0), (0.1, 0), (0.1, 0.05), (0.0, 0.05)),), ((1.0, 0.0, -1.0, 0.0),), "do not cross or touch themselves"),
    ],
)
def test_arcs_that_make_no_sense_are_refused(rings, bulges, phrase):
    with pytest.raises(InputError, match=phrase):
        Polygon(rings, bulges)


def test_what_is_written_with_measures_is_told_from_what_is_drawn(shapes):
    assert Circle(0.1).has_measures
    assert [name for name, shape in shapes.items() if shape.has_measures] == ["rectangle"]
    assert not polygon_from([circle(0.1)]).has_measures
    square = 0.05 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    assert polygon_from([square]).has_measures
    # A rectangle is written about the origin, and upright.
    assert not polygon_from([square + 0.01], "file").has_measures
    assert not polygon_from([square @ [[0.6, 0.8], [-0.8, 0.6]]]).has_measures


def test_the_repr_of_an_outline_is_short_however_many_corners_it_has():
    angles = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    fine = polygon_from([circle(0.1), 0.01 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)])
    assert repr(fine) == "Polygon(200 mm x 200 mm with 1 hole, 1002 corners)"
