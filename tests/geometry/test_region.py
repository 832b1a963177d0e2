import numpy as np
import pytest

from markergen.geometry.contour import circle
from markergen.geometry.region import (
    Region,
    enclosing_circle,
    hull,
    line_distances,
    pairs_in_boxes,
    pairwise_distances,
    parents,
    signed_area,
)


@pytest.fixture
def frame():
    """A rectangle of 4 by 3 with a hole of 2 by 1 in it."""
    return Region.rectangle(0, 0, 4, 3) - Region.rectangle(1, 1, 3, 2)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_regions_are_joined_cut_and_shared():
    one, other = Region.rectangle(0, 0, 2, 2), Region.rectangle(1, 1, 3, 3)
    assert [(one | other).area, (one & other).area, (one - other).area, (one ^ other).area] == [7, 1, 3, 6]
    assert Region.union([one, other, Region.rectangle(9, 9, 10, 10)]).area == 8
    assert not Region()
    assert Region().area == 0
    assert Region().rings == ()
    # A common side is no area.
    assert not (one & Region.rectangle(2, 0, 3, 2))
    assert one
    assert not Region.rectangle(0, 0, 1, 1).offset(-1)


def test_neighbors_on_a_grid_leave_no_slit():
    halves = [Region.rectangle(0, 0, 1, 1), Region.rectangle(1 + 1e-9, 0, 2, 1)]
    assert len(Region.union(halves).pieces) == 2
    (whole,) = Region.union(halves, grid=1e-6).pieces
    assert whole.area == pytest.approx(2, abs=1e-12)


def test_holes_and_islands_by_direction_or_by_number():
    hole, island = 0.25 + SQUARE[::-1] / 2, 0.4 + SQUARE / 5
    expected = 1 - 0.25 + 0.04
    assert Region.enclosed([island, SQUARE, hole]).area == pytest.approx(expected)
    assert Region.odd([island[::-1], SQUARE, hole[::-1]]).area == pytest.approx(expected)
    assert Region.polygon(SQUARE, [hole]).area == 0.75
    assert Region.enclosed([]).area == 0
    # A figure of eight encloses two triangles.
    eight = [(0, 0), (1, 1), (1, 0), (0, 1)]
    assert Region.polygon(eight, mend=True).area == pytest.approx(0.5)


def test_circles_are_polygons_as_fine_as_one_asks():
    assert Region.disk(1, 2, 0.5).area == pytest.approx(np.pi / 4, rel=1e-5)
    assert Region.disk(1, 2, 0.5).box == pytest.approx((0.5, 1.5, 1.5, 2.5))
    ring = Region.of_contour(circle(2.0), [circle(1.0, hole=True)], 1e-6)
    assert ring.area == pytest.approx(3 * np.pi, rel=1e-5)


def test_offsets_have_round_or_mitered_corners(frame):
    square = Region.polygon(SQUARE)
    assert square.offset(1, "miter").area == pytest.approx(9)
    assert square.offset(1, segments=200).area == pytest.approx(5 + np.pi, rel=1e-4)
    assert square.offset(1).area < square.offset(1, segments=200).area
    assert square.offset(-0.25).area == pytest.approx(0.25)
    # A hole closes.
    assert len(frame.offset(0.6).rings) == 1


def test_rings_of_pieces_run_around_what_they_enclose(frame):
    two = Region.union([frame, Region.rectangle(10, 0, 11, 1)]).oriented()
    assert [[signed_area(ring) for ring in piece.rings] for piece in two.pieces] in (
        [[12, -2], [1]],
        [[1], [12, -2]],
    )
    assert sum(map(len, two.rings)) == 12
    assert two.filled().area == 13
    assert frame.filled().box == (0, 0, 4, 3)


def test_points_inside_and_their_distance_to_the_edge(frame):
    points = [[0.5, 0.5], [2, 1.5], [5, 0.5], [0, 1]]
    assert frame.contains(points).tolist() == [True, False, False, False]
    assert frame.depth(points) == pytest.approx([0.5, -0.5, -1, 0])
    assert frame.depth([0.5, 0.5]) == 0.5
    assert frame.distance(points) == pytest.approx([0, 0.5, 1, 0])
    assert frame.within(points, 0.6).tolist() == [True, True, False, True]
    x, y = frame.inner_point()
    assert frame.contains([[x, y]])[0]


def test_shapes_inside_and_their_distance_to_the_edge(frame):
    small = Region.rectangle(0.25, 0.25, 0.5, 0.5)
    assert frame.covers(small)
    assert frame.surrounds(small)
    assert frame.meets(small)
    at_edge = Region.rectangle(0, 0, 0.5, 0.5)
    assert frame.covers(at_edge)
    assert not frame.surrounds(at_edge)
    assert not frame.meets(Region.rectangle(1.2, 1.2, 2, 1.8))
    assert frame.surrounds_boxes([[(0.25, 0.25, 0.5, 0.5)], [(0, 0, 0.5, 0.5)]]).tolist() == [[True], [False]]
    ring, point = 0.25 + SQUARE / 4, [[0.5, 0.5]]
    assert frame.clearance([small, ring, point, 1.25 + SQUARE / 2]) == pytest.approx([0.25, 0.25, 0.5, -0.25])
    assert pairwise_distances([point, small], [[[0.5, 0.9]], ring]) == pytest.approx(np.array([[0.4, 0], [0.4, 0]]))


def test_a_line_runs_through_a_region_in_parts(frame):
    runs = frame.runs([(-1, 1.5), (2, 1.5), (5, 1.5)])
    assert [run.tolist() for run in runs] == [[[0, 1.5], [1, 1.5]], [[3, 1.5], [4, 1.5]]]
    assert frame.runs([(-1, 9), (5, 9)]) == []
    assert frame.runs([(4, 4), (4, 3)]) == []
    assert line_distances([(0, 0), (1, 1)], [[(0, 1), (1, 0)], [(3, 1), (4, 1)]]).tolist() == [0, 2]


def test_triangles_make_up_the_whole(frame):
    corners, area = frame.triangles()
    assert area.sum() == pytest.approx(frame.area)
    assert np.abs([signed_area(corner) for corner in corners]) == pytest.approx(area)
    assert not len(Region().triangles()[1])


def test_edges_may_become_curved():
    square = Region.rectangle(0, 0, 1, 1)
    assert square.mapped(lambda p: p * [2, 3]).box == (0, 0, 2, 3)
    bent = square.mapped(lambda p: np.stack([p[:, 0], p[:, 1] + p[:, 0] ** 2], axis=-1), step=0.01)
    assert bent.area == pytest.approx(1)
    assert len(bent.rings[0]) == 400


def test_circles_and_hulls_around_and_inside():
    center, radius = enclosing_circle([[0, 0], [2, 0], [1, 0.5]])
    assert (*center, radius) == pytest.approx((1, 0, 1))
    assert sorted(hull([[0, 0], [2, 0], [1, 0.2], [1, 1]]).tolist()) == [[0, 0], [1, 1], [2, 0]]
    assert Region.rectangle(0, 0, 2, 1).largest_circle(1e-4)[1] == pytest.approx(0.5, abs=1e-3)


def test_nested_polygons_have_the_smallest_one_around_them_as_parent():
    def square(half, x=0.0):
        return [(x - half, -half), (x + half, -half), (x + half, half), (x - half, half)]

    assert parents([square(1), square(9), square(0.5), square(1, 5), square(2, 20)]) == [1, -1, 0, 1, -1]
    assert parents([square(1), square(1, 1.5)]) is None
    assert parents([square(1), square(1, 2)]) is None


@pytest.mark.parametrize("most", [1, 50, 10**6])
def test_points_in_boxes_are_those_of_all_pairs_whatever_the_number_at_once(most):
    generator = np.random.default_rng(0)
    points = np.round(generator.random((60, 2)), 1)
    points[3, 1] = np.nan
    low = np.round(generator.random((40, 2)), 1)
    high = low + np.round(0.4 * generator.random((40, 2)), 1)
    inside = ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=2)
    pairs = [pair for index, box in pairs_in_boxes(points, low, high, most) for pair in zip(index, box, strict=True)]
    assert sorted(pairs) == list(zip(*np.nonzero(inside), strict=True))
