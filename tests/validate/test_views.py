import json

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper
from markergen.render import Optics
from markergen.validate import views
from markergen.validate.views import take_views, validate_views

POSES = paper()


def ngon(n, key=True, diameter=0.036):
    angles = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return Marker(
        tuple(
            ControlPoint(
                i,
                float(0.1284 * np.cos(angle)),
                float(0.1284 * np.sin(angle)),
                0.0,
                key_ring(diameter) if key and i == 0 else Feature(diameter),
            )
            for i, angle in enumerate(angles)
        ),
        Circle(0.15),
        0.0036,
    )


@pytest.fixture(scope="module")
def result():
    return validate_views(ngon(5), PAPER_CAMERA, POSES, count=20)


def test_good_marker_is_found_in_every_view(result):
    assert (result["count"], result["detected"], result["wrong"], result["failures"]) == (20, 20, 0, [])
    assert result["point_px"]["count"] == 100
    # Measured: 0.0045 px RMS, and 0.16 px without the correction.
    assert result["point_px"]["rms"] < 0.008
    assert result["uncorrected_px"]["rms"] > 0.1


def test_views_are_spread_evenly_over_the_poses(result):
    # 400 poses in 20 stretches: each polar angle of each distance once.
    assert {angle: group["count"] for angle, group in result["by_polar_angle"].items()} == {
        "0": 4,
        "17.5": 4,
        "35": 4,
        "52.5": 4,
        "70": 4,
    }
    assert all(group["rate"] == 1 for group in result["by_polar_angle"].values())
    assert sum(group["point_px"]["count"] for group in result["by_polar_angle"].values()) == 100


def test_same_seed_same_bytes_other_seed_others(result):
    again = validate_views(ngon(5), PAPER_CAMERA, POSES, count=20)
    assert json.dumps(again) == json.dumps(result)
    other = validate_views(ngon(5), PAPER_CAMERA, POSES, count=20, seed=1)
    assert other["point_px"] != result["point_px"]


def test_nothing_found_is_valid_json_with_reasons():
    result = validate_views(ngon(5, key=False), PAPER_CAMERA, POSES, count=5)
    json.dumps(result, allow_nan=False)
    assert (result["count"], result["detected"], result["wrong"]) == (5, 0, 0)
    assert result["point_px"]["count"] == 0
    assert len(result["failures"]) == 5
    for failure in result["failures"]:
        assert "ambiguous" in failure["reason"]
        assert failure["distance"] == pytest.approx(POSES.translation[failure["pose"], 2])
        assert failure["polar_angle_deg"] == pytest.approx(POSES.polar_angle_deg[failure["pose"]], abs=0.01)


def test_views_too_bad_to_detect_are_counted_per_angle():
    # 12 mm dots vanish at 70 deg and are large enough in frontal views.
    result = validate_views(ngon(5, diameter=0.012), PAPER_CAMERA, POSES, count=20)
    assert result["by_polar_angle"]["0"]["rate"] == 1
    assert result["by_polar_angle"]["70"]["rate"] < 1
    assert result["detected"] + len(result["failures"]) == 20
    assert result["wrong"] == 0


def test_wrong_labels_are_counted_apart(monkeypatch):
    honest = views.detect

    def careless(image, marker, camera):
        found = honest(image, marker, camera)
        order = np.roll(np.arange(len(marker)), 1)
        return type(found)(True, found.ids, found.pixels[order], found.ellipse_centers[order])

    monkeypatch.setattr(views, "detect", careless)
    result = validate_views(ngon(5), PAPER_CAMERA, POSES, count=3)
    assert (result["detected"], result["wrong"], result["point_px"]["count"]) == (0, 3, 0)
    assert all("wrong label" in failure["reason"] for failure in result["failures"])


def test_more_views_than_poses():
    few = POSES.seen_whole(Circle(0.15), PAPER_CAMERA)
    few = type(few)("two", few.rotation[[0, 130]], few.translation[[0, 130]])
    chosen = [view.pose for view in take_views(ngon(5), PAPER_CAMERA, few, count=6)]
    assert chosen == [0, 0, 0, 1, 1, 1]


def test_progress_counts_to_the_end():
    calls = []
    validate_views(ngon(5), PAPER_CAMERA, POSES, count=3, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_view_as_png():
    view = next(take_views(ngon(5), PAPER_CAMERA, POSES, count=1))
    assert view.png().startswith(b"\x89PNG")
    assert view.detected


def test_optics_are_used():
    noisy = validate_views(ngon(5), PAPER_CAMERA, POSES, count=5, optics=Optics(noise_grey=8))
    quiet = validate_views(ngon(5), PAPER_CAMERA, POSES, count=5, optics=Optics(noise_grey=0))
    # Error goes with the noise; 8 grey levels against rounding alone is a factor above ten.
    assert noisy["point_px"]["rms"] > 5 * quiet["point_px"]["rms"]


@pytest.mark.parametrize(
    ("marker", "count", "said"), [(ngon(5), 0, "one view"), (ngon(5, False, 0.0), 3, "diameter 0")]
)
def test_impossible_requests_are_refused(marker, count, said):
    with pytest.raises(InputError, match=said):
        validate_views(marker, PAPER_CAMERA, POSES, count=count)
