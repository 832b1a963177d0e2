from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.detect import Detector
from markergen.errors import InputError
from markergen.model.body_json import from_json, to_json
from markergen.model.rescale import (
    RULERS_MM,
    MeasuredDot,
    Rulers,
    exchanged,
    photographed,
    poor_fit_sentence,
    remeasure,
    rescale_body,
)


def again(marker):
    return from_json(to_json(marker).decode())


def test_two_rulers_two_factors(pentagon):
    result, message = rescale_body(pentagon, Rulers(0.1986, 0.1991))
    np.testing.assert_allclose(result.xyz, pentagon.xyz * [0.993, 0.9955, 1], rtol=1e-15)
    assert result.print_scale == pytest.approx((0.993, 0.9955), rel=1e-15)
    assert result.provenance["print"]["rulers"]["measured_x"] == 0.1986
    assert [p.feature for p in result.control_points] == [p.feature for p in pentagon.control_points]
    assert "99.3 % of the design along x and 99.55 %" in message[0]
    assert "98.33 % of the design along x and 100 %" in rescale_body(pentagon, Rulers(0.0983333, 0.1))[1][0]
    assert again(result) == result
    # What is drawn is still the design; coordinates are rounded to a picometer.
    np.testing.assert_allclose(result.as_designed.xyz, pentagon.xyz, atol=1e-12)
    assert pentagon.as_designed is pentagon


def test_one_ruler_stands_for_both_and_says_so(pentagon):
    for rulers in (Rulers(0.199, None), Rulers(None, 0.199)):
        result, message = rescale_body(pentagon, rulers)
        assert result.print_scale[0] == result.print_scale[1] == pytest.approx(0.995)
        assert any("stands for" in item for item in message)


def test_shorter_rulers(pentagon):
    result, message = rescale_body(pentagon, Rulers(0.0995, 0.151, 0.1, 0.15))
    assert result.print_scale == pytest.approx((0.995, 0.151 / 0.15))
    assert message[0].endswith("x 99.5 mm of 100 mm, y 151 mm of 150 mm.")
    assert not any("This assumes" in sentence for sentence in message)


@given(st.sampled_from(RULERS_MM), st.sampled_from(RULERS_MM), st.floats(0.9501, 1.0499), st.floats(0.9501, 1.0499))
def test_a_length_tells_which_ruler_was_measured(pentagon, x, y, sx, sy):
    result, message = rescale_body(pentagon, Rulers(x * sx / 1e3, y * sy / 1e3))
    assert result.print_scale == pytest.approx((sx, sy))
    assert message[1].startswith(f"This assumes --nominal-x {x}mm and --nominal-y {y}mm;")
    assert result.provenance["print"]["rulers"]["nominal_y"] == y / 1e3
    assert rescale_body(pentagon, Rulers(x * sx / 1e3, y * sy / 1e3, x / 1e3, y / 1e3))[0] == result


def test_every_length_that_fits_none_needs_its_nominal(pentagon):
    for length in np.arange(0.01, 0.3, 0.0005):
        nearby = [mm for mm in RULERS_MM if abs(length * 1e3 / mm - 1) < 0.05 - 1e-9]
        assert len(nearby) <= 1
        if not nearby:
            with pytest.raises(InputError, match=r"5 % .* 200, 150, 100, 50 or 20 mm, found"):
                rescale_body(pentagon, Rulers(float(length), None), force=True)


@given(st.floats(0.192, 0.208), st.floats(0.192, 0.208), st.floats(0.192, 0.208))
def test_a_second_rescaling_takes_the_place_of_the_first(pentagon, x, y, other):
    once, _ = rescale_body(pentagon, Rulers(x, y))
    before, _ = rescale_body(pentagon, Rulers(other, None))
    twice, message = rescale_body(before, Rulers(x, y))
    np.testing.assert_allclose(twice.xyz, once.xyz, atol=2e-12)
    assert twice.print_scale == once.print_scale
    assert (before.print_scale == (1, 1)) != any("takes the place" in item for item in message)


@pytest.mark.parametrize(
    ("rulers", "message"),
    [
        (Rulers(None, None), "found none"),
        (Rulers(0.19, None), "found 190 mm; check the unit; or give --nominal-x"),
        (Rulers(0.19, None, 0.2), "found 190 mm, which is -5.00 %"),
        (Rulers(None, 0.2101, None, 0.2), "+5.05 %"),
        (Rulers(0.2, 0.07), "give --nominal-y"),
        (Rulers(198.6, 0.2), "check the unit"),
        (Rulers(0.0, 0.2), "above 0"),
        (Rulers(-0.2, 0.2), "above 0"),
        (Rulers(np.nan, 0.2), "above 0"),
        (Rulers(0.2, 0.2, 0.0), "nominal_x=0.0"),
        (Rulers(0.2, 0.2, 0.2, np.inf), "nominal_y=inf"),
    ],
)
def test_lengths_that_cannot_be(pentagon, rulers, message):
    with pytest.raises(InputError) as error:
        rescale_body(pentagon, rulers)
    assert message in str(error.value)


def test_a_length_without_its_unit_is_not_on_the_sheet(pentagon):
    with pytest.raises(InputError, match=r"at most .*found 150 m; give it"):
        rescale_body(pentagon, Rulers(149.7, None, 150.0))


def test_rulers_that_fit_when_exchanged_are_asked_about(pentagon):
    sheets = [(0.15, 0.1), (0.2, 0.2), (0.2, 0.0)]
    assert exchanged(Rulers(0.0996, 0.1504), sheets) == (0.15, 0.1)
    for x, y in ((0.1504, 0.0996), (0.199, 0.201), (0.1, 0.2), (0.1, None), (float("nan"), 0.15), (0.0, 0.15)):
        assert exchanged(Rulers(x, y), sheets) is None
    with pytest.raises(InputError, match=r"y 100 mm, found x 99.6 mm and y 150.4 mm; .* exch"):
        rescale_body(pentagon, Rulers(0.0996, 0.1504, 0.15, 0.1))
    with pytest.raises(InputError, match="are x and y exchanged"):
        rescale_body(replace(pentagon, rulers=(0.15, 0.1)), Rulers(0.0996, 0.1504))


def test_five_percent_and_more_with_force(pentagon):
    assert rescale_body(pentagon, Rulers(0.18, 0.2, 0.2), force=True)[0].print_scale == pytest.approx((0.9, 1))
    with pytest.raises(InputError):
        rescale_body(pentagon, Rulers(0.05, 0.2, 0.2), force=True)


def measured(marker, rng, sigma=2e-5, angle=0.7, ids=None, covariance=(4e-10, 1e-10, 2e-10)):
    c, s = np.cos(angle), np.sin(angle)
    places = (marker.xyz[:, :2] + sigma * rng.standard_normal((len(marker), 2))) @ [[c, s], [-s, c]] + [0.3, -0.2]
    return tuple(
        MeasuredDot(point.id, float(x), float(y), covariance)
        for point, (x, y) in zip(marker.control_points, places, strict=True)
        if ids is None or point.id in ids
    )


def test_measured_dots_come_home_from_any_frame(pentagon):
    exact = measured(pentagon, np.random.default_rng(0), sigma=0.0)
    result, message = remeasure(pentagon, exact)
    np.testing.assert_allclose(result.xyz, pentagon.xyz, atol=2e-12)
    assert "turned by -40.107 deg" in message[0]
    # The covariance is turned with the frame: R S R' with the inverse of the turn above.
    c, s = np.cos(-0.7), np.sin(-0.7)
    rotation = np.array([[c, -s], [s, c]])
    expected = rotation @ [[4e-10, 1e-10], [1e-10, 2e-10]] @ rotation.T
    np.testing.assert_allclose(result.place_covariance[0], expected, rtol=1e-9)
    assert again(result) == result
    np.testing.assert_allclose(result.as_designed.xyz, pentagon.xyz, atol=1e-12)
    assert result.as_designed.place_covariance is None


def test_what_was_not_measured_keeps_its_place_and_is_named(pentagon):
    result, message = remeasure(pentagon, measured(pentagon, np.random.default_rng(1), ids=(0, 2, 3)))
    assert [point.covariance is None for point in result.control_points] == [False, True, False, False, True]
    np.testing.assert_array_equal(result.xyz[[1, 4]], pentagon.xyz[[1, 4]])
    assert "Dots 1, 4 were" in message[-1]
    assert np.isnan(result.place_covariance[[1, 4]]).all()
    # Measuring the rest later does not undo what was measured before.
    rest, _ = remeasure(result, measured(pentagon, np.random.default_rng(2), ids=(1, 4)))
    assert not np.isnan(rest.place_covariance).any()
    np.testing.assert_array_equal(rest.xyz[[0, 2, 3]], result.xyz[[0, 2, 3]])


def test_measuring_a_rescaled_print(pentagon):
    scaled, _ = rescale_body(pentagon, Rulers(0.198, 0.199))
    result, _ = remeasure(scaled, measured(scaled, np.random.default_rng(3), ids=(0, 1, 2)))
    np.testing.assert_allclose(result.as_designed.xyz, pentagon.xyz, atol=2e-12)
    assert result.print_scale == scaled.print_scale
    with pytest.raises(InputError, match="one by one"):
        rescale_body(result, Rulers(0.2, 0.2))


def test_without_sigma(pentagon):
    result, message = remeasure(pentagon, measured(pentagon, np.random.default_rng(1), covariance=None))
    assert result.place_covariance is None
    assert result.control_points[0].designed == pytest.approx((pentagon.xyz[0, 0], pentagon.xyz[0, 1]), abs=1e-12)
    assert "No dot has" in message[-1]


def test_a_print_may_reach_beyond_what_was_designed(pentagon):
    # The outermost dots touch the clearance: 4 % more is beyond the boundary, and still this marker.
    larger, _ = rescale_body(pentagon, Rulers(0.208, 0.208))
    assert again(larger) == larger


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda found: found[:1], "two measured dots"),
        (lambda found: (*found, found[0]), "twice"),
        (lambda found: (*found[:4], MeasuredDot(9, 0, 0)), "found id 9; the marker has 0, 1, 2, 3, 4"),
        (lambda found: tuple(MeasuredDot(d.id, 1e3 * d.x, 1e3 * d.y) for d in found), "unit"),
        (lambda found: tuple(MeasuredDot(d.id, 1.3 * d.x, 1.3 * d.y) for d in found), "--force"),
        # 5 % off is as much for dots as it is for a ruler.
        (lambda found: tuple(MeasuredDot(d.id, 1.051 * d.x, 1.051 * d.y) for d in found), "--force"),
        (lambda found: tuple(MeasuredDot(d.id, 0.949 * d.x, 0.949 * d.y) for d in found), "--force"),
        (lambda found: tuple(MeasuredDot(d.id, 0, 0) for d in found), "apart from each other"),
        (lambda found: tuple(MeasuredDot(d.id, np.nan, d.y) for d in found), "apart from each other"),
    ],
)
def test_measured_dots_that_cannot_be(pentagon, change, message):
    with pytest.raises(InputError) as error:
        remeasure(pentagon, change(measured(pentagon, np.random.default_rng(0), 0.0, covariance=None)))
    assert message in str(error.value)


def test_just_below_five_percent_needs_no_force(pentagon):
    dots = measured(pentagon, np.random.default_rng(0), 0.0)
    result, _ = remeasure(pentagon, tuple(MeasuredDot(d.id, 0.951 * d.x, 0.951 * d.y) for d in dots))
    # The middle of the dots stays where it was designed.
    middle = pentagon.xyz.mean(axis=0)
    np.testing.assert_allclose(result.xyz - middle, 0.951 * (pentagon.xyz - middle), atol=1e-9)


def test_mirrored_measurements_are_told(make_marker):
    skew = make_marker(np.array([[0.03, 0.02], [-0.035, 0.018], [-0.01, -0.03], [0.036, -0.012]]), 0.05, 0.012)
    down = tuple(MeasuredDot(d.id, d.x, -d.y) for d in measured(skew, np.random.default_rng(0), 0.0))
    with pytest.raises(InputError, match="mirrored"):
        remeasure(skew, down)
    assert len(remeasure(skew, down, force=True)[0]) == 4


@pytest.mark.parametrize(("factor", "is_doubted"), [(1.4, False), (7.35, True)])
def test_photographs_that_fit_worse_than_their_noise_are_named(make_ngon, factor, is_doubted):
    marker = make_ngon(4, 0.05, 0.012)
    assert poor_fit_sentence(marker) == ""
    ids = [point.id for point in marker.control_points]
    measured = photographed(marker, ids, marker.xyz, np.eye(12) * 1e-12, {"variance_factor": factor})
    assert bool(poor_fit_sentence(measured)) == is_doubted
    assert Detector(measured).note.endswith("than claimed") == is_doubted
