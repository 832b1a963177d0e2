"""Rigs in comparisons: what is rendered and found of them, and of the same body with tags."""

import numpy as np
import pytest

import markergen as mg
from markergen.comparison.baselines import line_up
from markergen.comparison.contestants.dots import DotBody
from markergen.comparison.contestants.tags import TagBody
from markergen.errors import InputError
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import named_poses
from markergen.render import Optics
from tests.support.rigs import cube, scattered

AROUND = "sphere:distance=0.3..0.5m,count=6"
RIG = cube(seed=10)


@pytest.mark.parametrize("contestant", [DotBody("rig", RIG), TagBody.on(RIG, "aruco:DICT_4X4_50")])
def test_each_is_found_where_it_is(contestant):
    poses, rng = named_poses(AROUND), np.random.default_rng(0)
    exact = contestant.print_error(0.0, rng)
    for rotation, translation in zip(poses.rotation, poses.translation, strict=True):
        image = contestant.render(PAPER_CAMERA, (rotation, translation), Optics(), rng, exact)
        seen = contestant.sight(image, PAPER_CAMERA, {}, 0.0)
        pixels = PAPER_CAMERA.project(contestant.points[seen.ids], rotation[None], translation[None])[0]
        # Corners without refinement are rounded to a pixel.
        assert np.abs(seen.pixels - pixels).max() < 2
        assert np.arccos((np.trace(seen.rotation.T @ rotation) - 1) / 2) < np.deg2rad(3)
        assert seen.translation == pytest.approx(translation, rel=0.03, abs=0.01)


def test_print_errors_move_what_is_seen():
    contestant, (rotation, translation) = DotBody("rig", RIG), (p[0] for p in _pose())
    moved = contestant.print_error(1e-3, np.random.default_rng(1))
    assert moved.std() == pytest.approx(1e-3, rel=0.4)
    image = contestant.render(PAPER_CAMERA, (rotation, translation), Optics(), np.random.default_rng(0), moved)
    seen = contestant.sight(image, PAPER_CAMERA, {}, 1e-3)
    there = [item.to_body(np.column_stack([part, np.zeros(6)])) for item, part in _moved(moved)]
    pixels = PAPER_CAMERA.project(np.concatenate(there), rotation[None], translation[None])[0]
    np.testing.assert_allclose(seen.pixels, pixels[seen.ids], atol=0.2)


def _pose():
    poses = named_poses(AROUND)
    return poses.rotation, poses.translation


def _moved(moved):
    return [
        (marker, marker.marker.xyz[:, :2] + part) for marker, part in zip(RIG.markers, np.split(moved, 6), strict=True)
    ]


def test_ink_and_size():
    dots, tags = DotBody("rig", RIG), TagBody.on(RIG, "aruco:DICT_4X4_50:3")
    assert dots.area(1.0) == pytest.approx(6 * 0.08**2)
    points = [point.feature for marker in RIG.markers for point in marker.marker.control_points]
    area = np.pi / 4 * sum(p.diameter**2 - p.inner_diameter**2 for p in points)
    assert dots.ink(1.0) == pytest.approx(area, rel=1e-2)
    assert [tag.id for tag in tags.tags] == [3, 4, 5, 6, 7, 8]
    # Four cells of bits, two of the border and two of white.
    assert tags.tags[0].side == pytest.approx(0.08 * 6 / 8)


def test_rigs_are_compared_with_rigs():
    contestants, setting = line_up(["here", "apriltag:36h11"], AROUND, given={"here": RIG})
    assert [contestant.name for contestant in contestants] == ["here", "apriltag:36h11"]
    assert len(setting.poses) == 6
    assert len(line_up(["here"], AROUND, given={"here": RIG})[0]) == 3
    with pytest.raises(InputError, match="of its plates"):
        line_up(["here", "charuco:5x5"], AROUND, given={"here": RIG})


@pytest.mark.long
def test_comparison_of_a_cube_with_tags():
    comparison = mg.compare(RIG, scattered(0), "aruco:DICT_4X4_50", views=10, poses=AROUND)
    ours, _, tags = comparison.contestants.values()
    assert ours["detected"] == tags["detected"] == 10
    assert ours["wrong"] == tags["wrong"] == 0
    assert tags["rotation_deg"]["rms"] > ours["rotation_deg"]["rms"]
    assert ours["pattern_bound"]["rotation_deg"] is None
