import numpy as np
import pytest

from markergen.errors import InputError
from markergen.maths.dlt import condition, condition_and_gradient, dlt_matrix
from markergen.maths.information import covariance, displacement_weight, information, pose_jacobian
from markergen.maths.projection import apply_homography, plane_homography, project
from markergen.model.poses import RIM_POINTS
from markergen.objectives import OBJECTIVES
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.objectives.homography import validation_grid


def test_pose_is_the_expected_displacement_of_the_rim(setting):
    # Sampled: poses drawn from the CRLB at each pose move the rim by as much as the closed form says.
    points = regular_polygon(5, 0.15)
    value = OBJECTIVES["pose"](setting).per_pose(points[None])[0]
    poses, rng = setting.poses, np.random.default_rng(0)
    bound = covariance(information(pose_jacobian(points, poses.rotation, poses.translation, setting.camera.focal)))
    rim = setting.boundary.rim(RIM_POINTS)
    for index in (0, 170, 399):
        twists = rng.multivariate_normal(np.zeros(6), bound[index], size=20_000)
        rotated = rim @ poses.rotation[index, :, :2].T
        moved = np.cross(twists[:, None, :3], rotated) + twists[:, None, 3:]
        sampled = np.sqrt(np.mean(np.sum(moved**2, axis=-1)))
        # 20,000 draws of six normals: the RMS is good to about 1 / sqrt(2 * 20,000) = 0.5 %; four sigma.
        assert sampled == pytest.approx(value[index], rel=0.02)


def test_homography_is_the_expected_error_on_the_grid(setting):
    # Sampled: a small perturbation of the image points, fitted by linear least squares, moves the grid as predicted.
    points, grid = regular_polygon(5, 0.15), validation_grid(0.15)
    objective = OBJECTIVES["homography"](setting)
    value = objective.per_pose(points[None])[0]
    poses, rng = setting.poses, np.random.default_rng(1)
    for index in (0, 250):
        matrix = plane_homography(poses.rotation[[index]], poses.translation[[index]], setting.camera.matrix)[0]
        # Derivative of a mapped point by the nine entries of H: [p 0 -x p; 0 p -y p] / w.
        rows, targets = (np.concatenate([_entries(matrix, p) for p in subset]) for subset in (points, grid))
        noise = rng.normal(size=(20_000, rows.shape[0]))
        moved = noise @ np.linalg.pinv(rows, rcond=1e-12).T @ targets.T
        sampled = np.sqrt(np.mean(np.sum(moved**2, axis=-1)) / len(grid))
        assert sampled == pytest.approx(value[index], rel=0.02)


def _entries(matrix, point):
    p = np.append(point, 1.0)
    weight = matrix[2] @ p
    x, y = apply_homography(matrix, point[None])[0]
    zero = np.zeros(3)
    # Rows are scaled so that H's entries, from 1e-3 to 1e3, meet columns of like size.
    scale = np.abs(matrix).ravel() + 1.0
    return np.stack([np.concatenate([p, zero, -x * p]), np.concatenate([zero, p, -y * p])]) / weight * scale


@pytest.mark.parametrize("coordinates", ["unit", "metric", "pixel", "hartley"])
def test_condition_is_that_of_the_coordinates(setting, coordinates):
    points = np.random.default_rng(2).uniform(-0.1, 0.1, (5, 2))
    poses, camera = setting.poses, setting.camera
    image = project(points, poses.rotation, poses.translation, camera.matrix)
    normalized = (image - camera.matrix[:2, 2]) / camera.focal
    r, t = 0.15, poses.translation[:, None]
    written = {
        "unit": (points / r, (normalized - t[..., :2] / t[..., 2:]) * t[..., 2:] / r),
        "metric": (points, normalized),
        "pixel": (points, image),
        "hartley": (_hartley(points), _hartley(image)),
    }
    matrix = dlt_matrix(*written[coordinates])
    singular = np.linalg.svd(matrix, compute_uv=False)
    value = OBJECTIVES["condition"](setting, coordinates=coordinates).per_pose(points[None])[0]
    # The square of a pixel condition number of 1e5 leaves six digits.
    np.testing.assert_allclose(value, singular[:, 0] / singular[:, 7], rtol=1e-4 if coordinates == "pixel" else 1e-8)


def _hartley(points):
    centered = points - points.mean(axis=-2, keepdims=True)
    return centered * np.sqrt(2 / np.mean(np.sum(centered**2, -1), -1))[..., None, None]


def test_unit_coordinates_forget_the_unit_of_length(setting):
    # A marker ten times as large, seen from ten times as far, is the same problem.
    from markergen.model.boundary import Circle
    from markergen.model.poses import PoseDistribution
    from markergen.objectives import Setting

    poses = PoseDistribution("far", setting.poses.rotation, setting.poses.translation * 10)
    large = Setting(Circle(1.5), setting.camera, poses)
    points = np.random.default_rng(3).uniform(-0.1, 0.1, (3, 6, 2))
    near, far = OBJECTIVES["condition"](setting)(points), OBJECTIVES["condition"](large)(10 * points)
    np.testing.assert_allclose(near, far, rtol=1e-9)


@pytest.mark.parametrize("coordinates", ["unit", "metric", "hartley"])
def test_gradients_of_c_are_its_differences(setting, coordinates):
    objective = OBJECTIVES["condition"](setting, coordinates=coordinates)
    rng = np.random.default_rng(4)
    points, along, step = rng.uniform(-0.1, 0.1, (5, 2)), rng.normal(size=(5, 2)), 1e-7
    after, before = (objective((points + sign * step * along)[None])[0] for sign in (1, -1))
    gradient = objective.value_and_gradient(points[None])[1][0]
    assert np.sum(gradient * along) == pytest.approx((after - before) / (2 * step), rel=1e-5)


def test_gradients_of_c_are_finite_where_singular_values_coincide():
    square = regular_polygon(4, 1.0)
    value, *gradients = condition_and_gradient(square, square)
    assert np.all(np.isfinite(gradients))
    assert value == condition(square, square)


def test_a_degenerate_layout_is_infinite_and_stays_put(setting):
    line = np.stack([np.linspace(-0.1, 0.1, 5), np.zeros(5)], -1)[None]
    for name in OBJECTIVES:
        objective = OBJECTIVES[name](setting)
        value, gradient = objective.value_and_gradient(line)
        # The pose of a line is undetermined about itself; rounding may leave a huge number instead of inf.
        assert value[0] > 1e4 * objective(regular_polygon(5, 0.15)[None])[0]
        assert np.all(np.isfinite(gradient)) or np.isfinite(value[0])


def test_rotation_and_translation_are_the_bounds(setting):
    points = np.random.default_rng(6).uniform(-0.1, 0.1, (2, 5, 2))
    row = criteria(points, setting)
    for name, key in (("rotation", "rotation_deg"), ("translation", "translation_pct")):
        np.testing.assert_allclose(OBJECTIVES[name](setting)(points), [item[key] for item in row], rtol=1e-12)


def test_criteria_of_a_relief_are_those_that_it_has(setting):
    flat = np.pad(regular_polygon(5, 0.1), ((0, 0), (0, 1)))
    assert criteria(flat[None], setting) == criteria(flat[None, :, :2], setting)
    raised = flat + [0, 0, 0.02] * np.arange(5)[:, None] / 4
    row = criteria(raised[None], setting)[0]
    assert set(row) == {"pose_m", "rotation_deg", "translation_pct"}
    # Height tells the tilt of frontal poses, which decide the RMS.
    assert row["rotation_deg"] < 0.9 * criteria(flat[None], setting)[0]["rotation_deg"]


def test_unknown_names_list_the_known(setting):
    with pytest.raises(InputError, match="condition, homography, pose, rotation, translation"):
        OBJECTIVES["size"]
    with pytest.raises(InputError, match="cvar, logmean, max, mean, rms"):
        OBJECTIVES["pose"](setting, "median")
    with pytest.raises(InputError, match="unit, metric, pixel, hartley"):
        OBJECTIVES["condition"](setting, coordinates="polar")


def test_displacement_weight_has_one_unit(setting):
    weight = displacement_weight(setting.boundary.rim(RIM_POINTS), setting.poses.rotation)
    np.testing.assert_allclose(np.linalg.eigvalsh(weight)[:, -1], 1.0, atol=1e-12)
