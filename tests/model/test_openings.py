"""Holes through whatever is made: of mounts, dowels and drawings, each once, and named where dots are near."""

from dataclasses import replace
from math import isclose, pi

import numpy as np
import pytest
from sentences import sentence

from markergen.geometry.contour import Contour, area, circle
from markergen.model.boundary import Circle, polygon_from
from markergen.model.marker import build_marker
from markergen.model.openings import drawn_holes, near_holes, openings
from markergen.model.substrate import Substrate, parse_dowel, parse_mount


def plate(half, *holes):
    outer = Contour(((-half, -half), (half, -half), (half, half), (-half, half)))
    return polygon_from([outer, *(circle(radius, x, y, hole=True) for x, y, radius in holes)], "file")


@pytest.fixture(scope="module")
def drawn():
    points = np.array([[0.05, 0.0], [0.0, 0.05], [-0.05, 0.0], [0.0, -0.05]])
    marker = build_marker(points, plate(0.1, (0.08, 0.08, 0.0045)), 0.02, 0.002)
    holes = (*parse_mount("M4c:-60mm,60mm"), *parse_dowel("4mm:75mm,0mm"))
    return replace(marker, substrate=Substrate(edge=0.0, holes=holes))


def test_every_hole_is_listed_clockwise_at_its_place(drawn):
    results = openings(drawn)
    assert [str(item) for item in results] == [
        sentence("hole", "M4", "-60 mm, 60 mm"),
        sentence("dowel", "4 mm pin", "75 mm, 0 mm"),
        sentence("drawn hole", "80 mm, 80 mm"),
    ]
    assert [item.contour.as_circle for item in results] == [
        pytest.approx(whole) for whole in [(-0.06, 0.06, 0.00225), (0.075, 0, 0.002), (0.08, 0.08, 0.0045)]
    ]
    assert all(area(item.contour) < 0 for item in results)
    # The opening in the printed face is that of the countersink.
    assert isclose(results[0].region.area, pi * 0.00448**2, rel_tol=1e-4)


def test_a_hole_of_boundary_and_outline_counts_once_and_the_larger_one_wins():
    boundary = plate(0.1, (0.08, 0.08, 0.0045), (-0.08, 0.08, 0.01), (0.08, -0.08, 0.003))
    outline = plate(0.15, (0.08, 0.08, 0.0045), (-0.08, 0.08, 0.002), (0.08, -0.08, 0.006), (0.13, 0.0, 0.004))
    results = {drawn_hole.as_circle for drawn_hole in drawn_holes(boundary, outline)}
    assert {tuple(round(value, 6) for value in drawn_hole) for drawn_hole in results} == {
        (0.08, 0.08, 0.0045), (-0.08, 0.08, 0.01), (0.08, -0.08, 0.006), (0.13, 0.0, 0.004)
    }  # fmt: skip
    assert len(drawn_holes(boundary)) == 3
    assert drawn_holes(Circle(0.1)) == ()
    assert drawn_holes(Circle(0.1), Circle(0.2)) == ()


def test_holes_in_quiet_zones_are_named_with_their_dots(drawn):
    # Dot 0 reaches to 60 mm and its quiet zone to 70 mm; the pin's hole begins at 73 mm.
    assert near_holes(drawn) == ()
    close = replace(drawn, substrate=replace(drawn.substrate, holes=parse_mount("M3:64mm,0mm; -90mm,0mm")))
    [warning] = near_holes(close)
    assert sentence("hole", "M3", "64 mm, 0 mm") + " into that of dot 0;" in warning
    assert "-90 mm" not in warning
    assert warning.endswith("design with --clearance 10mm")
    assert near_holes(replace(close, control_points=())) == ()
