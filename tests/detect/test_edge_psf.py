import cv2
import numpy as np
import pytest
from scipy.special import ndtr

from markergen.detect.edge_psf import BOXED, blurred_ellipse, pixel_edge

FINE, SIZE = 12, 41


def shape_of(semi, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = turn @ np.diag(1 / np.array(semi, dtype=float)) @ turn.T
    return matrix[0, 0], matrix[0, 1], matrix[1, 1]


def evaluate(x, y, shape, blur):
    return blurred_ellipse(x, y, tuple(np.full(x.shape, m) for m in shape), np.full(x.shape, blur))


@pytest.mark.parametrize(
    ("semi", "blur", "most"),
    # RMS over the band, as a share of the contrast: better than 0.001 for large dots, 0.01 for b = 2 s.
    [((12, 12), 0.7, 1e-3), ((12, 9), 1.5, 2e-3), ((8, 2.5), 0.7, 6e-3), ((6, 1.5), 0.7, 0.015), ((16, 2), 0.7, 8e-3)],
)
def test_is_the_blurred_ellipse(semi, blur, most):
    angle = 0.5
    y, x = (np.indices((FINE * SIZE, FINE * SIZE)) + 0.5) / FINE - 0.5 - SIZE // 2
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    ink = ((u / semi[0]) ** 2 + (v / semi[1]) ** 2 < 1).astype(float)
    seen = cv2.resize(cv2.GaussianBlur(ink, (0, 0), blur * FINE), (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    y, x = np.indices((SIZE, SIZE)) - float(SIZE // 2)
    model, by_rho, *_ = evaluate(x.ravel(), y.ravel(), shape_of(semi, angle), np.hypot(blur, np.sqrt(1 / 12)))
    band = np.abs(by_rho) > 1e-3 * np.abs(by_rho).max()
    assert np.sqrt(np.mean((model - seen.ravel())[band] ** 2)) < most


@pytest.mark.parametrize("blur", [0.4, 0.9])
def test_derivatives(blur):
    rng = np.random.default_rng(0)
    shape = shape_of((14, 11), 0.4)
    angle = rng.uniform(0, 2 * np.pi, 60)
    x, y = 14 * np.cos(angle) + rng.normal(0, 1, 60), 11 * np.sin(angle) + rng.normal(0, 1, 60)
    _, by_rho, by_blur, direction, _ = evaluate(x, y, shape, blur)
    matrix = np.array([[shape[0], shape[1]], [shape[1], shape[2]]])
    step = 1e-5
    along_x = (evaluate(x + step, y, shape, blur)[0] - evaluate(x - step, y, shape, blur)[0]) / (2 * step)
    along_blur = (evaluate(x, y, shape, blur + step)[0] - evaluate(x, y, shape, blur - step)[0]) / (2 * step)
    # The change of |grad rho| over the band and of the curvature are left out of the derivatives: some percent.
    np.testing.assert_allclose(by_rho * (matrix @ direction)[0], along_x, rtol=0, atol=0.05 * np.abs(along_x).max())
    np.testing.assert_allclose(by_blur, along_blur, rtol=0, atol=0.05 * np.abs(along_blur).max())


@pytest.mark.parametrize("semi", [(10, 10), (10, 2)])
def test_the_center_itself_is_all_ink(semi):
    ink, by_rho, by_blur, *_ = evaluate(np.zeros(1), np.zeros(1), shape_of(semi, 0.3), 0.5)
    # Four blurs from the nearest edge.
    assert ink[0] > 0.999
    assert np.isfinite([by_rho[0], by_blur[0]]).all()


@pytest.mark.parametrize("angle", [0.0, 0.2, np.pi / 4, 1.3])
@pytest.mark.parametrize("lens", [0.1, 0.3, 0.5])
def test_square_pixels_see_an_edge(angle, lens):
    depth = np.linspace(-2, 2, 41)
    normal = np.full(41, np.cos(angle)), np.full(41, np.sin(angle))
    ink, slope, by_square = pixel_edge(depth, normal, np.full(41, np.sqrt(lens**2 + 1 / 12)))
    # The mean of the blurred edge over 200 x 200 places of a pixel.
    places = (np.arange(200) + 0.5) / 200 - 0.5
    across = (np.cos(angle) * places[:, None] + np.sin(angle) * places).ravel()
    t = (depth[:, None] + across) / lens
    bell = np.exp(-0.5 * t**2) / np.sqrt(2 * np.pi)
    # The midpoint rule is good to 1e-4 of all; a pixel is at least 0.02 px wide along the normal.
    np.testing.assert_allclose(ink, ndtr(t).mean(axis=1), rtol=0, atol=2e-4)
    np.testing.assert_allclose(slope, bell.mean(axis=1) / lens, rtol=0, atol=2e-3)
    np.testing.assert_allclose(by_square, (-0.5 * t * bell).mean(axis=1) / lens**2, rtol=0, atol=1e-2)


def test_without_a_lens_an_edge_is_the_area_of_squares():
    depth = np.linspace(-1, 1, 21)
    ink, _, _ = pixel_edge(depth, (np.ones(21), np.zeros(21)), np.full(21, 0.28))
    # The least lens, 0.05 px, rounds the ramp's corners by 0.4 of it.
    np.testing.assert_allclose(ink, np.clip(0.5 + depth, 0, 1), rtol=0, atol=0.021)


def test_the_models_meet_where_the_square_no_longer_shows():
    x = np.linspace(8, 12, 41)
    y = np.linspace(-3, 3, 41)
    below, above = (evaluate(x, y, shape_of((10, 9), 0.4), BOXED + step) for step in (-1e-9, 1e-9))
    np.testing.assert_allclose(below[0], above[0], rtol=0, atol=1.3e-3)


def test_the_tips_may_be_held_while_the_ellipse_moves_little():
    y, x = np.indices((9, 40)).reshape(2, -1) - np.array([[4.0], [20.0]])
    blur = np.full(x.size, 0.8)
    near, true = (tuple(np.full(x.size, m) for m in shape_of(semi, 0.1)) for semi in ((15.02, 2.48), (15, 2.5)))
    fresh, *_, exact = blurred_ellipse(x, y, true, blur)
    *_, tips = blurred_ellipse(x - 0.02, y + 0.02, near, blur)
    held, *_, same = blurred_ellipse(x, y, true, blur, tips)
    np.testing.assert_array_equal(same, tips)
    # After a move of 0.02 px, as the last steps make, they are off by a tenth at most.
    assert np.abs(exact).max() > 0.05
    assert np.sqrt(np.mean((held - fresh) ** 2)) < 0.1 * np.sqrt(np.mean(exact**2))
