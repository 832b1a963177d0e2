"""What a report says of its subject: errors to expect by distance and tilt, and how large the dots should be."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint
from markergen.model.poses import PoseDistribution
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import rms
from markergen.validation.report.subject import advise, bound, pose_bins, short_axes
from markergen.validation.sentences import advice_sentences


def test_cells_of_the_table_make_up_the_whole(pentagon, few):
    result = bound(pentagon, few, 0.2)
    table = pose_bins(result)
    assert len(table) == 20
    whole = np.average([item.rotation_deg**2 for item in table], weights=[item.poses.sum() for item in table])
    assert np.sqrt(whole) == pytest.approx(rms(result.rotation_deg))
    reference = pose_bounds(pentagon.xyz, few.camera, few.poses, 0.2)
    np.testing.assert_allclose(result.rotation_deg, reference.rotation_deg)
    np.testing.assert_allclose(result.translation_pct, reference.translation_pct)


def test_short_axis_at_the_origin_is_the_formula(make_marker, setting):
    # d f cos(tilt)/z for a circle much smaller than its distance; the exact ellipse differs in second order.
    marker = make_marker(np.zeros((1, 2)), 0.15, 0.01)
    poses = setting.poses
    formula = 0.01 * 800 * poses.cos_tilt / poses.translation[:, 2]
    np.testing.assert_allclose(short_axes(marker, setting.camera, poses)[:, 0], formula, rtol=1e-3)


def test_short_axis_of_a_raised_dot_is_that_of_a_nearer_one(make_marker, setting):
    flat = make_marker(np.zeros((1, 2)), 0.15, 0.01)
    raised = replace(flat, control_points=(ControlPoint(0, 0.0, 0.0, 0.05, Feature(0.01)),))
    frontal = PoseDistribution("one", setting.poses.rotation[[0]], setting.poses.translation[[0]])
    nearer = PoseDistribution("one", frontal.rotation, frontal.translation - [0, 0, 0.05])
    seen = short_axes(raised, setting.camera, frontal)
    np.testing.assert_allclose(seen, short_axes(flat, setting.camera, nearer), rtol=1e-12)


def test_advice_reaches_what_it_promises(pentagon, setting):
    result = advise(pentagon, setting.camera, setting.poses)
    axes = short_axes(pentagon, setting.camera, setting.poses).min(axis=1)
    assert result.worst.thinnest_px == axes.min()
    assert setting.poses.polar_angle_deg[result.worst.pose] == pytest.approx(70)
    # 36 mm at 1.5 m and 70 deg, seen with f = 800 px.
    assert result.worst.center_px == pytest.approx(36e-3 * 800 * np.cos(np.deg2rad(70)) / 1.5, rel=2e-3)
    for wanted, share in ((result.worst, 1.0), (result.most, 0.94)):
        scale = wanted.diameter / pentagon.dot_diameter
        larger = short_axes(pentagon, setting.camera, setting.poses, scale).min(axis=1)
        smaller = short_axes(pentagon, setting.camera, setting.poses, scale - 0.2e-3 / pentagon.dot_diameter).min(
            axis=1
        )
        assert np.mean(larger >= 8) >= share
        assert np.mean(smaller >= 8) < share


def test_advice_in_words(pentagon, make_ngon, setting):
    message = advice_sentences(advise(pentagon, setting.camera, setting.poses), pentagon, setting.poses)
    assert message[0].startswith(sentence("smallest dot", "1.5 m", "70 deg", "36 mm", "5.6 px"))
    assert "use 51.2 mm for" in message[0]
    assert "--dot 51.2mm" in message[-1]
    many = make_ngon(30, 0.15, 0.02)
    assert "whole marker to 2" in advice_sentences(advise(many, setting.camera, setting.poses), many, setting.poses)[-1]
    large = make_ngon(4, 0.15, 0.06)
    (only,) = advice_sentences(advise(large, setting.camera, setting.poses), large, setting.poses)
    assert "large enough" in only
