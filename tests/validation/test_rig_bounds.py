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
from markergen.validation import bounds
from markergen.validation.metrics import mean_nees_interval
from markergen.validation.rigs.bounds import _budget_at, budget_of, dot_noise, visibility
from markergen.validation.rigs.trials import run_trials
from markergen.validation.rigs.views import RigViews
from markergen.validation.views import SyntheticViews
from tests.support.rigs import cube, plate

AROUND = named_poses("sphere:distance=0.3..0.6m,count=30")
EXACT = ErrorSources(print_sigma=0.0)


def series(rig, errors=EXACT, poses=AROUND):
    return RigViews(rig, PAPER_CAMERA, poses, 0, errors=errors)


def test_a_rig_of_one_marker_has_the_errors_of_that_marker():
    marker, poses = plate(0), named_poses("cone:distance=0.3..0.4m,tilt=10..50,count=5")
    rig, errors = Rig((Plate("a", marker, np.eye(3).tolist(), (0, 0, 0)),)), ErrorSources(1e-4)
    shown = visibility(series(rig, errors, poses))
    assert shown.seen.all()
    expected = bounds.budget_of(SyntheticViews(marker, PAPER_CAMERA, poses, 0, errors=errors))
    for found in (budget_of(shown), budget_of(shown, alone=True)):
        np.testing.assert_allclose(found.total, expected.total, rtol=1e-9)
        np.testing.assert_allclose(found.print, expected.print, rtol=1e-9)


def test_the_information_of_plates_adds_up():
    every = series(cube())
    shown, noise = visibility(every), dot_noise(every)
    joint = budget_of(shown).image
    for pose in np.flatnonzero((shown.of_plates[:, :] != 0).sum(axis=1) > 1)[:8]:
        whole = [shown.dots(pose, k) for k in np.flatnonzero(shown.of_plates[pose] > 3)]
        if sum(map(len, whole)) < shown.seen[pose].sum():
            continue
        parts = [np.linalg.inv(_budget_at(every, pose, dots, noise[pose, dots]).image[0]) for dots in whole]
        np.testing.assert_allclose(np.linalg.inv(joint[pose]), sum(parts), rtol=1e-6)
    assert (budget_of(shown, alone=True).rotation_deg["total"] >= budget_of(shown).rotation_deg["total"]).all()


def test_what_moves_all_plates_together_moves_the_pose():
    rig, motion = cube(), np.random.default_rng(0).normal(size=(6, 6)) * 1e-3
    # A plate at R x + s, moved by (w, dt) of the whole rig, is turned by w and shifted by dt + w x s.
    moved = [
        np.block([[np.eye(3), np.zeros((3, 3))], [-skew(each.translation_vector), np.eye(3)]]) for each in rig.markers
    ]
    relation = np.concatenate(moved) @ motion @ motion.T @ np.concatenate(moved).T
    relation = (relation + relation.T) / 2
    shown = visibility(series(replace(rig, relation=relation.tolist())))
    found = budget_of(shown).print
    for pose in np.flatnonzero(shown.served):
        turn = np.kron(np.eye(2), AROUND.rotation[pose])
        np.testing.assert_allclose(found[pose], turn @ motion @ motion.T @ turn.T, atol=1e-10)


def test_a_dot_counts_where_it_is_whole_and_large_enough():
    rig = cube()
    turn = np.diag([1.0, -1.0, -1.0])
    near, far, aside = (np.array(place) for place in ([0, 0, 0.07], [0, 0, 4.0], [0.12, 0, 0.4]))
    poses = PoseDistribution("", np.stack([turn] * 3), np.stack([near, far, aside]))
    shown = visibility(series(rig, poses=poses))
    # From 3 cm above the upper face: what is in the image is within 12 x 9 mm; from 4 m: dots of 2.4 px.
    assert not shown.seen[:2].any()
    assert shown.served.tolist() == [False, False, True]
    pixels = PAPER_CAMERA.project(rig.xyz, poses.rotation[2:], poses.translation[2:])[0]
    top = rig.owner == 4
    # At a depth of 36 cm, parallel to the image.
    radius = 800 * 0.006 / 0.36
    expected = pixels[top, 0] + radius < 639.5
    assert 0 < expected.sum() < 6
    assert (shown.seen[2, top] == expected).all()
    assert np.isinf(budget_of(shown).total[:2]).all()


def test_trials_reach_the_bound_and_one_plate_alone_does_not():
    shown = visibility(series(cube()))
    errors = run_trials(shown, 0.1, 60, 0, 1)
    several = shown.served & (shown.plates > 1)
    joint, alone = errors["joint"].summary(several), errors["alone"].summary(several)
    assert joint["failure_rate"] == joint["flip_rate"] == 0
    low, high = mean_nees_interval(60 * int(several.sum()))
    assert low <= joint["nees"] <= high
    share = (errors["joint"].rotation_deg[several] / errors["joint"].bound_deg[several, None]) ** 2
    # Three degrees of freedom, of which one may make nearly all: a standard deviation of at most 1.4.
    assert share.mean() == pytest.approx(1, abs=4 * 1.4 / np.sqrt(share.size))
    assert alone["bound"]["rotation_deg"] > 1.3 * joint["bound"]["rotation_deg"]
    assert alone["rotation_deg"]["rms"] > 1.3 * joint["rotation_deg"]["rms"]
