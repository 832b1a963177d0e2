import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.maths.distortion import (
    LARGEST_RADIUS,
    coefficient_jacobian,
    distort,
    distortion_hessian,
    distortion_jacobian,
    domain_radius,
    undistort,
)
from markergen.maths.lenses import LENSES as MODELS

# What calibrations of real lenses look like: a webcam, a wide lens with and without k3, one whose polynomial turns
# over soon, a telephoto lens, two rational fits, a fisheye, and one that turns over.
LENSES = {
    "none": ("none", ()),
    "webcam": ("radtan", (0.12, -0.25, 1e-3, -2e-3, 0.11)),
    "wide": ("radtan", (-0.283, 0.074, 1.9e-4, 1.8e-5)),
    "wide-k3": ("radtan", (-0.35, 0.16, -8e-4, 3e-4, -0.04)),
    "barrel": ("radtan", (-0.4, 0.0, 0.0, 0.0)),
    "telephoto": ("radtan", (0.8, -40.0, 1e-3, 5e-4, 2500.0)),
    "rational": ("rational", (0.52, -2.53, 4.7e-4, -2e-4, 1.48, 0.40, -2.35, 1.41)),
    "rational-turning": ("rational", (0.5, -0.3, 1e-3, 2e-4, 0.01, 0.8, -0.2, 0.03)),
    "fisheye": ("equidistant", (0.0035, 0.0007, -0.002, 0.0002)),
    "turning": ("equidistant", (-0.3, 0.0, 0.0, 0.0)),
}
FOCAL = 800.0


@pytest.fixture(params=LENSES)
def lens(request):
    return LENSES[request.param]


def inside(lens, count=400, share=0.98):
    """Points (count, 2) all over the domain, or as far out as the lens sees."""
    rng = np.random.default_rng(0)
    sees = 0.2 if lens == LENSES["telephoto"] else 1.5
    radius = min(domain_radius(*lens), sees) * share * np.sqrt(rng.random(count))
    angle = rng.uniform(0, 2 * np.pi, count)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def test_as_opencv_has_it(lens):
    import cv2

    model, coefficients = lens
    points = inside(lens)
    matrix = np.diag([FOCAL, FOCAL, 1.0])
    if model == "equidistant":
        expected = cv2.fisheye.distortPoints(points[:, None], matrix, np.array(coefficients))
    else:
        flat = np.column_stack([points, np.ones(len(points))])
        expected, _ = cv2.projectPoints(flat, np.zeros(3), np.zeros(3), matrix, np.array(coefficients or [0.0] * 4))
    # Rounding: some 1e-16 of coordinates up to 1000 px, a few operations long.
    np.testing.assert_allclose(FOCAL * distort(model, points, coefficients), expected[:, 0], atol=1e-9)


def test_derivatives_against_differences(lens):
    model, coefficients = lens
    points, step = inside(lens, share=0.9), 1e-6
    numeric = np.stack(
        [
            (distort(model, points + step * e, coefficients) - distort(model, points - step * e, coefficients))
            / (2 * step)
            for e in np.eye(2)
        ],
        axis=-1,
    )
    # Central differences: 1e-12 of the third derivative, and 1e-16/1e-6 of rounding; third derivatives are up to 1e4.
    np.testing.assert_allclose(distortion_jacobian(model, points, coefficients), numeric, atol=1e-7)
    analytic = coefficient_jacobian(model, points, coefficients)
    assert analytic.shape == (len(points), 2, len(coefficients))
    for i in range(len(coefficients)):
        ahead, behind = ([c + s * (j == i) for j, c in enumerate(coefficients)] for s in (step, -step))
        slope = (distort(model, points, tuple(ahead)) - distort(model, points, tuple(behind))) / (2 * step)
        np.testing.assert_allclose(analytic[..., i], slope, atol=1e-8)


def test_second_derivatives_against_differences(lens):
    model, coefficients = lens
    points, step = inside(lens, share=0.9), 1e-6
    ahead, behind = (
        [distortion_jacobian(model, points + s * e, coefficients) for e in np.eye(2)] for s in (step, -step)
    )
    numeric = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2 * step)
    # Central differences: 1e-12 of a fourth derivative of up to 1e4, and 1e-16/1e-6 of rounding.
    hessian = distortion_hessian(model, points, coefficients)
    np.testing.assert_allclose(hessian, numeric, atol=1e-7)
    for order in ((0, 2, 1, 3), (0, 1, 3, 2), (0, 3, 2, 1)):
        np.testing.assert_array_equal(hessian, hessian.transpose(order))


def test_undistort_undoes_distort(lens):
    model, coefficients = lens
    points = inside(lens, share=0.95)
    again = undistort(model, distort(model, points, coefficients), coefficients)
    # The residual is 1e-13; the smallest eigenvalue of the Jacobian at 0.95 of the domain is 0.05 and more.
    np.testing.assert_allclose(again, points, atol=1e-11)


def test_at_the_center_and_far_outside():
    for model, coefficients in LENSES.values():
        center = np.zeros((1, 2))
        np.testing.assert_array_equal(distort(model, center, coefficients), center)
        np.testing.assert_allclose(distortion_jacobian(model, center, coefficients)[0], np.eye(2), atol=1e-15)
        np.testing.assert_array_equal(undistort(model, center, coefficients), center)
        # d'' of a center-symmetric lens is odd; what is left there is the tangential terms, 6 p2 and so on.
        p1, p2 = (0.0, 0.0) if model in ("none", "equidistant") else coefficients[2:4]
        np.testing.assert_array_equal(
            distortion_hessian(model, center, coefficients)[0],
            [[[6 * p2, 2 * p1], [2 * p1, 2 * p2]], [[2 * p1, 2 * p2], [2 * p2, 6 * p1]]],
        )
        # Its series at the center meets its formula at 1e-6, where rounding is 1e-16/1e-6.
        beside = distortion_hessian(model, np.array([[0.999e-6, 0], [1.001e-6, 0]]), coefficients)
        np.testing.assert_allclose(beside[0], beside[1], atol=2e-8)
        # The fisheye's series at the center meets its formula at 1e-6; the tangential terms are 3 * 0.002 r.
        near = np.array([[0.999e-6, 0], [1.001e-6, 0], [1e-160, 0]])
        np.testing.assert_allclose(distort(model, near, coefficients), near, rtol=1e-8, atol=3e-15)
        if model != "none":
            for far in (1e7, 1e200, np.inf, np.nan):
                assert np.isnan(distort(model, np.array([far, 1.0]), coefficients)).all()
                assert np.isnan(distortion_jacobian(model, np.array([far, 1.0]), coefficients)).all()
                assert np.isnan(distortion_hessian(model, np.array([far, 1.0]), coefficients)).all()
                assert np.isnan(coefficient_jacobian(model, np.array([far, 1.0]), coefficients)).all()
                assert np.isnan(undistort(model, np.array([[1.0, far]]), coefficients)).all() or far == 1e7


@pytest.mark.parametrize(
    ("model", "coefficients", "radius"),
    [
        ("radtan", (-0.4, 0.0, 0.0, 0.0), (1 / 1.2) ** 0.5),  # 1 - 3 * 0.4 r^2 = 0
        ("radtan", (0.3, 0.0, 0.0, 0.0), LARGEST_RADIUS),
        ("radtan", (0.0, 0.0, 0.03, 0.04), 1 / 0.3),  # 1 = 6 |p| r
        ("radtan", (0.0,) * 5, LARGEST_RADIUS),
        ("radtan", (1e-300, 0.0, 0.0, 0.0, 1e-310), LARGEST_RADIUS),
        ("rational", (0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0), 2.0),  # a pole
        ("rational", (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0), 1.0),  # r / (1 + r^2) has its maximum at 1
        ("equidistant", (0.0,) * 4, LARGEST_RADIUS),
        ("equidistant", (-1.0, 0.0, 0.0, 0.0), np.tan((1 / 3) ** 0.5)),  # 1 - 3 a^2 = 0
        ("equidistant", (-0.1, 0.0, 0.0, 0.0), LARGEST_RADIUS),  # it would turn at 105 degrees
        ("none", (), LARGEST_RADIUS),
    ],
)
def test_the_domain_ends_where_the_lens_turns_over(model, coefficients, radius):
    # Roots of polynomials: some 1e-16 times their condition, which is below 1e4 here.
    assert domain_radius(model, coefficients) == pytest.approx(radius, rel=1e-12)


def test_nothing_is_folded_back_into_the_image():
    model, coefficients = LENSES["barrel"]
    limit = domain_radius(model, coefficients)
    r = np.array([0.5, 0.999 * limit, 1.001 * limit, 1.2, 1.58, 3.0])
    after = distort(model, np.stack([r, 0 * r], axis=-1), coefficients)
    np.testing.assert_array_equal(np.isnan(after[:, 0]), [False, False, True, True, True, True])
    # The largest radius that an image has: f(limit). Beyond, no ray comes.
    edge = limit * (1 - 0.4 * limit**2)
    back = undistort(model, np.array([[0.999 * edge, 0], [0, 1.001 * edge], [50, 50]]), coefficients)
    np.testing.assert_array_equal(np.isnan(back[:, 0]), [False, True, True])
    assert 0 < back[0, 0] < limit


@st.composite
def lenses(draw):
    model = draw(st.sampled_from([name for name in MODELS if name != "none"]))
    count = len(draw(st.sampled_from(MODELS[model].coefficients)))
    coefficients = draw(st.lists(st.floats(-1, 1), min_size=count, max_size=count))
    if model != "equidistant":
        coefficients[2:4] = [0.02 * p for p in coefficients[2:4]]
    return model, tuple(coefficients)


@given(lenses(), st.integers(0, 2**32 - 1))
def test_every_lens_is_one_to_one_on_its_domain(lens, seed):
    model, coefficients = lens
    rng = np.random.default_rng(seed)
    limit = min(domain_radius(*lens), 5.0)
    points = limit * rng.uniform(-1, 1, (300, 2))
    after = distort(model, points, coefficients)
    seen = np.hypot(*points.T) < limit
    np.testing.assert_array_equal(np.isfinite(after[:, 0]), seen | (np.hypot(*points.T) < domain_radius(*lens)))
    points, after = points[seen], after[seen]
    # A gradient map with a positive definite Jacobian is monotone: no two points meet or change places.
    forward = np.sum((points[:, None] - points) * (after[:, None] - after), axis=-1)
    apart = np.linalg.norm(points[:, None] - points, axis=-1) > 1e-3
    assert (forward[apart] > 0).all()
    # Beside a pole, the rounding of a coordinate makes more than the tolerance; no lens has such a slope.
    mild = np.trace(distortion_jacobian(model, points, coefficients), axis1=-1, axis2=-2) < 100
    after = after[mild]
    back = undistort(model, after, coefficients)
    assert np.isfinite(back).all()
    residual = distort(model, back, coefficients) - after
    assert np.linalg.norm(residual, axis=-1).max() <= 1e-12 * (1 + np.linalg.norm(after, axis=-1).max())


@given(lenses(), st.integers(0, 2**32 - 1))
def test_the_inverse_is_right_or_nan(lens, seed):
    model, coefficients = lens
    places = np.random.default_rng(seed).normal(scale=2, size=(200, 2))
    back = undistort(model, places, coefficients)
    result = np.isfinite(back[:, 0])
    np.testing.assert_allclose(distort(model, back[result], coefficients), places[result], atol=1e-11)


def test_any_batch(lens):
    model, coefficients = lens
    points = inside(lens, 12).reshape(2, 3, 2, 2)
    after = distort(model, points, coefficients)
    assert after.shape == points.shape
    np.testing.assert_array_equal(after[1, 2, 1], distort(model, points[1, 2, 1], coefficients))
    assert distortion_jacobian(model, points, coefficients).shape == (2, 3, 2, 2, 2)
    assert distortion_hessian(model, points, coefficients).shape == (2, 3, 2, 2, 2, 2)
    assert coefficient_jacobian(model, points, coefficients).shape == (2, 3, 2, 2, len(coefficients))
    np.testing.assert_allclose(undistort(model, after, coefficients), points, atol=1e-10)
    for function in (distort, undistort):
        assert function(model, np.zeros((0, 2)), coefficients).shape == (0, 2)
    # Blocks do not touch each other.
    many = inside(lens, 20_000)
    whole = undistort(model, many, coefficients)
    np.testing.assert_array_equal(whole[-5:], undistort(model, many[-5:], coefficients))
