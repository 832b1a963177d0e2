"""The report says what the results say: the answer, its reasons, and how large the dots should be."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from markergen.maths.information import rotation_bound
from markergen.validation import report
from markergen.validation.metrics import rms
from markergen.validation.report.subject import value_text
from markergen.validation.sentences import shares


def test_answer_has_the_hardest_case(subject, budget, few):
    """The calibration of 0.5 px moves the position most far away, where it is first order; the rotation frontally."""
    far = few.poses.distance > 1.49
    steep, frontal = far & (few.poses.polar_angle_deg > 69), far & (few.poses.polar_angle_deg < 1)
    mm = rms(1e3 * np.sqrt(np.trace(budget.total[steep, 3:, 3:], axis1=1, axis2=2)))
    deg = rms(np.rad2deg(rotation_bound(budget.total))[frontal])
    second = report.answer(subject).sentences[1]
    assert f"{value_text(mm, 2)} mm at 1.5 m, tilted by 70 deg" in second
    message = float(second.split("The hardest: ")[1].split(" deg")[0])
    # Four poses with 500 draws, and what first order leaves out.
    assert message == pytest.approx(deg, rel=0.1)
    assert "at 1.5 m, tilted by 0 deg" in second


def test_shares_in_words():
    parts = shares({"rotation_deg": {"image": 3.0, "print": 4.0, "camera": 0.0, "total": 5.0}}, "rotation_deg")
    assert report.in_words(parts) == sentence("shares", 64, 36, 0)


def test_command_makes_the_results_again(subject, results):
    assert report.command(subject) == (
        "markergen validate MARKER.json --camera CAMERA.yaml --poses paper --runs 3 --noise 0.2 --views 160 "
        "--print-sigma 0.1mm --seed 0 --report report.html"
    )
    designed = {**subject.marker.provenance, "camera": subject.setting.camera.as_dict()}
    ours = report.command(replace(subject, marker=replace(subject.marker, provenance=designed)))
    assert "--camera CAMERA.yaml" not in ours
    assert "--camera-covariance COVARIANCE" in ours
    views = {
        **results["views"], "hidden": 1, "background": "clutter", "stress": {"x": {}},
        "optics": {**results["views"]["optics"], "blur_px": 1.5},
    }  # fmt: skip
    message = report.command(replace(subject, results={**results, "views": views}))
    for option in ("--hide 1", "--background clutter", "--stress", "--optics blur_px=1.5"):
        assert option in message
    assert "--views 0" in report.command(replace(subject, results={**results, "views": None}))


def test_long_provenance_is_cut_off(pentagon):
    long = replace(pentagon, provenance={"note": "x" * 10_000, "seed": "y" * 10_000})
    assert len(report.provenance(long)) < 5000
    assert all(len(text) < 300 for _, text in report.origin(long))


def test_constraints_of_the_search_are_stated(pentagon):
    result = {
        "value": 2.0, "clearance_m": 0.0036, "gap_m": 0.0064, "gap_reason": "images", "lower_bound": 1.9,
        "lower_bound_without_gap": 1.8, "limits": ["rotation <= 1.05 ngon"], "interrupted_s": 12.2,
    }  # fmt: skip
    terms = dict(report.searched(replace(pentagon, provenance={"search": result})))
    for term, figure in (
        ("Clearance", "3.6 mm"), ("Gap between dots", "6.4 mm"), ("Bounds", "rotation <= 1.05 ngon"),
        ("At best", "5 %"), ("At best, without the gap", "10 %"), ("Search", "12 s"),
    ):  # fmt: skip
        assert figure in terms[term]
    assert report.searched(replace(pentagon, provenance={"search": {"value": "2", "gap_m": None}})) == []
    assert report.searched(replace(pentagon, provenance={"search": "lost"})) == []
