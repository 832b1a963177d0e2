import numpy as np
import pytest

from markergen.maths.conic import circle_image
from markergen.maths.projection import plane_homography, project
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper
from markergen.render.optics import Optics
from markergen.render.view import ink_coverage, render_view

POSES = paper()
SHARP = Optics(blur_px=0, noise_grey=0)
FACING = np.diag([1.0, -1.0, -1.0])


def one_dot(x, y, z=0.0, feature=None):
    return Marker((ControlPoint(0, x, y, z, feature or Feature(0.036)),), Circle(0.15), 0.0036)


def centroid(weight):
    y, x = np.indices(weight.shape)
    return np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()


@pytest.mark.parametrize("pose", [3, 47, 66, 95, 230, 395])
def test_grey_centroid_is_the_ellipse_center_not_the_projected_one(pose):
    marker, rotation, translation = one_dot(0.07, -0.1), POSES.rotation[pose], POSES.translation[pose]
    # Contrast enough that rounding to whole grey levels is small.
    image = render_view(marker, PAPER_CAMERA, rotation, translation, Optics(0.7, 0, 0, 255), np.random.default_rng(0))
    homography = plane_homography(rotation[None], translation[None], PAPER_CAMERA.matrix)[0]
    ellipse = circle_image(marker.xyz[0, :2], 0.018, homography)[0]
    # Rounding to grey levels moves the centroid by 5e-4 px RMS and 2e-3 px at most, measured over the poses.
    np.testing.assert_allclose(centroid(255.0 - image), ellipse, rtol=0, atol=2.5e-3)
    projected = project(marker.xyz, rotation[None], translation[None], PAPER_CAMERA.matrix)[0, 0]
    tilted = POSES.polar_angle_deg[pose] > 1
    assert (np.linalg.norm(ellipse - projected) > 0.02) == tilted


def test_frontal_dot_has_the_size_the_pinhole_gives_it():
    coverage = ink_coverage(one_dot(0, 0), PAPER_CAMERA, FACING, np.array([0, 0, 0.6]))
    # Radius 18 mm at 0.6 m and f = 800 px: 24 px. Rounding alone is left.
    assert coverage.sum() == pytest.approx(np.pi * 24**2, rel=1e-10)
    np.testing.assert_allclose(centroid(coverage), [320, 240], atol=1e-9)


def test_marker_axes_are_right_and_up():
    coverage = ink_coverage(one_dot(0.06, 0.03), PAPER_CAMERA, FACING, np.array([0, 0, 0.6]))
    # 60 mm to the right is +80 px, 30 mm up is -40 px. A centroid of sharp pixels is off by up to 1e-3 px.
    np.testing.assert_allclose(centroid(coverage), [400, 200], atol=1e-2)


def test_ring_is_the_disk_without_its_hole():
    pose = POSES.rotation[95], POSES.translation[95]
    ring, disk, hole = (
        ink_coverage(one_dot(0.05, 0.08, feature=feature), PAPER_CAMERA, *pose)
        for feature in (key_ring(0.036), Feature(0.036), Feature(0.018))
    )
    np.testing.assert_allclose(ring, disk - hole, rtol=0, atol=1e-12)
    assert ring.min() >= -1e-12


def test_raised_dot_is_seen_as_if_the_marker_came_nearer():
    raised = ink_coverage(one_dot(0.05, 0.02, 0.1), PAPER_CAMERA, FACING, np.array([0, 0, 0.7]))
    nearer = ink_coverage(one_dot(0.05, 0.02), PAPER_CAMERA, FACING, np.array([0, 0, 0.6]))
    np.testing.assert_allclose(raised, nearer, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [
        (np.eye(3), (0, 0, 0.6)),  # the back of the marker
        (FACING, (0, 0, -0.6)),  # behind the camera
        (FACING, (5, 0, 0.6)),  # beside the image
        (np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), (0, 0, 0.01)),  # edge-on, through the camera
    ],
)
def test_what_cannot_be_seen_leaves_the_substrate(rotation, translation):
    image = render_view(one_dot(0, 0), PAPER_CAMERA, rotation, np.array(translation), SHARP, np.random.default_rng(0))
    assert image.min() == 225


def test_bare_points_are_not_drawn():
    image = ink_coverage(one_dot(0, 0, feature=Feature(0.0)), PAPER_CAMERA, FACING, np.array([0, 0, 0.6]))
    assert not image.any()


def test_image_has_the_camera_size_and_repeats_with_its_seed():
    camera = Camera(101, 67, 400, 400, 50, 33)
    first, again, other = (
        render_view(one_dot(0, 0), camera, FACING, np.array([0, 0, 1.0]), Optics(), np.random.default_rng(seed))
        for seed in (5, 5, 6)
    )
    assert first.shape == (67, 101)
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
