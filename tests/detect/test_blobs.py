from dataclasses import replace

import numpy as np
import pytest
from plain_blobs import plain_blobs

from markergen.detect.blobs import undo_lens
from markergen.detect.detection import detect_dots
from markergen.errors import InputError
from markergen.maths.projection import circle_image, plane_homography
from markergen.maths.rotation import turn_z
from markergen.model.camera import PAPER_CAMERA, Distortion
from markergen.model.poses import paper
from markergen.render import Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS, scattered

POSES = paper()


def fitted(image):
    blobs = detect_dots(image)
    return blobs.take(blobs.fitted)


def view(marker, pose, optics=None, seed=0, scenery=None):
    rng = np.random.default_rng([seed, pose])
    if callable(scenery):
        scenery = scenery(rng)
    return render_view(
        marker, PAPER_CAMERA, POSES.rotation[pose], POSES.translation[pose], optics or Optics(), rng, scenery
    )


def truth(marker, pose):
    """Centers and semi-axes of the dots' image ellipses."""
    radii = np.array([point.feature.diameter / 2 for point in marker.control_points])
    homography = plane_homography(POSES.rotation[pose], POSES.translation[pose], PAPER_CAMERA.matrix)
    return circle_image(marker.xyz[:, :2], radii, homography)[:2]


def errors(marker, poses, optics=None, scenery=None):
    """Errors (k, 2), normalized squares (k,), the share of dots found, and of those found wrongly as ring or disk."""
    error, square, wrong = [], [], 0
    for pose in poses:
        blobs = fitted(view(marker, pose, optics, scenery=scenery))
        center, semi = truth(marker, pose)
        for i in range(len(center)):
            distance = np.linalg.norm(blobs.center - center[i], axis=-1)
            if len(blobs) and distance.min() < 1 + 0.3 * semi[i, 1]:
                k = int(distance.argmin())
                error.append(blobs.center[k] - center[i])
                square.append(error[-1] @ np.linalg.solve(blobs.covariance[k], error[-1]))
                wrong += int(blobs.ring[k] != (marker.control_points[i].feature.kind == "ring"))
    found = len(error) / (len(poses) * len(marker.control_points))
    return np.array(error), np.array(square), found, wrong / len(error)


def rms(error):
    return np.sqrt(np.mean(np.sum(error**2, axis=-1)))


@pytest.mark.parametrize("pose", [0, 90, 275, 399])
def test_finds_the_dots_and_the_ring(pentagon, pose):
    blobs = detect_dots(view(pentagon, pose))
    assert len(blobs) == 5
    assert blobs.ring.sum() == 1
    assert (blobs.semi[:, 0] >= blobs.semi[:, 1]).all()
    assert blobs.covariance.shape == (5, 2, 2)


def test_at_the_accuracy_the_noise_allows_and_says_so(pentagon):
    error, square, found, wrong = errors(pentagon, range(0, 400, 9))
    assert found == 1
    assert wrong == 0
    # The image bound over these poses is 0.0044 px, and 225 squared errors scatter by 7 %.
    assert rms(error) < 0.0056
    # 2.6 standard deviations of a mean of values of chi^2 with 2 degrees of freedom.
    assert abs(square.mean() - 2) < 2.6 * 2 / np.sqrt(len(square))


@pytest.mark.long
def test_the_covariance_over_all_poses(pentagon):
    error, square, found, _ = errors(pentagon, range(400))
    assert found == 1
    assert rms(error) < 1.1 * 0.0044
    assert abs(square.mean() - 2) < 2.6 * 2 / np.sqrt(len(square))


def test_without_noise_only_rounding_is_left(pentagon):
    error, _, found, _ = errors(pentagon, range(0, 400, 29), Optics(noise_grey=0))
    assert found == 1
    assert rms(error) < 0.001


@pytest.mark.parametrize(
    ("optics", "most"),
    # Most: half as much again as 0.0045 px times the noise per contrast, and the square root of the blur, beside the
    # default's.
    [
        (Optics(blur_px=2), 0.012),
        (Optics(noise_grey=8), 0.027),
        (Optics(noise_grey=20), 0.07),
        (Optics(dark=100, light=164), 0.021),
        (Optics(dark=100, light=164, noise_grey=8), 0.09),
        (Optics(exposure=0.5), 0.014),
        (Optics(exposure=1.3), 0.01),
        (Optics(gradient=1.0), 0.01),
        (Optics(defocus_px=3), 0.013),
        (Optics(motion_px=4, motion_deg=30), 0.013),
        (Optics(blur_px=0), 0.01),
    ],
)
def test_other_optics(pentagon, optics, most):
    error, _, found, wrong = errors(pentagon, range(0, 400, 29), optics)
    assert found == 1
    assert wrong == 0
    assert rms(error) < most


@pytest.mark.parametrize("background", ["clutter", "photo", 20.0, 120.0])
def test_whatever_is_behind_the_plate(pentagon, background):
    def scenery(rng):
        return Scenery(BACKGROUNDS[background](PAPER_CAMERA, rng) if isinstance(background, str) else background)

    error, _, found, wrong = errors(pentagon, range(0, 400, 29), scenery=scenery)
    assert found == 1
    assert wrong == 0
    assert rms(error) < 0.008


def test_things_before_the_marker_hide_dots_but_do_not_move_them(pentagon):
    def scenery(rng):
        return Scenery(occluders=scattered(0.15, PAPER_CAMERA, rng))

    error, square, found, _ = errors(pentagon, range(0, 400, 19), scenery=scenery)
    assert 0.5 < found < 1
    assert rms(error) < 0.01
    assert square.max() < 40


def test_more_bits_give_the_same_dots(pentagon):
    image = view(pentagon, 90)
    eight, sixteen = detect_dots(image), detect_dots(image.astype(np.uint16) * 257)
    order = [np.argmin(np.linalg.norm(sixteen.center - center, axis=-1)) for center in eight.center]
    # The fit does not depend on the unit of the grey levels, but for where it starts and its last step of 1e-3 px.
    np.testing.assert_allclose(eight.center, sixteen.center[order], rtol=0, atol=2e-3)
    np.testing.assert_array_equal(eight.ring, sixteen.ring[order])
    np.testing.assert_allclose(eight.covariance, sixteen.covariance[order], rtol=0.1, atol=1e-7)


def test_uneven_light_is_no_hindrance(pentagon):
    image = view(pentagon, 130)
    shaded = (image * np.linspace(0.3, 1.0, image.shape[1])).astype(np.uint8)
    blobs = detect_dots(shaded)
    assert len(blobs) == 5
    assert blobs.ring.sum() == 1


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (2, 640), (480, 2), (3, 3), (480, 640)])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_flat_images_have_no_dots(shape, level):
    for kind in (np.uint8, np.uint16):
        blobs = detect_dots(np.full(shape, level, kind))
        assert len(blobs) == 0
        assert blobs.center.shape == (0, 2)
        assert blobs.covariance.shape == (0, 2, 2)


@pytest.mark.parametrize("seed", range(3))
def test_noise_has_no_dots(seed):
    rng = np.random.default_rng(seed)
    every = rng.integers(0, 256, (480, 640)).astype(np.uint8)
    faint = (128 + 5 * rng.standard_normal((480, 640))).astype(np.uint8)
    deep = rng.integers(0, 65536, (480, 640)).astype(np.uint16)
    for image in (every, faint, deep):
        found = detect_dots(image)
        assert len(found) <= 2
        assert not found.fitted.any()


def test_dots_cut_off_by_the_edge_are_left_out(pentagon):
    image = view(pentagon, 0)
    center = detect_dots(image).center
    leftmost = int(center[:, 0].min())
    assert len(detect_dots(np.ascontiguousarray(image[:, leftmost:]))) == 4


def test_a_part_of_an_image_need_not_be_contiguous(pentagon):
    image = view(pentagon, 0)
    part = detect_dots(image[4:, 6:])
    np.testing.assert_allclose(
        np.sort(part.center + (6, 4), axis=0), np.sort(detect_dots(image).center, axis=0), atol=1e-6
    )


def test_rectangles_and_letters_are_no_dots(pentagon):
    image = view(pentagon, 130)
    image[20:50, 20:50] = 30
    image[400:470, 30:38] = 30
    image[400:408, 30:90] = 30
    assert detect_dots(image).fitted.sum() == 5


@pytest.mark.parametrize(
    # What is found in coins, page and text is round; the clock's face and the brick wall have nothing to find.
    ("name", "most"),
    [("camera", 3), ("coins", 3), ("page", 6), ("text", 4), ("clock", 0), ("brick", 3), ("moon", 8), ("coffee", 9)],
)
def test_pictures_have_few_dots(name, most):
    from skimage import color, data

    picture = getattr(data, name)()
    if picture.ndim == 3:
        picture = np.rint(255 * color.rgb2gray(picture)).astype(np.uint8)
    assert len(fitted(picture)) <= most


def test_too_large_an_image_is_refused():
    # One row, many times: no memory is needed.
    image = np.broadcast_to(np.zeros(30_000, np.uint8), (30_000, 30_000))
    with pytest.raises(InputError, match="megapixels, found 30000x30000 px; reduce its size"):
        detect_dots(image)


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4)), np.zeros(9, np.uint8), np.zeros((4, 4), np.int64)]
)
def test_other_images_are_refused(image):
    with pytest.raises(InputError, match="uint8 or uint16"):
        detect_dots(image)


LENSES = {
    "radtan": replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.3, 0.1, 0.001, -0.0005))),
    "fisheye": replace(PAPER_CAMERA, fx=400.0, fy=390.0, distortion=Distortion("equidistant", (-0.02, 0.005, 0, 0))),
}
CENTER = np.array([[320.0, 240.0], [60.3, 50.2], [590.1, 430.7], [100.5, 400.5], [500.0, 100.0]])
SEMI = np.array([[20.0, 20.0], [24.0, 10.0], [12.0, 8.0], [3.0, 2.0], [25.0, 24.0]])
ANGLE = np.array([0.0, 0.5, -1.0, 1.3, 0.2])
BLOBS = plain_blobs(CENTER, SEMI, ANGLE, np.arange(5) == 2, np.broadcast_to(1e-4 * np.eye(2), (5, 2, 2)))


def test_without_distortion_it_is_linear():
    camera = replace(PAPER_CAMERA, fy=700.0)
    found = undo_lens(BLOBS, camera)
    np.testing.assert_allclose(camera.to_pixels(found.center), CENTER, rtol=0, atol=1e-9)
    turn = turn_z(ANGLE)[:, :2, :2]
    shape = (turn * SEMI[:, None] ** 2) @ turn.swapaxes(1, 2)
    np.testing.assert_allclose(found.shape * np.outer(camera.focal, camera.focal), shape, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.ring, BLOBS.ring)


@pytest.mark.parametrize("lens", LENSES)
def test_an_ellipse_seen_through_a_lens_comes_back(lens):
    """Outlines of true ellipses through the lens, fitted by an ellipse as the image's fit does, and undone."""
    camera = LENSES[lens]
    truth = undo_lens(BLOBS, camera.ideal)
    circle = 2 * np.pi * np.arange(720) / 720
    values, vectors = np.linalg.eigh(truth.shape)
    rim = truth.center[:, None] + np.einsum(
        "bij,sj->bsi", vectors * np.sqrt(values)[:, None], np.stack([np.cos(circle), np.sin(circle)], axis=-1)
    )
    fitted = [_fit(points) for points in camera.to_pixels(rim)]
    seen = plain_blobs(*(np.array([fit[k] for fit in fitted]) for k in range(3)), BLOBS.ring, BLOBS.covariance)
    found = undo_lens(seen, camera)
    # Dots of up to 50 px: the asymmetry of third order that the ellipse in the image cannot have is what is left.
    centers = camera.to_pixels(found.center), camera.to_pixels(truth.center)
    np.testing.assert_allclose(*centers, rtol=0, atol=5e-3)
    np.testing.assert_allclose(found.shape, truth.shape, rtol=0.01, atol=1e-3 * truth.shape.max())
    # The mere center sent back through the lens is farther off.
    assert np.abs(800 * (camera.from_pixels(seen.center) - truth.center)).max() > 0.05


def _fit(points):
    """Center, semi-axes and angle of the ellipse nearest to points on an outline, by the distance along its normals."""
    from scipy.optimize import least_squares

    def residual(p):
        matrix = np.array([[p[2], p[3]], [p[3], p[4]]])
        mapped = (points - p[:2]) @ matrix
        rho = np.linalg.norm(mapped, axis=-1)
        steep = np.linalg.norm(mapped @ matrix / rho[:, None], axis=-1)
        return (rho - 1) / steep * np.sqrt(arc)

    arc = np.linalg.norm(np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0), axis=-1)
    center = points.mean(axis=0)
    values, vectors = np.linalg.eigh(2 * np.cov((points - center).T))
    start = (vectors / np.sqrt(values)) @ vectors.T
    p = least_squares(residual, [*center, start[0, 0], start[0, 1], start[1, 1]], xtol=1e-14, ftol=1e-14).x
    values, vectors = np.linalg.eigh(np.array([[p[2], p[3]], [p[3], p[4]]]))
    return p[:2], 1 / values, np.arctan2(vectors[1, 0], vectors[0, 0])


def test_blobs_that_no_ray_reaches_are_left_out():
    # Of this lens the image ends at 400 * 0.77 px from the center.
    camera = replace(PAPER_CAMERA, fx=400.0, fy=400.0, distortion=Distortion("radtan", (-0.25, 0.0, 0.0, 0.0)))
    far = plain_blobs(
        np.array([[320.0, 240.0], [636.0, 470.0]]),
        *(getattr(BLOBS, f)[:2] for f in ("semi", "angle", "ring")),
        BLOBS.covariance[:2],
    )
    np.testing.assert_array_equal(undo_lens(far, camera).index, [0])


def test_no_blobs():
    none = plain_blobs(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), np.zeros((0, 2, 2)))
    for camera in (PAPER_CAMERA, LENSES["radtan"]):
        assert len(undo_lens(none, camera)) == 0
