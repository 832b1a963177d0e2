from dataclasses import replace

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker import light_marker
from markergen.model.poses import PoseDistribution, paper
from markergen.render import Optics
from markergen.validation.view_records import summarize, take_records
from markergen.validation.views import SyntheticViews, pictures

POSES = paper()


@pytest.fixture(scope="module")
def series(ngon):
    return SyntheticViews(ngon(), PAPER_CAMERA, POSES, count=20)


def test_views_are_spread_evenly_over_the_poses(series):
    # 400 poses in 20 stretches: each polar angle of each distance once.
    chosen = [series.pose_of(k) for k in range(20)]
    assert [pose // 20 for pose in chosen] == list(range(20))


def test_more_views_than_poses(ngon):
    few = PoseDistribution("two", POSES.rotation[[0, 130]], POSES.translation[[0, 130]])
    series = SyntheticViews(ngon(), PAPER_CAMERA, few, count=6)
    assert [series.pose_of(k) for k in range(6)] == [0, 0, 0, 1, 1, 1]
    # The same pose again, with other noise.
    assert (series.take(0).image != series.take(1).image).any()


def test_same_view_same_image_other_seed_another(series):
    first, again = series.take(7), series.take(7)
    np.testing.assert_array_equal(first.image, again.image)
    other = replace(series, seed=1).take(7)
    assert (first.image != other.image).any()


def test_truth_is_where_the_dots_are(series):
    view = series.take(13)
    assert view.detected
    assert not view.failure
    # Measured 0.0044 px RMS over all poses; a dot ten times as far off would be another's.
    assert view.error_px.max() < 0.05
    assert view.uncorrected_px.max() > view.error_px.max()


def test_print_error_moves_dots_and_truth_alike(series):
    exact, printed = series.take(13), replace(series, errors=ErrorSources(print_sigma=1e-3)).take(13)
    # A millimeter is 0.5 to 1.3 px in these poses.
    assert 0.05 < np.abs(exact.truth - printed.truth).max() < 10
    assert printed.error_px.max() < 0.05


def test_hidden_dots_are_not_found_and_the_others_are(series):
    views = [replace(series, hidden=1).take(k) for k in range(6, 14)]
    assert len({int(view.hidden[0]) for view in views}) > 1
    for view in views:
        assert len(view.hidden) == 1
        if view.hidden[0] == 0:
            # Without its key a regular pentagon has five labelings.
            assert not view.detected
            assert "ambiguous" in view.failure or "key" in view.failure
        else:
            assert view.detected
            assert set(view.found) == set(range(5)) - set(view.hidden)
            assert view.error_px.max() < 0.05


@pytest.mark.parametrize("background", ["clutter", "photo"])
def test_background_is_behind_the_marker(series, background):
    plain, before = series.take(3), replace(series, background=background).take(3)
    assert (plain.image != before.image).mean() > 0.2
    inside = np.rint(plain.truth.mean(axis=0)).astype(int)
    # The middle of a pentagon is substrate; its noise has 2 grey levels.
    assert abs(int(before.image[inside[1], inside[0]]) - 225) < 15


def test_views_of_light_dots(series):
    light = replace(series, marker=light_marker(series.marker), background="photo")
    for k in (3, 13):
        view = light.take(k)
        assert view.detected, view.failure
        assert view.error_px.max() < 0.05
        inside = np.rint(view.truth.mean(axis=0)).astype(int)
        assert abs(int(view.image[inside[1], inside[0]]) - 30) < 15


def test_optics_are_used(ngon):
    quiet = SyntheticViews(ngon(), PAPER_CAMERA, POSES, optics=Optics(noise_grey=0)).take(0)
    noisy = SyntheticViews(ngon(), PAPER_CAMERA, POSES, optics=Optics(noise_grey=8)).take(0)
    corner = (slice(0, 20), slice(0, 20))
    assert quiet.image[corner].std() == 0
    # 400 samples know their standard deviation to 3.5 %.
    assert noisy.image[corner].std() == pytest.approx(8, rel=0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": -1}, "0 to 1000000 views"),
        ({"seed": -1}, "seed"),
        ({"hidden": 6}, "0 to 5 hidden"),
        ({"background": "fog"}, "clutter"),
    ],
)
def test_impossible_series_are_refused(ngon, options, message):
    with pytest.raises(InputError, match=message):
        SyntheticViews(ngon(), PAPER_CAMERA, POSES, **options)


def test_bare_points_cannot_be_seen(ngon):
    with pytest.raises(InputError, match="diameter 0"):
        SyntheticViews(ngon(key=False, diameter=0.0), PAPER_CAMERA, POSES)


def test_failures_come_first_then_the_worst_then_others(ngon):
    # 10 mm dots are 1.8 px across at 70 deg and 1.5 m: some views fail, others do not.
    series = SyntheticViews(ngon(diameter=0.010), PAPER_CAMERA, paper(), count=20, optics=Optics(noise_grey=6))
    views = summarize(series, take_records(series, workers=1))
    assert 0 < views["detected"] < 20
    printed = list(pictures(series, views))
    kinds = [picture.name.split("-")[0] for picture in printed]
    assert kinds == sorted(kinds, key=["failure", "worst", "typical"].index)
    assert set(kinds) == {"failure", "worst", "typical"}
    assert len({picture.name for picture in printed}) == len(printed)
    assert all(picture.png.startswith(b"\x89PNG") for picture in printed)
    assert printed[0].caption.endswith(f"{views['failures'][0]['reason']}.") or len(views["failures"]) > 6
