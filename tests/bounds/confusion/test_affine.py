"""Layouts that no view confuses with others."""

from itertools import permutations

import numpy as np
import pytest

from markergen.bounds.confusion.affine import affine_distance, foreign_safety, partial_distance, self_distance
from markergen.bounds.confusion.perspective import find_rivals, representative
from markergen.bounds.confusion.rival_fits import seen_layout
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import named_poses
from markergen.objectives import Setting

RNG = np.random.default_rng(5)
ONE, OTHER = RNG.uniform(-0.04, 0.04, size=(2, 6, 2))


def fitted(layout, other):
    """RMS that the best affine map with a positive determinant leaves, by least squares for every labeling."""
    best = np.inf
    for labeling in permutations(range(len(other))):
        rows = np.column_stack([other[list(labeling)], np.ones(len(other))])
        results = np.linalg.lstsq(rows, layout, rcond=None)[0]
        if np.linalg.det(results[:2]) > 0:
            best = min(best, np.sqrt(np.mean(np.sum((layout - rows @ results) ** 2, axis=-1))))
    return best


def test_the_distance_is_that_of_the_best_affine_map():
    assert affine_distance(ONE[None], OTHER)[0] == pytest.approx(fitted(ONE, OTHER))
    assert affine_distance(OTHER[None], ONE)[0] == pytest.approx(fitted(OTHER, ONE))


def test_the_partial_distance_leaves_out_one_dot_of_each():
    least = np.inf
    for one in range(6):
        for labeling in permutations(range(6)):
            rest = [j for j in range(6) if j != one]
            rows = np.column_stack([OTHER[[labeling[j] for j in rest]], np.ones(5)])
            if np.linalg.det(np.linalg.lstsq(np.c_[OTHER[list(labeling)], np.ones(6)], ONE, rcond=None)[0][:2]) > 0:
                left = ONE[rest] - rows @ np.linalg.lstsq(rows, ONE[rest], rcond=None)[0]
                least = min(least, np.sqrt(np.mean(np.sum(left**2, axis=-1))))
    assert partial_distance(ONE[None], OTHER)[0] == pytest.approx(least)
    changed = ONE + 0.01 * np.eye(6)[3][:, None]
    assert partial_distance(changed[None], ONE)[0] == pytest.approx(0, abs=1e-9)


def test_an_affine_image_is_no_other_layout():
    image = ONE[[3, 1, 0, 5, 4, 2]] @ [[0.5, 0.3], [-0.1, 0.8]] + 0.01
    assert affine_distance(image[None], ONE)[0] == pytest.approx(0, abs=1e-9)
    assert affine_distance(ONE[None] * [-1, 1], ONE)[0] > 0.002
    assert affine_distance(ONE[None, :5], ONE)[0] == np.inf
    many = RNG.uniform(-0.04, 0.04, size=(2, 12, 2))
    assert affine_distance(many[:1] @ [[0.5, 0.3], [-0.1, 0.8]], many[0])[0] < 3e-4
    assert affine_distance(many[:1], many[1])[0] > 2e-3


def test_a_layout_with_a_turn_looks_like_itself():
    # The ring in the middle of a square.
    square = 0.03 * np.array([[0, 0], [1, 1], [-1, 1], [-1, -1], [1, -1]])
    assert self_distance(square[None])[0] == pytest.approx(0, abs=1e-9)
    assert self_distance(ONE[None])[0] > 1e-3


def test_safety_is_that_of_the_thorough_search():
    poses = named_poses("cone:distance=0.2..0.6m,tilt=0..70,count=60")
    setting = Setting(Circle(0.06), PAPER_CAMERA, poses)
    result = foreign_safety(ONE, OTHER, setting)
    scene = seen_layout(ONE, np.zeros(6, dtype=np.intp), setting.camera, poses)
    at = representative(poses, 12)
    other = type(scene)(
        np.column_stack([OTHER, np.zeros(6)]), scene.kinds, scene.camera, poses, scene.rays, scene.images
    )
    assert result.px == pytest.approx(find_rivals(other, at).px.min(), rel=0.01)
    rotated = foreign_safety(ONE, ONE[::-1], setting)
    assert rotated.px == pytest.approx(0, abs=1e-6)
    assert rotated.undecided == pytest.approx(1)
