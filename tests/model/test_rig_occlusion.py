"""What hides what on a rig, against rays to the rims of the dots."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.maths.rotation import exponential
from markergen.model.body import Plate
from markergen.model.marker import build_marker
from markergen.model.occlusion import hidden, painting_levels
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from tests.support.rigs import corner, cube, face, first_hits, mounted, plate, rectangle, scattered, wall

RIM = 60


def poses_of(count, seed, distance=(0.15, 0.6)):
    rng = np.random.default_rng(seed)
    rotation = exponential(rng.normal(size=(count, 3)) * 2)
    eyes = rng.normal(size=(count, 3))
    eyes *= (rng.uniform(*distance, count) / np.linalg.norm(eyes, axis=-1))[:, None]
    return PoseDistribution("random", rotation, -np.einsum("pij,pj->pi", rotation, eyes)), eyes


def by_rays(rig, eye, scale):
    """Dots (n,) of which a ray to the rim of a disk of `scale` times its radius meets something else first."""
    angle = 2 * np.pi * np.arange(RIM) / RIM
    results = np.zeros(len(rig), dtype=bool)
    for k in range(len(rig)):
        item = rig.markers[rig.owner[k]]
        rim = scale * rig.radii[k] * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        ways = rig.xyz[k] + np.concatenate([rim, np.zeros((1, 3))]) @ item.rotation_matrix.T - eye
        behind = (eye - rig.xyz[k]) @ item.rotation_matrix[:, 2] <= 0
        results[k] = behind or np.any(first_hits(rig, eye, ways)[0] != rig.owner[k])
    return results


@pytest.mark.parametrize("rig", [cube(), wall(), corner(True), corner(False), scattered(0), scattered(1)])
def test_rays_find_the_same_dots_hidden(rig):
    poses, eyes = poses_of(40, 3)
    result = hidden(rig, poses)
    for eye, here in zip(eyes, result, strict=True):
        # Rays miss the nearest point of a rim, by less than 1 % of its radius.
        assert not (by_rays(rig, eye, 0.99) & ~here).any()
        assert not (here & ~by_rays(rig, eye, 1.02)).any()
    assert 0 < result.mean() < 1


def test_some_dots_of_these_are_hidden_by_other_plates():
    poses, eyes = poses_of(40, 3)
    for rig, expected in [(cube(), False), (wall(), False), (corner(True), True), (scattered(0), True)]:
        away = np.einsum("pnk,nk->pn", eyes[:, None] - rig.xyz, rig.normals) <= 0
        assert (hidden(rig, poses) & ~away).any() == expected
        assert rig.is_convex != expected
        assert not (away & ~hidden(rig, poses)).any()


def test_a_rig_of_one_marker_is_that_marker():
    rng = np.random.default_rng(2)
    points = np.column_stack([plate(0).xyz[:, :2], rng.uniform(0, 0.02, 6)])
    relief = build_marker(points, rectangle(0.08, 0.08), 0.012, 0.0012)
    poses, _ = poses_of(50, 5)
    expected = hidden(relief, poses)
    assert (hidden(Rig((Plate("a", relief, np.eye(3).tolist(), (0, 0, 0)),)), poses) == expected).all()
    rotation, offset = exponential(rng.normal(size=3)), rng.normal(size=3)
    there = PoseDistribution("", poses.rotation @ rotation.T, poses.translation - poses.rotation @ rotation.T @ offset)
    assert (hidden(Rig((Plate("a", relief, rotation.tolist(), tuple(offset)),)), there) == expected).all()


def test_plates_are_painted_behind_what_hides_them():
    rig = mounted([plate(0)] * 3, [np.eye(3)] * 3, [[0, 0, 0], [0, 0, 0.1], [1, 0, 0]])
    assert painting_levels(rig, np.array([0, 0, 1.0])) == [[0, 2], [1]]
    assert painting_levels(rig, np.array([0, 0, -1.0])) == [[1, 2], [0]]
    assert painting_levels(cube(), np.array([1.0, 1.0, 0.01])) == [[0, 2]]


def test_plates_that_pierce_one_another_are_refused():
    rig = mounted([plate(0), plate(1)], [face(2, 1), face(0, 1)], [[0, 0, 0]] * 2)
    with pytest.raises(InputError, match=r"in a circle"):
        painting_levels(rig, np.array([1.0, 0, 1.0]))


def test_plates_reach_half_way_to_their_neighbors():
    assert cube().margins == pytest.approx(0)
    assert wall(pitch=0.5).margins == pytest.approx(0.012)
    # 80 mm plates with gaps of 10 mm.
    assert wall(pitch=0.09).margins == pytest.approx(0.0035)
