import json

import numpy as np
import pytest
from sentences import sentence

from markergen.bounds.confusion.perspective import label_safety
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.boundary import Circle
from markergen.model.feature import RING_PIXELS
from markergen.model.marker import Marker
from markergen.objectives import OBJECTIVES
from markergen.presentation.results import json_bytes
from markergen.validation import sentences, tables
from markergen.validation.setting import setting_of
from markergen.validation.validation import run_validation
from markergen.validation.views import SyntheticViews


def bare(marker, setting):
    """No views, and the usual print."""
    return SyntheticViews(marker, setting.camera, setting.poses, 0, errors=ErrorSources())


@pytest.fixture(scope="module")
def results(pentagon):
    calls = []
    setting = setting_of(pentagon)
    series = SyntheticViews(pentagon, setting.camera, setting.poses, count=5, errors=ErrorSources())
    validated = run_validation(series, runs=5, stressed=True, progress=lambda *call: calls.append(call))
    assert {stage for stage, _, _ in calls} == {"trials", "views", "stress", "expected errors"}
    return validated


def test_everything_is_plain_json(results):
    assert json.loads(json_bytes(results)) == results


def test_criteria_bounds_and_condition_tell_one_story(results, setting, pentagon):
    assert results["criteria"]["rotation_deg"] * 0.2 == pytest.approx(results["bound"]["rotation_deg"])
    assert results["criteria"]["translation_pct"] * 0.2 == pytest.approx(results["bound"]["translation_pct"])
    # The pentagon is the regular n-gon of its own region.
    assert results["comparisons"]["ngon"]["bound"]["rotation_deg"] == pytest.approx(results["bound"]["rotation_deg"])
    values = OBJECTIVES["condition"](setting).per_pose(pentagon.xyz[None, :, :2])[0]
    assert results["condition"] == pytest.approx({"mean": values.mean(), "min": values.min(), "max": values.max()})


def test_tables_show_the_numbers_of_the_results(results):
    printed = [
        tables.rotation_table(results),
        tables.translation_table(results),
        tables.polar_angle_table(results, "rotation_deg"),
        tables.polar_angle_table(results, "translation_pct"),
        tables.homography_table(results),
        tables.comparison_table(results),
        tables.labels_table(results["labels"]),
        tables.budget_table(results),
        tables.group_table(results["views"]),
        tables.estimator_table(results["views"]),
        tables.stress_table(results["views"]),
    ]
    for _, header, rows, _ in printed:
        assert {len(row) for row in rows} == {len(header)}
    for (_, header, rows, _), key in zip(printed, ("rotation_deg", "translation_pct"), strict=False):
        named = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
        for statistic in ("mean", "std", "rms", "median", "p95", "max"):
            expected = results["estimators"]["lm"][key][statistic]
            assert float(named["LM"][statistic]) == pytest.approx(expected, rel=5e-3)
        assert float(named["bound (CRLB)"]["rms"]) == pytest.approx(results["bound"][key], rel=5e-3)
    assert "400 poses (paper) x 5 runs, noise 0.2" in tables.conditions(results)
    assert any("5 of 5 rendered views detected" in line for line in sentences.view_sentences(results))
    assert any(sentence("limits", "the print", "rotation") in line for line in sentences.view_sentences(results))


def test_dots_too_small_to_be_found_are_named(results, make_ngon):
    assert results["dots"]["too_small"] == 0
    assert not any("it takes" in line for line in sentences.view_sentences(results))
    small = make_ngon(5, 0.15, 0.012)
    setting = setting_of(small)
    validated = run_validation(bare(small, setting), runs=0)
    # f d sqrt(cos(tilt)) / z at the middle; the ring is up to 0.12 m farther away, and seen at a lower angle.
    tilt = np.cos(np.deg2rad(setting.poses.polar_angle_deg))
    extent = 800 * 0.012 * np.sqrt(tilt) / setting.poses.distance
    assert validated["dots"]["least_px"] == pytest.approx(extent.min(), rel=0.15)
    assert validated["dots"]["needed_px"] == RING_PIXELS
    assert validated["dots"]["too_small"] == pytest.approx(np.mean(extent < RING_PIXELS), abs=0.1)
    assert 0 < validated["dots"]["too_small"] < 1
    line = sentences.view_sentences(validated)[0]
    assert line.startswith("In ")
    assert f"{RING_PIXELS:g} px that it" in line


def test_the_setting_is_what_the_marker_was_designed_for(pentagon):
    spec = {
        "n": 5,
        "poses": "paper-roll",
        "camera": {"width": 1280, "height": 960, "fx": 1600, "fy": 1600, "cx": 640, "cy": 480},
    }
    marker = Marker(pentagon.control_points, Circle(0.15), 0.0036, provenance={"spec": spec})
    setting = setting_of(marker)
    assert (setting.camera.width, setting.poses.name) == (1280, "paper-roll")
    assert setting_of(marker, "paper").poses.name == "paper"
    np.testing.assert_array_equal(setting.boundary.radius, 0.15)


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (0.0, "0.00"), (12.0, "12.0"), (123.0, "123"), (0.001234, "0.00123"), (2e-9, "<1e-6")],
)
def test_numbers_keep_their_digits(value, text):
    assert tables.number(value) == text


def test_points_on_a_line_are_refused_in_one_line(make_marker, setting):
    line = make_marker(np.stack([np.linspace(-0.12, 0.12, 5), np.zeros(5)], -1), 0.15, 0.03)
    with pytest.raises(InputError, match="determine a homography"):
        run_validation(bare(line, setting), runs=1)


@pytest.mark.parametrize(
    ("share", "text"), [(None, "-"), (0.0, "0 %"), (1.0, "100 %"), (0.3825, "38.2 %"), (2.5e-6, "0.00025 %")]
)
def test_shares_are_plain_percentages(share, text):
    assert tables.percent(share) == text


def test_trials_of_the_others_belong_to_one_layout(pentagon):
    series = bare(pentagon, setting_of(pentagon, "cone:count=20"))
    validated = run_validation(series, runs=2, trials_for_all=True, workers=1)
    for row in validated["comparisons"].values():
        assert row["criteria"]["rotation_deg"] * 0.2 == pytest.approx(row["bound"]["rotation_deg"])
        assert row["estimators"]["lm"]["rotation_deg"]["count"] > 0


def test_labels_are_told_apart_as_the_results_say(results, pentagon, setting):
    labels = results["labels"]
    assert labels == json.loads(json.dumps(label_safety(pentagon, setting).as_dict()))
    assert labels["dots"][0] == {"id": 0, "px": None}
    assert labels["undecided"] < 1e-6
    assert labels["margin"] == min(dot["margin"] for dot in labels["dots"][1:])
    assert sentences.trial_sentences(results)[0].startswith("Labels are safe")
    rows = tables.labels_table(labels)[2]
    assert rows[0][-1] == sentence("never alike")
    assert float(rows[1][1]) == pytest.approx(labels["dots"][1]["px"], rel=5e-3)
    many = {**labels, "dots": [{**labels["dots"][1], "id": i, "px": float(i % 50)} for i in range(60)]}
    title, _, rows, _ = tables.labels_table(many)
    assert "40 least safe of 60" in title
    assert max(float(row[1]) for row in rows) < 35


def test_a_relief_and_a_lens_are_said(results):
    """Estimators that assume a plane step aside with a word; what is flat and seen by a pinhole has none of this."""
    camera = results["camera"] | {"distortion": {"model": "equidistant", "coefficients": [0.0, 0.0, 0.0, 0.0]}}
    criteria = {key: value for key, value in results["criteria"].items() if key != "condition"}
    estimators = {key: value for key, value in results["estimators"].items() if key != "ippe"}
    raised = results | {"camera": camera, "criteria": criteria, "estimators": estimators}
    assert tables.conditions(raised).endswith(", equidistant lens")
    assert not tables.conditions(results).endswith("lens")
    message = "DLT and IPPE assume a plane and step aside"
    assert any(line.startswith(message) for line in sentences.trial_sentences(raised))
    assert not any(line.startswith(message) for line in sentences.trial_sentences(results))
    assert "IPPE" not in tables.rotation_table(raised)[3]
    assert "IPPE" in tables.rotation_table(results)[3]
