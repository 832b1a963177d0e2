import numpy as np
import pytest
from sentences import sentence

from markergen.model.boundary import Circle
from markergen.model.planned_error import PlannedError
from markergen.model.poses import PoseDistribution, named_poses
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import regular_polygon
from markergen.objectives.survive import HiddenDots
from markergen.optimize.comparisons import comparison_layouts, criteria_table, hidden_table
from markergen.optimize.problem import FeasibleRegion

DISK = FeasibleRegion(Circle(0.15), 0.02, 0.002)


def test_in_a_disk_polygons_reach_the_inset_rim_upright(setting):
    for stated in (None, setting):
        layouts = comparison_layouts(DISK, 5, setting=stated)
        assert list(layouts) == ["ngon", "square", "random"]
        np.testing.assert_array_equal(layouts["ngon"][0], regular_polygon(5, 0.15 - 0.012))
        np.testing.assert_array_equal(layouts["square"][0], regular_polygon(4, 0.15 - 0.012))
        assert DISK.holds(layouts["random"]).all()


def test_a_polygon_is_turned_where_that_matters(setting):
    poses = named_poses("cone:distance=0.8..1.2,tilt=40..70,azimuth=-15..15,count=40")
    sided = Setting(Circle(0.15), setting.camera, poses.seen_whole(Circle(0.15), setting.camera))
    objective = OBJECTIVES["pose"](sided)
    result = comparison_layouts(DISK, 4, setting=sided)["ngon"]
    angles = np.deg2rad(np.arange(0, 90, 2))
    turns = np.stack([np.cos(angles), -np.sin(angles), np.sin(angles), np.cos(angles)], axis=-1).reshape(-1, 2, 2)
    every = objective(regular_polygon(4, 0.138) @ turns)
    assert np.ptp(every) > 0.02 * every.min()
    # Turns are tried in steps of 90/24 degrees, about a minimum.
    assert objective(result)[0] <= every.min() * 1.002


@pytest.mark.parametrize("n", [5, pytest.param(4, marks=pytest.mark.long)])
def test_polygons_are_regular_and_as_large_as_can_be(rooms, n):
    for room in rooms.values():
        region = FeasibleRegion(room, 0.02, 0.002)
        layouts = comparison_layouts(region, n)
        for points in [layouts[name][0] for name in ("ngon", "square") if name in layouts]:
            center = points.mean(axis=0)
            sides = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=-1)
            np.testing.assert_allclose(sides, sides[0], rtol=1e-9)
            assert region.holds(points[None])[0]
            larger = center + (points - center) * 1.001
            assert not region.holds(larger[None])[0]


def test_a_ring_has_its_polygon_around_the_hole(rooms):
    points = comparison_layouts(FeasibleRegion(rooms["ring"], 0.02, 0.002), 6)["ngon"][0]
    np.testing.assert_allclose(np.hypot(*points.T), 0.138, atol=1e-6)


def test_what_does_not_fit_is_left_out(rooms, setting):
    region = FeasibleRegion(rooms["two squares"], 0.03, 0.003)
    layouts = comparison_layouts(region, 9, setting=Setting(rooms["two squares"], setting.camera, few(setting)))
    assert "ngon" not in layouts
    assert region.holds(layouts["square"]).all()


def few(setting):
    return PoseDistribution("few", setting.poses.rotation[::20], setting.poses.translation[::20])


FLAT = {"pose_m": 0.0086638, "rotation_deg": 2.7742, "translation_pct": 0.5431, "homography_px": 1.5, "condition": 3.0}


def test_a_row_for_each_layout_in_the_units_of_its_column():
    table = criteria_table({"design": FLAT, "ngon": FLAT, "square": {"pose_m": 0.01}}, 5, "image noise of 1 px")
    assert table.title == sentence("layout title", "1 px")
    assert table.header == ["", "pose mm", "rotation deg", "translation %", "homography px", "c(A)"]
    assert table.rows[0] == ["this marker", "8.664", "2.774", "0.5431", "1.500", "3.000"]
    assert [row[0] for row in table.rows] == ["this marker", "regular 5-gon", "square, 4 dots"]
    # A relief lacks some.
    assert table.rows[2][1:] == ["10.00", "-", "-", "-", "-"]


def test_worst_and_mean_with_dots_hidden():
    errors = [HiddenDots(0, FLAT, FLAT, ()), HiddenDots(1, FLAT, FLAT, (3,)), HiddenDots(2, FLAT, FLAT, (0, 3))]
    names = [row[0] for row in hidden_table(errors, "noise").rows]
    assert names == [
        "none hidden",
        sentence("worst hidden", "dot 3"),
        sentence("mean hidden", 1),
        sentence("worst hidden", "dots 0, 3"),
        sentence("mean hidden", 2),
    ]


def test_rotations_beyond_first_order_are_no_errors():
    table = criteria_table({"design": {"rotation_deg": 128.9}, "ngon": {"rotation_deg": 3.1}}, 6, "image noise of 1 px")
    column = table.header.index("rotation deg")
    assert [row[column] for row in table.rows] == ["undetermined", "3.100"]
    assert "deg" not in PlannedError(128.9, 3.0, 1.0).amounts
