import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.maths.rotation import angle_between
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.feature import Feature, key_ring
from markergen.model.poses import POSES, named_poses, paper, paper_roll
from markergen.model.spec import Spec


def test_the_papers_poses():
    poses = paper()
    assert len(poses) == 400
    assert {name: int(mask.sum()) for name, mask in poses.by_polar_angle().items()} == {
        "0": 80, "17.5": 80, "35": 80, "52.5": 80, "70": 80,
    }  # fmt: skip
    np.testing.assert_allclose(np.linalg.det(poses.rotation), 1, atol=1e-12)
    # A marker at the origin seen frontally upright has R = diag(1, -1, -1).
    np.testing.assert_allclose(poses.rotation[0], np.diag([1, -1, -1]), atol=1e-12)
    # Camera centers are d (cos a sin p, sin a sin p, cos p).
    center = -np.einsum("pji,pj->pi", poses.rotation, poses.translation)
    np.testing.assert_allclose(np.linalg.norm(center, axis=-1), poses.translation[:, 2], atol=1e-12)
    assert np.all(center[:, 2] > 0)
    seen = poses.seen_whole(Circle(0.15), PAPER_CAMERA)
    assert (len(seen), seen.dropped) == (400, 0)


def test_roll_turns_about_the_optical_axis_and_is_always_the_same():
    plain, rolled = paper(), paper_roll()
    np.testing.assert_array_equal(rolled.rotation, paper_roll().rotation)
    np.testing.assert_allclose(rolled.polar_angle_deg, plain.polar_angle_deg, atol=1e-5)
    rotation = rolled.rotation @ plain.rotation.swapaxes(-1, -2)
    np.testing.assert_allclose(rotation[:, 2], np.tile([0, 0, 1], (400, 1)), atol=1e-12)
    assert np.std(angle_between(plain.rotation, rolled.rotation)) > 0.5


def test_presets_are_listed():
    assert list(POSES) == ["cone", "paper", "paper-roll", "sphere", "view"]


def test_poses_from_behind_or_beside_are_dropped():
    poses = paper()
    # A camera that sees half as wide loses the near ones.
    narrow = Camera(640, 480, 1600.0, 1600.0, 320.0, 240.0)
    seen = poses.seen_whole(Circle(0.15), narrow)
    assert 0 < len(seen) < 400
    assert seen.dropped == 400 - len(seen)
    with pytest.raises(InputError, match="none of 400"):
        poses.seen_whole(Circle(5.0), PAPER_CAMERA)


def test_many_tilts_are_put_in_bins():
    rng = np.random.default_rng(0)
    poses = paper()
    # Moving the marker sideways tilts the line of sight against its normal.
    spread = type(poses)("spread", poses.rotation, poses.translation + rng.normal(scale=0.05, size=(400, 3)))
    bins = spread.by_polar_angle()
    assert sum(int(mask.sum()) for mask in bins.values()) == 400
    assert all(".." in name for name in bins)


def test_bins_of_distance_end_where_the_poses_do():
    names = list(named_poses("cone:distance=0.3..1.5m,count=200").by_distance())
    assert (names[0], names[1], names[-1]) == ("0.3..0.4", "0.4..0.6", "1.4..1.5")


@given(st.floats(0.01, 2), st.integers(0, 2**32 - 1), st.floats(0, 0.5))
def test_circle_geometry(radius, seed, share):
    circle, rng = Circle(radius), np.random.default_rng(seed)
    inset = share * radius
    points = rng.normal(scale=radius, size=(20, 2))
    inside = circle.project(points, inset)
    assert np.all(circle.depth(inside) >= inset - 1e-12 * radius)
    kept = circle.depth(points) >= inset
    np.testing.assert_array_equal(inside[kept], points[kept])
    # The nearest such point: straight toward the center.
    cross = inside[:, 0] * points[:, 1] - inside[:, 1] * points[:, 0]
    np.testing.assert_allclose(cross, 0, atol=1e-12 * radius**2)
    assert np.all(circle.depth(circle.sample(50, inset, rng)) >= inset - 1e-12 * radius)
    np.testing.assert_allclose(circle.depth(circle.rim(16)), 0, atol=1e-12 * radius)
    step = 1e-6 * radius
    along = rng.normal(size=(20, 2))
    slope = (circle.depth(points + step * along) - circle.depth(points - step * along)) / (2 * step)
    np.testing.assert_allclose(np.sum(circle.depth_gradient(points) * along, -1), slope, rtol=1e-3, atol=1e-3)


def test_samples_are_uniform():
    points = Circle(1.0).sample(4000, 0.0, np.random.default_rng(0))
    share = np.mean(np.hypot(*points.T) < 0.5)
    # A quarter of the area; four binomial standard deviations.
    assert share == pytest.approx(0.25, abs=4 * math.sqrt(0.25 * 0.75 / 4000))


@pytest.mark.parametrize("radius", [0, -0.15, math.nan, math.inf])
def test_bad_radii_are_refused(radius):
    with pytest.raises(InputError, match=f"radius={radius}"):
        Circle(radius)


@pytest.mark.parametrize(
    "values",
    [
        {"n": 3},
        {"dot": -1.0},
        {"dot": math.nan},
        {"clearance": -0.1},
        {"restarts": -1},
        {"restarts": 10**9},
        {"seed": -1},
    ],
)
def test_bad_specs_are_refused(values):
    with pytest.raises(InputError, match=next(iter(values))):
        Spec(**values)


def test_bad_cameras_and_features_are_refused():
    with pytest.raises(InputError, match="focal"):
        Camera(640, 480, 0.0, 800.0, 320.0, 240.0)
    for focal in (math.nan, math.inf, 10**400):
        with pytest.raises(InputError, match="focal"):
            Camera(640, 480, 800.0, focal, 320.0, 240.0)
    with pytest.raises(InputError, match="principal point"):
        Camera(640, 480, 800.0, 800.0, math.nan, 240.0)
    for side in (0, -1, 20_001, 10**400):
        with pytest.raises(InputError, match="image size"):
            Camera(side, 480, 800.0, 800.0, 320.0, 240.0)
    assert Camera(20_000, 1, 800.0, 800.0, 320.0, 240.0).width == 20_000
    for diameter, inner in ((-1.0, 0.0), (0.01, 0.01), (0.01, -0.001), (math.nan, 0.0)):
        with pytest.raises(InputError, match="diameter"):
            Feature(diameter, inner)


def test_key_ring():
    assert key_ring(0.036) == Feature(0.036, 0.018)
    assert key_ring(0.036).kind == "ring"
    assert Feature(0.036).kind == "dot"


def test_the_hash_names_the_spec():
    assert Spec().hash == Spec(n=5).hash
    assert len(Spec().hash) == 8
    assert Spec(dot=0.03).hash != Spec().hash


def test_sensor_limits_are_the_pixels_outer_edges():
    corners = np.array([[-0.5, -0.5], [639.5, 479.5], [-0.51, 0], [0, 479.51]])
    np.testing.assert_array_equal(PAPER_CAMERA.sees(corners), [True, True, False, False])
