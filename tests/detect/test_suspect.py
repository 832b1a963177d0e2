"""Which dot of a detection is wrong, by the residuals of the others."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.detect import Detector
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker import build_marker
from markergen.objectives.criteria import regular_polygon
from markergen.render import Optics, render_view

POINTS = np.vstack([regular_polygon(6, 0.1), [[0.02, 0.03]]])
MARKER = build_marker(POINTS, Circle(0.13), diameter=0.03, clearance=0.003)
TILT = np.deg2rad(35)
POSE = (
    np.array([[1, 0, 0], [0, -np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), -np.cos(TILT)]]),
    np.array([0.01, -0.02, 0.7]),
)


def found(offset, seed, print_sigma=1e-4):
    """Detection of a print whose dot 4 is off by a shift in m."""
    points = [replace(point, x=point.x + offset * (point.id == 4)) for point in MARKER.control_points]
    printed = replace(MARKER, control_points=tuple(points))
    view = render_view(printed, PAPER_CAMERA, *POSE, Optics(), np.random.default_rng(seed))
    (result,) = Detector(MARKER, PAPER_CAMERA, print_sigma=print_sigma)(view)
    return result


def test_the_dot_that_is_off_is_the_suspect():
    result = found(0.6e-3, 0)  # Farther off, and the detector leaves it out.
    assert result.suspect == 4
    assert result.as_dict()["suspect"] == 4
    assert "dot 4 is suspect" in str(result)


@pytest.mark.parametrize("seed", range(6))
def test_a_right_print_has_no_suspect(seed):
    result = found(0.0, seed)
    assert result.suspect is None
    # Two degrees of freedom each, of which the print leaves nothing to chance here.
    assert (result.blunder_statistics < 14).all()


def test_without_a_camera_none_is_suspect():
    view = render_view(MARKER, PAPER_CAMERA, *POSE, Optics(), np.random.default_rng(0))
    (result,) = Detector(MARKER)(view)
    assert result.blunder_statistics is None
    assert result.suspect is None
