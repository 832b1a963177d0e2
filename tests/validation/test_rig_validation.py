"""Validation of rigs: views against what is expected, results as JSON, report and files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from html_pages import check
from sentences import sentence

import markergen as mg
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import named_poses
from markergen.presentation.results import json_bytes
from markergen.validation.bounds import budget_of
from markergen.validation.print_error import misprinted
from markergen.validation.view_records import CONDITIONS, record, take_records
from markergen.validation.views import SyntheticViews
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
    assert sum(item["count"] for item in groups.values()) == 6
    assert sum(item["poses"] for item in results["headline"]["by_plates"].values()) == results["poses"]["served"]
    assert found.check("estimators.lm.failure_rate > 0") == (True, "estimators.lm.failure_rate = 0 <= 0")
    files = [tmp_path / name for name in ("report.html", "rig.json", "plot.svg")]
    written = found.save(*files, pictures=tmp_path / "pictures")
    assert len(written) == 3 + 6
    page = check(files[0].read_bytes())
    # Two sides of the rig, the errors, and two stills of the dome.
    assert len(page.of("svg")) == 5
    assert len(page.of("img")) == 6
    assert "plate 4" in page.text
    (dome,) = (json.loads(item["data-dome"]) for item in page.of("div") if "data-dome" in item)
    assert sum(item is not None for item in dome["poses"]["rotation"]) == results["poses"]["served"]


def test_what_is_said_has_the_numbers(found):
    text = str(found)
    assert text.splitlines()[-1].startswith("Plan with ")
    assert sentence("views found", 6, 6) in text
    assert "plate alone: 2" in text
    assert repr(found).startswith("<Validation: 6 markers, 20 poses, 6 of 6 views")


def test_the_same_views_every_time(rig):
    series = SyntheticViews(rig, PAPER_CAMERA, named_poses(AROUND), 4, errors=ErrorSources(1e-4))
    one, again = series.take(2), series.take(2)
    assert (one.image == again.image).all()
    assert (one.detection.pixels == again.detection.pixels).all()


def test_options_that_make_no_sense_for_a_rig_are_refused(rig):
    with pytest.raises(InputError, match="found a rig, whose"):
        mg.validate(rig, poses=AROUND, trials_for_all=True)
    with pytest.raises(InputError, match=r"of a plate"):
        mg.validate(rig, poses="sphere:distance=8m,count=5", runs=0, views=0)


def test_what_the_type_of_a_validation_promises_is_there(rig, found):
    assert found.marker == rig
    assert found.setting.boundary.radius == pytest.approx(rig.radius)
    assert found.setting.sight.seen.shape == (20, len(rig))
    assert found.nees["count"] == pytest.approx(5 * found.results["poses"]["served"], abs=10)
    assert found.nees["mean"] == pytest.approx(found.estimators["lm"]["nees"])
    frame = found.to_frame()
    assert set(frame.source) == {"trials", "views"}
    assert set(frame.plates) == {"all", *found.views["by_plates"], *found.headline["by_plates"]}
    every = frame[(frame.estimator == "lm") & (frame.plates == "all")].iloc[0]
    assert every.rotation_deg_rms == found.estimators["lm"]["rotation_deg"]["rms"]
    assert every.rotation_deg_bound == found.bound["rotation_deg"]


def test_dots_of_a_rig_in_view_are_hidden(rig):
    series = SyntheticViews(rig, PAPER_CAMERA, named_poses(AROUND), 3, errors=ErrorSources(1e-4), hidden=2)
    for k in range(3):
        view = series.take(k)
        assert len(view.hidden) == 2
        assert series.coverage.seen[view.pose, view.hidden].all()
        assert not np.isin(view.found, view.hidden).any()


def test_a_rig_is_stressed(rig):
    result = mg.validate(rig, poses=AROUND, runs=0, views=2, stress=True, workers=1)
    stressed = result.views["stress"]
    assert set(stressed) == set(CONDITIONS)
    assert stressed["one dot hidden"]["hidden"] == 1
    assert stressed["noise 8"]["expected_deg"] > result.views["expected_deg"]
    assert "half the light" in str(result)


def test_a_wrong_scale_counts_alike_for_a_rig_and_its_only_marker(rig):
    marker = rig.markers[0].marker
    alone = mg.Rig((mg.Plate("a", marker, np.eye(3).tolist(), (0, 0, 0)),))
    poses, sizes = named_poses("cone:distance=0.3..0.4m,tilt=10..50,count=5"), []
    for body in (marker, alone):
        series = SyntheticViews(body, PAPER_CAMERA, poses, 0, errors=ErrorSources(1e-5, scale_sigma=2e-3))
        sizes.append(budget_of(series).translation["print"])
        made = [
            misprinted(body, series.errors, np.random.default_rng(k)).xyz[:, 0] / body.xyz[:, 0] for k in range(200)
        ]
        assert np.std([np.median(scale) for scale in made]) == pytest.approx(2e-3, rel=0.25)
    # A rig's weights count the scale as an error of the single dots, a marker's do not.
    np.testing.assert_allclose(sizes[1], sizes[0], rtol=0.1)


def test_a_rig_is_assembled_as_its_relation_says(rig):
    sigma = np.tile([1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4], 6)
    loose, rng = replace(rig, relation=np.diag(sigma**2).tolist()), np.random.default_rng(0)
    made = [misprinted(loose, ErrorSources(0.0), rng) for _ in range(200)]
    shifts = np.array([[marker.translation_vector for marker in one.markers] for one in made]) - [
        marker.translation_vector for marker in rig.markers
    ]
    # 3600 samples: 5 standard errors of their standard deviation are 6 %.
    assert shifts.std() == pytest.approx(1e-4, rel=0.06)
    assert all(one.markers[0].marker == rig.markers[0].marker for one in made)


@pytest.mark.long
def test_views_are_as_good_as_expected(rig):
    series = SyntheticViews(
        rig, PAPER_CAMERA, named_poses("sphere:distance=0.3..0.6m,count=400"), 400, background="clutter",
        errors=ErrorSources(1e-4),
    )  # fmt: skip
    records = take_records(series)
    several = [item for item in records if series.coverage.plates[item.pose] > 2 and item.detected]
    assert all(item.detected for item in records)
    expected = budget_of(series).rotation_deg["total"][[item.pose for item in several]]
    # Some 170 views of three degrees of freedom: the standard error of the RMS is some 4 %.
    measured = np.sqrt(np.mean([item.rotation_deg**2 for item in several]))
    assert measured == pytest.approx(np.sqrt(np.mean(expected**2)), rel=0.15)
    assert record(series, series.take(0)).rotation_deg == records[0].rotation_deg
