"""The report says what the results say: the answer, its reasons, and how large the dots should be."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.maths.information import rotation_bound
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint
from markergen.model.poses import PoseDistribution
from markergen.validation.bounds import pose_bounds
from markergen.validation.report import overview, words
from markergen.validation.report.advice import advise, sentences, short_axes
from markergen.validation.report.expected import bound, cells, rms


def test_answer_is_the_budget_at_the_far_and_steep_end(subject, budget, few):
    there = (few.poses.distance > 1.49) & (few.poses.polar_angle_deg > 69)
    deg = rms(np.rad2deg(rotation_bound(budget.total))[there])
    mm = rms(1e3 * np.sqrt(np.trace(budget.total[there, 3:, 3:], axis1=1, axis2=2)))
    first = overview.answer(subject).sentences[0]
    assert first == f"At 1.5 m and 70 deg expect {words.number(deg, 2)} deg and {words.number(mm, 2)} mm RMS."


def test_cells_of_the_table_make_up_the_whole(pentagon, few):
    found = bound(pentagon, few, 0.2)
    table = cells(found)
    assert len(table) == 20
    whole = np.average([cell.rotation_deg**2 for cell in table], weights=[cell.poses.sum() for cell in table])
    assert np.sqrt(whole) == pytest.approx(rms(found.rotation_deg))
    reference = pose_bounds(pentagon.xyz, few.camera, few.poses, 0.2)
    np.testing.assert_allclose(found.rotation_deg, reference.rotation_deg)
    np.testing.assert_allclose(found.translation_pct, reference.translation_pct)


@pytest.mark.parametrize(
    ("source", "word"), [("image", "noise of the image"), ("print", "print"), ("camera", "calibration")]
)
def test_what_limits_the_pose_is_the_largest_source(source, word):
    parts = {"image": 0.1, "print": 0.1, "camera": 0.1} | {source: 1.0}
    said = words.limits({"rotation_deg": parts, "translation_pct": parts})
    assert said[0].startswith(f"What limits the rotation and the translation is the {word}") or word in said[0]
    assert "next to nothing" in said[0]
    others = [name for name in words.REMEDIES if name != source]
    assert not any(words.REMEDIES[name] in line for name in others for line in said)


def test_two_sources_are_told_apart_and_an_even_share_is_no_reason_to_stop():
    said = words.limits(
        {"rotation_deg": {"image": 1.0, "print": 0.9}, "translation_pct": {"image": 0.1, "print": 0.2, "camera": None}}
    )
    assert [line.split(" is ")[0] for line in said[:2]] == ["What limits the rotation", "What limits the translation"]
    assert "next to nothing" not in said[0]
    assert "--camera-covariance" in said[2]


def test_shares_of_the_variance_add_up():
    parts = words.shares({"rotation_deg": {"image": 3.0, "print": 4.0, "camera": 0.0, "total": 5.0}}, "rotation_deg")
    assert parts == pytest.approx({"image": 0.36, "print": 0.64, "camera": 0.0})
    assert words.in_words(parts) == "print 64 %, image noise 36 %, calibration 0 %"
    assert words.shares({"rotation_deg": dict.fromkeys(parts, 0.0)}, "rotation_deg") == {}


def test_command_makes_the_results_again(subject, results):
    assert overview.command(subject) == (
        "markergen validate marker.json --poses paper --runs 3 --noise 0.2 --views 160 --print-sigma 0.1mm "
        "--camera-covariance FILE --seed 0 --json results.json --report report.html"
    )
    views = {
        **results["views"], "hidden": 1, "refine": "photometric", "background": "clutter", "stress": {"x": {}},
        "optics": {**results["views"]["optics"], "blur_px": 1.5},
    }  # fmt: skip
    said = overview.command(replace(subject, results={**results, "views": views}))
    for option in ("--hide 1", "--refine photometric", "--background clutter", "--stress", "--optics blur_px=1.5"):
        assert option in said
    assert "--views 0" in overview.command(replace(subject, results={**results, "views": None}))


def test_long_provenance_is_cut_off(pentagon):
    long = replace(pentagon, provenance={"note": "x" * 10_000, "seed": "y" * 10_000})
    assert len(overview.provenance(long)) < 5000
    assert all(len(text) < 300 for _, text in overview.origin(long))


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
    found = advise(pentagon, setting.camera, setting.poses)
    axes = short_axes(pentagon, setting.camera, setting.poses).min(axis=1)
    assert found.worst.thinnest_px == axes.min()
    assert setting.poses.polar_angle_deg[found.worst.pose] == pytest.approx(70)
    # 36 mm at 1.5 m and 70 deg, seen with f = 800 px.
    assert found.worst.center_px == pytest.approx(36e-3 * 800 * np.cos(np.deg2rad(70)) / 1.5, rel=2e-3)
    for wanted, share in ((found.worst, 1.0), (found.most, 0.94)):
        scale = wanted.diameter / pentagon.dot_diameter
        larger = short_axes(pentagon, setting.camera, setting.poses, scale).min(axis=1)
        smaller = short_axes(pentagon, setting.camera, setting.poses, scale - 0.2e-3 / pentagon.dot_diameter).min(
            axis=1
        )
        assert np.mean(larger >= 8) >= share
        assert np.mean(smaller >= 8) < share


def test_advice_in_words(pentagon, make_ngon, setting):
    said = sentences(advise(pentagon, setting.camera, setting.poses), pentagon, setting.poses)
    assert said[0].startswith("At 1.5 m and 70 deg the dot that looks smallest, of 36 mm, is 5.6 px")
    assert "use 51.2 mm for the 8 px" in said[0]
    assert "--dot 51.2mm" in said[-1]
    many = make_ngon(30, 0.15, 0.02)
    assert (
        "scale the whole marker to 2" in sentences(advise(many, setting.camera, setting.poses), many, setting.poses)[-1]
    )
    large = make_ngon(4, 0.15, 0.06)
    (only,) = sentences(advise(large, setting.camera, setting.poses), large, setting.poses)
    assert "large enough" in only
