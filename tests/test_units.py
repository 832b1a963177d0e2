import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.options import settle
from markergen.options.declarations import DesignKeywords
from markergen.read.spec_file import spec_from_mapping
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


@pytest.mark.parametrize("text", ["1e300", "-1e300", "1001m", "1.0000001e6mm", "1e308in"])
def test_lengths_beyond_a_kilometer_are_refused(text):
    with pytest.raises(InputError, match="at most 1 km"):
        parse_length(text)
    assert parse_length("1000m") == 1000


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"dot": 1e-9}, "dot=1e-09 (a length of 1 um to 1 km"), ({"radius": 2e3}, "radius=2000.0 (a length of 1 um to"),
        ({"dot": "0.5um"}, "a length of 1 um to 1 km"), ({"print_sigma": 1e-9}, ""), ({"dot": 0}, ""),
        ({"clearance": "0mm"}, ""), ({"dot": "1um"}, ""),
    ],
)  # fmt: skip
def test_sizes_of_options(options, phrase):
    if not phrase:
        settle(options, DesignKeywords)
        return
    with pytest.raises(InputError) as caught:
        settle(options, DesignKeywords)
    assert phrase in str(caught.value)


def test_sizes_in_files_and_of_shapes():
    for radius in (1e-7, 1e4, 1e308):
        with pytest.raises(InputError, match="1 um to 1 km"):
            Circle(radius)
        with pytest.raises(InputError, match=r"1 um to 1 km|less than or equal to 1000"):
            spec_from_mapping({"boundary": {"kind": "circle", "radius": radius}})
    for values in ({"dot": "1e-9m"}, {"mount": "M2:0mm,1e308mm"}, {"radius": 1e300}):
        with pytest.raises(InputError, match=r"1 um to 1 km|of at most 1 km|unit with the number"):
            spec_from_mapping(values)
    assert spec_from_mapping({"print_sigma": "1e-9m", "noise_model": "image"}).print_sigma == 1e-9
