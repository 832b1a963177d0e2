import numpy as np
import pytest

from markergen.maths.projection import circle_image, plane_homography, project
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper
from markergen.render import Optics, Patch, Scenery, render_patches, render_view
from markergen.render.view import marker_patches

POSES = paper()
SHARP = Optics(blur_px=0, noise_grey=0)
FACING = np.diag([1.0, -1.0, -1.0])
LENS = Distortion("radtan", (-0.35, 0.12, 0.003, -0.002))
PSFS = {
    "sharp": {"blur_px": 0.0},
    "gaussian": {"blur_px": 0.7},
    "defocus": {"blur_px": 0.3, "defocus_px": 2.3},
    "motion": {"blur_px": 0.3, "motion_px": 6.4, "motion_deg": 37.0},
    "all": {"blur_px": 0.7, "defocus_px": 1.1, "motion_px": 3.0, "motion_deg": 110.0},
}


def one_dot(x, y, z=0.0, feature=None):
    return Marker((ControlPoint(0, x, y, z, feature or Feature(0.036)),), Circle(0.15), 0.0036)


def fine_grey(psf):
    """No noise, and levels so fine that rounding does not count."""
    return Optics(**PSFS[psf], noise_grey=0, dark=0, light=255, bits=16)


@pytest.mark.parametrize("psf", PSFS)
@pytest.mark.parametrize("pose", [3, 47, 66, 95, 230, 395])
def test_grey_centroid_is_the_ellipse_center_not_the_projected_one(pose, psf, centroid):
    marker, rotation, translation = one_dot(0.07, -0.1), POSES.rotation[pose], POSES.translation[pose]
    image = render_view(marker, PAPER_CAMERA, rotation, translation, fine_grey(psf), np.random.default_rng(0))
    homography = plane_homography(rotation[None], translation[None], PAPER_CAMERA.matrix)[0]
    ellipse = circle_image(marker.xyz[0, :2], 0.018, homography)[0]
    # Sampling a sharp outline by pixels moves the centroid by up to 1e-3 px; any blur leaves less.
    np.testing.assert_allclose(centroid(65535.0 - image), ellipse, rtol=0, atol=2e-3)
    projected = project(marker.xyz, rotation[None], translation[None], PAPER_CAMERA.matrix)[0, 0]
    tilted = POSES.polar_angle_deg[pose] > 1
    assert (np.linalg.norm(ellipse - projected) > 0.02) == tilted


def disk_centroid(x, y, radius, camera, rotation, translation):
    """Centroid in px of a disk's image: the mean of the pixels of its points, weighted by how each is magnified."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    angle = 2 * np.pi * np.arange(64) / 64
    distance = radius * np.sqrt((nodes[:, None] + 1) / 2)
    points = np.stack([x + distance * np.cos(angle), y + distance * np.sin(angle)], axis=-1)

    def pixels(dx, dy):
        return camera.project(points + [dx, dy], rotation[None], translation[None])[:, 0]

    h = 1e-5
    along_x, along_y = (pixels(h, 0) - pixels(-h, 0)) / (2 * h), (pixels(0, h) - pixels(0, -h)) / (2 * h)
    weight = weights[:, None] * np.abs(along_x[..., 0] * along_y[..., 1] - along_x[..., 1] * along_y[..., 0])
    return np.sum(weight[..., None] * pixels(0, 0), axis=(0, 1)) / weight.sum()


@pytest.mark.parametrize("psf", PSFS)
@pytest.mark.parametrize("place", [(0.07, -0.1), (-0.12, 0.06)])
def test_grey_centroid_through_a_lens_is_that_of_the_disk(place, psf, centroid):
    camera = Camera(240, 180, 220, 224, 122, 88, LENS)
    rotation, translation = POSES.rotation[47], 0.6 * POSES.translation[47]
    image, straight = (
        render_view(one_dot(*place), lens, rotation, translation, fine_grey(psf), None)
        for lens in (camera, camera.ideal)
    )
    expected = disk_centroid(*place, 0.018, camera, rotation, translation)
    # As above.
    np.testing.assert_allclose(centroid(65535.0 - image), expected, rtol=0, atol=2e-3)
    # The test can fail: without the lens the dot is elsewhere.
    assert np.linalg.norm(centroid(65535.0 - straight) - expected) > 0.5


@pytest.mark.parametrize("lens", [Distortion(), LENS])
def test_whole_marker_agrees_with_rays(lens, pentagon, traced):
    camera = Camera(80, 60, 100, 100, 41, 29, lens)
    rotation, translation = POSES.rotation[95], POSES.translation[95]
    sharp = Optics(0, 0, 0, 255, bits=16)
    image = render_view(pentagon, camera, rotation, translation, sharp, None)
    # An outline through 16 x 16 points is counted to half a row, 1/32, at worst.
    np.testing.assert_allclose(1 - image / 65535, traced(pentagon, camera, rotation, translation), rtol=0, atol=1 / 32)


def test_frontal_dot_has_the_size_the_pinhole_gives_it(centroid):
    image = render_view(one_dot(0, 0), PAPER_CAMERA, FACING, np.array([0, 0, 0.6]), fine_grey("sharp"), None)
    ink = 1 - image / 65535
    # Radius 18 mm at 0.6 m and f = 800 px: 24 px. Some 200 pixels are rounded to 16 bits.
    assert ink.sum() == pytest.approx(np.pi * 24**2, abs=200 / 65535)
    np.testing.assert_allclose(centroid(ink), [320, 240], atol=1e-5)


def test_marker_axes_are_right_and_up(centroid):
    image = render_view(one_dot(0.06, 0.03), PAPER_CAMERA, FACING, np.array([0, 0, 0.6]), fine_grey("sharp"), None)
    # 60 mm to the right is +80 px, 30 mm up is -40 px. A centroid of sharp pixels is off by up to 1e-3 px.
    np.testing.assert_allclose(centroid(65535.0 - image), [400, 200], atol=1e-2)


def test_ring_is_the_disk_without_its_hole():
    pose = POSES.rotation[95], POSES.translation[95]
    ring, disk, hole = (
        65535.0 - render_view(one_dot(0.05, 0.08, feature=feature), PAPER_CAMERA, *pose, fine_grey("gaussian"), None)
        for feature in (key_ring(0.036), Feature(0.036), Feature(0.018))
    )
    # Three images rounded.
    np.testing.assert_allclose(ring, disk - hole, rtol=0, atol=1.5)


def test_raised_dot_is_seen_as_if_the_marker_came_nearer():
    raised, nearer = (
        render_view(one_dot(0.05, 0.02, z), PAPER_CAMERA, FACING, np.array([0, 0, distance]), fine_grey("sharp"), None)
        for z, distance in ((0.1, 0.7), (0.0, 0.6))
    )
    # Single precision.
    np.testing.assert_allclose(raised.astype(float), nearer, rtol=0, atol=1)


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
    for scenery in (None, Scenery(225.0)):
        image = render_view(one_dot(0, 0), PAPER_CAMERA, rotation, np.array(translation), SHARP, None, scenery)
        assert image.shape == (480, 640)
        assert (image == 225).all()


def test_bare_points_are_not_drawn():
    image = render_view(one_dot(0, 0, feature=Feature(0.0)), PAPER_CAMERA, FACING, np.array([0, 0, 0.6]), SHARP, None)
    assert (image == 225).all()


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


@pytest.mark.parametrize("psf", PSFS)
@pytest.mark.parametrize("pose", [0, 95, 395])
def test_blurring_only_around_the_marker_changes_nothing(pentagon, psf, pose):
    # With a background of its grey level everything is drawn and blurred: the plate too, which then cannot be seen.
    part, whole = (
        render_view(
            pentagon, PAPER_CAMERA, POSES.rotation[pose], POSES.translation[pose], fine_grey(psf), None, scenery
        )
        for scenery in (None, Scenery(255.0))
    )
    # Single precision.
    np.testing.assert_allclose(part.astype(float), whole, rtol=0, atol=1)


def test_marker_is_rendered_as_its_patches(pentagon):
    pose = POSES.rotation[66], POSES.translation[66]
    view = render_view(pentagon, PAPER_CAMERA, *pose, fine_grey("gaussian"), None)
    image = render_patches(marker_patches(pentagon), PAPER_CAMERA, *pose, fine_grey("gaussian"), None)
    # Circles have other numbers of vertices: 2e-4 px of an outline, of 65535 levels.
    np.testing.assert_allclose(view.astype(float), image, rtol=0, atol=15)


def test_later_patches_cover_earlier_ones():
    squares = [np.array([[-s, -s, 0], [s, -s, 0], [s, s, 0], [-s, s, 0]]) for s in (0.1, 0.05, 0.02)]
    patches = [Patch((square,), value) for square, value in zip(squares, (0.5, 0.0, 1.0), strict=True)]
    image = render_patches(patches, PAPER_CAMERA, FACING, np.array([0, 0, 1.0]), Optics(0, 0, 20, 220), None)
    # f = 800 px at 1 m: the squares' half sides are 80, 40 and 16 px, to 319.5.
    np.testing.assert_array_equal(image[240, [230, 250, 270, 290, 320, 350, 370, 390, 410]].astype(int),
                                  [220, 120, 120, 20, 220, 20, 120, 120, 220])  # fmt: skip
