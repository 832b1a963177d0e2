import cv2
import numpy as np
import pytest
from ellipse_coverage import ellipse_coverage
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import i1e

from markergen.maths.dot_crlb import (
    center_covariance,
    center_information,
    directions,
    displaced_center,
    dot_covariance,
    linearize,
)

BLUR, CONTRAST, NOISE = 0.7, 195.0, 2.0
EDGE, RATIO = np.hypot(BLUR, 12**-0.5), CONTRAST / NOISE


def affine(semi, angle, rotation=0.3):
    """A with these semi-axes, the first along the angle; the circle may be turned before, which changes nothing."""
    return _turn(angle) @ np.diag(semi) @ _turn(rotation)


def _turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def relative(result, expected):
    """Extreme relative differences of two covariances along any direction."""
    root = np.linalg.inv(np.linalg.cholesky(expected))
    return np.linalg.eigvalsh(root @ result @ root.T) - 1


def test_the_dot_that_everybody_can_reckon():
    # Straight edges: (contrast/noise)^2 pi r / (2 sqrt(pi) s); the curvature adds 3/4 s^2/r^2, here 0.4 %.
    wide = np.sqrt(2 * np.sqrt(np.pi) * EDGE / (np.pi * 10)) / RATIO
    result = np.sqrt(np.diag(center_covariance(10 * np.eye(2), EDGE, RATIO)))
    assert wide == pytest.approx(0.003, rel=0.01)
    np.testing.assert_allclose(result, wide, rtol=0.003)


@pytest.mark.parametrize(
    ("semi", "angle"),
    [((12, 12), 0), ((2, 2), 0), ((3, 3), 0), ((6, 2), 0.4), ((9, 3), 1.2), ((24, 8), 0.1), ((5, 3), 2.0)],
)
def test_an_image_of_a_dot_tells_as_much_as_the_formula_says(semi, angle):
    # Fisher information of the grey levels of a rendered dot with eight unknowns: center, shape, levels, blur. Blurring
    # by pixels that are squares, not Gaussians, and sampling are what is left: 2 % of variance, 1 % of sigma.
    expected = _image_covariance(np.array(semi, dtype=float), angle)
    assert np.abs(relative(center_covariance(affine(semi, angle), EDGE, RATIO), expected)).max() < 0.02


def _image_covariance(semi, angle, fine=12):
    center = np.ceil(semi.max()) + 5 + np.array([0.21, -0.34])
    root = _turn(angle) @ np.diag(semi) @ _turn(angle).T

    def image(x):
        values, vectors = np.linalg.eigh(root + np.array([[x[2], x[3]], [x[3], x[4]]]))
        size = int(2 * np.ceil(semi.max()) + 11) * fine
        subpixel = (center + x[:2] + 0.5) * fine - 0.5
        tile, top, left = ellipse_coverage(
            subpixel, values[::-1] * fine, float(np.arctan2(vectors[1, 1], vectors[0, 1])), size, size
        )
        ink = np.zeros((size, size))
        ink[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
        ink = cv2.GaussianBlur(ink, (0, 0), (BLUR + x[5]) * fine, borderType=cv2.BORDER_REPLICATE)
        ink = ink.reshape(size // fine, fine, size // fine, fine).mean(axis=(1, 3))
        return ((225 + x[6]) * (1 - ink) + (30 + x[7]) * ink).ravel()

    steps = np.diag([0.02] * 5 + [0.01] + [1.0] * 2)
    jacobian = np.stack([(image(s) - image(-s)) / (2 * s.sum()) for s in steps], axis=-1)
    return NOISE**2 * np.linalg.inv(jacobian.T @ jacobian)[:2, :2]


@pytest.mark.parametrize("thin", [1.0, 0.6, 0.34])
@pytest.mark.parametrize("radius", [1.0, 2.0, 5.0, 20.0])
def test_few_directions_are_enough(radius, thin):
    # Against the Bessel function itself and very many directions.
    shape = affine((radius / thin, radius), 0.7)
    angle = 2 * np.pi * np.arange(2000) / 2000
    k = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    z = np.sum((k @ shape) ** 2, axis=-1) / (2 * EDGE**2)
    exact = (RATIO * np.linalg.det(shape)) ** 2 / (4 * EDGE**4)
    exact = exact * (k * (i1e(z) / z)[:, None]).T @ k * (2 * np.pi / 2000)
    # The closed form of the Bessel function is good to 1.6 % for half-widths of 1.3 s and to 0.2 % above 2.6 s.
    assert np.abs(relative(center_information(shape, EDGE, RATIO), exact)).max() < (0.016 if radius < 2 else 0.002)


sizes = st.floats(0.8, 30.0)
angles = st.floats(-3.2, 3.2)


@given(sizes, st.floats(0.34, 1.0), angles, angles)
def test_it_turns_with_the_dot_and_forgets_how_the_circle_was_turned(radius, thin, angle, turn):
    upright = center_covariance(affine((radius, radius * thin), 0.0, 0.0), EDGE, RATIO)
    rotated = center_covariance(affine((radius, radius * thin), angle, turn), EDGE, RATIO)
    back = _turn(angle).T @ rotated @ _turn(angle)
    # As good as the integral over the directions.
    np.testing.assert_allclose(back, upright, rtol=1e-3, atol=1e-3 * upright.max())
    # Seen obliquely the short axis is better known: the long sides of the outline tell about it.
    assert upright[1, 1] <= upright[0, 0] * (1 + 1e-3)


def test_it_is_proportional_to_the_noise_and_falls_with_the_size():
    shapes = np.array([1, 2, 4, 8])[:, None, None] * affine((1.0, 0.5), 0.3)
    spread = center_covariance(shapes, EDGE, RATIO)
    np.testing.assert_allclose(center_covariance(shapes, EDGE, RATIO / 3), 9 * spread, rtol=1e-12)
    assert np.all(np.diff(np.trace(spread, axis1=-2, axis2=-1)) < 0)
    assert spread.shape == (4, 2, 2)


def test_the_pullback_agrees_with_differences():
    rng = np.random.default_rng(0)
    shapes = affine((4.0, 2.0), 0.5) + rng.normal(scale=0.5, size=(3, 5, 2, 2))
    nodes = directions(shapes[:, 0])
    cotangent = rng.normal(size=shapes.shape)
    cotangent = cotangent + cotangent.swapaxes(-1, -2)
    along = rng.normal(size=shapes.shape)
    value = [np.sum(cotangent * linearize(shapes + h * along, EDGE, RATIO, nodes)[0]) for h in (1e-6, -1e-6)]
    gradient = linearize(shapes, EDGE, RATIO, nodes)[1](cotangent)
    # Central differences over 1e-6 of values near 1e5 leave eight digits.
    assert np.sum(gradient * along) == pytest.approx((value[0] - value[1]) / 2e-6, rel=1e-6)


def test_a_dot_seen_edge_on_tells_nothing():
    assert not np.isfinite(center_covariance(np.array([[3.0, 0.0], [0.0, 0.0]]), EDGE, RATIO)).all()


def test_an_ellipse_may_be_given_by_its_axes():
    semi, angle = np.array([[6.0, 2.0], [3.0, 3.0], [np.nan, np.nan]]), np.array([0.4, 0.0, np.nan])
    results = dot_covariance(semi, angle, EDGE, CONTRAST, NOISE)
    np.testing.assert_allclose(results[0], center_covariance(affine((6, 2), 0.4), EDGE, RATIO), rtol=1e-3)
    assert np.isnan(results[2]).all()
    assert results.shape == (3, 2, 2)


def dots_out_of_place(count=6):
    """Information of images from round to 1:20, displacements B that turn and stretch, and symmetric cotangents."""
    rng = np.random.default_rng(4)
    shapes = np.stack([affine((8.0, 8.0 / ratio), angle) for angle, ratio in enumerate(np.linspace(1, 20, count))])
    cotangent = rng.normal(size=shapes.shape)
    displacement = 1e-2 * rng.normal(size=shapes.shape)
    return center_information(shapes, EDGE, RATIO), displacement, cotangent + cotangent.swapaxes(-1, -2)


def test_covariances_of_image_and_displacement_add_up():
    information, displacement, _ = dots_out_of_place()
    expected = np.linalg.inv(np.linalg.inv(information) + displacement @ displacement.swapaxes(-1, -2))
    # Both are rounded; the inverses lose up to three digits on the longest images.
    np.testing.assert_allclose(displaced_center(information, displacement)[0], expected, rtol=1e-10)
    np.testing.assert_array_equal(displaced_center(information, 0 * displacement)[0], information)


def test_a_dot_seen_edge_on_tells_nothing_across():
    # F is singular, and so is what remains of it: along x the variances 1/4 and 0.01 add up.
    result = displaced_center(np.diag([4.0, 0.0]), np.diag([0.1, 0.3]))[0]
    np.testing.assert_allclose(result, np.diag([1 / 0.26, 0.0]), rtol=1e-15)


def test_displacement_is_pulled_back_as_differences_say():
    information, displacement, cotangent = dots_out_of_place()
    by_information, by_displacement = displaced_center(information, displacement)[1](cotangent)
    rng = np.random.default_rng(5)
    rotation = rng.normal(size=information.shape)
    # Relative steps of 1e-5: the square of it, and rounding, leave eight digits.
    for step, gradient, moved in (
        (
            1e-5 * information @ (rotation + rotation.swapaxes(-1, -2)) @ information / 1e4,
            by_information,
            "information",
        ),
        (1e-5 * displacement * rotation, by_displacement, "displacement"),
    ):
        ahead, behind = (
            displaced_center(information + sign * step, displacement)[0]
            if moved == "information"
            else displaced_center(information, displacement + sign * step)[0]
            for sign in (1, -1)
        )
        numeric = np.sum(cotangent * (ahead - behind), axis=(-2, -1)) / 2
        np.testing.assert_allclose(np.sum(gradient * step, axis=(-2, -1)), numeric, rtol=1e-6)
