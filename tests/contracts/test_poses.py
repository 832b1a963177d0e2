"""What every source of poses of the table keeps to."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import POSES, named_poses
from markergen.model.spec import Spec
from markergen.read.poses import poses_from


@pytest.mark.parametrize("name", list(POSES))
def test_the_name_alone_makes_poses_that_see_a_marker(name):
    poses = named_poses(name)
    assert len(poses) >= 1
    np.testing.assert_allclose(
        poses.rotation @ poses.rotation.swapaxes(-1, -2), np.tile(np.eye(3), (len(poses), 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(poses.rotation), 1)
    assert poses.translation.shape == (len(poses), 3)
    assert len(poses.seen_whole(Circle(0.05), PAPER_CAMERA)) >= 1


@pytest.mark.parametrize("name", list(POSES))
def test_what_it_calls_its_poses_reads_back_as_the_same_ones(name):
    poses = named_poses(name)
    again = named_poses(poses.name)
    assert again.name == poses.name
    np.testing.assert_array_equal(again.rotation, poses.rotation)
    np.testing.assert_array_equal(again.translation, poses.translation)
    assert Spec(poses=name).poses == poses.name == poses_from(name).name


@pytest.mark.parametrize("name", list(POSES))
def test_arguments_are_read_or_refused_in_a_line(name):
    form = POSES[name].form
    assert form == "" or form.startswith(f"{name}:")
    for text in (f"{name}:nothing=1", f"{name}:nothing", f"{name}:,"):
        with pytest.raises(InputError) as caught:
            named_poses(text)
        assert "\n" not in str(caught.value)
