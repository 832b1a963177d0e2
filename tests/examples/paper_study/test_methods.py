import numpy as np
import pytest
from markergen_paper.methods import Decomposition, FromDlt, FromPoor, FromTruth, Harker, OpenCv, PlainDlt
from markergen_paper.options import REGION, poses_of

from markergen.estimators import ESTIMATORS, Correspondences
from markergen.maths.dlt import dlt_matrix, normalization
from markergen.maths.projection import apply_homography
from markergen.model.camera import PAPER_CAMERA

POSE = poses_of([205])


def batch(n, noise_px, trials=6):
    rng = np.random.default_rng(n)
    layouts = REGION.sample(trials, n, rng)
    exact = PAPER_CAMERA.project(layouts, POSE.rotation, POSE.translation)[:, 0]
    return Correspondences(layouts, exact + noise_px * rng.standard_normal(exact.shape), PAPER_CAMERA)


@pytest.mark.parametrize("n", [4, 7])
@pytest.mark.parametrize("estimator", [Harker(), OpenCv(), PlainDlt()], ids=lambda each: each.name)
def test_without_noise_homographies_map_every_point(estimator, n):
    seen = batch(n, 0.0)
    homography = seen.once(estimator)
    # OpenCV converts points to single precision.
    assert np.abs(apply_homography(homography, seen.object_points) - seen.image_points).max() < 1e-3


def test_harkers_last_row_is_the_eigenvector_of_what_the_others_leave():
    """The first six unknowns eliminated from A'A of normalized points by a Schur complement."""
    seen = batch(7, 2.0)
    homography = seen.once(Harker())
    for points, image, result in zip(seen.object_points, seen.image_points, homography, strict=True):
        (center, scale), (image_center, image_scale) = normalization(points), normalization(image)
        a = dlt_matrix((points - center) * scale, (image - image_center) * image_scale)
        normal = a.T @ a
        inverse = np.linalg.solve(normal[:6, :6], normal[:6, 6:])
        last = np.linalg.eigh(normal[6:, 6:] - normal[6:, :6] @ inverse)[1][:, 0]
        h = np.concatenate([-inverse @ last, last]).reshape(3, 3)
        expected = apply_homography(h, (points - center) * scale) / image_scale + image_center
        np.testing.assert_allclose(apply_homography(result, points), expected, atol=1e-6)


def test_four_points_have_one_homography():
    seen = batch(4, 2.0)
    dlt = seen.once(ESTIMATORS["dlt"])
    for estimator in (Harker(), PlainDlt()):
        np.testing.assert_allclose(seen.once(estimator) / dlt, 1, atol=1e-6)


@pytest.mark.parametrize(
    "estimator",
    [Decomposition(), FromDlt(), *(start(POSE.rotation, POSE.translation) for start in (FromTruth, FromPoor))],
)
def test_without_noise_poses_are_true(estimator):
    rotation, translation = batch(6, 0.0).once(estimator).best
    np.testing.assert_allclose(rotation, np.broadcast_to(POSE.rotation, rotation.shape), atol=1e-9)
    np.testing.assert_allclose(translation, np.broadcast_to(POSE.translation, translation.shape), atol=1e-9)


def test_from_the_truth_levenberg_marquardt_fits_no_worse_than_the_truth():
    seen = batch(6, 2.0)
    truth = (np.broadcast_to(item, (6, *item.shape[1:])) for item in (POSE.rotation, POSE.translation))
    error = seen.reprojection_error(*seen.once(FromTruth(POSE.rotation, POSE.translation)).best)
    assert np.all(error <= seen.reprojection_error(*truth))
