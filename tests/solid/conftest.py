from collections.abc import Callable

import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker


def build(points: np.ndarray, radius: float, diameter: float) -> Marker:
    """Marker with dots at points (n, 2) in m, the first one a ring."""
    return Marker(
        tuple(
            ControlPoint(i, float(x), float(y), 0.0, key_ring(diameter) if i == 0 and diameter else Feature(diameter))
            for i, (x, y) in enumerate(points)
        ),
        Circle(radius),
        diameter / 10,
        provenance={"spec_hash": "1a2b3c4d"},
    )


def ngon(n: int, radius: float, diameter: float) -> Marker:
    """Regular n-gon, dots a tenth of their diameter inside the disk, the first at the top."""
    angles = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return build((radius - 0.6 * diameter) * np.stack([np.cos(angles), np.sin(angles)], axis=-1), radius, diameter)


@pytest.fixture(scope="session")
def make_marker() -> Callable[..., Marker]:
    return build


@pytest.fixture(scope="session")
def make_ngon() -> Callable[..., Marker]:
    return ngon
