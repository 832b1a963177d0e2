"""The error to plan with is one number: in marker.json, on the sheet, and where it is validated."""

import pytest

from markergen.api.design import design
from markergen.api.design import rig as design_rig
from markergen.api.validate import validate
from markergen.drawing.print_measurements import measured_columns
from markergen.model.marker import Marker
from markergen.model.planned_error import KEY, PlannedError, planned_error_of


@pytest.fixture(scope="module")
def found():
    return design(n=5, boundary="page", paper="A5", dot="12mm", poses="cone:count=20,distance=0.3..0.8m", restarts=1)


def test_it_is_the_same_everywhere(found, tmp_path):
    found.marker.save(tmp_path / "marker.json")
    plan = planned_error_of(Marker.load(tmp_path / "marker.json").provenance)
    assert plan == found.plan
    proved = validate(found.marker, runs=0, views=0)
    assert proved.headline["rotation_deg"] == pytest.approx(plan.rotation_deg, rel=1e-3)
    assert proved.headline["translation_mm"] == pytest.approx(plan.translation_mm, rel=1e-3)
    assert proved.headline["exact"] == plan.exact == "scale and calibration"
    for text in (found.brief(), proved.brief(), measured_columns(found.marker, (100, 100))):
        assert plan.amounts in " ".join(map(str, text))


def test_a_relief_has_that_of_its_validation():
    relief = design(n=6, radius="60mm", dot="12mm", relief="20mm", restarts=1, poses="cone:count=20,distance=0.3..0.8m")
    proved = validate(relief.marker, runs=0, views=0)
    assert proved.headline["rotation_deg"] == pytest.approx(relief.plan.rotation_deg, rel=1e-3)
    assert proved.headline["translation_mm"] == pytest.approx(relief.plan.translation_mm, rel=1e-3)
    assert relief.plan.sentence in relief.brief()


def test_a_rig_has_that_of_its_validation():
    tags = {"tag": "aruco:DICT_4X4_50", "poses": "cone:distance=0.3..0.8m,tilt=0..60,count=12"}
    rig = design_rig("pair", plate="100mm", n=4, restarts=1, **tags)
    headline = validate(rig.rig, runs=0, views=0).headline
    farthest = float(rig.poses.distance.max())
    plan = PlannedError(headline["rotation_deg"], headline["translation_mm"], farthest, exact="scale and calibration")
    assert plan.sentence in rig.brief()
    assert "relation of the plates" in rig.brief()[3]
    assert rig.brief()[0].startswith("pair: 2 plates (left, right) with 8 dots of ")


@pytest.mark.long
def test_dots_of_several_sizes_have_that_of_their_validation():
    pad = design(n="auto", radius="0.2m", poses="cone:distance=0.15..1.5m,tilt=0..30,count=24", restarts=1)
    assert len(pad.covered.scales) > 1
    headline = validate(pad.marker, runs=0, views=0).headline
    assert headline["rotation_deg"] == pytest.approx(pad.plan.rotation_deg, rel=1e-3)
    assert headline["translation_mm"] == pytest.approx(pad.plan.translation_mm, rel=1e-3)
    assert planned_error_of(pad.marker.provenance).amounts == pad.plan.amounts
    assert pad.plan.sentence in pad.brief()
    assert len(pad.brief()) < 5


def test_a_measured_print_is_better(found):
    exact = validate(found.marker, runs=0, views=0, print_sigma="0.01mm")
    assert exact.headline["rotation_deg"] == pytest.approx(found.plan.measured_deg, rel=1e-3)
    assert found.plan.measured_deg < 0.5 * found.plan.rotation_deg


def test_what_is_counted_is_not_taken_as_exact(found):
    counted = validate(found.marker, runs=0, views=0, scale_sigma=0.002)
    assert counted.headline["exact"] == "calibration"
    assert counted.headline["translation_mm"] > found.plan.translation_mm


@pytest.mark.parametrize("stored", [{}, {KEY: 3}, {KEY: {"rotation_deg": "x"}}, {KEY: {"rotation_deg": 1, "other": 2}}])
def test_files_without_it(stored):
    assert planned_error_of(stored) is None


def test_an_error_without_a_measured_one():
    plan = PlannedError(0.1234, 1.5, 0.999)
    assert plan.sentence == "Plan with 0.12 deg and 1.5 mm at up to 1 m."
    assert planned_error_of({KEY: plan.as_dict()}) == plan
    assumed = PlannedError(0.1234, 1.5, 0.999, exact="scale and calibration")
    assert assumed.sentence == "Plan with 0.12 deg and 1.5 mm at up to 1 m, scale and calibration exact."
    assert planned_error_of({KEY: assumed.as_dict()}) == assumed
