import numpy as np
import pytest

from markergen.detect.photometric import align_dots
from markergen.detect.plane_model import PredictedDot
from markergen.maths.projection import plane_homography
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.render import Optics, render_view

POSES = paper()


def view(marker, pose, optics=None):
    """Image, dots that start at the truth, true pixels."""
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    image = render_view(
        marker, PAPER_CAMERA, rotation, translation, optics or Optics(), np.random.default_rng([2, pose])
    )
    homography = plane_homography(rotation[None], translation[None], np.eye(3))[0]
    dots = []
    for point in marker.control_points:
        radius = point.feature.diameter / 2
        plane = homography @ np.array([[radius, 0, point.x], [0, radius, point.y], [0, 0, 1]])
        hole = point.feature.inner_diameter / point.feature.diameter
        dots.append(PredictedDot(plane, np.zeros(2), hole, np.zeros((0, 3))))
    return image, dots, PAPER_CAMERA.project(marker.xyz, rotation[None], translation[None])[0]


def moved(dots, by):
    return [PredictedDot(dot.plane, dot.start + by, dot.hole, dot.neighbors) for dot in dots]


@pytest.mark.parametrize("pose", [30, 230, 390])
def test_the_start_does_not_matter(pentagon, pose):
    image, dots, truth = view(pentagon, pose)
    first = align_dots(image, PAPER_CAMERA, dots)
    assert first.good.all()
    # Some 0.03 px: five standard deviations of the smallest dot.
    assert np.abs(first.pixels - truth).max() < 0.03
    second = align_dots(image, PAPER_CAMERA, moved(dots, [0.02, -0.03]))
    # The step that ends the iteration.
    np.testing.assert_allclose(second.pixels, first.pixels, atol=1e-3)
    # Another start gathers a few other pixels, of 2000 that tell the noise.
    np.testing.assert_allclose(*(np.trace(each.covariance, axis1=1, axis2=2) for each in (second, first)), rtol=0.1)


def test_a_start_far_off_is_no_good(pentagon):
    image, dots, _ = view(pentagon, 30)
    assert not align_dots(image, PAPER_CAMERA, moved(dots, [0.2, 0])).good.any()


def test_dots_are_aligned_each_by_itself(pentagon):
    image, dots, _ = view(pentagon, 130)
    together = align_dots(image, PAPER_CAMERA, dots)
    for i, dot in enumerate(dots):
        alone = align_dots(image, PAPER_CAMERA, [dot])
        # Only the noise, and where the iteration ends, are common.
        np.testing.assert_allclose(alone.pixels[0], together.pixels[i], atol=1e-3)


def test_covariance_follows_the_noise(pentagon):
    quiet, loud = (
        align_dots(image, PAPER_CAMERA, dots)
        for image, dots, _ in (view(pentagon, 130, Optics(noise_grey=noise)) for noise in (2, 8))
    )
    # (64 + 1/12)/(4 + 1/12) in variance; four standard errors of two estimates from 2000 pixels each.
    ratio = np.trace(loud.covariance, axis1=1, axis2=2) / np.trace(quiet.covariance, axis1=1, axis2=2)
    np.testing.assert_allclose(ratio, 15.7, rtol=0.2)


def test_blur_wider_than_expected(pentagon):
    for optics in (Optics(2.0), Optics(defocus_px=4)):
        image, dots, truth = view(pentagon, 30, optics)
        aligned = align_dots(image, PAPER_CAMERA, dots)
        assert aligned.good.all()
        assert np.abs(aligned.pixels - truth).max() < 0.03


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_blank_image_has_no_dots(pentagon, level):
    _, dots, _ = view(pentagon, 130)
    aligned = align_dots(np.full((480, 640), level, np.uint8), PAPER_CAMERA, dots)
    assert not aligned.good.any()
    assert np.isnan(aligned.pixels).all()


def test_an_image_too_small_for_the_dots(pentagon):
    _, dots, _ = view(pentagon, 130)
    assert not align_dots(np.zeros((1, 1), np.uint8), PAPER_CAMERA, dots).good.any()
