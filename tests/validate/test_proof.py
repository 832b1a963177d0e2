import json

import numpy as np
import pytest

from markergen.model.boundary import Circle
from markergen.model.marker import Marker
from markergen.objectives import OBJECTIVES
from markergen.validate import tables
from markergen.validate.proof import prove, setting_of, to_json


@pytest.fixture(scope="module")
def results(pentagon):
    calls = []
    found = prove(pentagon, setting_of(pentagon), runs=5, views=3, progress=lambda *call: calls.append(call))
    assert {stage for stage, _, _ in calls} == {"trials", "views"}
    return found


def test_everything_is_plain_json(results):
    assert json.loads(to_json(results)) == results


def test_criteria_bounds_and_condition_tell_one_story(results, setting, pentagon):
    assert results["criteria"]["rotation_deg"] * 0.2 == pytest.approx(results["bound"]["rotation_deg"])
    assert results["criteria"]["translation_pct"] * 0.2 == pytest.approx(results["bound"]["translation_pct"])
    # The pentagon is the regular n-gon of its own region.
    assert results["comparisons"]["ngon"]["bound"]["rotation_deg"] == pytest.approx(results["bound"]["rotation_deg"])
    values = OBJECTIVES["condition"](setting).per_pose(pentagon.xyz[None, :, :2])[0]
    assert results["condition"] == pytest.approx({"mean": values.mean(), "min": values.min(), "max": values.max()})


def test_tables_show_the_numbers_of_the_results(results):
    for table in (tables.estimator_table, tables.polar_angle_table, tables.homography_table, tables.comparison_table):
        _, header, rows, _ = table(results)
        assert {len(row) for row in rows} == {len(header)}
    rows = {row[0]: row for row in tables.estimator_table(results)[2]}
    shown = float(rows["LM from IPPE"][2])
    assert shown == pytest.approx(results["estimators"]["lm"]["rotation_deg"]["rms"], rel=5e-3)
    assert len(rows) == 5
    assert any("3 of 3 detected" in line for line in tables.sentences(results))


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
    ("value", "text"), [(None, "-"), (0.0, "0.00"), (12.0, "12.0"), (123.0, "123"), (0.001234, "0.00123")]
)
def test_numbers_keep_their_digits(value, text):
    assert tables.number(value) == text
