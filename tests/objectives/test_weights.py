from dataclasses import replace

import numpy as np
import pytest

from markergen.maths.dot_noise import center_covariance
from markergen.maths.information import covariance, pose_jacobian, rotation_bound
from markergen.maths.projection import project
from markergen.model.image_noise import ImageNoise
from markergen.objectives import OBJECTIVES
from markergen.objectives.aggregates import AGGREGATES
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.objectives.pose import PoseObjective
from markergen.objectives.weights import DotNoise

WEIGHING = ("homography", "pose", "rotation", "translation")
NOISE = DotNoise(0.036)


@pytest.fixture(scope="module")
def image(setting):
    return replace(setting, noise=NOISE)


@pytest.mark.parametrize("name", WEIGHING)
@pytest.mark.parametrize("aggregate", list(AGGREGATES))
def test_gradient_agrees_with_differences(image, name, aggregate):
    objective = OBJECTIVES[name](image, aggregate)
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
    found = PoseObjective(image).covariance(points[None])[0]
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
        ratio = rotation_bound(found[index]) / rotation_bound(covariance(total))
        assert ratio == pytest.approx(1.0, abs=1e-3)


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
    assert setting.noise_words == "image noise of 1 px"
    assert image.noise_words == ("the image noise of 36 mm dots (blur 0.7 px, noise 2 and contrast 195 grey levels)")


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
