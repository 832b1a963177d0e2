"""Files of several markers."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.boundary import polygon_from
from markergen.model.feature import Feature
from markergen.objectives.criteria import regular_polygon
from markergen.verification import rays

DPI = 300
"""Of the sheets of pixels: a quarter of what 600 take, in memory and time."""


def without_ring(marker):
    points = tuple(replace(p, feature=Feature(p.feature.diameter)) for p in marker.control_points)
    return replace(marker, control_points=points)


@pytest.fixture(scope="session")
def markers(make_ngon, make_marker, make_in):
    """Markers by name: symmetric or not, with a key ring or not, in a disk or not; all small, for A5 to A4."""
    five = make_ngon(5, 0.05, 0.012)
    skew = make_marker(
        np.array([[0.03, 0.02], [-0.035, 0.018], [-0.01, -0.03], [0.036, -0.012], [0.0, 0.035]]), 0.05, 0.012
    )
    bent = polygon_from([np.array([[0, 0], [0.1, 0], [0.1, 0.05], [0.05, 0.05], [0.05, 0.1], [0, 0.1]])])
    return {
        "4": make_ngon(4, 0.05, 0.012),
        "5": five,
        "5 alike": without_ring(five),
        "5 skew": skew,
        "12": make_marker(np.concatenate([regular_polygon(11, 0.04), [[0.002, 0.001]]]), 0.05, 0.008),
        "L": make_in(bent, 5, 0.01),
        "L alike": without_ring(make_in(bent, 7, 0.01, seed=3)),
    }


@pytest.fixture(scope="session")
def files(markers, tmp_path_factory):
    """Path of the file of a marker, by name and suffix, written once."""
    folder = tmp_path_factory.mktemp("files")
    written = {}

    def get(name, suffix):
        path = folder / f"{name.replace(' ', '-')}{suffix}"
        if path not in written:
            written[path] = save(markers[name], [path], ExportOptions(dpi=DPI))
        return path

    return get


@pytest.fixture(autouse=True)
def few_rays(request, monkeypatch):
    """Compare solids along a sixth of the usual rays, except in `make test-long` and in tests of the rays themselves.

    What is finer than their distance is looked for triangle by triangle, with few rays as with many.
    """
    if request.path.stem != "test_rays" and not request.node.get_closest_marker("long"):
        for name, value in (("RAYS", 160), ("LAYERS", 30), ("FINEST", 0.4)):
            monkeypatch.setattr(rays, name, value)
