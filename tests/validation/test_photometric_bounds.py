"""The bound from all grey levels, proved by line integrals over edges and by the bound of a dot."""

from functools import partial

import numpy as np
import pytest

from markergen.maths.dot_crlb import dot_covariance
from markergen.maths.information import apply_pose_step, pose_jacobian
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import PoseDistribution, paper
from markergen.objectives.observation import lens_blocks
from markergen.render import Optics, Patch, circle, expected_levels, render_patches, seen_patches
from markergen.validation import bounds as module
from markergen.validation.bounds import image_covariance, photometric_bounds

OPTICS = Optics()
LENS = Camera(640, 480, 800, 800, 320, 240, Distortion("radtan", (-0.2, 0.1, 0.001, 0.0)))
SQUARE = 0.1 * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])


def taken(*indices):
    return paper().taken(np.array(indices), 0)


def square(_rotation, _translation):
    return [Patch((circle(np.zeros(3), 0.15),), 1.0), Patch((SQUARE,), 0.0)]


def edge_information(outline, camera, rotation, translation, optics):
    """Sum over edges of A^2/(2 sqrt(pi) s sigma^2) times the integral of g g' along them, with g = normal' J."""
    share = (np.arange(400) + 0.5) / 400
    matrix = np.zeros((6, 6))
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        points = start + share[:, None] * (end - start)
        jacobian = pose_jacobian(points, rotation[None], translation[None], camera.focal).reshape(-1, 2, 6)
        lens = lens_blocks(camera, perspective(to_camera(points, rotation[None], translation[None])))
        jacobian = lens.reshape(-1, 2, 2) @ jacobian
        pixels = camera.project(points, rotation[None], translation[None])[0]
        along = np.gradient(pixels, axis=0)
        length = np.linalg.norm(along, axis=-1)
        normal = np.stack([-along[:, 1], along[:, 0]], axis=-1) / length[:, None]
        g = np.einsum("mi,mik->mk", normal, jacobian)
        matrix += (g * length[:, None]).T @ g
    level = np.array([optics.dark, optics.light])
    return matrix * np.ptp(level) ** 2 / (2 * np.sqrt(np.pi) * optics.edge_blur * optics.grey_noise(level.mean()) ** 2)


@pytest.mark.parametrize("camera", [PAPER_CAMERA, LENS], ids=["pinhole", "lens"])
def test_a_square_is_known_as_well_as_its_edges(camera):
    poses = taken(47, 129, 230, 333)
    result = photometric_bounds(square, camera, poses, OPTICS)
    for k in range(len(poses)):
        expected = edge_information(SQUARE, camera, poses.rotation[k], poses.translation[k], OPTICS)
        # The energy of an edge's slope is that of the Gaussian within 5 %; at each corner 1 px of edge is missing.
        inverse = np.linalg.inv(expected)
        for part in (slice(0, 3), slice(3, 6)):
            theirs, ours = (np.trace(item[part, part]) for item in (inverse, np.linalg.inv(result.information[k])))
            assert ours == pytest.approx(theirs, rel=0.08)


def test_a_dot_from_the_front_is_known_as_well_as_its_center():
    """For shifts alone: by symmetry neither its size nor its shape says anything about its place."""
    radius, distance = 0.02, 1.0

    def dot(_rotation, _translation):
        return [Patch((circle(np.zeros(3), radius),), 0.0)]

    poses = PoseDistribution("front", np.diag([1.0, -1.0, -1.0])[None], np.array([[0.0, 0.0, distance]]))
    result = photometric_bounds(dot, PAPER_CAMERA, poses, OPTICS).information[0]
    scale = PAPER_CAMERA.fx / distance
    noise = OPTICS.grey_noise(127.0)
    least = dot_covariance(
        np.full(2, radius * scale), np.array(0.0), OPTICS.edge_blur, OPTICS.light - OPTICS.dark, noise
    )
    # As above: 5 % of the slope's energy.
    assert np.diag(result)[3:5] / scale**2 == pytest.approx(1 / np.diag(least), rel=0.05)


def test_nothing_beats_it_that_looks_at_centers_only(pentagon):
    poses = taken(47, 129, 230)
    all_levels = photometric_bounds(partial(seen_patches, pentagon, PAPER_CAMERA), PAPER_CAMERA, poses, OPTICS)
    centers = image_covariance(pentagon, PAPER_CAMERA, poses, OPTICS)
    for k in range(len(poses)):
        jacobian = pose_jacobian(pentagon.xyz, poses.rotation[[k]], poses.translation[[k]], PAPER_CAMERA.focal).reshape(
            -1, 2, 6
        )
        reference = np.einsum("nik,nij,njl->kl", jacobian, np.linalg.inv(centers[k]), jacobian)
        more = np.linalg.eigvalsh(all_levels.information[k] - reference) / np.linalg.eigvalsh(reference)
        # Sizes and shapes add something in every direction, up to the 5 % of the slope's energy.
        assert more.min() > -0.05


@pytest.mark.long
def test_the_best_linear_estimate_from_noisy_images_has_this_covariance():
    """400 images of 8 bits: the NEES of (sum of g (level - mean)/sigma^2) times the bound's covariance is 6."""
    poses = taken(129)
    rotation, translation = poses.rotation[0], poses.translation[0]
    result = photometric_bounds(square, PAPER_CAMERA, poses, OPTICS)
    patches = square(rotation, translation)
    mean = expected_levels(patches, PAPER_CAMERA, rotation, translation, OPTICS)
    covariance = np.linalg.inv(result.information[0])
    steps = np.diag(0.2 * np.sqrt(np.diag(covariance)))
    gradient = []
    for k in range(6):
        ends = [
            expected_levels(patches, PAPER_CAMERA, *(item[0] for item in moved), OPTICS)
            for moved in (apply_pose_step(rotation[None], translation[None], s * steps[[k]]) for s in (1, -1))
        ]
        gradient.append((ends[0] - ends[1]).astype(float) / (2 * steps[k, k]))
    used = np.any(gradient, axis=0)
    weights = np.array([item[used] for item in gradient]) / OPTICS.grey_noise(mean[used]) ** 2
    rng = np.random.default_rng(5)
    images = (render_patches(patches, PAPER_CAMERA, rotation, translation, OPTICS, rng)[used] for _ in range(400))
    errors = np.array([covariance @ (weights @ (image - mean[used])) for image in images])
    nees = np.einsum("ti,ij,tj->t", errors, result.information[0], errors)
    # Chi-square with 6 degrees of freedom: 12 variance, so 3 standard deviations of the mean are 0.52.
    assert nees.mean() == pytest.approx(6, abs=0.52)


def test_half_the_step_changes_nothing(pentagon, monkeypatch):
    poses, scene = taken(3, 333), partial(seen_patches, pentagon, PAPER_CAMERA)
    whole = photometric_bounds(scene, PAPER_CAMERA, poses, OPTICS)
    monkeypatch.setattr(module, "STEP_PX", module.STEP_PX / 2)
    half = photometric_bounds(scene, PAPER_CAMERA, poses, OPTICS)
    assert half.rotation_deg == pytest.approx(whole.rotation_deg, rel=5e-4)
    assert half.translation_pct == pytest.approx(whole.translation_pct, rel=5e-4)


def test_it_goes_with_contrast_and_noise():
    poses = taken(129)
    plain, noisy, faint = (
        photometric_bounds(square, PAPER_CAMERA, poses, optics).rotation_deg[0]
        for optics in (Optics(bits=16), Optics(noise_grey=4, bits=16), Optics(dark=127.5, bits=16))
    )
    assert noisy / plain == pytest.approx(2, rel=1e-3)
    assert faint / plain == pytest.approx(2, rel=1e-3)


@pytest.mark.long
def test_values_of_the_default_marker_in_the_paper_s_poses(pentagon):
    """A twentieth of the poses; others computed 0.0098 deg for another choice of 20."""
    poses = taken(*range(10, 400, 20))
    result = photometric_bounds(partial(seen_patches, pentagon, PAPER_CAMERA), PAPER_CAMERA, poses, OPTICS)
    assert np.sqrt(np.mean(result.rotation_deg**2)) == pytest.approx(0.0098, rel=0.05)
