from itertools import pairwise

import pytest

from markergen.drawing.paper import AMERICAN, ISO, find_paper
from markergen.errors import InputError


def test_iso_sizes_are_cut_in_half_each_time():
    # ISO 216: the short side is half the long side of the next larger size, rounded down to a whole mm.
    for small, large in pairwise(ISO):
        assert small.height == large.width
        assert small.width == large.height // 2
    assert ISO[-1].width * ISO[-1].height == pytest.approx(1e6, rel=1e-4)  # A0 is 1 m^2, in whole mm


def test_american_sizes_are_exact_inches():
    inches = {"letter": (8.5, 11), "legal": (8.5, 14), "tabloid": (11, 17)}
    for paper in AMERICAN:
        assert (paper.width, paper.height) == pytest.approx([25.4 * side for side in inches[paper.name]], abs=1e-9)


@pytest.mark.parametrize(
    ("name", "found", "size"),
    [
        ("a4", "A4", (210, 297)),
        ("A4-portrait", "A4", (210, 297)),
        ("A3-landscape", "A3-landscape", (420, 297)),
        ("Letter", "letter", (215.9, 279.4)),
    ],
)
def test_names_in_any_case_and_both_ways_round(name, found, size):
    paper = find_paper(name)
    assert (paper.name, paper.width, paper.height) == (found, *size)


def test_unknown_paper_lists_the_known_and_the_nearest():
    with pytest.raises(InputError, match=r"'lettre'; did you mean 'letter'\? Known: A5, A4, A3, A2, A1, A0, letter"):
        find_paper("lettre")
    with pytest.raises(InputError, match="known: A5"):
        find_paper("")
