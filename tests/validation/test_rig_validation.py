"""Validation of rigs: views against what is expected, results as JSON, report and files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from html_pages import check

import markergen as mg
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import named_poses
from markergen.presentation.results import json_bytes
from markergen.validation.rigs.bounds import budget_of, visibility
from markergen.validation.rigs.views import RigViews, built, record, take_records
from tests.support.rigs import cube

AROUND = "sphere:distance=0.3..0.6m,count=20"


@pytest.fixture(scope="module")
def rig():
    return cube(seed=10)


@pytest.fixture(scope="module")
def found(rig):
    return mg.validate(rig, poses=AROUND, runs=5, views=6, background="clutter", workers=1)


def test_results_are_plain_json_and_views_are_of_the_rig(found, tmp_path):
    results = found.results
    assert json.loads(json_bytes(dict(results))) == results
    assert results["rig"]["control_points"] == 36
    assert results["views"]["detected"] == 6
    assert results["views"]["wrong"] == 0
    groups = results["views"]["by_plates"]
    assert sum(each["count"] for each in groups.values()) == 6
    assert sum(each["poses"] for each in results["headline"]["by_plates"].values()) == results["poses"]["served"]
    assert found.check("estimators.lm.failure_rate > 0") == (True, "estimators.lm.failure_rate = 0 <= 0")
    files = [tmp_path / name for name in ("report.html", "rig.json", "plot.svg")]
    written = found.save(*files, pictures=tmp_path / "pictures")
    assert len(written) == 3 + 6
    page = check(files[0].read_bytes())
    # Two sides of the rig, the errors, and two stills of the dome.
    assert len(page.of("svg")) == 5
    assert len(page.of("img")) == 6
    assert "plate 4" in page.text
    (dome,) = (json.loads(each["data-dome"]) for each in page.of("div") if "data-dome" in each)
    assert sum(each is not None for each in dome["poses"]["rotation"]) == results["poses"]["served"]


def test_what_is_said_has_the_numbers(found):
    text = str(found)
    assert text.splitlines()[-1].startswith("Plan with ")
    assert "Found in 6 of 6 views, none with a wrong label." in text
    assert "the best plate alone: 2" in text
    assert repr(found).startswith("<RigValidation: 6 markers, 20 poses, 6 of 6 views found, plan with ")


def test_the_same_views_every_time(rig):
    series = RigViews(rig, PAPER_CAMERA, named_poses(AROUND), 4, errors=ErrorSources(1e-4))
    one, again = series.take(2), series.take(2)
    assert (one.image == again.image).all()
    assert (one.detection.pixels == again.detection.pixels).all()


def test_options_of_markers_alone_are_refused(rig):
    for option in ({"hide": 1}, {"refine": "photometric"}, {"stress": True}, {"scale_sigma": 0.001}):
        with pytest.raises(InputError, match=r"for a rig"):
            mg.validate(rig, poses=AROUND, **option)
    with pytest.raises(InputError, match=r"four dots of a plate"):
        mg.validate(rig, poses="sphere:distance=8m,count=5", runs=0, views=0)


def test_a_rig_is_assembled_as_its_relation_says(rig):
    sigma = np.tile([1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4], 6)
    loose, rng = replace(rig, relation=np.diag(sigma**2).tolist()), np.random.default_rng(0)
    made = [built(loose, ErrorSources(0.0), rng) for _ in range(200)]
    shifts = np.array([[each.translation_vector for each in one.markers] for one in made]) - [
        each.translation_vector for each in rig.markers
    ]
    # 3600 samples: 5 standard errors of their standard deviation are 6 %.
    assert shifts.std() == pytest.approx(1e-4, rel=0.06)
    assert all(one.markers[0].marker == rig.markers[0].marker for one in made)


@pytest.mark.long
def test_views_are_as_good_as_expected(rig):
    series = RigViews(
        rig, PAPER_CAMERA, named_poses("sphere:distance=0.3..0.6m,count=400"), 400, background="clutter",
        errors=ErrorSources(1e-4),
    )  # fmt: skip
    records, shown = take_records(series), visibility(series)
    several = [each for each in records if shown.plates[each.pose] > 2 and each.detected]
    assert all(each.detected for each in records)
    expected = budget_of(shown).rotation_deg["total"][[each.pose for each in several]]
    # Some 170 views of three degrees of freedom: the standard error of the RMS is some 4 %.
    measured = np.sqrt(np.mean([each.rotation_deg**2 for each in several]))
    assert measured == pytest.approx(np.sqrt(np.mean(expected**2)), rel=0.15)
    assert record(series, series.take(0)).rotation_deg == records[0].rotation_deg
