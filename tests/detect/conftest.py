import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker

IRREGULAR = [(0.12, 0.03), (-0.1, 0.07), (0.02, -0.11), (-0.05, -0.02), (0.05, 0.1), (-0.11, -0.05)]


def build(points, rings=(0,), diameter=0.036, heights=None):
    features = [key_ring(diameter) if i in rings else Feature(diameter) for i in range(len(points))]
    heights = np.zeros(len(points)) if heights is None else heights
    return Marker(
        # Identifiers that are not positions in the list, so that one cannot stand for the other.
        tuple(
            ControlPoint(10 + i, float(x), float(y), float(z), f)
            for i, ((x, y), z, f) in enumerate(zip(points, heights, features, strict=True))
        ),
        Circle(0.15),
        0.0036,
    )


def regular(n, **options):
    angle = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return build(0.1284 * np.stack([np.cos(angle), np.sin(angle)], axis=-1), **options)


@pytest.fixture(scope="session")
def pentagon():
    return regular(5)


@pytest.fixture(scope="session")
def make():
    """Build markers: make(points, rings=..., diameter=..., heights=...)."""
    return build


@pytest.fixture(scope="session")
def ngon():
    """Build regular markers: ngon(n, rings=..., diameter=..., heights=...)."""
    return regular


@pytest.fixture(scope="session")
def irregular():
    return build(IRREGULAR)
