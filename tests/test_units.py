import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.units import METERS, format_length, parse_length


@pytest.mark.parametrize(
    ("text", "meters"),
    [
        ("0.15", 0.15),
        ("150mm", 0.15),
        ("15 cm", 0.15),
        ("6in", 0.1524),
        ("1ft", 0.3048),
        ("36000um", 0.036),
        (0.15, 0.15),
    ],
)
def test_known_units_are_exact(text, meters):
    assert parse_length(text) == meters


@pytest.mark.parametrize("text", ["", "mm", "15 parsec", "1,5mm", "0x10", "1 2", "--3"])
def test_what_is_no_length_is_refused_with_the_known_units(text):
    with pytest.raises(InputError, match="mm"):
        parse_length(text, "radius")


def test_a_decimal_comma_is_answered_with_the_point():
    with pytest.raises(InputError, match=r"'150,4mm'; write a point: 150\.4mm$"):
        parse_length("150,4mm")


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e999", "1e99999999999999999999", "1e9999999mm"])
def test_lengths_are_finite(text):
    with pytest.raises(InputError, match=r"finite radius|length for radius"):
        parse_length(text, "radius")


@given(st.floats(1e-4, 1e3), st.sampled_from([unit for unit in METERS if unit]))
def test_a_unit_scales_as_its_table_says(value, unit):
    # Two roundings in the float product, one in ours.
    assert math.isclose(parse_length(f"{value!r}{unit}"), value * float(METERS[unit]), rel_tol=4e-16)


@given(st.floats(1e-6, 10))
def test_what_is_written_reads_back(meters):
    # Six significant digits are written.
    assert math.isclose(parse_length(format_length(meters)), meters, rel_tol=1e-5)
