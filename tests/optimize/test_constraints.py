"""Walls and contacts hold the same region as the boundary's own depth."""

import numpy as np

from markergen.model.boundary import Circle, area_without, polygon_from
from markergen.optimize.constraints import contacts, walls_of


def inside(room, count=400, seed=0):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.16, 0.16, (8 * count, 2))
    return points[room.depth(points) > 1e-6][:count]


def every(walls, points):
    return np.repeat(points, len(walls), axis=0), np.tile(np.arange(len(walls)), len(points))


def test_the_nearest_wall_is_the_depth(rooms):
    for room in rooms.values():
        walls, points = walls_of(room), inside(room)
        distance = walls.distance(*every(walls, points))[0].reshape(len(points), -1)
        np.testing.assert_allclose(distance.min(axis=1), room.depth(points), atol=1e-12)


def test_gradients_are_those_of_the_distance(rooms):
    step = 1e-7
    for room in rooms.values():
        walls, points = walls_of(room), inside(room, 60)
        points, wall = every(walls, points)
        for signed in (False, True):
            value, gradient = walls.distance(points, wall, signed)
            slopes = [
                (walls.distance(points + e, wall, signed)[0] - walls.distance(points - e, wall, signed)[0]) / (2 * step)
                for e in step * np.eye(2)
            ]
            # On the line through a wall's end, or beside its middle line, the distance has a kink.
            smooth = np.abs(np.hypot(*slopes) - 1) < 1e-6
            assert smooth.mean() > 0.98
            np.testing.assert_allclose(gradient[smooth], np.stack(slopes, axis=-1)[smooth], atol=1e-5)
            assert np.isfinite(value).all()


def test_corners_part_walls_and_round_outlines_stay_together():
    angles = 2 * np.pi * np.arange(200) / 200
    disk = polygon_from([0.1 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)])
    square = polygon_from([np.array([[0, 0], [0, 0.1], [0.1, 0.1], [0.1, 0]])])
    assert len(walls_of(square)) == 4
    # A full turn in pieces that bend by 45 degrees or little less.
    assert 8 <= len(walls_of(disk)) <= 9
    assert len(walls_of(Circle(0.1))) == 1
    assert len(walls_of(area_without(Circle(0.1), [Circle(0.02)]))) == 2


def test_a_wall_has_a_sign_beyond_its_end_in_an_outer_corner():
    square = walls_of(polygon_from([np.array([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]])]))
    outside = np.full((4, 2), 0.06)
    signed = square.distance(outside, np.arange(4), True)[0]
    # The origin is in the middle: two walls are passed by 10 mm, the others are 110 mm away.
    np.testing.assert_allclose(np.sort(signed), [-0.01, -0.01, 0.11, 0.11], atol=1e-12)
    assert np.all(square.distance(outside, np.arange(4))[0] > 0)


def test_contacts_hold_the_region_while_dots_stay_in_reach(rooms):
    rng = np.random.default_rng(3)
    inset, reach = 0.01, 0.015
    for room in rooms.values():
        points = room.project(inside(room, 12), inset)
        nearby = contacts(walls_of(room), points, inset, inset + np.sqrt(2) * reach, -1.0)
        forbidden = total = 0
        for _ in range(100):
            moved = points + rng.uniform(-reach, reach, points.shape)
            least = np.full(len(points), np.inf)
            np.minimum.at(least, nearby.dot, nearby.room(moved))
            deep = room.depth(moved) >= inset
            # What the constraints allow is in the region.
            assert np.all(deep[least >= inset])
            forbidden += np.sum(deep[least < inset])
            total += np.sum(deep)
        # A wall that is taken for a line forbids a little more than need be, beside a short edge.
        assert forbidden < 0.03 * total


def test_contacts_list_the_dots_that_can_meet(rooms):
    rng = np.random.default_rng(4)
    spacing, reach = 0.02, 0.015
    room = rooms["star"]
    points = inside(room, 12)
    nearby = contacts(walls_of(room), points, 0.0, 0.0, spacing + 2 * np.sqrt(2) * reach)
    first, second = np.triu_indices(len(points), 1)
    assert 0 < len(nearby.first) < len(first)
    for _ in range(100):
        moved = points + rng.uniform(-reach, reach, points.shape)
        gaps = np.linalg.norm(moved[first] - moved[second], axis=-1)
        assert np.sum(np.linalg.norm(nearby.apart(moved), axis=-1) < spacing) == np.sum(gaps < spacing)


def test_jacobians_have_one_row_for_each_contact(rooms):
    room = rooms["L"]
    points = room.project(inside(room, 6), 0.01)
    nearby = contacts(walls_of(room), points, 0.01, 0.05, 0.1)
    offset = np.random.default_rng(0).normal(size=points.shape)
    step = 1e-7
    change = (nearby.room(points + step * offset) - nearby.room(points - step * offset)) / (2 * step)
    np.testing.assert_allclose(np.sum(nearby.room_jacobian(points) * offset, axis=(1, 2)), change, atol=1e-5)
    apart = nearby.apart(points)
    change = np.sum(apart * (nearby.apart(points + offset) - apart), axis=-1)
    np.testing.assert_allclose(np.sum(nearby.apart_jacobian(points, apart) * offset, axis=(1, 2)), change, atol=1e-12)
