"""What many tests start from: the paper's setting, and the regular pentagon that `design` makes of it."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper
from markergen.objectives import Setting
from markergen.objectives.criteria import regular_polygon


@pytest.fixture(scope="session")
def setting() -> Setting:
    """The paper's disk, camera and 400 poses."""
    boundary = Circle(0.15)
    return Setting(boundary, PAPER_CAMERA, paper().seen_whole(boundary, PAPER_CAMERA))


def make_marker(points: np.ndarray, diameter: float = 0.036, clearance: float = 0.0036, radius: float = 0.15) -> Marker:
    return Marker(
        tuple(
            ControlPoint(i, float(x), float(y), 0.0, Feature(diameter) if i else key_ring(diameter))
            for i, (x, y) in enumerate(points)
        ),
        Circle(radius),
        clearance,
        provenance={"spec_hash": "0123abcd"},
    )


@pytest.fixture(scope="session")
def pentagon() -> Marker:
    """Five dots of 36 mm, evenly on the rim that they and their clearance leave."""
    return make_marker(regular_polygon(5, 0.1284))
