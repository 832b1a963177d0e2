from dataclasses import replace
from math import inf, nan

import pytest

from markergen.errors import InputError
from markergen.geometry.contour import circle
from markergen.model.boundary import Circle, polygon_from
from markergen.model.substrate import EDGE, MOST_HOLES, Hole, Substrate


def test_only_what_is_not_the_default_is_written():
    assert Substrate().as_dict() == {"thickness": 0.003}
    full = Substrate(0.004, 0.001, 0.005, 0.0005, Circle(0.2), (Hole(0.04, -0.02, 0.0034, 0.00672, name="M3"),))
    assert full.as_dict() == {
        "thickness": 0.004,
        "edge": 0.001,
        "corner_radius": 0.005,
        "chamfer": 0.0005,
        "outline": {"kind": "circle", "radius": 0.2},
        "holes": [{"x": 0.04, "y": -0.02, "diameter": 0.0034, "sink": 0.00672, "use": "mount", "name": "M3"}],
    }


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"thickness": 0.0}, "thickness=0.0 m; give --thickness"),
        ({"thickness": -0.003}, "thickness=-0.003 m"),
        ({"thickness": nan}, "a thickness of 10 um to 1 m"),
        ({"thickness": 3.0}, "a thickness of 10 um to 1 m"),
        ({"edge": -0.001}, "edge=-0.001 m; use --edge 2mm"),
        ({"corner_radius": inf}, "a plate's corner radius of 0 to 1 m"),
        ({"chamfer": -0.001}, "a chamfer of 0 or more"),
        ({"chamfer": 0.003}, "below the thickness of 3 mm, found chamfer=0.003 m"),
        ({"holes": (Hole(0, 0, 0.001),) * (MOST_HOLES + 1)}, "at most 200 holes, found 201"),
    ],
)
def test_plates_that_cannot_be_are_refused(values, words):
    with pytest.raises(InputError, match=words) as caught:
        Substrate(**values)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"x": nan}, "a hole at a finite place"),
        ({"diameter": 0.0}, "diameter above 0"),
        ({"diameter": 3.4}, "such as 3.4mm"),
        ({"sink": 0.003}, "a countersink wider than its hole of 3.4 mm"),
        ({"sink": -0.003}, "a countersink wider"),
        ({"sink": nan}, "a countersink wider"),
    ],
)
def test_holes_that_cannot_be_are_refused(values, words):
    with pytest.raises(InputError, match=words):
        replace(Hole(0.0, 0.0, 0.0034), **values)


def test_the_rim_of_a_countersunk_hole_is_that_of_its_countersink():
    assert Hole(0.01, 0.02, 0.0034).rim == Circle(0.0017, (0.01, 0.02))
    assert Hole(0.01, 0.02, 0.0034, 0.00672).rim == Circle(0.00336, (0.01, 0.02))
    assert str(Hole(0.01, 0.02, 0.0034, name="M3")) == "the hole M3 at 10 mm, 20 mm"
    assert str(Hole(0.01, 0.02, 0.004, use="dowel")) == "the dowel hole 4 mm at 10 mm, 20 mm"


def test_the_edge_goes_around_disks_and_rectangles_alone(shapes):
    hole_in_disk = polygon_from([circle(0.1), circle(0.02)])
    for boundary in (Circle(0.1), shapes["rectangle"]):
        assert Substrate().edge_around(boundary) == EDGE == 0.002
        assert Substrate(edge=0.005).edge_around(boundary) == 0.005
        assert Substrate(edge=0.0).edge_around(boundary) == 0.0
        assert Substrate(outline=Circle(0.3)).edge_around(boundary) == 0.0
    for boundary in (shapes["L"], shapes["plate"], hole_in_disk, polygon_from([circle(0.1)])):
        assert Substrate().edge_around(boundary) == Substrate(edge=0.005).edge_around(boundary) == 0.0
    assert Substrate().as_dict() == {"thickness": 0.003}
    assert Substrate(edge=0.002).as_dict() == {"thickness": 0.003, "edge": 0.002}
