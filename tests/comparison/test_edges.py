"""Corners of tags from lines fitted to their edges are as accurate as the grey levels of the edges allow."""

import numpy as np
import pytest

from markergen.comparison.contestants.edges import fit_edges
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import paper
from markergen.model.tag import Tag
from markergen.render import Optics, Patch, circle, render_patches

POSES = paper()
TAG = Tag("aruco:DICT_4X4_50", 0, 0.159)
LENS = Camera(640, 480, 800, 800, 320, 240, Distortion("radtan", (-0.2, 0.1, 0.001, 0.0)))


def seen(pose, camera, optics, seed=0):
    plate = Patch((circle(np.zeros(3), 0.15),), 1.0)
    ink = Patch(tuple(np.pad(outline, ((0, 0), (0, 1))) for outline in TAG.outlines), 0.0)
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    image = render_patches([plate, ink], camera, rotation, translation, optics, np.random.default_rng(seed))
    corners = np.pad(TAG.corners, ((0, 0), (0, 1)))
    return image, camera.to_pixels(perspective(to_camera(corners, rotation[None], translation[None])))[0]


@pytest.mark.parametrize("camera", [PAPER_CAMERA, LENS], ids=["pinhole", "lens"])
@pytest.mark.parametrize("pose", [3, 129, 230, 333])
@pytest.mark.parametrize("blur", [0.5, 1.5])
def test_corners_are_where_the_lines_meet(camera, pose, blur):
    image, truth = seen(pose, camera, Optics(noise_grey=0, blur_px=blur))
    start = truth + np.random.default_rng(pose).uniform(-0.7, 0.7, truth.shape)
    # An edge along the pixels is rounded alike everywhere: by half a grey level, where it changes by 50 per px.
    assert np.abs(fit_edges(image, start, TAG.cells, camera) - truth).max() < 0.02


def test_it_is_as_accurate_as_an_edge_allows():
    """A corner's coordinate across an edge of n px is known to about 2 s/sqrt(n), s that of one px of edge."""
    errors = []
    for seed in range(24):
        image, truth = seen(129, PAPER_CAMERA, Optics(), seed)
        errors.append(fit_edges(image, truth + 0.3, TAG.cells, PAPER_CAMERA) - truth)
    optics, length = Optics(), np.linalg.norm(np.diff(truth, axis=0), axis=-1).mean()
    per_px = np.sqrt(2 * np.sqrt(np.pi) * optics.edge_blur) * optics.grey_noise(127.0) / 195
    # Extrapolated to its end, a line of which the inner part is used; 192 numbers are known to 5 %.
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(2 * per_px / np.sqrt(length), rel=0.25)


def test_no_edges_no_corners():
    image, truth = seen(129, PAPER_CAMERA, Optics())
    assert fit_edges(np.full_like(image, 200), truth, TAG.cells, PAPER_CAMERA) is None
    assert fit_edges(image, truth[:1] + (truth - truth[:1]) / 100, TAG.cells, PAPER_CAMERA) is None
    assert fit_edges(image, truth + 5000, TAG.cells, PAPER_CAMERA) is None
