import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker


def build(n=5, key=True, diameter=0.036):
    angles = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    features = [key_ring(diameter) if key and i == 0 else Feature(diameter) for i in range(n)]
    return Marker(
        tuple(
            ControlPoint(i, float(0.1284 * np.cos(angle)), float(0.1284 * np.sin(angle)), 0.0, feature)
            for i, (angle, feature) in enumerate(zip(angles, features, strict=True))
        ),
        Circle(0.15),
        0.0036,
    )


@pytest.fixture(scope="session")
def ngon():
    """Build regular markers: ngon(n, key=..., diameter=...)."""
    return build
