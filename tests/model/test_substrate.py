import re
from dataclasses import replace
from math import atan2, degrees, hypot, inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sentences import sentence

from markergen.errors import InputError
from markergen.geometry.contour import circle
from markergen.model.boundary import Circle, polygon_from
from markergen.model.substrate import EDGE, HEADS, MOST_HOLES, SCREWS, Hole, Substrate, parse_dowel, parse_mount

PICOMETER = 1e-12
"""To which places on a circle are rounded."""


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
    ("values", "phrase"),
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
def test_plates_that_cannot_be_are_refused(values, phrase):
    with pytest.raises(InputError, match=phrase) as caught:
        Substrate(**values)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"x": nan}, "a hole at a finite place"),
        ({"diameter": 0.0}, "diameter above 0"),
        ({"diameter": 3.4}, "such as 3.4mm"),
        ({"sink": 0.003}, "a countersink wider than its hole of 3.4 mm"),
        ({"sink": -0.003}, "a countersink wider"),
        ({"sink": nan}, "a countersink wider"),
    ],
)
def test_holes_that_cannot_be_are_refused(values, phrase):
    with pytest.raises(InputError, match=phrase):
        replace(Hole(0.0, 0.0, 0.0034), **values)


def test_the_rim_of_a_countersunk_hole_is_that_of_its_countersink():
    assert Hole(0.01, 0.02, 0.0034).rim == Circle(0.0017, (0.01, 0.02))
    assert Hole(0.01, 0.02, 0.0034, 0.00672).rim == Circle(0.00336, (0.01, 0.02))
    assert str(Hole(0.01, 0.02, 0.0034, name="M3")) == sentence("hole", "M3", "10 mm, 20 mm")
    assert str(Hole(0.01, 0.02, 0.004, use="dowel")) == sentence("dowel", "4 mm", "10 mm, 20 mm")


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


def test_a_pitch_circle_is_given_by_its_diameter_and_lies_astride_the_x_axis():
    holes = parse_mount("4xM3@0.12")
    assert [hypot(hole.x, hole.y) for hole in holes] == pytest.approx([0.06] * 4, abs=PICOMETER)
    assert [degrees(atan2(hole.y, hole.x)) % 360 for hole in holes] == pytest.approx([45, 135, 225, 315])
    assert {(hole.diameter, hole.sink, hole.use, hole.name) for hole in holes} == {(0.0034, 0.0, "mount", "M3")}
    assert degrees(atan2(parse_mount("3xM3@40mm")[0].y, parse_mount("3xM3@40mm")[0].x)) == pytest.approx(60)


@pytest.mark.parametrize("text", ["4xM3@120mm/0", "4xM3@120mm/0deg", "4xM3@120mm/360", " 4 x M3 @ 120mm / 0 "])
def test_the_angle_of_the_first_hole(text):
    assert [(hole.x, hole.y) for hole in parse_mount(text)] == [(0.06, 0), (0, 0.06), (-0.06, 0), (0, -0.06)]


def test_listed_holes_are_where_it_says():
    assert parse_mount("M3:40mm,-20mm; 0.1,0in") == (
        Hole(0.04, -0.02, 0.0034, name="M3"),
        Hole(0.1, 0.0, 0.0034, name="M3"),
    )


def test_a_diameter_in_place_of_a_screw():
    assert {(hole.diameter, hole.name) for hole in parse_mount("2x3.4mm@0.1")} == {(0.0034, "")}
    assert parse_mount("0.25in:0,0") == (Hole(0.0, 0.0, 0.00635),)


@pytest.mark.parametrize("text", ["M3c", "m3C", "M3 c", "M3 countersunk", "M3-countersunk"])
def test_countersunk_in_either_writing(text):
    assert parse_mount(f"{text}:0,0") == (Hole(0.0, 0.0, 0.0034, 0.00672, name="M3"),)
    assert len(parse_mount(f"2x{text}@40mm")) == 2


def test_heads_lie_in_their_countersinks_and_screws_in_their_holes():
    for screw, diameter in SCREWS.items():
        size = float(screw[1:])
        # ISO 273's medium series is 0.2 to 1.5 mm wider than the screw, by 8 to 20 %.
        assert 0.199 <= diameter - size <= 1.501
        assert 1.08 <= diameter / size <= 1.201
        if screw in HEADS:
            # Theoretical heads of countersunk screws are 2.1 to 2.3 times as wide as the screw.
            assert 2.09 <= HEADS[screw] / size <= 2.25


def test_dowels_are_on_the_x_axis():
    one, other = parse_dowel("2x4mm@0.13")
    assert one == Hole(0.065, 0.0, 0.004, 0.0, "dowel", "4 mm pin")
    assert (other.x, other.y) == (-0.065, 0.0)
    assert parse_dowel("6mm:10mm,20mm") == (Hole(0.01, 0.02, 0.006, 0.0, "dowel", "6 mm pin"),)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("", "expected mounting holes, found ''; write 4xM3@120mm"),
        ("4xM3", "write 4xM3@120mm"),
        ("xM3@0.1", "write 4xM3@120mm"),
        ("4xM3@", "a length for pitch circle"),
        ("4xM3@nan", "a finite pitch circle"),
        ("4xM3@-0.1", "a pitch circle with a diameter above 0, found -100 mm"),
        ("4xM3@0.1/up", "an angle in degrees"),
        ("4xM3@0.1/inf", "an angle in degrees"),
        ("0xM3@0.1", "1 to 200 mounting holes, found 0"),
        ("99999xM3@0.1", "1 to 200 mounting holes"),
        ("4xM7@0.1", "found 'M7'; known: M1.6, M2,"),
        ("4x@0.1", "known: M1.6, M2,"),
        ("4xM1.6c@0.1", "a countersunk screw, found 'M1.6c'; known: M2, M2.5"),
        ("4x3.4mm countersunk@0.1", "a screw that is countersunk"),
        ("4x-3mm@0.1", "diameter above 0"),
        ("4x0@0.1", "diameter above 0"),
        ("4x3.4@0.1", "found 3.4 m in '4x3.4@0.1'; write a screw such as M3, or a length with its unit"),
        ("M3:", "write 4xM3@120mm"),
        ("M3:0.1", "a place x,y of each of the mounting holes, found '0.1'"),
        ("M3:0.1,0.2;", "a place x,y"),
        ("M3:0.1,wide", "a length for y"),
        ("x" * 5000, "expected mounting holes"),
    ],
)
def test_what_are_no_holes_is_told_in_one_line(text, phrase):
    with pytest.raises(InputError, match=re.escape(phrase)) as caught:
        parse_mount(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("text", ["2xM4@0.1", "2x4mmc@0.1", "4mm", "2x@0.1", "M4:0,0"])
def test_what_are_no_pins_is_told(text):
    with pytest.raises(InputError):
        parse_dowel(text)


@given(st.text(alphabet="0123456789xM@:;,/.c -mn", max_size=20))
def test_any_text_gives_holes_or_one_line(text):
    for parse in (parse_mount, parse_dowel):
        message, holes = "", ()
        try:
            holes = parse(text)
        except InputError as error:
            message = str(error)
        assert bool(message) != bool(holes)
        assert "\n" not in message
