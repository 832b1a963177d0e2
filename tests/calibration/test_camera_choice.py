"""Camera parameters that left-out photographs justify."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration_sets import CAMERA, simulate
from markergen.calibration.camera_choice import choose_camera
from markergen.calibration.judging import NotJudged
from markergen.model.camera import Distortion

BASE = ("fx", "cx", "cy", "k1", "k2")


def _lens(*coefficients):
    return replace(CAMERA, distortion=Distortion("radtan", coefficients))


def _choice(camera, n=16, photos=12, seed=0):
    made = simulate(n, photos, np.random.default_rng(seed), camera=camera)
    network = made.unknown_camera()
    network = replace(network, cameras=(replace(network.camera, distortion=Distortion()),))
    return choose_camera(network, made.views, np.arange(photos))


def test_the_base_set_is_kept_where_the_lens_needs_no_more():
    result = _choice(CAMERA, seed=1)
    assert result.names == BASE
    assert result.camera.distortion == Distortion("radtan", (0.0,) * 5)
    assert len(result.freedom) == 5
    assert result.freedom.directions[:2, 0].tolist() == [1, 1]
    assert result.tried[0].names == BASE
    assert result.tried[0].taken
    assert not any(item.taken for item in result.tried[1:])
    assert result.tried[0].left_out.rms < min(item.left_out.rms for item in result.tried[1:]) * 1.01


@pytest.mark.parametrize(
    ("camera", "joins", "n"),
    [
        (replace(CAMERA, fy=808.0), ("fy",), 9),
        pytest.param(_lens(-0.1, 0.05, 0.004, -0.003, 0.0), ("p1", "p2"), 16, marks=pytest.mark.long),
        pytest.param(_lens(-0.3, 0.15, 0.0, 0.0, -2.0), ("k3",), 30, marks=pytest.mark.long),
    ],
)
def test_a_parameter_joins_that_left_out_photographs_need(camera, joins, n):
    result = _choice(camera, n)
    assert set(joins) <= set(result.names)
    taken = next(item for item in result.tried[1:] if item.taken)
    assert set(joins) <= set(taken.names)
    assert taken.gain.low > 1


def test_groups_join_together_where_none_does_by_itself():
    choice = _choice(replace(_lens(-0.3, 0.12, 0.004, -0.003, 0.0), fy=797.0), 5, 10)
    assert choice.names == (*BASE, "p1", "p2", "fy")
    assert not any(trial.taken for trial in choice.tried if len(set(trial.names) & {"p1", "k3", "fy"}) == 1)
    joined = next(trial for trial in choice.tried[1:] if trial.taken)
    assert joined.names == choice.names
    assert joined.gain.low > 1


@pytest.mark.long
def test_few_photographs_hold_what_they_do_not_determine():
    result = _choice(CAMERA, 5, 4)
    assert set(result.names) < set(BASE)
    assert "held" in result.notes[0]


def test_too_few_photographs_are_told():
    assert isinstance(_choice(CAMERA, 4, 3), NotJudged)
