"""Everything runs on one core, ours and its peer's, and for the processor's seconds: other work is unfair to none."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from markergen.arrays import Array
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution, paper
from markergen.objectives import Setting

RADIUS = 0.15


@pytest.fixture(autouse=True, scope="session")
def one_core() -> Iterator[None]:
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    yield
    os.sched_setaffinity(0, cores)


@pytest.fixture(scope="session")
def setting() -> Setting:
    """The paper's disk, camera and 400 poses."""
    return Setting(Circle(RADIUS), PAPER_CAMERA, paper())


@pytest.fixture(scope="session")
def one_pose(setting: Setting) -> Setting:
    """The same with one of the poses, tilted by 35 degrees: the paper descends in one pose at a time."""
    poses, chosen = setting.poses, [45]
    return Setting(
        setting.boundary, setting.camera, PoseDistribution("one", poses.rotation[chosen], poses.translation[chosen])
    )


@pytest.fixture
def compare(benchmark: Any, request: pytest.FixtureRequest) -> Callable[..., Any]:
    """Time a call, in one row of the table of its group: what is not called ``ours`` is a peer or a floor."""

    def run(group: str, call: Callable[[], Any], rounds: int = 5) -> Any:
        benchmark.group = group
        benchmark.name = request.node.originalname.removeprefix("test_").replace("_", " ")
        return benchmark.pedantic(call, rounds=rounds, warmup_rounds=1 if rounds > 1 else 0)

    return run


def matrices(count: int) -> Array:
    """Symmetric 9x9 matrices (count, 9, 9)."""
    half = np.random.default_rng(0).normal(size=(count, 9, 9))
    return np.asarray(half @ half.swapaxes(-1, -2))
