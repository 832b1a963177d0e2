"""The report says what the results say: the answer, its reasons, and how large the dots should be."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.maths.information import rotation_bound
from markergen.validation.metrics import rms
from markergen.validation.report import overview
from markergen.validation.report.subject import number, shares


def test_answer_is_the_budget_at_the_far_and_steep_end(subject, budget, few):
    there = (few.poses.distance > 1.49) & (few.poses.polar_angle_deg > 69)
    deg = rms(np.rad2deg(rotation_bound(budget.total))[there])
    mm = rms(1e3 * np.sqrt(np.trace(budget.total[there, 3:, 3:], axis1=1, axis2=2)))
    first = overview.answer(subject).sentences[0]
    assert first == f"At 1.5 m and 70 deg expect {number(deg, 2)} deg and {number(mm, 2)} mm RMS."


@pytest.mark.parametrize(
    ("source", "word"), [("image", "noise of the image"), ("print", "print"), ("camera", "calibration")]
)
def test_what_limits_the_pose_is_the_largest_source(source, word):
    parts = {"image": 0.1, "print": 0.1, "camera": 0.1} | {source: 1.0}
    said = overview.limit_sentences({"rotation_deg": parts, "translation_pct": parts})
    assert said[0].startswith(f"What limits the rotation and the translation is the {word}") or word in said[0]
    assert "next to nothing" in said[0]
    others = [name for name in overview.REMEDIES if name != source]
    assert not any(overview.REMEDIES[name] in line for name in others for line in said)


def test_two_sources_are_told_apart_and_an_even_share_is_no_reason_to_stop():
    said = overview.limit_sentences(
        {"rotation_deg": {"image": 1.0, "print": 0.9}, "translation_pct": {"image": 0.1, "print": 0.2, "camera": None}}
    )
    assert [line.split(" is ")[0] for line in said[:2]] == ["What limits the rotation", "What limits the translation"]
    assert "next to nothing" not in said[0]
    assert "--camera-covariance" in said[2]


def test_shares_of_the_variance_add_up():
    parts = shares({"rotation_deg": {"image": 3.0, "print": 4.0, "camera": 0.0, "total": 5.0}}, "rotation_deg")
    assert parts == pytest.approx({"image": 0.36, "print": 0.64, "camera": 0.0})
    assert overview.in_words(parts) == "print 64 %, image noise 36 %, calibration 0 %"
    assert shares({"rotation_deg": dict.fromkeys(parts, 0.0)}, "rotation_deg") == {}


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
