"""What many tests start from: the paper's setting, and the regular pentagon that `design` makes of it."""

import os
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper
from markergen.objectives import Setting
from markergen.objectives.criteria import regular_polygon

# What is to land is judged by the same examples every time; people at work get fresh ones.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("work", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "work")


@pytest.fixture(scope="session")
def setting() -> Setting:
    """The paper's disk, camera and 400 poses."""
    boundary = Circle(0.15)
    return Setting(boundary, PAPER_CAMERA, paper().seen_whole(boundary, PAPER_CAMERA))


def build_marker(points: np.ndarray, radius: float, diameter: float) -> Marker:
    """Marker with dots at points (n, 2) in m, the first one a ring; clearance a tenth of the diameter."""
    return Marker(
        tuple(
            ControlPoint(i, float(x), float(y), 0.0, key_ring(diameter) if i == 0 and diameter else Feature(diameter))
            for i, (x, y) in enumerate(points)
        ),
        Circle(radius),
        diameter / 10,
        provenance={"spec_hash": "1a2b3c4d"},
    )


def build_ngon(n: int, radius: float, diameter: float) -> Marker:
    """Regular n-gon, as far out as dots and clearance allow."""
    return build_marker(regular_polygon(n, radius - 0.6 * diameter), radius, diameter)


@pytest.fixture(scope="session")
def make_marker() -> Callable[..., Marker]:
    return build_marker


@pytest.fixture(scope="session")
def make_ngon() -> Callable[..., Marker]:
    return build_ngon


@pytest.fixture(scope="session")
def pentagon() -> Marker:
    """What `design` makes of its defaults."""
    return build_ngon(5, 0.15, 0.036)
