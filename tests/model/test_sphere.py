"""Poses from all around the origin."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.poses import named_poses


def test_directions_are_uniform_over_the_sphere():
    poses = named_poses("sphere:distance=0.3..0.6m,count=2000")
    center = -np.einsum("pij,pi->pj", poses.rotation, poses.translation)
    unit = center / np.linalg.norm(center, axis=-1, keepdims=True)
    # Independent directions would have standard deviations of 0.013 and at most 0.007; the even sequence is better.
    assert unit.mean(axis=0) == pytest.approx(0, abs=0.03)
    assert unit.T @ unit / len(unit) == pytest.approx(np.eye(3) / 3, abs=0.015)
    assert np.ptp(poses.distance) == pytest.approx(0.3, rel=0.01)
    assert poses.rotation @ poses.rotation.swapaxes(-1, -2) == pytest.approx(np.tile(np.eye(3), (2000, 1, 1)))
    assert np.linalg.det(poses.rotation) == pytest.approx(1)


def test_its_name_makes_the_same_poses():
    poses = named_poses("sphere:distance=300mm..600mm,roll=0..90,count=20,seed=3,sampling=random")
    assert poses.name == "sphere:distance=0.3..0.6,roll=0..90,count=20,seed=3,sampling=random"
    assert (named_poses(poses.name).rotation == poses.rotation).all()


@pytest.mark.parametrize("text", ["sphere:tilt=0..10", "sphere:distance=0", "sphere:count=0", "sphere:distance=1..2,3"])
def test_other_arguments_are_refused(text):
    with pytest.raises(InputError):
        named_poses(text)
