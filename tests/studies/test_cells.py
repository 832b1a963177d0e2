import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.studies.cells import Cell

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(), VALUES, max_size=4))
def test_equal_settings_make_equal_cells_in_whatever_order(settings):
    cell, other = Cell("kind", settings), Cell("kind", dict(reversed(settings.items())))
    assert cell == other
    assert hash(cell) == hash(other)
    assert (cell.key, cell.name, cell.seed) == (other.key, other.name, other.seed)


def test_kind_and_every_setting_make_another_cell_with_other_numbers():
    cells = [Cell("a", {"n": 4}), Cell("b", {"n": 4}), Cell("a", {"n": 5}), Cell("a", {"n": 4, "m": 0})]
    assert len({cell.name for cell in cells}) == len(set(cells)) == 4
    assert len({float(cell.rng.standard_normal()) for cell in cells}) == 4


def test_the_name_and_seed_of_a_cell_stay_what_they_are():
    """Files of studies that are under way are found by them."""
    cell = Cell("design", {"n": 4, "radius": 0.15})
    assert cell.key == '{"kind":"design","settings":{"n":4,"radius":0.15}}'
    assert cell.name == "ccd596fba7104332"
    assert cell.seed == 0x3EC22409017F5F1CF65BC7D06DACC40B


def test_settings_are_as_json_has_them_and_do_not_follow_what_they_were_made_of():
    settings = {"points": (1, 2)}
    cell = Cell("a", settings)
    settings["points"] = 3
    assert cell.settings == {"points": [1, 2]}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), {1, 2}, np.zeros(2)])
def test_what_is_no_json_is_refused(value):
    with pytest.raises((TypeError, ValueError)):
        Cell("a", {"value": value})
