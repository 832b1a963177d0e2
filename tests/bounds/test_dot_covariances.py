"""What the dots of a pose tell."""

import numpy as np
import pytest

from markergen.bounds.dot_covariances import dot_ellipses, dot_information, marker_budget
from markergen.estimators.budget import ErrorSources
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import named_poses, paper
from markergen.model.sight import Coverage
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.observation import DotNoise
from markergen.optimize.layouts import regular_polygon

FACING = np.diag([1.0, -1.0, -1.0])


def test_dot_ellipses_leave_out_what_is_not_seen():
    marker = Marker((ControlPoint(0, 0.05, 0.02, 0.0, Feature(0.036)),), Circle(0.15), 0.0036)
    diameters = np.array([0.036])
    center, semi, _ = dot_ellipses(marker.xyz, PAPER_CAMERA, FACING, np.array([0, 0, 0.6]), diameters)
    # 50 mm and 20 mm at f = 800 px and 0.6 m; a frontal circle stays one.
    np.testing.assert_allclose(center, [[320 + 200 / 3, 240 - 80 / 3]], rtol=1e-9)
    np.testing.assert_allclose(semi, [[24, 24]], rtol=1e-9)
    for rotation, distance in ((np.eye(3), 0.6), (FACING, -0.6)):
        _, semi, _ = dot_ellipses(marker.xyz, PAPER_CAMERA, rotation, np.array([0, 0, distance]), diameters)
        assert np.isnan(semi).all()


def test_information_of_dots_of_several_sizes_is_the_sum_of_theirs():
    spec = Spec(n=0, boundary=Circle(0.5))
    poses, points = named_poses("cone:distance=2..4m,tilt=0..45,count=5"), np.eye(4, 2) * 0.2 + 0.01
    diameters = np.array([0.03, 0.03, 0.08, 0.08])
    seen = Coverage(points, diameters, poses, np.ones((5, 4), dtype=bool))
    results = dot_information(seen, spec.camera, spec.image_noise, 1e-4)
    for diameter in (0.03, 0.08):
        alike = np.flatnonzero(diameters == diameter)
        noise = DotNoise(diameter, spec.image_noise, 1e-4)
        alone = OBJECTIVES["pose"](Setting(spec.boundary, spec.camera, poses, noise)).information(points[None, alike])[
            0
        ]
        np.testing.assert_allclose(results[:, alike].sum(axis=1), alone[0], rtol=1e-3, atol=1e-3 * np.abs(alone).max())


def test_five_default_dots_err_by_a_quarter_of_a_degree():
    setting = Setting(Circle(0.15), PAPER_CAMERA, paper())
    result = marker_budget(regular_polygon(5, 0.1284), 0.036, setting, Spec().image_noise, ErrorSources())
    # The whole error with a print good to 0.1 mm that validate reports.
    assert np.sqrt(np.mean(result.rotation_deg["total"] ** 2)) == pytest.approx(0.234, abs=5e-4)
