from itertools import pairwise

import pytest

from markergen.drawing.paper import AMERICAN, ISO, find_paper, oriented
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
    ("name", "result", "size"),
    [
        ("a4", "A4", (210, 297)),
        ("A4-portrait", "A4", (210, 297)),
        ("A3-landscape", "A3-landscape", (420, 297)),
        ("Letter", "letter", (215.9, 279.4)),
    ],
)
def test_names_in_any_case_and_both_ways_round(name, result, size):
    paper = find_paper(name)
    assert (paper.name, paper.width, paper.height) == (result, *size)


def test_unknown_paper_lists_the_known_and_the_nearest():
    with pytest.raises(InputError, match=r"'lettre'; did you mean 'letter'\? Known: A5, A4, A3, A2, A1, A0, letter"):
        find_paper("lettre")
    with pytest.raises(InputError, match="known: A5"):
        find_paper("")


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("300x400mm", (300, 400)),
        ("300 x 400 mm", (300, 400)),
        ("1067X914.4mm", (1067, 914.4)),
        ("300mmx400mm", (300, 400)),
    ],
)
def test_paper_of_any_size(name, size):
    paper = find_paper(name)
    assert (paper.width, paper.height) == size
    assert paper.name == f"{size[0]:g}x{size[1]:g}mm"
    assert str(paper) == f"{size[0]:g} x {size[1]:g} mm"
    assert paper.turned.turned == paper
    assert (paper.turned.width, paper.turned.height) == size[::-1]


def test_a_paper_turned_has_its_usual_name():
    assert find_paper("A4").turned == find_paper("A4-landscape") == find_paper("a4", "landscape")
    assert find_paper("A4-landscape").turned == find_paper("A4") == find_paper("A4", "portrait")
    assert find_paper("300x400mm", "landscape").name == "400x300mm"
    assert find_paper("300x400mm-landscape").name == "400x300mm"
    assert find_paper("300x300mm", "landscape").name == "300x300mm"


@pytest.mark.parametrize("name", ["0x0mm", "99x400mm", "300x6000mm", "1e9x1mm", "3..0x400mm"])
def test_sizes_beyond_all_reason(name):
    with pytest.raises(InputError, match=r"of 100 to 5000 mm|paper size"):
        find_paper(name)


def test_name_and_orientation_must_agree():
    with pytest.raises(InputError, match="leave out -landscape"):
        find_paper("A4-landscape", "portrait")


def test_a_name_may_say_which_way_round():
    assert [oriented(name) for name in ("A4", "a4-Landscape", "A4-portrait", "300x400mm")] == [False, True, True, True]
