"""Lenses in C against OpenCV's formulas in NumPy, their inverses against the way there, outlines against dense ones."""

import numpy as np
import pytest
from markergen_detect.core import constants, library, pointer, structures
from numpy.testing import assert_allclose

PINHOLE, BROWN_CONRADY, EQUIDISTANT, SAMPLED, ROUGH, FITTED = (
    constants()[name] for name in ("PINHOLE", "BROWN_CONRADY", "EQUIDISTANT", "SAMPLED", "ROUGH", "FITTED")
)
WIDTH, HEIGHT, FOCAL, CENTER = 640, 480, np.array([520.0, 510.0]), np.array([322.3, 236.1])
RADTAN = (-0.28, 0.09, 1.2e-3, -8e-4)
LENSES = {
    "4": (BROWN_CONRADY, RADTAN),
    "5": (BROWN_CONRADY, (*RADTAN, -0.012)),
    "8": (BROWN_CONRADY, (0.6, 0.1, 1e-3, -5e-4, 0.01, 0.9, 0.25, 0.02)),
    "12": (BROWN_CONRADY, (0.6, 0.1, 1e-3, -5e-4, 0.01, 0.9, 0.25, 0.02, 2e-3, -1e-3, -3e-3, 5e-4)),
    "14": (BROWN_CONRADY, (0.6, 0.1, 1e-3, -5e-4, 0.01, 0.9, 0.25, 0.02, 2e-3, -1e-3, -3e-3, 5e-4, 0.03, -0.05)),
    "fisheye": (EQUIDISTANT, (-0.01, 0.004, -0.003, 6e-4)),
}


class Lens:
    """A camera in C, and its sampled map, which it only points to."""

    def __init__(self, kind=PINHOLE, coefficients=(), reach=1e6, grid=None):
        self.struct, self.grid = np.zeros(1, structures()["Camera"]), grid
        self.struct["width"], self.struct["height"], self.struct["lens"] = WIDTH, HEIGHT, kind
        (self.struct["fx"], self.struct["fy"]), (self.struct["cx"], self.struct["cy"]) = FOCAL, CENTER
        self.struct["count"], self.struct["reach"] = len(coefficients), reach
        self.struct["c"][0, : len(coefficients)] = coefficients
        if grid is not None:
            self.struct["rows"], self.struct["columns"] = grid.shape[:2]
            self.struct["map"] = pointer(grid)

    @property
    def at(self):
        return pointer(self.struct)


def rotation(angle, axis):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, s], [0, -s, c]] if axis == 0 else [[c, 0, -s], [0, 1, 0], [s, 0, c]])


def pixels(kind, coefficients, rays):
    """OpenCV's documentation, section camera calibration."""
    x, y = rays.T
    r2 = x * x + y * y
    if kind == EQUIDISTANT:
        a = np.arctan(np.sqrt(r2))
        s = a * (1 + sum(k * a ** (2 * i + 2) for i, k in enumerate(coefficients))) / np.sqrt(r2)
        return FOCAL * np.stack([s * x, s * y], axis=-1) + CENTER
    c = np.zeros(14)
    c[: len(coefficients)] = coefficients
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tx, ty = c
    s = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = s * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r2**2
    v = s * y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + s3 * r2 + s4 * r2**2
    R = rotation(ty, 1) @ rotation(tx, 0)
    T = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R
    p = T @ np.stack([u, v, np.ones_like(u)])
    return FOCAL * (p[:2] / p[2]).T + CENTER


def to_pixels(lens, rays):
    out, J = np.empty((len(rays), 2)), np.empty((len(rays), 2, 2))
    for ray, pixel, jacobian in zip(rays, out, J, strict=True):
        library().lens_pixel(lens.at, pointer(ray), pointer(pixel), pointer(jacobian))
    return out, J


def to_rays(lens, points):
    out, seen = np.full((len(points), 2), np.nan), []
    for (x, y), ray in zip(points, out, strict=True):
        seen.append(library().lens_ray(lens.at, x, y, pointer(ray)))
    return out, np.array(seen, dtype=bool)


def undone(lens, center, semi, angle, covariance=(0.01, 0.002, 0.02), state=FITTED):
    blobs = np.zeros(1, structures()["Blob"])
    blobs["center"], blobs["semi"], blobs["angle"], blobs["covariance"] = center, semi, angle, covariance
    blobs["state"] = state
    library().undo_lens(lens.at, pointer(blobs), None, 1)
    return blobs[0]


@pytest.mark.parametrize("name", LENSES)
def test_pixels_of_rays_and_their_derivatives_are_those_of_the_formulas(name, rng):
    kind, coefficients = LENSES[name]
    rays = rng.uniform(-0.6, 0.6, (50, 2))
    out, J = to_pixels(Lens(kind, coefficients), rays)
    assert_allclose(out, pixels(kind, coefficients, rays), atol=1e-10)
    for k in (0, 1):
        step = 1e-6 * np.eye(2)[k]
        ahead, behind = (pixels(kind, coefficients, rays + h) for h in (step, -step))
        assert_allclose(J[:, :, k], (ahead - behind) / 2e-6, atol=1e-6)


@pytest.mark.parametrize("name", LENSES)
def test_rays_of_pixels_are_the_inverse(name, rng):
    lens = Lens(*LENSES[name], reach=1.2)
    rays = rng.uniform(-0.8, 0.8, (200, 2))
    points, _ = to_pixels(lens, rays)
    back, seen = to_rays(lens, points)
    assert seen.all()
    assert_allclose(back, rays, atol=1e-11)


def test_no_ray_lies_beyond_the_reach():
    lens = Lens(BROWN_CONRADY, (-0.3, 0, 0, 0), reach=1 / np.sqrt(0.9))
    edge, _ = to_pixels(lens, np.array([[1.0540, 0], [1.0542, 0]]))
    assert np.isfinite(edge[0]).all()
    assert np.isnan(edge[1]).all()
    assert to_rays(lens, [[CENTER[0] + FOCAL[0] * r, CENTER[1]] for r in (0.70, 0.71)])[1].tolist() == [True, False]
    assert not to_rays(lens, [[np.nan, 1], [np.inf, 1], [1e300, 1e300]])[1].any()


def test_a_fisheye_sees_almost_a_right_angle():
    lens = Lens(EQUIDISTANT, (0, 0, 0, 0))
    back, seen = to_rays(lens, [[CENTER[0] + FOCAL[0] * np.deg2rad(89.9), CENTER[1]]])
    assert seen.all()
    assert_allclose(back[0, 0], np.tan(np.deg2rad(89.9)), rtol=1e-9)


@pytest.fixture(scope="module")
def grid():
    """The lens of 8 coefficients, sampled at about every 10 px."""
    x, y = np.meshgrid(np.linspace(-0.5, WIDTH - 0.5, 65), np.linspace(-0.5, HEIGHT - 0.5, 49))
    rays, seen = to_rays(Lens(*LENSES["8"], reach=3), np.stack([x.ravel(), y.ravel()], axis=-1))
    assert seen.all()
    return rays.reshape(49, 65, 2)


def test_a_sampled_map_is_the_lens_that_it_was_sampled_from(grid, rng):
    lens, exact = Lens(SAMPLED, grid=grid), Lens(*LENSES["8"], reach=3)
    points = rng.uniform([-0.5, -0.5], [WIDTH - 0.5, HEIGHT - 0.5], (300, 2))
    rays, seen = to_rays(lens, points)
    assert seen.all()
    assert_allclose(rays, to_rays(exact, points)[0], atol=2e-7)
    back, J = to_pixels(lens, rays)
    assert_allclose(back, points, atol=1e-8)
    assert_allclose(J, to_pixels(exact, rays)[1], rtol=1e-4, atol=0.05)
    assert np.isnan(to_pixels(lens, np.array([[2.0, 0], [np.nan, 0]]))[0]).all()
    assert not to_rays(lens, [[-0.6, 10], [10, HEIGHT], [np.nan, 1]])[1].any()


def test_nodes_without_a_ray_leave_the_others_alone(grid):
    holed = grid.copy()
    holed[:5, :5] = np.nan
    lens = Lens(SAMPLED, grid=holed)
    assert to_rays(lens, [[10, 10], [400, 300]])[1].tolist() == [False, True]
    assert np.isnan(to_pixels(lens, grid[2:3, 2])[0]).all()
    assert np.isfinite(to_pixels(lens, grid[30:31, 30])[0]).all()


def test_a_blob_without_a_lens_is_scaled():
    blob = undone(Lens(), (100.25, 300.5), (9, 4), 0.7)
    axes = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]]) * [9, 4] / FOCAL[:, None]
    assert blob["reached"]
    assert_allclose(blob["at"], ([100.25, 300.5] - CENTER) / FOCAL)
    assert_allclose(blob["shape"], (axes @ axes.T)[[0, 0, 1], [0, 1, 1]])
    assert_allclose(blob["spread"], [0.01 / FOCAL[0] ** 2, 0.002 / FOCAL.prod(), 0.02 / FOCAL[1] ** 2])


@pytest.mark.parametrize("name", ["8", "14", "fisheye", "sampled"])
def test_an_outline_through_a_lens_is_fitted_by_an_ellipse(name, grid):
    lens = Lens(SAMPLED, grid=grid) if name == "sampled" else Lens(*LENSES[name], reach=3)
    center, semi, angle = np.array([80.0, 70.0]), np.array([40.0, 15.0]), 0.4
    blob = undone(lens, center, semi, angle)
    rotation = 2 * np.pi * np.arange(400) / 400
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) * semi
    points, _ = to_rays(lens, center + np.stack([np.cos(rotation), np.sin(rotation)], axis=-1) @ axes.T)
    weight = np.linalg.norm(np.stack([-np.sin(rotation), np.cos(rotation)], axis=-1) @ axes.T, axis=-1)
    by_pixels = np.linalg.inv(to_pixels(lens, points)[1])

    def rows(state):
        # Distances in the image, where the grey levels are fitted.
        M = np.array([[state[2], state[3]], [state[3], state[4]]])
        mapped = (points - state[:2]) @ M
        rho = np.linalg.norm(mapped, axis=-1)
        gradient = np.einsum("ni,nij->nj", mapped / rho[:, None] @ M, by_pixels)
        return (rho - 1) / np.linalg.norm(gradient, axis=-1) * np.sqrt(weight)

    E = blob["shape"][[0, 1, 1, 2]].reshape(2, 2)
    values, vectors = np.linalg.eigh(np.linalg.inv(E))
    M = vectors * np.sqrt(values) @ vectors.T
    state = np.array([*blob["at"], M[0, 0], M[0, 1], M[1, 1]])
    # At the minimum, a Gauss-Newton step is zero.
    J = np.stack([(rows(state + h) - rows(state - h)) / (2 * np.abs(h).sum()) for h in np.diag(1e-6 * np.abs(state))])
    step = np.linalg.lstsq(J.T, -rows(state), rcond=None)[0]
    assert np.abs(step[:2] * FOCAL).max() < 2e-3
    assert_allclose(state[2:] + step[2:], state[2:], rtol=1e-4)
    rough = undone(lens, center, semi, angle, state=ROUGH)
    assert np.abs((rough["at"] - blob["at"]) * FOCAL).max() < 0.05
    # The covariance passes through the lens's derivative at the center.
    _, jacobian = to_pixels(lens, to_rays(lens, center[None])[0])
    inverse = np.linalg.inv(jacobian[0])
    spread = inverse @ [[0.01, 0.002], [0.002, 0.02]] @ inverse.T
    assert_allclose(blob["spread"], spread[[0, 0, 1], [0, 1, 1]], rtol=1e-6)


@pytest.mark.parametrize("name", ["8", "fisheye"])
def test_an_outline_is_bent_by_the_lens_to_one_that_is_an_ellipse_without_it(name):
    lens = Lens(*LENSES[name], reach=3)
    blob = np.zeros(1, structures()["Blob"])
    blob["center"], blob["semi"], blob["angle"], blob["state"] = (120, 100), (45, 30), 0.4, FITTED
    bend = np.zeros(16)
    library().outline_bend(lens.at, pointer(blob), 16, pointer(bend))
    rotation, axis = 2 * np.pi * (np.arange(16) + 0.5) / 16, np.array([np.cos(0.4), np.sin(0.4)])
    root = 30 * np.eye(2) + 15 * np.outer(axis, axis)
    circle = np.stack([np.cos(rotation), np.sin(rotation)], axis=-1)
    normal = circle @ np.linalg.inv(root)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    ellipse = undone(lens, (120, 100), (45, 30), 0.4)
    inverse = np.linalg.inv(ellipse["shape"][[0, 1, 1, 2]].reshape(2, 2))

    def misses(inward):
        off = to_rays(lens, [120, 100] + circle @ root - inward[:, None] * normal)[0] - ellipse["at"]
        return np.abs(np.sqrt(np.einsum("ni,ij,nj->n", off, inverse, off)) - 1) * 35

    assert misses(0 * bend).max() > 0.05
    assert misses(bend).max() < 0.1 * misses(0 * bend).max()
    library().outline_bend(Lens().at, pointer(blob), 16, pointer(bend))
    assert not bend.any()


def test_blobs_that_no_ray_reaches_are_left_out():
    lens = Lens(BROWN_CONRADY, (-0.3, 0, 0, 0), reach=1 / np.sqrt(0.9))
    assert not undone(lens, (CENTER[0] + 0.70 * FOCAL[0], CENTER[1]), (9, 8), 0)["reached"]
    assert not undone(lens, (np.nan, 2), (9, 8), 0)["reached"]
    assert not undone(lens, (20, 20), (9, 0), 0)["reached"]
    assert not undone(lens, (20, 20), (np.nan, np.nan), 0)["reached"]
