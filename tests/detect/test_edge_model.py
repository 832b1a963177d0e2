import cv2
import numpy as np
import pytest

from markergen.detect.edge_model import blurred_ellipse

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
    model, by_rho, _, _ = evaluate(x.ravel(), y.ravel(), shape_of(semi, angle), np.hypot(blur, np.sqrt(1 / 12)))
    band = np.abs(by_rho) > 1e-3 * np.abs(by_rho).max()
    assert np.sqrt(np.mean((model - seen.ravel())[band] ** 2)) < most


def test_derivatives():
    rng = np.random.default_rng(0)
    shape, blur = shape_of((14, 11), 0.4), 0.9
    angle = rng.uniform(0, 2 * np.pi, 60)
    x, y = 14 * np.cos(angle) + rng.normal(0, 1, 60), 11 * np.sin(angle) + rng.normal(0, 1, 60)
    _, by_rho, by_blur, direction = evaluate(x, y, shape, blur)
    matrix = np.array([[shape[0], shape[1]], [shape[1], shape[2]]])
    step = 1e-5
    along_x = (evaluate(x + step, y, shape, blur)[0] - evaluate(x - step, y, shape, blur)[0]) / (2 * step)
    along_blur = (evaluate(x, y, shape, blur + step)[0] - evaluate(x, y, shape, blur - step)[0]) / (2 * step)
    # The change of |grad rho| over the band and of the curvature are left out of the derivatives: some percent.
    np.testing.assert_allclose(by_rho * (matrix @ direction)[0], along_x, rtol=0, atol=0.05 * np.abs(along_x).max())
    np.testing.assert_allclose(by_blur, along_blur, rtol=0, atol=0.05 * np.abs(along_blur).max())


@pytest.mark.parametrize("semi", [(10, 10), (10, 2)])
def test_the_center_itself_is_all_ink(semi):
    ink, by_rho, by_blur, _ = evaluate(np.zeros(1), np.zeros(1), shape_of(semi, 0.3), 0.5)
    # Four blurs from the nearest edge.
    assert ink[0] > 0.999
    assert np.isfinite([by_rho[0], by_blur[0]]).all()
