from dataclasses import replace

import numpy as np
import pytest

from markergen.maths.rotation import exponential
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import PoseDistribution
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.objectives.lens import through_lens
from markergen.objectives.pose import PoseObjective
from markergen.objectives.survive import SurvivalObjective
from markergen.objectives.weights import DotNoise

TRACES = ("homography", "pose", "rotation", "translation")
LENSES = {
    "radtan": Distortion("radtan", (-0.35, 0.16, -8e-4, 3e-4, -0.04)),
    "rational": Distortion("rational", (0.52, -2.53, 4.7e-4, -2e-4, 1.48, 0.40, -2.35, 1.41)),
    "equidistant": Distortion("equidistant", (0.0035, 0.0007, -0.002, 0.0002)),
}
WIDE = Camera(640, 480, 260.0, 250.0, 322.0, 235.0)


@pytest.fixture(params=LENSES)
def bent(request, setting):
    """Off the axis of a wide camera, where a lens makes a difference."""
    beside = setting.poses.translation * 0.6 + [0.12, -0.1, 0]
    poses = PoseDistribution("beside", setting.poses.rotation[::7], beside[::7])
    return Setting(setting.boundary, replace(WIDE, distortion=LENSES[request.param]), poses)


def layouts(dimension, n=6):
    rng = np.random.default_rng(0)
    points = regular_polygon(n, 0.1) + rng.normal(scale=0.015, size=(2, n, 2))
    return points if dimension == 2 else np.concatenate([points, rng.uniform(0, 0.02, (2, n, 1))], axis=-1)


def test_pose_information_is_that_of_the_image_as_taken(bent):
    points, poses, camera, step = layouts(3)[0], bent.poses, bent.camera, 1e-6

    def image(change):
        return camera.project(points, exponential(change[:3]) @ poses.rotation, poses.translation + change[3:])

    columns = [(image(step * e) - image(-step * e)).reshape(len(poses), -1) / (2 * step) for e in np.eye(6)]
    jacobian = np.stack(columns, axis=-1)
    expected = np.linalg.inv(jacobian.swapaxes(-1, -2) @ jacobian)
    # Differences of pixels are good to 1e-9 of the Jacobian; frontal poses lose three digits in the inverse.
    np.testing.assert_allclose(PoseObjective(bent).covariance(points[None])[0], expected, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("noise", [None, DotNoise(0.03)])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", [*TRACES, "survive", "condition"])
def test_gradients_through_the_lens(bent, name, dimension, noise):
    setting = replace(bent, noise=noise)
    objective = SurvivalObjective(PoseObjective(setting), 1) if name == "survive" else OBJECTIVES[name](setting)
    if objective.planar_only and dimension == 3:
        return
    points = layouts(dimension)
    along, step = np.random.default_rng(1).normal(size=points.shape), 1e-7
    gradient = objective.value_and_gradient(points)[1]
    numeric = (objective(points + step * along) - objective(points - step * along)) / (2 * step)
    # Central differences over 1e-6 of the marker's size leave eight digits.
    np.testing.assert_allclose(np.sum(gradient * along, axis=(1, 2)), numeric, rtol=1e-6)


def test_a_lens_that_bends_nothing_changes_nothing(setting):
    plain = replace(setting, noise=DotNoise(0.03))
    straight = replace(plain, camera=replace(PAPER_CAMERA, distortion=Distortion("radtan", (0.0,) * 4)))
    points = layouts(2)
    for name in TRACES:
        one, other = (OBJECTIVES[name](each).value_and_gradient(points) for each in (plain, straight))
        np.testing.assert_allclose(one[0], other[0], rtol=1e-13)
        np.testing.assert_allclose(one[1], other[1], rtol=1e-9, atol=1e-12 * np.abs(one[1]).max())


def test_condition_is_written_with_undistorted_points(bent):
    ideal = replace(bent, camera=bent.camera.ideal)
    for coordinates in ("unit", "metric", "pixel"):
        one, other = (OBJECTIVES["condition"](each, coordinates=coordinates)(layouts(2)) for each in (bent, ideal))
        np.testing.assert_array_equal(one, other)


def test_a_fisheye_tells_less_at_its_rim(setting):
    # Far off the axis it squeezes the image along the radius by 1 / (1 + r^2), so that the pose is known less well.
    poses = PoseDistribution("aside", setting.poses.rotation[::7], setting.poses.translation[::7] * 0.5 + [0.6, 0, 0])
    fisheye = replace(WIDE, distortion=Distortion("equidistant", (0.0,) * 4))
    points = layouts(2)
    for name in ("pose", "homography"):
        pinhole, bent = (OBJECTIVES[name](Setting(setting.boundary, c, poses))(points) for c in (WIDE, fisheye))
        assert np.all(bent > 1.2 * pinhole)


def test_what_the_lens_does_not_see_determines_nothing(setting):
    # The lens turns over at r = 0.913, and the marker lies at r = 1.
    camera = replace(WIDE, distortion=Distortion("radtan", (-0.4, 0.0, 0.0, 0.0)))
    poses = PoseDistribution("out", setting.poses.rotation[:2], np.array([[0, 0, 1.0], [1.0, 0, 1.0]]))
    outside = Setting(setting.boundary, camera, poses)
    value, gradient = PoseObjective(outside).value_and_gradient(layouts(2))
    assert np.isinf(value).all()
    assert not gradient.any()
    assert np.isfinite(PoseObjective(outside).per_pose(layouts(2))[:, 0]).all()
    assert criteria(layouts(2), outside)[0]["rotation_deg"] == np.inf


def test_criteria_are_those_through_the_lens(bent):
    row = criteria(layouts(2), bent)[0]
    straight = criteria(layouts(2), replace(bent, camera=bent.camera.ideal))[0]
    assert row["condition"] == straight["condition"]
    assert row["rotation_deg"] == pytest.approx(float(OBJECTIVES["rotation"](bent)(layouts(2))[0]))
    assert row["rotation_deg"] != pytest.approx(straight["rotation_deg"], rel=1e-3)


def test_rows_of_a_camera_without_a_lens_are_the_rows(setting):
    rows = np.ones((400, 12, 6))
    assert through_lens(rows, layouts(3)[0], PAPER_CAMERA, setting.poses) is rows
