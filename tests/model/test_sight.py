import numpy as np
import pytest

from markergen.bounds.dot_covariances import dot_ellipses
from markergen.model.body import scales_of
from markergen.model.boundary import Circle
from markergen.model.camera import Camera
from markergen.model.marker import build_marker
from markergen.model.occlusion import hidden
from markergen.model.poses import PoseDistribution, named_poses
from markergen.model.sight import (
    LEAST_FACING,
    NARROWEST_PX,
    TRIED_FACING,
    Coverage,
    coverage,
    disks_in_view,
    dots_in_view,
)
from markergen.model.spec import PAPER_CAMERA
from tests.support.rigs import cube

CAMERA = Camera(640, 480, 800, 800, 320, 240)
FRONTAL = np.diag([1.0, -1.0, -1.0])


def frontal(*distances):
    translation = np.array([[0.0, 0.0, d] for d in distances])
    return PoseDistribution("frontal", np.tile(FRONTAL, (len(distances), 1, 1)), translation)


def test_a_dot_counts_up_to_three_pixels_from_the_edge():
    # At 1 m a dot of 20 mm has a radius of 8 px; the sensor ends at 479.5 px, 239.5 px below the principal point.
    for inside, y in ((True, -(239.5 - 3 - 8 - 0.1) / 800), (False, -(239.5 - 3 - 8 + 0.1) / 800)):
        seen = disks_in_view(np.array([[0.0, y]]), np.array([0.02]), CAMERA, frontal(1.0))
        assert seen[0, 0] == inside


def test_a_dot_counts_from_its_least_size_on():
    points, diameters = np.zeros((1, 2)), np.array([0.03])
    # 24 px at 1 m.
    assert disks_in_view(points, diameters, CAMERA, frontal(3.99, 4.01), 6.0).ravel().tolist() == [True, False]


def test_size_is_that_of_the_image_ellipse():
    poses = named_poses("cone:distance=1..3m,tilt=0..60,count=20")
    marker = build_marker(np.array([[0.05, 0.02], [-0.1, 0], [0, 0.1], [0, -0.1]]), Circle(0.2), 0.03, 0.003)
    for rotation, translation in zip(poses.rotation, poses.translation, strict=True):
        _, semi, _ = dot_ellipses(marker.xyz, PAPER_CAMERA, rotation, translation, np.full(4, 0.03))
        one = PoseDistribution("one", rotation[None], translation[None])
        mean = 2 * np.sqrt(semi.prod(axis=-1))
        for nearby, seen in ((0.99, True), (1.01, False)):
            assert disks_in_view(marker.xyz, np.full(4, 0.03), PAPER_CAMERA, one, nearby * mean).all() == seen


def test_dots_behind_or_from_the_back_do_not_count():
    points, diameters = np.array([[0.0, 0.0], [0.5, 0.0]]), np.full(2, 0.05)
    back = PoseDistribution("back", np.eye(3)[None], np.array([[0.0, 0.0, 1.0]]))
    assert not disks_in_view(points, diameters, CAMERA, back).any()
    steep = named_poses("cone:distance=0.3,tilt=60,azimuth=0,roll=0,count=1")
    assert disks_in_view(points, diameters, CAMERA, steep).tolist() == [[True, False]]


@pytest.mark.parametrize("tilt", [60, 69, 71, 80, 83, 85])
@pytest.mark.parametrize("distance", [0.5, 1, 2, 4])
def test_a_steep_dot_counts_if_its_short_axis_is_long_enough(tilt, distance):
    marker = build_marker(np.array([[0.05, 0.02], [-0.1, 0], [0, 0.1], [0, -0.1]]), Circle(0.2), 0.03, 0.003)
    poses = named_poses(f"cone:distance={distance},tilt={tilt},count=5")
    seen = disks_in_view(marker.xyz, np.full(4, 0.03), PAPER_CAMERA, poses, 2.5)
    for pose, row in zip(zip(poses.rotation, poses.translation, strict=True), seen, strict=True):
        _, semi, _ = dot_ellipses(marker.xyz, PAPER_CAMERA, *pose, np.full(4, 0.03))
        places = marker.xyz @ pose[0].T + pose[1]
        facing = -places @ pose[0][:, 2] / np.linalg.norm(places, axis=-1)
        large = (2 * np.sqrt(semi.prod(axis=-1)) >= 2.5) & ((facing >= TRIED_FACING) | (2 * semi[:, 1] >= NARROWEST_PX))
        assert row.tolist() == (large & (facing > LEAST_FACING)).tolist()


def test_a_rig_shows_what_its_plates_show_and_nothing_hides():
    rig, poses = cube(), named_poses("sphere:distance=0.3..0.9m,count=40")
    seen = dots_in_view(rig, PAPER_CAMERA, poses)
    for k, plate in enumerate(rig.plates):
        here = PoseDistribution("", *plate.camera_pose(poses.rotation, poses.translation))
        whole = dots_in_view(plate.marker, PAPER_CAMERA, here)
        np.testing.assert_array_equal(seen[:, rig.owner == k], whole & ~hidden(rig, poses)[:, rig.owner == k])
    assert seen.any()
    assert not seen.all()


def test_what_serves_is_told_by_distance():
    points = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1], [0.0, 0.3]])
    marker = build_marker(points, Circle(0.4), 0.04, 0.004)
    result = coverage(marker, CAMERA, frontal(0.3, 0.8, 2.0, 5.0, 14.0))
    assert result.count.tolist() == [0, 4, 5, 5, 0]
    assert result.served.tolist() == [False, True, True, True, False]
    first, last = result.gaps
    assert first.startswith("0.3 to 0.3")
    assert first.endswith("0 dots in view")
    assert "14 m: 0 dots in view" in last
    assert sum(row["served"] for row in result.rows()) == 3


def test_four_dots_on_a_line_do_not_serve():
    points = np.array([[0.1 * i, 0.0] for i in range(4)] + [[0.0, 9.0]])
    seen = np.array([[True, True, True, True, False]])
    assert not Coverage(points, np.full(5, 0.02), frontal(3.0), seen).served.any()


def test_four_dots_of_two_sizes_do_not_serve():
    points = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])
    every = np.ones((1, 4), dtype=bool)
    assert Coverage(points, np.full(4, 0.02), frontal(3.0), every).served.all()
    mixed = Coverage(points, np.array([0.02, 0.02, 0.05, 0.05]), frontal(3.0), every)
    assert not mixed.served.any()
    assert [scale.tolist() for scale in mixed.scales] == [[2, 3], [0, 1]]
    assert "no 4 of one" in mixed.gaps[0]


@pytest.mark.parametrize("sizes", [[0.02, 0.02], [0.02, 0.05, 0.02]])
def test_scales_begin_with_the_largest(sizes):
    assert sum(map(len, scales_of(sizes))) == len(sizes)
    assert scales_of(sizes)[0].tolist() == [i for i, size in enumerate(sizes) if size == max(sizes)]
