from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import shapely
from sentences import sentence

from markergen.drawing.text import text_width
from markergen.geometry.contour import area, flattened
from markergen.model.substrate import Substrate
from markergen.model.tag import FAMILIES, Tag
from markergen.solid.plate import grouped, plate_of
from markergen.solid.primitives import cylinder
from markergen.workshop.engraving import DEPTH, MARGIN, WALL, _lines, engraving


def polygon(outer, *holes):
    return shapely.Polygon(flattened(outer, 1e-3), [flattened(hole, 1e-3) for hole in holes])


def engraved(marker, cut=(), thickness=3.0):
    plate = plate_of(marker)
    result = engraving(marker, plate.outline, -thickness, cut)
    outline = shapely.union_all([polygon(*outline) for outline in plate.outlines])
    return outline, result, [polygon(prism.outer, *prism.holes) for prism in result.cut]


def pockets(marker, depth=0.6):
    return [cylinder(1e3 * p.x, 1e3 * p.y, 500 * p.feature.diameter, -depth, 0) for p in marker.control_points]


def test_letters_neither_touch_nor_cross():
    """Every character that a title may have, next to each other in all tags' names."""
    lines = [f"{family}:{'0123456789'}" for family in FAMILIES] + ["markergen 0123456789abcdef", "x"]
    for line in lines:
        shapes = [polygon(*letter) for letter in grouped(_lines((line,), 0, 0, 4.0).contours)]
        assert all(shape.is_valid for shape in shapes)
        assert min(one.distance(other) for one, other in combinations(shapes, 2)) > 0.01 if len(shapes) > 1 else True


def test_it_reads_from_behind_and_stays_in_its_box():
    block = _lines(("1a", "b"), 10, 20, 4.0)
    one, a, b = (polygon(*letter) for letter in grouped(block.contours))
    # Seen from behind, x runs to the left.
    assert one.centroid.x > a.centroid.x
    assert b.centroid.y < min(one.centroid.y, a.centroid.y)
    assert len(grouped(block.contours)[1]) == 2
    box = shapely.box(*block.box)
    assert all(box.contains(shape) for shape in (one, a, b))
    assert box.centroid.x == pytest.approx(10)
    assert block.box[2] - block.box[0] == pytest.approx(text_width("1a", 4.0, "bold"))


def test_arcs_stand_for_the_font_s_curves():
    from markergen.drawing.text import text

    block = _lines(("3",), 0, 0, 4.0)
    (three,) = block.contours
    curves = [points for command, points in text("3", 0, 0, 4.0, "center", "bold").segments if command == "Q"]
    assert 0 < sum(bulge != 0 for bulge in three.bulges) < len(curves)
    start, points = (0.0, 0.0), []
    for _, stated in text("3", 0, 0, 4.0, "center", "bold").segments:
        if len(stated) == 2:
            t = np.linspace(0, 1, 9)[:, None]
            points += ((1 - t) ** 2 * start + 2 * t * (1 - t) * np.array(stated[0]) + t**2 * stated[1]).tolist()
        start = np.array(stated[-1]) if stated else start
    line = shapely.LinearRing(flattened(three, 1e-4))
    # 0.6 % of the height, and half as much again between the three points of each curve that are looked at.
    off = shapely.distance(line, shapely.points([(-x, y - 2.0) for x, y in points]))
    assert off.max() < 0.009 * 4.0


def test_name_hash_axes_and_ids(make_ngon):
    marker = make_ngon(5, 0.15, 0.036)
    plate, result, shapes = engraved(marker, pockets(marker))
    assert result.notes == ()
    # 9 letters and 8 digits, a cross with an arrow, an x, and five ids.
    assert len(result.cut) == 17 + 2 + 5
    assert all((prism.bottom, prism.top) == (-3.0, -3.0 + DEPTH) for prism in result.cut)
    assert all(area(prism.outer) > 0 and all(area(hole) < 0 for hole in prism.holes) for prism in result.cut)
    assert all(shapely.buffer(plate, -MARGIN).contains(shape) for shape in shapes)
    # The cross is at the origin, and its arrow points along x.
    (axes,) = [shape for shape in shapes if shape.contains(shapely.Point(0, 0))]
    assert axes.bounds == pytest.approx((-4, -4, 14, 4))
    for point in marker.control_points:
        dot = shapely.Point(1e3 * point.x, 1e3 * point.y).buffer(500 * point.feature.diameter)
        assert sum(dot.contains(shape) for shape in shapes) == 1


def test_the_tag_is_named_too(make_ngon):
    marker = make_ngon(5, 0.15, 0.02)
    _, _, plain = engraved(marker)
    _, _, tagged = engraved(replace(marker, tag=Tag("aruco:DICT_4X4_50", 7, 0.05)))
    assert len(tagged) == len(plain) + len("aruco:DICT_4X4_50:7") + 2  # two colons have two dots each


def test_what_is_near_in_the_plate_is_kept_clear(make_ngon):
    marker = make_ngon(5, 0.15, 0.036)
    deep = pockets(marker, 3.0 - DEPTH - WALL + 1e-3)
    _, result, shapes = engraved(marker, deep)
    for p in marker.control_points:
        dot = shapely.Point(1e3 * p.x, 1e3 * p.y).buffer(500 * p.feature.diameter, quad_segs=64)
        # Polygons are 2 um off their arcs at most.
        assert min(dot.distance(shape) for shape in shapes) > MARGIN - 3e-3
        # Its id is next to it.
        assert any(dot.distance(shape) < 3 for shape in shapes)
    assert result.notes == ()
    _, _, shallow = engraved(marker, pockets(marker, 3.0 - DEPTH - WALL - 1e-3))
    assert any(
        shapely.Point(1e3 * p.x, 1e3 * p.y).buffer(1).intersects(shape)
        for p in marker.control_points
        for shape in shallow
    )


def test_what_has_no_room_is_left_out_and_said(make_ngon, shapes, make_in):
    _, result, _ = engraved(make_ngon(4, 0.012, 0.004), pockets(make_ngon(4, 0.012, 0.004), 2.9))
    assert result.notes == (sentence("back full", "origin and x-axis; name and spec hash"),)
    marker = make_in(shapes["annulus"], 7, 0.01)
    _, result, parts = engraved(marker)
    assert result.notes == (sentence("back full", "origin and x-axis"),)
    assert len(parts) == 17 + 7
    full = [cylinder(0, 0, 200, -2.5, 0)]
    _, result, parts = engraved(marker, full)
    assert parts == []
    assert result.notes == (
        sentence("back full", "origin and x-axis; name and spec hash; ids 0, 1, 2, 3, 4 and 2 more"),
    )


def test_a_narrow_plate_has_its_title_in_two_lines(shapes, make_in):
    marker = make_in(shapes["two squares"], 5, 0.01)
    _, _, parts = engraved(marker)
    left = sum(shape.centroid.x < 0 for shape in parts), sum(point.x < 0 for point in marker.control_points)
    # One plate has the 17 letters, the other only ids.
    assert left[0] - left[1] in (0, 17)
    assert len(parts) == 17 + 5


def test_a_plate_that_letters_would_fall_out_of_is_not_engraved(make_ngon):
    def thick(thickness: float):
        marker = replace(make_ngon(5, 0.06, 0.014), substrate=Substrate(thickness=thickness))
        return engraved(marker, thickness=thickness * 1e3)[1]

    assert thick(0.0005).cut
    thin = thick(0.00049)
    assert thin.cut == ()
    assert thin.notes == (sentence("back thin", "0.49 mm", "0.5 mm"),)


def test_a_large_title_takes_no_room_from_ids(make_ngon):
    """In the largest letters, above the origin, it would be as wide as to cover those of dots 1 and 4."""
    marker = replace(make_ngon(5, 0.06, 0.014), tag=Tag("aruco:DICT_4X4_50", 3, 0.03))
    _, result, shapes = engraved(marker)
    assert result.notes == ()
    for p in marker.control_points:
        assert sum(shapely.Point(1e3 * p.x, 1e3 * p.y).buffer(7).contains(shape) for shape in shapes) == 1
