import numpy as np
import pytest

from markergen.model.boundary import Circle, area_without
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.problem import fewer


@pytest.fixture(scope="session")
def rooms(shapes):
    """Where dots may be, by name: the six shapes, and two with keep-outs."""
    holes = tuple(Circle(0.013, (x, 0.0)) for x in (-0.07, 0.07))
    return {
        **shapes,
        "ring": area_without(Circle(0.15), [Circle(0.08)]),
        "drilled": area_without(shapes["rectangle"], holes),
    }


@pytest.fixture(scope="session")
def criterion(setting):
    """`criterion(boundary, name)`: an objective for about fifty of the paper's poses, or for some of these."""

    def made(boundary, name="pose", aggregate="", every=1):
        poses = fewer(setting.poses.seen_whole(boundary, setting.camera))
        poses = poses.taken(np.arange(0, len(poses), every), 0)
        return OBJECTIVES[name](Setting(boundary, setting.camera, poses), aggregate)

    return made
