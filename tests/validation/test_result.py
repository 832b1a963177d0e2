import json

import numpy as np
import pytest

from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution, paper
from markergen.validation.metrics import statistics
from markergen.validation.run import validate

STATS = {"count", "mean", "std", "rms", "median", "p95", "max"}
KEYS = {
    "marker", "criteria", "comparisons", "nees", "camera", "poses", "noise_px", "runs", "seed", "condition",
    "homography", "estimators", "bound", "budget", "labels", "views",
}  # fmt: skip


@pytest.fixture(scope="module")
def result(pentagon):
    poses = paper()
    kept = [0, 20, 40, 300, 320, 340]
    poses = PoseDistribution("some", poses.rotation[kept], poses.translation[kept])
    return validate(pentagon, PAPER_CAMERA, poses, runs=20, workers=1, condition=np.arange(1.0, 7.0))


@pytest.fixture(scope="module")
def content(result):
    return result.as_dict(criteria={"pose": 1.0}, comparisons=[], views={"count": 0})


def test_form(content, pentagon):
    assert set(content) == KEYS
    assert content["criteria"] == {"pose": 1.0}
    assert content["comparisons"] == []
    assert content["views"] == {"count": 0}
    assert content["marker"]["spec_hash"] == pentagon.spec_hash
    assert content["camera"] == {"width": 640, "height": 480, "fx": 800, "fy": 800, "cx": 320, "cy": 240}
    assert content["condition"] == {"mean": 3.5, "min": 1, "max": 6}
    assert set(content["estimators"]) == {"epnp", "ippe", "lm", "sqpnp"}
    for part in [content["estimators"]["lm"], *content["estimators"]["lm"]["by_polar_angle"].values()]:
        assert set(part["rotation_deg"]) == set(part["translation_pct"]) == STATS
        assert {"flip_rate", "failure_rate", "efficiency"} <= set(part)
    dlt = content["homography"]["dlt"]
    assert set(dlt["he_px2"]) == set(dlt["rms_px"]) == STATS
    assert set(content["bound"]["by_polar_angle"]) == {"0", "17.5", "35"}


def test_is_json(content):
    assert json.loads(json.dumps(content, allow_nan=False)) == content


def test_overall_is_made_of_the_polar_angles(result, content):
    lm = content["estimators"]["lm"]
    groups = lm["by_polar_angle"].values()
    assert lm["rotation_deg"]["count"] == sum(group["rotation_deg"]["count"] for group in groups) == 120
    assert lm["rotation_deg"]["max"] == max(group["rotation_deg"]["max"] for group in groups)
    assert lm["rotation_deg"] == statistics(result.errors["lm"].rotation_deg)
    # Two poses for each of the three angles.
    bounds = [group["rotation_deg"] for group in content["bound"]["by_polar_angle"].values()]
    assert content["bound"]["rotation_deg"] == pytest.approx(np.sqrt(np.mean(np.square(bounds))))


def test_root_of_the_homography_error_is_taken_for_each_trial(result, content):
    roots = np.sqrt(result.errors["dlt"].he_px2)
    dlt = content["homography"]["dlt"]
    assert dlt["rms_px"]["mean"] == pytest.approx(roots.mean())
    assert dlt["he_px2"]["mean"] == pytest.approx(dlt["rms_px"]["rms"] ** 2)


def test_numbers_that_do_not_exist_are_null(pentagon):
    poses = paper()
    one = PoseDistribution("one", poses.rotation[[0]], poses.translation[[0]])
    result = validate(pentagon, PAPER_CAMERA, one, noise_px=0, runs=2, condition=np.array([np.inf]))
    content = result.as_dict()
    assert content["condition"]["mean"] is None
    assert content["nees"]["mean"] is None
    assert content["estimators"]["lm"]["efficiency"] is None
    assert content["criteria"] is content["views"] is None
