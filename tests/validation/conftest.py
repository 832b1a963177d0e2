from collections.abc import Iterator

import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.validation import expectation

SAMPLED = ("test_error_to_plan_with", "test_expectation")
"""Tests of the errors that are expected by sampling."""


@pytest.fixture(scope="module", autouse=True)
def few_draws(request: pytest.FixtureRequest) -> Iterator[None]:
    """Expected errors are sampled by as few draws as can be, which take most of the time of a validation."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.stem not in SAMPLED:
            patch.setattr(expectation, "MOST_DRAWS", expectation.LEAST_DRAWS)
        yield


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
