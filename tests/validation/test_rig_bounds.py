"""What poses show of a rig, and the errors to first order, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import skew
from markergen.model.body import Plate
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution, named_poses
from markergen.model.rig import Rig
from markergen.validation.bounds import budget_of, image_covariance, rig_budget
from markergen.validation.metrics import mean_nees_interval
from markergen.validation.trials import all_errors, pose_summary, rig_experiments
from markergen.validation.views import SyntheticViews
from tests.support.rigs import cube, plate

AROUND = named_poses("sphere:distance=0.3..0.6m,count=30")
EXACT = ErrorSources(print_sigma=0.0)


def series(rig, errors=EXACT, poses=AROUND):
    return SyntheticViews(rig, PAPER_CAMERA, poses, 0, errors=errors)


def test_a_rig_of_one_marker_has_the_errors_of_that_marker():
    marker, poses = plate(0), named_poses("cone:distance=0.3..0.4m,tilt=10..50,count=5")
    rig, errors = Rig((Plate("a", marker, np.eye(3).tolist(), (0, 0, 0)),)), ErrorSources(1e-4)
    every = series(rig, errors, poses)
    assert every.coverage.seen.all()
    expected = budget_of(series(marker, errors, poses))
    for result in (budget_of(every), budget_of(every, alone=True)):
        np.testing.assert_allclose(result.total, expected.total, rtol=1e-9)
        np.testing.assert_allclose(result.print, expected.print, rtol=1e-9)


def test_the_information_of_plates_adds_up():
    every = series(cube())
    printed, noise = every.coverage, image_covariance(every.marker, PAPER_CAMERA, AROUND, every.optics)
    joint = budget_of(every)
    for pose in np.flatnonzero(printed.plates > 1)[:8]:
        on_plates = [dots[printed.seen[pose, dots]] for dots in printed.on_plates]
        whole = [dots for dots in on_plates if len(dots) > 3]
        if sum(map(len, whole)) < printed.seen[pose].sum():
            continue
        parts = [np.linalg.inv(rig_budget(every, pose, dots, noise[pose, dots]).image[0]) for dots in whole]
        np.testing.assert_allclose(np.linalg.inv(joint.image[pose]), sum(parts), rtol=1e-6)
    assert (budget_of(every, alone=True).rotation_deg["total"] >= joint.rotation_deg["total"]).all()


def test_what_moves_all_plates_together_moves_the_pose():
    rig, motion = cube(), np.random.default_rng(0).normal(size=(6, 6)) * 1e-3
    # A plate at R x + s, moved by (w, dt) of the whole rig, is turned by w and shifted by dt + w x s.
    moved = [
        np.block([[np.eye(3), np.zeros((3, 3))], [-skew(marker.translation_vector), np.eye(3)]])
        for marker in rig.markers
    ]
    relation = np.concatenate(moved) @ motion @ motion.T @ np.concatenate(moved).T
    relation = (relation + relation.T) / 2
    every = series(replace(rig, relation=relation.tolist()))
    results = budget_of(every).print
    for pose in np.flatnonzero(every.coverage.served):
        rotation = np.kron(np.eye(2), AROUND.rotation[pose])
        np.testing.assert_allclose(results[pose], rotation @ motion @ motion.T @ rotation.T, atol=1e-10)


def test_a_dot_counts_where_it_is_whole_and_large_enough():
    rig = cube()
    rotation = np.diag([1.0, -1.0, -1.0])
    near, far, aside = (np.array(place) for place in ([0, 0, 0.07], [0, 0, 4.0], [0.12, 0, 0.4]))
    poses = PoseDistribution("", np.stack([rotation] * 3), np.stack([near, far, aside]))
    every = series(rig, poses=poses)
    printed = every.coverage
    # From 3 cm above the upper face: what is in the image is within 12 x 9 mm; from 4 m: dots of 2.4 px.
    assert not printed.seen[:2].any()
    assert printed.served.tolist() == [False, False, True]
    pixels = PAPER_CAMERA.project(rig.xyz, poses.rotation[2:], poses.translation[2:])[0]
    top = rig.owner == 4
    # At a depth of 36 cm, parallel to the image.
    radius = 800 * 0.006 / 0.36
    expected = pixels[top, 0] + radius < 639.5
    assert 0 < expected.sum() < 6
    assert (printed.seen[2, top] == expected).all()
    assert np.isinf(budget_of(every).total[:2]).all()


def test_trials_reach_the_bound_and_one_plate_alone_does_not():
    every = series(cube())
    several = every.coverage.served & (every.coverage.plates > 1)
    experiments = rig_experiments(every, 0.1, 60)
    errors = {name: all_errors(experiment, 1)["lm"] for name, experiment in experiments.items()}
    bounds = {name: experiment.bounds for name, experiment in experiments.items()}
    joint, alone = (pose_summary(bounds[name], errors[name], several) for name in ("lm", "lm_alone"))
    assert joint["failure_rate"] == joint["flip_rate"] == 0
    low, high = mean_nees_interval(60 * int(several.sum()))
    assert low <= errors["lm"].nees[several].mean() <= high
    share = (errors["lm"].rotation_deg[several] / bounds["lm"].rotation_deg[several, None]) ** 2
    # Three degrees of freedom, of which one may make nearly all: a standard deviation of at most 1.4.
    assert share.mean() == pytest.approx(1, abs=4 * 1.4 / np.sqrt(share.size))
    least = bounds["lm"].summary(several)["rotation_deg"]
    assert bounds["lm_alone"].summary(several)["rotation_deg"] > 1.3 * least
    assert alone["rotation_deg"]["rms"] > 1.3 * joint["rotation_deg"]["rms"]
