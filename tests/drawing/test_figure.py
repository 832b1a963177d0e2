from dataclasses import replace

import numpy as np
import pytest

from markergen.drawing.figure import marker_dots, marker_tag
from markergen.drawing.scene import Layer, Scene, bounds
from markergen.errors import InputError
from markergen.model.marker import marker_name
from markergen.model.tag import Tag


def test_scene_of_a_marker_is_its_dots_in_mm(make_ngon):
    marker = make_ngon(5, 0.15, 0.036)
    disks = list(marker_dots(marker))
    scene = Scene((Layer("dots", tuple(disks)),))
    assert list(scene) == disks
    assert [disk.name for disk in disks] == [f"dot-{i}" for i in range(5)]
    assert scene["dots"] == tuple(disks)
    assert scene["nothing"] == ()
    # Rounded to 1e-9 mm on the way to millimeters.
    np.testing.assert_allclose([(d.x, d.y) for d in disks], marker.xyz[:, :2] * 1e3, atol=1e-9, rtol=0)
    assert [d.radius for d in disks] == [18.0] * 5
    assert [d.inner_radius for d in disks] == [9.0, 0.0, 0.0, 0.0, 0.0]


def test_bare_points_and_relief_are_refused(make_ngon):
    with pytest.raises(InputError, match=r"point 0 without a dot .*--dot above 0"):
        marker_dots(make_ngon(4, 0.15, 0.0))
    flat = make_ngon(4, 0.15, 0.02)
    raised = replace(
        flat, control_points=(*flat.control_points[:2], replace(flat.control_points[2], z=0.01), flat.control_points[3])
    )
    with pytest.raises(InputError, match="point 2 at z=10 mm"):
        marker_dots(raised)


@pytest.mark.parametrize(
    ("result", "name"),
    [("1a2b3c4d", "markergen-1a2b3c4d"), ("a<b>&'\x00\n;#1", "markergen-ab1"), ("x" * 99, "markergen-" + "x" * 16)],
)
def test_name_is_safe_in_every_format(make_ngon, result, name):
    assert marker_name(replace(make_ngon(4, 0.1, 0.01), provenance={"spec_hash": result})) == name


def test_a_tag_is_one_outline_with_holes(make_ngon):
    marker = replace(make_ngon(5, 0.15, 0.036), tag=Tag("aruco:DICT_4X4_50", 7, 0.06, (0.01, 0.0)))
    (outline,) = marker_tag(marker)
    assert outline.name == "tag"
    # Rounded to 1e-9 mm on the way to millimeters.
    assert bounds(outline) == pytest.approx((-20, -30, 40, 30), abs=1e-9)
    loops, area = [], 0.0
    for kind, points in outline.segments:
        if kind == "M":
            loops.append([])
        loops[-1] += points
    for loop in loops:
        x, y = np.array(loop).T
        area += (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2
    # Holes run against what they are cut from: the sum is the area of the black cells, 10 mm square each.
    assert abs(area) == pytest.approx(100 * marker.tag.ink.sum())
    assert marker_tag(make_ngon(5, 0.15, 0.036)) == ()
