import json

import numpy as np
import pytest

import markergen as mg
from markergen.maths.information import information, pose_jacobian
from markergen.model.boundary import Circle
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import named_poses
from markergen.model.sight import partly_seen, poses_that_serve
from markergen.model.spec import PAPER_CAMERA
from markergen.validation.bounds import UNSEEN_PX2, counted_covariance, pose_bounds
from markergen.validation.setting import setting_of
from markergen.validation.views import SyntheticViews

WIDE = "cone:distance=0.3..8m,tilt=0..45,count=24"


@pytest.fixture(scope="module")
def pad():
    points = []
    for n, radius, diameter, rotation in ((6, 0.42, 0.13, 0.3), (5, 0.075, 0.024, 0.0)):
        for i, angle in enumerate(2 * np.pi * np.arange(n) / n + rotation):
            place = float(radius * np.cos(angle)), float(radius * np.sin(angle)), 0.0
            points.append(ControlPoint(len(points), *place, Feature(diameter) if i else key_ring(diameter)))
    return Marker(tuple(points), Circle(0.5), 0.002)


def test_poses_that_see_four_dots_of_one_size_count(pad):
    poses = named_poses(WIDE)
    results = poses_that_serve(pad, PAPER_CAMERA, poses)
    assert len(results) == len(poses)
    one = Marker(pad.control_points[:6], pad.boundary, pad.clearance)
    assert len(poses_that_serve(one, PAPER_CAMERA, poses)) < len(poses)
    assert partly_seen(one, PAPER_CAMERA, results) is None
    with pytest.raises(mg.InputError, match="of one size"):
        poses_that_serve(pad, PAPER_CAMERA, named_poses("cone:distance=0.02,count=3"))


def test_bounds_are_those_of_the_dots_in_view(pad):
    poses = named_poses(WIDE)
    seen = partly_seen(pad, PAPER_CAMERA, poses)
    bounds = pose_bounds(pad.xyz, PAPER_CAMERA, poses, 0.2, seen)
    for p in (0, 7):
        ours = pose_jacobian(pad.xyz[seen[p]], poses.rotation[[p]], poses.translation[[p]], PAPER_CAMERA.focal)[0]
        np.testing.assert_allclose(bounds.information[p], information(ours), rtol=1e-9, atol=1e-6)
    image = counted_covariance(SyntheticViews(pad, PAPER_CAMERA, poses, 0))
    np.testing.assert_array_equal(image[..., 0, 0] == UNSEEN_PX2, ~seen)


def test_a_pad_is_validated_over_its_range(pad):
    validation = mg.validate(pad, poses=WIDE, runs=20, views=3)
    assert validation.views["detected"] == 3
    results = json.loads(validation.to_json())
    rows = results["coverage"]["by_distance"]
    assert sum(row["poses"] for row in rows) == 24
    assert all(row["served"] == row["poses"] and row["expected_deg"] > 0 for row in rows)
    assert 5 < validation.nees["mean"] < 7
    assert "homography_px" not in results["criteria"]
    text = str(validation)
    assert "each distance is" in text
    assert "relief" not in text


def test_the_setting_of_a_pad_knows_what_is_seen(pad):
    setting = setting_of(pad, WIDE)
    assert setting.sight is not None
    assert setting.sight.seen.shape == (24, 11)
