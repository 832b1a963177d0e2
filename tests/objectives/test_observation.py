from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from markergen.estimators.budget import ErrorSources, pose_budget
from markergen.maths.dot_crlb import center_covariance, directions, linearize
from markergen.maths.information import covariance, pose_jacobian, rotation_bound
from markergen.maths.projection import project
from markergen.maths.rotation import exponential
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import PoseDistribution
from markergen.model.spec import ImageNoise
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.aggregates import AGGREGATES
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.objectives.observation import DotNoise, through_lens
from markergen.objectives.pose import PoseObjective
from markergen.objectives.survive import SurvivalObjective

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


def test_pose_information_is_that_of_the_distorted_image(bent):
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
        one, other = (OBJECTIVES[name](item).value_and_gradient(points) for item in (plain, straight))
        np.testing.assert_allclose(one[0], other[0], rtol=1e-13)
        np.testing.assert_allclose(one[1], other[1], rtol=1e-9, atol=1e-12 * np.abs(one[1]).max())


def test_condition_is_written_with_undistorted_points(bent):
    ideal = replace(bent, camera=bent.camera.ideal)
    for coordinates in ("unit", "metric", "pixel"):
        one, other = (OBJECTIVES["condition"](item, coordinates=coordinates)(layouts(2)) for item in (bent, ideal))
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


WEIGHING = ("homography", "pose", "rotation", "translation")
NOISE = DotNoise(0.036)


@pytest.fixture(scope="module")
def image(setting):
    return replace(setting, noise=NOISE)


@pytest.mark.parametrize("name", WEIGHING)
@pytest.mark.parametrize("aggregate", list(AGGREGATES))
@pytest.mark.parametrize("print_sigma", [0.0, 4e-6, 1e-4])
def test_gradient_agrees_with_differences(image, name, aggregate, print_sigma):
    # Image and print in turn have the larger share; with 4 um they are about equal.
    objective = OBJECTIVES[name](replace(image, noise=replace(NOISE, print_sigma=print_sigma)), aggregate)
    rng = np.random.default_rng(0)
    points = regular_polygon(6, 0.11) + rng.normal(scale=0.015, size=(3, 6, 2))
    along, step = rng.normal(size=points.shape), 1e-7
    gradient = objective.value_and_gradient(points)[1]
    numeric = (objective(points + step * along) - objective(points - step * along)) / (2 * step)
    # Central differences over 1e-6 of the marker's size leave eight digits.
    np.testing.assert_allclose(np.sum(gradient * along, axis=(1, 2)), numeric, rtol=1e-6)


def test_pose_covariance_is_that_of_dots_weighed_one_by_one(image):
    # By the definition: every dot's image by differences of the projection, its covariance, and its inverse as weight.
    points, poses = regular_polygon(5, 0.12), image.poses
    results = PoseObjective(image).covariance(points[None])[0]
    for index in (0, 130, 399):
        R, t = poses.rotation[[index]], poses.translation[[index]]
        jacobian = pose_jacobian(points, R, t, image.camera.focal)[0].reshape(5, 2, 6)
        total = np.zeros((6, 6))
        for i, point in enumerate(points):
            columns = [
                project(np.stack([point + e, point - e]), R, t, image.camera.matrix)[0] for e in 1e-6 * np.eye(2)
            ]
            plane = np.stack([(ahead - behind) / 2e-6 for ahead, behind in columns], axis=-1)
            spread = center_covariance(0.018 * plane, NOISE.image.edge_px, NOISE.image.contrast_to_noise)
            total += jacobian[i].T @ np.linalg.inv(spread) @ jacobian[i]
        # The nodes of the integral are chosen by the marker's middle instead of by the dot: 3e-4.
        ratio = rotation_bound(results[index]) / rotation_bound(covariance(total))
        assert ratio == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("print_sigma", [1e-6, 1e-5, 1e-4, 1e-2])
def test_pose_covariance_is_the_budgets_total(image, print_sigma):
    points, poses, radius = regular_polygon(5, 0.12), image.poses, NOISE.diameter / 2
    result = PoseObjective(replace(image, noise=replace(NOISE, print_sigma=print_sigma))).covariance(points[None])[0]

    def shapes(of):
        jacobian = pose_jacobian(of, poses.rotation, poses.translation, image.camera.focal)
        return radius * (jacobian.reshape(len(poses), -1, 2, 6)[..., 3:] @ poses.rotation[:, None, :, :2])

    # The same nodes of the integral, so that nothing but rounding is left.
    nodes = directions(shapes(np.zeros((1, 2)))[:, 0])
    spread = np.linalg.inv(linearize(shapes(points), NOISE.image.edge_px, NOISE.image.contrast_to_noise, nodes)[0])
    budget = pose_budget(
        points, poses.rotation, poses.translation, image.camera, spread, ErrorSources(print_sigma=print_sigma)
    )
    scale = np.sqrt(np.einsum("pii->pi", budget.total))
    difference = (result - budget.total) / (scale[:, :, None] * scale[:, None, :])
    assert np.abs(difference).max() < 1e-9
    np.testing.assert_allclose(rotation_bound(result), rotation_bound(budget.total), rtol=1e-9)


@pytest.mark.parametrize("name", WEIGHING)
def test_a_print_error_of_nothing_changes_nothing_and_a_large_one_is_a_factor(image, name):
    points = regular_polygon(5, 0.11)[None]

    def value(print_sigma):
        return OBJECTIVES[name](replace(image, noise=replace(NOISE, print_sigma=print_sigma)))(points)[0]

    # 1e-12 of 0.01 px^2, far below rounding; next to 1 mm the image's share of the variance is some 1e-5.
    assert value(1e-12) == pytest.approx(OBJECTIVES[name](image)(points)[0], rel=1e-9)
    assert value(2e-3) == pytest.approx(2 * value(1e-3), rel=1e-4)


@pytest.mark.parametrize("name", WEIGHING)
def test_noise_is_a_factor_and_size_matters_with_its_root(image, name):
    points = regular_polygon(5, 0.11)[None]
    value = OBJECTIVES[name](image)(points)[0]
    noisy = replace(image, noise=DotNoise(0.036, ImageNoise(noise_grey=8.0)))
    # Rounding adds 1/12 to both variances.
    assert OBJECTIVES[name](noisy)(points)[0] == pytest.approx(value * np.sqrt((64 + 1 / 12) / (4 + 1 / 12)))
    larger = replace(image, noise=DotNoise(0.072))
    # An outline twice as long has half the variance, but for the curvature of the smallest images: 3 %.
    assert OBJECTIVES[name](larger)(points)[0] == pytest.approx(value / np.sqrt(2), rel=0.03)


def test_criteria_are_for_the_settings_noise(setting, image):
    points = regular_polygon(5, 0.12)[None]
    plain, weighed = criteria(points, setting)[0], criteria(points, image)[0]
    assert plain["condition"] == weighed["condition"]
    assert weighed["pose_m"] == pytest.approx(OBJECTIVES["pose"](image)(points)[0])
    # Dots of 36 mm are known to some thousandths of a pixel.
    for key in ("pose_m", "homography_px", "rotation_deg", "translation_pct"):
        assert 0.002 < weighed[key] / plain[key] < 0.006
    assert setting.noise_words == sentence("noise of", "1 px")
    assert image.noise_words == f"the image noise of 36 mm dots ({sentence('image noise', 0.7, 2, 195)})"
    printed = replace(image, noise=replace(NOISE, print_sigma=1e-4))
    assert printed.noise_words == image.noise_words + sentence("print error", "0.1 mm")


def test_a_dot_that_is_measured_worse_weighs_less(setting):
    # Seen from close by at 70 deg, the far side's dots are smaller. Equal weights believe them too much: the predicted
    # covariance of the weighted estimate is never above that of the estimate with equal weights.
    image = replace(setting, noise=NOISE)
    points = regular_polygon(5, 0.12)
    poses, focal = setting.poses, setting.camera.focal
    jacobian = pose_jacobian(points, poses.rotation, poses.translation, focal)
    plane = (jacobian.reshape(-1, 5, 2, 6)[..., 3:] @ poses.rotation[:, None, :, :2]) * 0.018
    spread = center_covariance(plane, NOISE.image.edge_px, NOISE.image.contrast_to_noise)
    gain = np.linalg.pinv(jacobian).reshape(-1, 6, 5, 2)
    equal = np.einsum("pina,pnab,pjnb->pij", gain, spread, gain)
    weighed = PoseObjective(image).covariance(points[None])[0]
    ratio = rotation_bound(weighed) / rotation_bound(equal)
    assert np.all(ratio <= 1 + 1e-3)
    assert ratio.min() < 0.99
