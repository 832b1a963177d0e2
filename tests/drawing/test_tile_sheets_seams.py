"""Seams against every choice there is, on drawings small enough to try all."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markergen.drawing.tile_sheets import KERF, SHORTEST, Item, find_seams


def cut(places, items) -> int:
    return sum(abs(place - item.middle) < item.half + KERF for place in places for item in items)


@settings(max_examples=40, deadline=None)
@given(
    extent=st.floats(120, 420),
    room=st.floats(100, 180),
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 8),
)
def test_no_choice_of_seams_cuts_fewer(extent, room, seed, count):
    rng = np.random.default_rng(seed)
    overlap = 10.0
    items = [
        Item(float(x), float(r), 2 * float(r))
        for x, r in zip(rng.uniform(0, extent, count), rng.uniform(3, 20, count), strict=True)
    ]
    result = find_seams(0.0, extent, room, overlap, items)
    if extent <= room:
        assert result.places == ()
        return
    edges = np.array([0.0, *result.places, extent])
    widths = np.diff(edges)
    outer, inner = room - overlap / 2, room - overlap
    assert widths[0] <= outer + 1e-9
    assert widths[-1] <= outer + 1e-9
    assert np.all(widths[1:-1] <= inner + 1e-9)
    assert widths.min() >= SHORTEST - 1e-9
    assert cut(result.places, items) == result.cut
    least = next(n for n in range(2, 99) if 2 * outer + (n - 2) * inner >= extent - 1e-9)
    assert len(result.places) + 1 in (least, least + 1)
    # All seams on a coarse grid with as few tiles.
    if least > 4:
        return
    grid = np.arange(0.0, extent, 4.0)
    hits = np.array([cut([place], items) for place in grid])
    chosen = np.array(list(combinations(range(len(grid)), least - 1)))
    gaps = np.diff(np.insert(grid[chosen], [0, least - 1], [0.0, extent], axis=1), axis=1)
    wide = (gaps[:, [0, -1]] > outer).any(axis=1) | (gaps[:, 1:-1] > inner).any(axis=1)
    others = hits[chosen].sum(axis=1)[~wide & (gaps.min(axis=1) >= SHORTEST)]
    assert np.all(others >= result.cut)
    assert len(result.places) + 1 == least or not np.any(others == 0)


def test_seams_keep_to_the_middle_of_a_gap():
    items = [Item(50, 10, 20), Item(110, 10, 20)]
    # Between the dots' edges at 60 and 100, out of both quiet zones.
    (place,) = find_seams(0, 160, 110, 10, items).places
    assert place == pytest.approx(80, abs=11)


def test_one_tile_more_rather_than_a_cut_dot():
    # With two tiles the seam has to be at 95 to 105, on the dot.
    assert len(find_seams(0, 200, 110, 10, []).places) == 1
    result = find_seams(0, 200, 110, 10, [Item(100, 20, 40)])
    assert (len(result.places), result.cut) == (2, 0)


def test_a_dot_wider_than_the_paper_is_cut():
    assert find_seams(0, 300, 110, 10, [Item(150, 150, 300)]).cut > 0
