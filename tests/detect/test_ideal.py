from dataclasses import replace

import numpy as np
import pytest

from markergen.detect.blobs import Blobs
from markergen.detect.ideal import undo_lens
from markergen.maths.rotation import turn_z
from markergen.model.camera import PAPER_CAMERA, Distortion

LENSES = {
    "radtan": replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.3, 0.1, 0.001, -0.0005))),
    "fisheye": replace(PAPER_CAMERA, fx=400.0, fy=390.0, distortion=Distortion("equidistant", (-0.02, 0.005, 0, 0))),
}
CENTER = np.array([[320.0, 240.0], [60.3, 50.2], [590.1, 430.7], [100.5, 400.5], [500.0, 100.0]])
SEMI = np.array([[20.0, 20.0], [24.0, 10.0], [12.0, 8.0], [3.0, 2.0], [25.0, 24.0]])
ANGLE = np.array([0.0, 0.5, -1.0, 1.3, 0.2])
BLOBS = Blobs(CENTER, SEMI, ANGLE, np.arange(5) == 2, np.broadcast_to(1e-4 * np.eye(2), (5, 2, 2)))


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
    seen = Blobs(*(np.array([fit[k] for fit in fitted]) for k in range(3)), BLOBS.ring, BLOBS.covariance)
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
    far = Blobs(
        np.array([[320.0, 240.0], [636.0, 470.0]]),
        *(getattr(BLOBS, f)[:2] for f in ("semi", "angle", "ring")),
        BLOBS.covariance[:2],
    )
    np.testing.assert_array_equal(undo_lens(far, camera).index, [0])


def test_no_blobs():
    none = Blobs(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), np.zeros((0, 2, 2)))
    for camera in (PAPER_CAMERA, LENSES["radtan"]):
        assert len(undo_lens(none, camera)) == 0
