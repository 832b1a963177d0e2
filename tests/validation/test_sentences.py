"""Sentences on what limits the pose."""

import pytest
from sentences import sentence

from markergen.validation import sentences


def said(rotation, translation=None, **results):
    budget = {"rotation_deg": rotation, "translation_pct": translation or rotation}
    return sentences.limit_sentences({"budget": budget, **results})


@pytest.mark.parametrize(
    ("source", "word"), [("image", "image noise"), ("print", "the print"), ("camera", "the calibration")]
)
def test_what_limits_the_pose_is_the_largest_source(source, word):
    first, *rest = said({"image": 0.1, "print": 0.1, "camera": 0.1} | {source: 1.0})
    assert first.startswith("Of image noise,")
    assert sentence("limits both", word, sentences.REMEDIES[source]) in first
    assert first.endswith(sentence("nothing else"))
    assert not rest


def test_two_sources_are_told_apart_and_an_even_share_is_no_reason_to_stop():
    results = said({"image": 1.0, "print": 0.9}, {"image": 0.1, "print": 0.2, "camera": None})
    assert sentence("limits", "image noise", "rotation") in results[0]
    assert sentence("limits", "the print", "translation") in results[1]
    assert not any("next to nothing" in line for line in results)
    assert "--camera-covariance" in results[2]


def test_of_a_measured_print_the_calibration_says_whether_photographs_help():
    budget = {"rotation_deg": {"image": 0.1, "print": 1.0, "camera": 0.0}, "print_measured": True}
    first, *_ = sentences.limit_sentences({"budget": budget | {"translation_pct": {"image": 1.0, "print": 0.1}}})
    assert sentences.REMEDIES_OF_MEASURED["rotation"] in first
    assert not any(remedy in first for remedy in (sentences.REMEDIES_OF_MEASURED["translation"], "again"))


def test_a_calibration_that_was_not_counted_is_named_with_its_cost():
    """The print is the largest of two; what was taken as exact may be larger."""
    off = {"focal_px": 2.0, "center_px": 1.5, "rotation_deg": 0.457, "translation_pct": 0.31}
    headline = {"calibration": off, "all": {"rotation_deg": 0.235, "translation_pct": 0.046}}
    first, second = said({"image": 0.01, "print": 0.23, "camera": 0.0}, headline=headline)
    assert first.startswith("Of image noise and")
    assert "calibration" not in first
    assert "by 2 px and the principal point by 1.5 px" in second
    assert "1.9 and 6.7 times as much" in second


def test_shares_of_the_variance_add_up():
    parts = sentences.shares(
        {"rotation_deg": {"image": 3.0, "print": 4.0, "camera": 0.0, "total": 5.0}}, "rotation_deg"
    )
    assert parts == pytest.approx({"image": 0.36, "print": 0.64, "camera": 0.0})
    assert sentences.shares({"rotation_deg": dict.fromkeys(parts, 0.0)}, "rotation_deg") == {}


@pytest.mark.parametrize(("count", "advice"), [(1, "--views 100."), (40, "Rely on the views.")])
def test_few_views_are_no_measurement(count, advice):
    off = {"count": count, "rms": 0.5, "expected": 0.1, "low": 0.08, "high": 0.12, "agrees": 0}
    place = {"rotation_deg": off, "translation_mm": off}
    lines = sentences.agreement({"hardest": place, "all": place, "lost": 0})
    assert lines
    assert all(line.endswith(advice) for line in lines)


def test_poses_that_are_left_out_are_counted_where_they_are_most(monkeypatch):
    monkeypatch.setattr(sentences, "marker_plan", lambda claim: ["Plan.", *claim])
    results = {"headline": ["More."], "poses": {"count": 60, "dropped": 340}}
    plan, more = sentences.plan_sentences(results)
    assert plan.startswith("Plan. 340 of 400 poses")
    assert more == "More."
    results["poses"]["dropped"] = 60
    assert sentences.plan_sentences(results) == ["Plan.", "More."]


@pytest.mark.parametrize(
    ("aperture", "phrase"),
    [(0.0, "Optics: blur 0.7 px."), (2.0, "Optics: blur 0.7 px, aperture 2 mm, focus 1, wavelength 550 nm.")],
)
def test_optics_are_those_that_act(aperture, phrase):
    optics = {"blur_px": 0.7, "motion_px": 0.0, "aperture_mm": aperture, "focus": 1.0, "wavelength_nm": 550.0}
    assert sentences.image_sentences({"detected": 1, "count": 1, "wrong": 0, "optics": optics})[-1] == phrase
