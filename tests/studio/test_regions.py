"""Regions that are drawn or moved on the page."""

import numpy as np
import pytest
from sentences import sentence

from markergen.errors import InputError
from markergen.studio.look import look
from markergen.studio.opening import opened_file
from markergen.studio.state import spec_of_options, with_region

CROSSED = [[[0, 0], [0.1, 0.1], [0.1, 0], [0, 0.1]]]
CORNER = [[[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.0, 0.1]]]


@pytest.mark.parametrize(
    ("room", "center", "radius"),
    [
        ({"kind": "circle", "radius": 0.0800004, "center": [0.04, -0.03]}, (0.04, -0.03), 0.08),
        ({"kind": "polygon", "outlines": CORNER}, (0.1, 0.05), np.hypot(0.1, 0.05)),
    ],
)
def test_a_room_takes_its_center_and_what_lies_there_along(room, center, radius):
    points = np.array([[0, 0.05], [0.05, 0], [-0.05, 0], [0, -0.05]])
    before = {
        "radius": "150mm",
        "points": points.tolist(),
        "dot": "5mm",
        "keep_out": ["circle:5mm@10mm,0.02", "rect:4mmx4mm", {"kind": "circle", "radius": 0.003, "center": [0.01, 0]}],
        "drawing_center": [1, 2],
    }
    after = with_region({"options": before, "room": room})["options"]
    old, new = spec_of_options(before), spec_of_options(after)
    assert new.boundary.center == pytest.approx((0, 0), abs=1e-9)
    assert new.boundary.radius == pytest.approx(radius)
    np.testing.assert_allclose(np.array(new.points), points - center, atol=1e-12)
    for one, other in zip(old.keep_outs, new.keep_outs, strict=True):
        np.testing.assert_allclose(np.array(other.center), np.subtract(one.center, center), atol=1e-9)
        assert other.radius == pytest.approx(one.radius)
    # What was typed can be typed again.
    assert [type(item) for item in after["keep_out"]] == [str, str, dict]
    assert after["dot"] == "5mm"
    assert after["drawing_center"] == pytest.approx(np.add((1, 2), center))


def test_a_relief_keeps_its_heights():
    points = "0mm,50mm,10mm; -50mm,0mm,0mm; 0mm,-50mm,5mm; 50mm,0mm,0mm"
    room = {"kind": "circle", "radius": 0.1, "center": [0.01, 0]}
    after = with_region({"options": {"points": points, "relief": "10mm"}, "room": room})["options"]
    assert after["points"] == "-10.0mm,50.0mm,10.0mm; -60.0mm,0.0mm,0.0mm; -10.0mm,-50.0mm,5.0mm; 40.0mm,0.0mm,0.0mm"


def test_one_keep_out_is_moved_and_what_is_drawn_is_in_whole_micrometers():
    drawn = {"kind": "circle", "radius": 0.01, "center": [-0.10769000000000001, 0]}
    first = with_region({"options": {"keep_out": "rect:4mmx4mm"}, "keep_out": drawn})["options"]
    assert first["keep_out"] == ["rect:4mmx4mm", {"kind": "circle", "radius": 0.01, "center": [-0.10769, 0.0]}]
    state = with_region({"options": first, "move": {"index": 0, "by": [0.001, 0.02]}})["options"]
    assert state["keep_out"] == ["rect:4mmx4mm@1.0mm,20.0mm", first["keep_out"][1]]
    assert [
        item["words"]
        for item in look({**state, "points": "0mm,90mm; 90mm,0mm; -60mm,0mm; 0mm,-90mm"})["room"]["keep_outs"]
    ] == [
        sentence("polygon of", "4 mm x 4 mm at 1.00, 20.00 mm"),
        sentence("disk", "10 mm at -107.69, 0.00 mm"),
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"room": {"kind": "polygon", "outlines": CROSSED}}, "expected outlines that do not cross"),
        ({"room": {"kind": "polygon", "outlines": [[[0, 0], [0.1, 0], [0.2, 0]]]}}, "an area in outline 1"),
        ({"keep_out": {"kind": "circle", "radius": 1, "center": [0, 0]}}, "keep-outs that leave room"),
        ({"keep_out": {"kind": "circle", "radius": 0.01}}, "x and y in m"),
        ({"keep_out": {"kind": "circle", "radius": 0.01, "center": [float("nan"), 0]}}, "x and y in m"),
        ({"room": "plate.svg"}, "a circle or polygon"),
        ({"move": {"index": 1, "by": [0, 0]}}, "the index of a keep-out"),
        ({}, "a table under move"),
    ],
)
def test_what_is_no_region_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        with_region({"options": {"keep_out": ["rect:4mmx4mm"]}, **change})


def test_a_keep_out_of_the_sheet_of_a_room_is_that_of_the_command():
    sheet = '<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="300mm" viewBox="0 0 300 300">{}</svg>'
    room = opened_file("plate.svg", sheet.format('<path d="M20,20 h200 v160 h-200 z"/>').encode())
    hole = sheet.format('<circle cx="50" cy="50" r="10"/>').encode()
    keep_out = opened_file("holes.svg", hole, origin=room["center"])["keep_out"]
    [result] = spec_of_options({"boundary": room["boundary"], "keep_out": [keep_out]}).keep_outs
    assert result.center == pytest.approx((-0.07, 0.05))
