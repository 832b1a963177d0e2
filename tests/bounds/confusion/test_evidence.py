"""The evidence between labelings: as often undecided as simulated, and as large as the detector's in rendered views."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.bounds.confusion import evidence
from markergen.bounds.confusion.perspective import find_rivals, label_safety
from markergen.bounds.confusion.rival_fits import fit_poses, seen_layout
from markergen.detect import Detector
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature
from markergen.model.poses import named_poses
from markergen.objectives import Setting
from markergen.render import DEFAULT_OPTICS, render_view

POSES = named_poses("cone:distance=0.6..1.5,tilt=0..65,count=12,seed=3")


def almost_regular(make_marker, n, jitter, seed):
    """Equal dots whose layout nearly repeats under a turn."""
    angle = 2 * np.pi * np.arange(n) / n
    points = 0.12 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points += np.random.default_rng(seed).normal(scale=jitter, size=points.shape)
    marker = make_marker(points - points.mean(axis=0), 0.2, 0.03)
    disks = tuple(replace(point, feature=Feature(point.feature.diameter)) for point in marker.control_points)
    return replace(marker, control_points=disks)


def nearest(marker, pose):
    scene = seen_layout(marker.xyz, np.zeros(len(marker), dtype=np.intp), PAPER_CAMERA, POSES)
    rivals = find_rivals(scene, np.array([pose]))
    return scene, rivals.take(np.array([rivals.distance.argmin()]))


def test_it_grows_with_the_distance_and_falls_with_noise():
    distance = np.array([0.0, 0.3, 0.5, 1.0, 2.0, 5.0, np.inf])
    view = 6, np.full(7, 600.0), 0.13
    quiet, loud = (evidence.margin(distance, *view, sigma) for sigma in (0.05, 0.2))
    assert quiet[0] == loud[0] == 0
    assert (np.diff(quiet) > 0).all()
    assert (quiet[1:-1] > loud[1:-1]).all()
    assert quiet[-1] == np.inf
    undecided = evidence.undecided(distance, *view, 0.05)
    assert undecided[0] == pytest.approx(1)
    assert undecided[-1] == 0
    assert (np.diff(undecided) <= 0).all()
    # Without noise, there is no doubt.
    exact = evidence.margin(distance, *view, 0.0) < evidence.DECIDED
    np.testing.assert_allclose(evidence.undecided(distance, *view, 0.0), exact, atol=1e-9)


def test_fewer_than_four_dots_fit_with_any_labels():
    view = np.array([1.0, np.inf]), 3, np.full(2, 600.0), 0.13, 0.2
    np.testing.assert_array_equal(evidence.margin(*view), 0)
    np.testing.assert_array_equal(evidence.undecided(*view), 1)


@pytest.mark.parametrize(
    ("n", "jitter", "sigma"), [(5, 0.001, 0.16), (6, 0.0006, 0.15), (8, 0.0006, 0.2), (12, 0.0006, 0.25)]
)
def test_noise_leaves_labels_undecided_as_often_as_stated(make_marker, n, jitter, sigma):
    scene, rival = nearest(almost_regular(make_marker, n, jitter, 1), 4)
    rng, trials = np.random.default_rng(0), 400
    noisy = scene.images[4] + rng.normal(scale=sigma, size=(trials, n, 2))
    squares = []
    for labeling, rotation, translation in (
        (scene.truth, POSES.rotation[4], POSES.translation[4]),
        (rival.labeling[0], rival.rotation[0], rival.translation[0]),
    ):
        starts = np.tile(rotation, (trials, 1, 1)), np.tile(translation, (trials, 1))
        squares.append(fit_poses(scene.points, noisy[:, labeling], PAPER_CAMERA, *starts)[2] ** 2)
    middle = scene.points.mean(axis=0)
    scale = PAPER_CAMERA.fx / (POSES.rotation[4] @ middle + POSES.translation[4])[2]
    variances = evidence._variances(np.full(trials, scale), np.linalg.norm(scene.points - middle, axis=-1).max())
    truth, other = (evidence._log_likelihood(square, n, variances) for square in squares)
    share = np.mean(truth - other < evidence.DECIDED)
    (expected,), (stated,) = scene.judged(rival.distance, rival.pose, sigma)
    assert 0.05 < stated < 0.95
    # Four standard errors of the trials; 2,000 of them differed by up to 0.04, as poses are not linear.
    assert abs(share - stated) < 0.05 + 4 * np.sqrt(stated * (1 - stated) / trials)
    assert np.mean(truth - other) == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize("print_sigma", [0.0, 1e-4])
def test_the_detector_has_that_evidence(make_marker, monkeypatch, print_sigma):
    """The dots' places have errors of 0.004 px here, and the detector knows."""
    monkeypatch.setattr(evidence, "CENTER_PX", 0.004)
    monkeypatch.setattr(evidence, "PRINT_SIGMA", print_sigma)
    rng, rows = np.random.default_rng(0), []
    for n, jitter in ((5, 0.0002), (5, 0.0004), (5, 0.002), (8, 0.002)):
        for seed in range(4):
            marker = almost_regular(make_marker, n, jitter, seed)
            pose = 3 * seed
            rotation, translation = POSES.rotation[pose], POSES.translation[pose]
            scene, rival = nearest(marker, pose)
            image = render_view(marker, PAPER_CAMERA, rotation, translation, DEFAULT_OPTICS, rng)
            (result,) = Detector(marker, PAPER_CAMERA, print_sigma=print_sigma)(image)
            expected = scene.judged(rival.distance, rival.pose, 0.004)[0][0]
            rows.append((expected, result.finding.margin))
            assert result.ok == (result.finding.margin >= evidence.DECIDED)
    expected, measured = np.array(rows).T
    assert measured[:4].min() < evidence.DECIDED < measured[4:8].max()
    # The more another labeling changes the pose, the more outlines tell, too: at most a quarter here.
    np.testing.assert_allclose(measured[:8], expected[:8], atol=0.3)
    np.testing.assert_allclose(measured[8:], expected[8:], rtol=0.25)


def test_two_labelings_that_differ_little_are_decided(make_marker):
    """0.17 px of noise, and at least 0.6 px by the wrong labels, at 70 degrees."""
    setting = Setting(None, PAPER_CAMERA, named_poses("cone:distance=0.6..1.5,tilt=70..70,count=24,seed=0"))
    for seed in range(20):
        marker = almost_regular(make_marker, 8, 0.0025, seed)
        safety = label_safety(marker, setting, noise_px=0.17)
        residual = 2 * safety.least
        if residual > 0.57:
            break
    assert 0.57 < residual < 1
    assert safety.is_decided
    assert safety.margin.min() > evidence.DECIDED
