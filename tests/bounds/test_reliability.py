"""Redundancy, detectable blunders and their effect, against a simulated adjustment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, ncx2

from markergen.bounds.dot_covariances import (
    dot_covariances,
    image_jacobian,
    image_slopes,
    reliability,
    reliability_table,
)
from markergen.maths.reliability import POWER, RISK, noncentrality
from markergen.model.spec import ImageNoise, Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import regular_polygon
from markergen.objectives.observation import DotNoise
from markergen.optimize.design import design


@pytest.fixture(scope="module")
def one_pose(setting):
    poses = setting.poses.taken(np.array([130]), 0)
    return Setting(setting.boundary, setting.camera, poses, DotNoise(0.03, print_sigma=1e-4))


def test_the_noncentrality_has_the_risk_and_power():
    threshold = chi2.isf(RISK, 2)
    assert ncx2.sf(threshold, 2, noncentrality()) == pytest.approx(POWER, abs=1e-6)


def test_a_blunder_of_the_size_is_noticed_with_the_power(one_pose):
    """Displaces a dot in an adjustment by least squares, with the noise of images and print, thousands of times."""
    rng = np.random.default_rng(1)
    points = regular_polygon(6, 0.12) + rng.normal(scale=0.01, size=(6, 2))
    dots = reliability(points, one_pose)
    assert sum(dot.redundancy for dot in dots) == pytest.approx(len(points) - 3, rel=1e-3)
    camera, poses = one_pose.camera, one_pose.poses
    jacobian = image_jacobian(points, camera, poses)
    slopes = image_slopes(jacobian, poses)[0]
    spread = dot_covariances(slopes[None], 0.03, ImageNoise(), 1e-4)[0]
    jacobian = jacobian[0]
    weight = np.linalg.inv(spread)
    normal = np.linalg.inv(np.einsum("nik,nij,njl->kl", jacobian, weight, jacobian))
    cofactor = spread - jacobian @ normal @ jacobian.swapaxes(-1, -2)
    roots = np.linalg.cholesky(spread)
    for index in (0, 3):
        best = 1.0
        for angle in np.linspace(0, np.pi, 61):
            blunder = slopes[index] @ [np.cos(angle), np.sin(angle)] * dots[index].blunder_m
            square = blunder @ weight[index] @ cofactor[index] @ weight[index] @ blunder
            best = min(best, square / noncentrality())
        # In the worst direction it is noticed with just the power, in all others with more.
        assert best == pytest.approx(1.0, abs=5e-3)
    draws = (roots @ rng.normal(size=(4000, 6, 2, 1)))[..., 0]
    vector = worst_direction(slopes[0], weight[0], cofactor[0]) * dots[0].blunder_m
    draws[:, 0] += slopes[0] @ vector
    pose = np.einsum("kl,nil,nij,bnj->bk", normal, jacobian, weight, draws)
    residuals = draws - np.einsum("nik,bk->bni", jacobian, pose)
    inverse = np.linalg.inv(cofactor[0])
    statistic = np.einsum("bi,ij,bj->b", residuals[:, 0], inverse, residuals[:, 0])
    assert np.mean(statistic > chi2.isf(RISK, 2)) == pytest.approx(POWER, abs=0.03)
    moved = pose.mean(axis=0)
    assert np.rad2deg(np.linalg.norm(moved[:3])) <= dots[0].rotation_deg * 1.05
    assert np.linalg.norm(moved[3:]) <= dots[0].translation_m * 1.05


def worst_direction(slopes, weight, cofactor):
    return np.linalg.eigh(slopes.T @ weight @ cofactor @ weight @ slopes)[1][:, 0]


def test_the_objective_is_the_largest_of_them(one_pose):
    points = np.random.default_rng(3).uniform(-0.1, 0.1, (6, 2))
    worst = max(dot.blunder_m for dot in reliability(points, one_pose))
    assert OBJECTIVES["blunder"](one_pose)(points[None])[0] == pytest.approx(worst, rel=1e-6)


def test_three_dots_control_nothing(one_pose):
    dots = reliability(regular_polygon(3, 0.1), one_pose)
    assert [dot.redundancy for dot in dots] == pytest.approx([0, 0, 0], abs=1e-6)
    assert all(np.isinf(dot.blunder_m) for dot in dots)
    assert len(reliability_table(dots, "noise").rows) == 3


@pytest.mark.long
def test_a_bound_on_blunders_is_kept():
    spec = Spec(
        n=6, dot=0.02, noise_model="image", print_sigma=1e-4, restarts=1, poses="cone:distance=0.6..1.2,count=24"
    )
    free = design(spec)
    worst = max(dot.blunder_m for dot in free.reliability)
    bound = 1e3 * worst * 0.97
    kept = design(replace(spec, objective=f"pose; blunder < {bound:.4f} mm"))
    assert max(dot.blunder_m for dot in kept.reliability) <= worst * 0.98
    assert kept.value >= free.value * (1 - 1e-6)
