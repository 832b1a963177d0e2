import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from sentences import sentence

from markergen.errors import InputError
from markergen.geometry.contour import circle
from markergen.geometry.region import Region
from markergen.model.boundary import Circle, polygon_from
from markergen.model.openings import WALL, check_edge, check_holes, check_plate, hole_clashes, plate_face
from markergen.model.substrate import Hole, Substrate, parse_mount
from markergen.model.tag import Tag


def rectangle(width: float, height: float):
    half = np.array([width, height]) / 2
    return polygon_from([np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half])


def refusal(call) -> str:
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    return message


def with_holes(marker, *holes, **more):
    return replace(marker, substrate=Substrate(holes=holes, **more))


def test_holes_between_the_dots_pass(pentagon):
    check_holes(pentagon)
    # Dots of 36 mm stand on a circle of 128.4 mm; there is no dot straight down.
    check_holes(with_holes(pentagon, Hole(0.0, -0.128, 0.0034), Hole(0.0, 0.0, 0.0034, 0.00672)))


def test_a_hole_in_a_dot_says_by_how_much_and_what_would_fit(pentagon):
    # The topmost dot reaches down to 110.4 mm, and the clearance to 106.8 mm.
    over = refusal(lambda: check_holes(with_holes(pentagon, Hole(0.0, 0.109, 0.0034, name="M3"))))
    assert sentence("hole", "M3", "0 mm, 109 mm") + " is 0.3 mm over dot 0 (move it by 3.9 mm)" in over
    nearby = refusal(lambda: check_holes(with_holes(pentagon, Hole(0.0, 0.106, 0.0034, name="M3"))))
    assert sentence("hole too near", "2.7 mm", "dot 0", "3.6 mm", "0.9 mm") in nearby
    check_holes(with_holes(pentagon, Hole(0.0, 0.106, 0.0016)))
    check_holes(with_holes(pentagon, Hole(0.0, 0.106 - 0.0009, 0.0034)))


def test_what_was_measured_on_a_print_moves_no_dot_of_the_plate(pentagon):
    holes = with_holes(pentagon, Hole(0.0, 0.1068 - 0.0017, 0.0034))
    check_holes(holes)
    points = tuple(replace(p, x=p.x * 0.98, y=p.y * 0.98) for p in pentagon.control_points)
    check_holes(replace(holes, control_points=points, print_scale=(0.98, 0.98)))


def test_the_tag_and_other_holes_are_in_the_way(pentagon):
    tagged = replace(pentagon, tag=Tag("apriltag:36h11", 3, 0.06))
    # Half of 60 mm and a quiet zone of 7.5 mm.
    message = refusal(lambda: check_holes(with_holes(tagged, Hole(0.038, 0.0, 0.0034))))
    assert "is 1.2 mm over " + sentence("quiet zone") in message
    check_holes(with_holes(tagged, Hole(0.0375 + 0.0017, 0.0, 0.0034)))
    pair = (Hole(0.0, 0.0, 0.0034), Hole(0.004, 0.0, 0.0034))
    message = refusal(lambda: check_holes(with_holes(pentagon, *pair)))
    assert sentence("hole too near", "0.6 mm", sentence("hole", "3.4 mm", "0 mm, 0 mm"), "1 mm", "0.4 mm") in message


def test_holes_at_the_edge_of_the_plate(pentagon):
    # Around the boundary of 150 mm the plate reaches to 164.4 mm: the topmost dot and half of its width.
    check_holes(with_holes(pentagon, *parse_mount("2xM3@323mm")))
    message = refusal(lambda: check_holes(with_holes(pentagon, *parse_mount("2xM3@325mm/-90"))))
    assert sentence("hole", "M3", "0 mm, -162.5 mm") + " leaves 0.2 mm to " in message
    message = refusal(lambda: check_holes(with_holes(pentagon, Hole(0.0, -0.17, 0.0034))))
    assert "is 7.3 mm over the edge" in message
    check_holes(with_holes(pentagon, Hole(0.0, -0.17, 0.0034), outline=rectangle(0.4, 0.4)))


def test_a_message_names_a_few_and_counts_the_rest(pentagon):
    message = refusal(lambda: check_holes(with_holes(pentagon, *parse_mount("12xM3@0.5"))))
    assert message.count("over the edge") == 4
    assert "and 8 more" in message


def test_a_countersink_must_end_in_the_plate(pentagon):
    sunk = Hole(0.0, 0.0, 0.0034, 0.00672, name="M3")
    check_holes(with_holes(pentagon, sunk, thickness=0.0017))
    message = refusal(lambda: check_holes(with_holes(pentagon, sunk, thickness=0.0016)))
    assert "1.66 mm deep in a plate of 1.6 mm (use --thickness 1.8mm" in message


def test_dots_that_an_outline_a_corner_or_a_chamfer_cuts_are_told(pentagon, make_in):
    message = refusal(lambda: check_holes(with_holes(pentagon, outline=rectangle(0.4, 0.27))))
    # The topmost dot reaches to 146.4 mm.
    assert "dot 0 is 11.4 mm over" in message
    check_holes(with_holes(pentagon, outline=rectangle(0.4, 0.4), corner_radius=0.01, chamfer=0.001))
    assert message.endswith(sentence("larger plate", "--outline, or"))
    square = make_in(rectangle(0.2, 0.2), 4, 0.036)
    message = refusal(lambda: check_holes(with_holes(square, corner_radius=0.1)))
    assert sentence("larger plate", "--edge, or") in message


def test_the_face_of_a_plate():
    disk = plate_face(Substrate(), Circle(0.1))
    # Of a circle taken for a fine polygon.
    assert disk.area == pytest.approx(np.pi * 0.102**2, rel=2e-5)
    reach = plate_face(Substrate(), Circle(0.1), [(0.09, 0.0, 0.01)])
    assert reach.area == pytest.approx(np.pi * 0.11**2, rel=2e-5)
    square = rectangle(0.1, 0.06)
    assert plate_face(Substrate(), square).area == pytest.approx(0.104 * 0.064)
    assert plate_face(Substrate(chamfer=0.001), square).area == pytest.approx(0.102 * 0.062)
    rounded = 0.104 * 0.064 - (4 - np.pi) * 0.005**2
    assert plate_face(Substrate(corner_radius=0.005), square).area == pytest.approx(rounded, rel=1e-5)
    assert plate_face(Substrate(outline=square), Circle(0.01)).area == pytest.approx(0.006)
    assert "60 mm and 0 mm" in refusal(lambda: plate_face(Substrate(corner_radius=0.06), square))


def test_an_edge_around_an_outline_is_refused_and_none_is_taken(make_in, shapes):
    for shape in (shapes["L"], polygon_from([circle(0.1), circle(0.02)])):
        assert plate_face(Substrate(), shape).area == pytest.approx(shape.area, rel=1e-4)
        check_plate(Substrate(), shape)
        check_plate(Substrate(edge=0.0), shape)
        check_plate(Substrate(edge=0.005, outline=Circle(0.5)), shape)
        message = refusal(lambda shape=shape: check_plate(Substrate(edge=0.005), shape))
        assert sentence("edge on polygon") + ", found edge=5 mm around a polygon" in message
        assert "leave out --edge" in message
    check_edge(Substrate(edge=0.005), shapes["rectangle"])
    # A dot that the corners' radius cuts needs another outline there, not an edge.
    marker = replace(make_in(shapes["star"], 5, 0.012, seed=1), substrate=Substrate(corner_radius=0.02))
    message = refusal(lambda: check_holes(marker, Region.disk(0, 0, 0.03)))
    assert sentence("larger plate", "--outline, or") in message


def test_a_plate_that_is_not_under_the_boundary_is_told_before_any_design():
    check_plate(Substrate(outline=Circle(0.15)), Circle(0.15))
    check_plate(Substrate(outline=rectangle(0.3, 0.3)), Circle(0.15))
    message = refusal(lambda: check_plate(Substrate(outline=rectangle(0.3, 0.2)), Circle(0.15)))
    assert "150 mm outside of a rectangle of 300 mm x 200 mm" in message
    # A bore in the plate is no lack where no dot may be.
    bored = polygon_from([rectangle(0.4, 0.4).outlines()[0], 0.05 * rectangle(1, 1).outlines()[0]])
    assert "outside of" in refusal(lambda: check_plate(Substrate(outline=bored), Circle(0.15)))
    check_plate(Substrate(outline=bored), Circle(0.15), (Circle(0.06),))


def test_holes_off_the_plate_are_told_before_any_design():
    check_plate(Substrate(holes=parse_mount("4xM3@0.3")), Circle(0.15), dot=0.036)
    # On a disk of 150 mm with dots of 36 mm no plate reaches beyond 168 mm.
    message = refusal(lambda: check_plate(Substrate(holes=parse_mount("4xM3@0.34")), Circle(0.15), dot=0.036))
    assert "3.7 mm over" in message


place = st.floats(-0.05, 0.05)
radius = st.floats(1e-4, 0.02)


@given(place, place, radius, radius, st.floats(0, 2 * np.pi), st.floats(0, 0.01), st.floats(-0.01, 0.02))
def test_giving_way_by_what_is_said_is_enough(u, v, q, r, angle, clearance, gap):
    assume(abs(gap - clearance) > 2e-9)  # Rounding is forgiven.
    apart, way = max(r + q + gap, 1e-3), np.array([np.cos(angle), np.sin(angle)])
    dots = {"dot 0": (u, v, q)}

    def at(distance: float, diameter: float = 2 * r):
        x, y = (np.array([u, v]) + distance * way).tolist()
        return hole_clashes([Hole(x, y, diameter)], dots, clearance)

    misfits = at(apart)
    assert bool(misfits) == (apart - r - q < clearance)
    for misfit in misfits:
        assert not at(apart + 1e-3 * float(re.search(r"move it by (\S+) mm", misfit.fits)[1]))
        smaller = re.search(r"at most (\S+) mm", misfit.fits)
        assert not (smaller and at(apart, 1e-3 * float(smaller[1])))


@given(place, place, radius)
def test_a_wall_is_left_to_the_edge(x, y, r):
    marker_free = Substrate(holes=(Hole(x, y, 2 * r),), outline=rectangle(0.1, 0.1))
    left = 0.05 - max(abs(x), abs(y)) - r
    assume(abs(left - WALL) > 2e-5)  # A hundredth of a millimeter is forgiven.
    if left > WALL:
        check_plate(marker_free, rectangle(0.02, 0.02))
    else:
        with pytest.raises(InputError, match="edge of the plate"):
            check_plate(marker_free, rectangle(0.02, 0.02))


def test_another_face_may_be_given(pentagon):
    tight = Region.disk(0, 0, 0.1)
    with pytest.raises(InputError, match="over its edge"):
        check_holes(pentagon, tight)
