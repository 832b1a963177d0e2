from math import inf, nan, radians

import pytest

from markergen.errors import InputError
from markergen.model.fabrication import PROCESSES, Fabrication


@pytest.mark.parametrize("process", list(PROCESSES))
def test_every_process_has_defaults(process):
    assert Fabrication(process=process).process == process


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"process": "casting"}, "found 'casting'; known: cnc, dome, fdm, laser, print"),
        ({"depth": 0.0}, "a depth above 0"),
        ({"depth": nan}, "a depth above 0"),
        ({"gap": -1e-4}, "a gap of 0 or more, found gap=-0.0001 m; use --gap"),
        ({"gap": inf}, "a gap of 0 or more"),
        ({"tool": 0.0}, "a tool above 0"),
        ({"foot": -1e-3}, "a foot of 0 or more"),
        ({"draft": -0.1}, "a draft of 0 to below 45 degrees"),
        ({"draft": radians(45)}, "a draft of 0 to below 45 degrees, found 45"),
        ({"draft": nan}, "a draft"),
        ({"tolerance": 0.0}, "a tolerance of 0.1 um to 1000 um, found tolerance=0 um"),
        ({"tolerance": 0.1}, "found tolerance=100000 um"),
        ({"process": "cnc", "fit": "loose"}, "a fit of slip or press"),
        ({"fit": "slip"}, "--fit with --process cnc, found --process fdm"),
        ({"through": True}, "--through with --process cnc"),
        ({"process": "laser", "dome": "ball"}, "--dome with --process dome"),
        ({"process": "dome", "dome": "whole"}, "domes of half or ball"),
    ],
)
def test_choices_that_cannot_be_are_one_line(values, phrase):
    with pytest.raises(InputError, match=phrase) as caught:
        Fabrication(**values)
    assert "\n" not in str(caught.value)


def test_zero_gaps_and_feet_are_allowed():
    assert Fabrication(gap=0.0, foot=0.0).gap == 0.0
