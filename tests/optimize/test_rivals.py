"""The search for near rivals finds those that all permutations contain."""

from itertools import permutations

import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import named_poses, paper
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.rival_fits import scene_of
from markergen.optimize.rivals import find_rivals, representative

POSES = named_poses("cone:distance=0.7..1.4,tilt=0..65,count=3,seed=2")


def per_dot(rivals):
    return np.where(rivals.moved, rivals.px[:, None], np.inf).min(axis=0)


@pytest.mark.parametrize("n", [4, 5, 6])
@pytest.mark.parametrize("ring", [False, True])
def test_the_search_finds_the_nearest_of_all_permutations(n, ring):
    rng = np.random.default_rng(10 * n + ring)
    kinds = np.zeros(n, dtype=np.intp)
    kinds[0] = ring
    layouts = [Circle(0.15).sample(n, 0.01, rng), regular_polygon(n, 0.13) + rng.normal(scale=0.01, size=(n, 2))]
    labelings = np.array(list(permutations(range(n))))[1:]
    labelings = labelings[(kinds[labelings] == kinds).all(axis=-1)]
    for points in layouts:
        scene = scene_of(points, kinds, PAPER_CAMERA, POSES)
        found = find_rivals(scene, np.arange(len(POSES)))
        assert (kinds[found.labeling] == kinds).all()
        for pose in range(len(POSES)):
            every = scene.fit(labelings, np.full(len(labelings), pose))
            mine = found.take(np.flatnonzero(found.pose == pose))
            assert mine.distance.min() == pytest.approx(every.distance.min(), rel=1e-6)
            # Far ones end at the limit of the tilt, where a fit that starts elsewhere can end a little lower.
            assert np.all(per_dot(mine) <= 1.03 * per_dot(every))


def test_a_turn_by_one_place_is_found_among_many_dots():
    points = regular_polygon(24, 0.13)
    points[0] *= 0.99
    scene = scene_of(points, np.zeros(24, dtype=np.intp), PAPER_CAMERA, POSES)
    found = find_rivals(scene, np.array([0]))
    shifts = np.mod(found.labeling - np.arange(24), 24)
    assert (shifts == shifts[:, :1]).all(axis=-1).any()
    assert found.px.min() < 0.2


def test_representative_poses_are_far_from_each_other_and_no_turn_counts():
    poses = paper()
    assert len(representative(poses, 12)) == 12
    # 80 of the 400 are four frontal views, turned: 4 + 320 differ.
    assert len(representative(poses, 400)) == 324
    first = representative(poses, 1)[0]
    assert poses.polar_angle_deg[first] == pytest.approx(70)
    assert poses.distance[first] == pytest.approx(1.5)
