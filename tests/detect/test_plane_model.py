import numpy as np
import pytest

from markergen.detect.plane_model import BLUR, UNKNOWNS, PredictedDot, grey_levels, surroundings
from markergen.maths.projection import plane_homography
from markergen.model.camera import PAPER_CAMERA, Distortion
from markergen.model.poses import paper
from markergen.render import Optics, render_view

POSES = paper()
STATE = np.array([0.01, -0.02, 0.005, 0.6, 0.05, 0.5, 225, 30, 0.002, -0.003])


def dot_of(marker, i, pose, start=(0.0, 0.0)):
    point = marker.control_points[i]
    homography = plane_homography(POSES.rotation[[pose]], POSES.translation[[pose]], np.eye(3))[0]
    radius = point.feature.diameter / 2
    plane = homography @ np.array([[radius, 0, point.x], [0, radius, point.y], [0, 0, 1]])
    return PredictedDot(plane, np.array(start), point.feature.inner_diameter / point.feature.diameter, np.zeros((0, 3)))


@pytest.fixture(scope="module")
def blank():
    return np.zeros((480, 640), np.uint8)


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("pose", [30, 230])
@pytest.mark.parametrize("sharper", [0.0, 0.35])
def test_derivatives(pentagon, blank, i, pose, sharper):
    state = STATE - sharper * np.isin(np.arange(UNKNOWNS), [3, 5])
    pixels = surroundings(blank, PAPER_CAMERA, [dot_of(pentagon, i, pose)], np.array([0.8]))
    _, jacobian, _ = grey_levels(state[None], pixels)
    for k in range(UNKNOWNS):
        h = 1e-5 * max(abs(state[k]), 0.1) * np.eye(UNKNOWNS)[k]
        high, low = (grey_levels((state + sign * h)[None], pixels)[0] for sign in (1, -1))
        numeric = (high - low) / (2 * h[k])
        # How gradient, perspective and retreat change with place and blur is left out on purpose: a few percent.
        share = 0.15 if k in range(*BLUR.indices(UNKNOWNS)) else 0.02
        assert np.linalg.norm(jacobian[k] - numeric) < share * np.linalg.norm(numeric)


@pytest.mark.parametrize("pose", [5, 130, 230])
def test_model_is_what_the_renderer_draws(pentagon, pose):
    """Two ways to the same picture: areas of ellipses, blurred, and edges in the plane."""
    image = render_view(
        pentagon,
        PAPER_CAMERA,
        POSES.rotation[pose],
        POSES.translation[pose],
        Optics(noise_grey=0),
        np.random.default_rng(0),
    )
    blur = 0.7**2 + 1 / 12
    state = np.array([0, 0, 0, blur, 0, blur, 225, 30, 0, 0])
    for i in (0, 2):
        pixels = surroundings(image, PAPER_CAMERA, [dot_of(pentagon, i, pose)], np.array([0.8]))
        residual = pixels.grey - grey_levels(state[None], pixels)[0]
        # Rounding is 0.3; at the tips of tilted ellipses the blur of a strongly curved edge is not exact.
        assert np.sqrt(np.mean(residual**2)) < 1.0
        assert np.abs(residual).max() < 6


def test_rays_come_back_to_the_plane(pentagon, blank):
    camera = PAPER_CAMERA.__class__(640, 480, 800, 790, 330, 235, Distortion("radtan", (-0.28, 0.09, 0.001, -0.0007)))
    dot = dot_of(pentagon, 3, 230, (0.1, -0.1))
    pixels = surroundings(blank, camera, [dot], np.array([0.8]))
    for k in range(0, pixels.grey.size, 37):
        there, derivative = dot.image(camera, pixels.place[:, k])
        # Undistortion is iterated to 1e-9 px and better.
        np.testing.assert_allclose(there, pixels.pixel[:, k], atol=1e-6)
        np.testing.assert_allclose(derivative @ pixels.jacobian[..., k], np.eye(2), atol=1e-9)


def test_pixels_near_other_dots_are_left_out(pentagon, blank):
    dot = dot_of(pentagon, 1, 30)
    near = PredictedDot(dot.plane, dot.start, 0.0, np.array([[2.1, 0, 1.0]]))
    alone, beside = (surroundings(blank, PAPER_CAMERA, [each], np.array([0.8])) for each in (dot, near))
    assert beside.grey.size < alone.grey.size
    assert np.hypot(beside.place[0] - 2.1, beside.place[1]).min() > 1.05


def test_dots_keep_to_their_parts(pentagon, blank):
    dots = [dot_of(pentagon, i, 130) for i in range(5)]
    pixels = surroundings(blank, PAPER_CAMERA, dots, np.full(5, 0.8))
    assert [part.stop for part in pixels.parts[:-1]] == [part.start for part in pixels.parts[1:]]
    assert pixels.parts[-1].stop == pixels.grey.size
    for i, part in enumerate(pixels.parts):
        assert (pixels.dot[part] == i).all()
        own = surroundings(blank, PAPER_CAMERA, [dots[i]], np.array([0.8]))
        np.testing.assert_array_equal(own.pixel, pixels.pixel[:, part])


def test_a_dot_outside_the_image_has_no_pixels(pentagon):
    pixels = surroundings(np.zeros((20, 20), np.uint8), PAPER_CAMERA, [dot_of(pentagon, 1, 30)], np.array([0.8]))
    assert pixels.grey.size == 0
