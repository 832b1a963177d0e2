"""What is known of a print's scale: by nothing, its rulers, lengths between dots, or both; photographs add nothing."""

import re
from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from benchmarks.calibration_sets import CAMERA
from markergen.calibration.calibration import ANEW, Known
from markergen.calibration.network import Length
from markergen.calibration.scale import ScaleErrors
from markergen.errors import InputError
from markergen.model.rescale import Rulers, by_rulers, rescale_body, scale_sigmas

RULER, WIDE = 2e-4, 0.2
"""Standard deviation of a length and the length of the rulers, m."""


def share(marker):
    """Standard deviation of a measured marker's scale, by the covariance of its dots."""
    away = (marker.xyz - marker.xyz.mean(axis=0)).ravel()
    return np.sqrt(away @ marker.joint_covariance.array @ away) / (away @ away)


@pytest.fixture(scope="module")
def design(make_ngon):
    return make_ngon(6, 0.1, 0.02)


def known(*lengths):
    return Known(CAMERA, errors=ScaleErrors(0.002, RULER), lengths=lengths)


def length(design, measured=1.0):
    across = float(np.linalg.norm(design.xyz[0] - design.xyz[3]))
    return Length(0, 3, measured * across, RULER)


def test_a_scale_that_nothing_measures_is_that_of_prints(calibrated, design):
    result = calibrated([design], 5, known(), false=0)
    assert share(result.markers[0]) == pytest.approx(0.002 / np.sqrt(2), rel=0.01)
    assert "to 0.2 % along x and y each, to 0.14 %" in result.scale_source


def test_rulers_tell_the_scale_as_well_as_they_are_read(calibrated, design):
    printed, _ = rescale_body(design, Rulers(1.001 * WIDE, 0.999 * WIDE))
    assert scale_sigmas(printed, 0.002, RULER) == (0.001, 0.001)
    result = calibrated([printed], 5, known(), false=0)
    assert share(result.markers[0]) == pytest.approx(0.001 / np.sqrt(2), rel=0.01)
    assert "known to 0.071 %" in result.scale_source
    assert ANEW not in result.notes
    assert ANEW in calibrated(result.markers, 5, known(), false=0).notes
    again = calibrated([by_rulers(result.markers[0])], 5, known(), false=0)
    assert share(again.markers[0]) == pytest.approx(share(result.markers[0]), rel=1e-3)


def test_a_ruler_that_was_not_measured_tells_nothing(design):
    printed, _ = rescale_body(design, Rulers(WIDE, None))
    assert printed.print_scale == (1.0, 1.0)
    assert scale_sigmas(printed, 0.002, RULER) == (0.001, 0.002)
    assert scale_sigmas(design, 0.002, RULER) == (0.002, 0.002)
    odd = replace(design, provenance={"print": {"rulers": {"measured_x": "wide", "nominal_x": "wide"}}})
    assert scale_sigmas(odd, 0.002, RULER) == (0.002, 0.002)


def test_a_measured_length_and_the_rulers_count_by_their_precision(calibrated, design):
    alone = calibrated([design], 8, known(length(design)), false=0)
    ours = RULER / length(design).length
    assert share(alone.markers[0]) == pytest.approx(ours, rel=0.05)
    assert sentence("scale doubted") not in alone.scale_source
    printed, _ = rescale_body(design, Rulers(WIDE, WIDE))
    result, moved = (calibrated([printed], 8, known(length(design, item)), false=0) for item in (1.0, 1.002))
    assert "and the rulers" in result.scale_source
    both, off = result.markers[0], moved.markers[0]
    together = (ours**-2 + 2 * 0.001**-2) ** -0.5
    assert share(both) == pytest.approx(together, rel=0.05)
    # The mean of what the length and the rulers tell, by their weights.
    sizes = [np.linalg.norm(item.xyz - item.xyz.mean(axis=0)) for item in (both, off)]
    assert sizes[1] / sizes[0] - 1 == pytest.approx(0.002 * (together / ours) ** 2, rel=0.1)


def test_a_measured_length_makes_no_rotation_worse(calibrated, design):
    alone, ruled = (calibrated([design], 8, known(*lengths), false=0).after for lengths in ((), (length(design),)))
    assert ruled.rotation_deg == pytest.approx(alone.rotation_deg, rel=0.01)
    assert ruled.translation < alone.translation


def test_a_length_over_the_outer_edges_is_told(design, tmp_path):
    across = float(np.linalg.norm(design.xyz[0] - design.xyz[3]))
    with pytest.raises(InputError, match="20 mm less than"):
        mg.calibrate(design, tmp_path, CAMERA, measured=[f"0-3={across + 0.02:.4f}m"])
    with pytest.raises(InputError, match="the dots' numbers"):
        mg.calibrate(design, tmp_path, CAMERA, measured=[f"0-3={2 * across:.4f}m"])


def test_a_length_that_tells_no_more_than_is_assumed_says_so(calibrated, design):
    result = calibrated([design], 5, known(replace(length(design), sigma=1e-3)), false=0)
    assert sentence("scale doubted") + ", 0.14 %" in result.scale_source


@pytest.mark.long
def test_rulers_that_contradict_the_photographs_are_doubted_where_the_scale_is_said(calibrated, design):
    # The print is 0.3 % longer along x than along y.
    doubts = {}
    for read in (1.003, 1.0, 1.012, 0.992):
        printed, _ = rescale_body(design, Rulers(WIDE * read, WIDE))
        result = calibrated([printed], 8, known(), false=0, made=[design])
        message = result.scale_source
        doubts[read] = re.findall(r"the print is ([\d.]+ % \w+) along x, compared with y, than by them", message)
        assert "contradict" not in str(result.notes)
        # One of two rulers is wrong, and their mean by half of that.
        left = abs(1.003 / read - 1) / 2 if doubts[read] else 0.001 / np.sqrt(2)
        assert share(result.markers[0]) == pytest.approx(left, rel=0.05)
        assert f"known to {100 * share(result.markers[0]):.2g} %{' only' * bool(doubts[read])}" in message
        # Such rulers tell of the print as designed no more than of the measured one.
        assert result.before.translation > result.after.translation
    assert not doubts[1.003]
    assert not doubts[1.0]  # off by twice what a ruler may be
    assert doubts[1.012] == ["0.91 % shorter"]
    assert doubts[0.992] == ["1.1 % longer"]


def test_doubted_rulers_count_less_beside_a_measured_length(calibrated, design):
    shares, sizes = [], []
    for read in (1.0, 1.03):
        printed, _ = rescale_body(design, Rulers(WIDE * read, WIDE))
        result = calibrated([printed], 8, known(length(design)), false=0, made=[design])
        shares.append(share(result.markers[0]))
        sizes.append(np.linalg.norm(result.markers[0].xyz - result.markers[0].xyz.mean(axis=0)))
        assert ("the rulers contradict" in result.scale_source) == (read > 1)
    alone = calibrated([design], 8, known(length(design)), false=0).markers[0]
    both = ((RULER / length(design).length) ** -2 + 2 * 0.001**-2) ** -0.5
    assert shares == pytest.approx([both, share(alone)], rel=0.05)
    assert sizes[1] == pytest.approx(np.linalg.norm(alone.xyz - alone.xyz.mean(axis=0)), rel=1e-4)


def test_the_rulers_of_another_marker_are_doubted_in_a_note(calibrated, design):
    printed, _ = rescale_body(design, Rulers(WIDE, 1.03 * WIDE))
    result = calibrated([design, printed], 8, known(), false=0, made=[design, design])
    assert "contradict" not in result.scale_source
    assert "print is 3.3 % longer along x" in str(result.notes)
    assert share(result.markers[1]) > 0.01
