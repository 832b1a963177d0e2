"""Drawings say their unit, or are asked for it."""

import numpy as np
import pytest
from drawings import SQUARE, dxf, geojson, read_outline, svg
from sentences import sentence

from markergen.read.outlines.formats import UNITS


@pytest.mark.parametrize(
    ("frame", "width"),
    [
        ('width="200mm" height="100mm" viewBox="0 0 200 100"', 0.05),
        ('width="20cm" height="10cm" viewBox="0 0 100 50"', 0.1),
        ('width="4in" height="2in" viewBox="-10 -10 400 200"', 0.0127),
        ('width="288pt" viewBox="0 0 400 200"', 0.0127),
        ('height="12pc" viewBox="0 0 400 200"', 0.0127),
        # The viewBox is fitted in whole, as it is by default.
        ('width="200mm" height="300mm" viewBox="0 0 200 100"', 0.05),
        ('width="200mm" height="300mm" viewBox="0 0 200 100" preserveAspectRatio="xMidYMid slice"', 0.15),
        # Pixels of CSS: 96 an inch.
        ('width="210mm" height="297mm"', 50 * 0.0254 / 96),
    ],
)
def test_svg_says_its_unit(write, frame, width):
    (ring,) = read_outline(write(svg('<rect x="10" y="10" width="50" height="20"/>', frame)))
    # Rounding alone.
    assert np.ptp(ring[:, 0]) == pytest.approx(width, rel=1e-12)
    assert np.ptp(ring[:, 1]) == pytest.approx(width * 0.4, rel=1e-12)


def test_a_stretched_svg(write):
    frame = 'width="200mm" height="300mm" viewBox="0 0 200 100" preserveAspectRatio="none"'
    (ring,) = read_outline(write(svg('<rect x="10" y="10" width="50" height="20"/>', frame)))
    np.testing.assert_allclose([ring.min(axis=0), ring.max(axis=0)], [[0.01, -0.09], [0.06, -0.03]], atol=1e-15)


@pytest.mark.parametrize(
    "frame",
    [
        "",
        'width="200" height="100"',
        'width="200px" height="100px" viewBox="0 0 200 100"',
        'width="100%" height="100%" viewBox="0 0 200 100"',
        'viewBox="0 0 200 100"',
        # Inkscape counted 90 px an inch then.
        'width="210mm" height="297mm" inkscape:version="0.48.4 r9939"',
    ],
)
def test_svg_without_a_unit_asks(write, refused, frame):
    text = svg('<rect x="10" y="10" width="30" height="40"/>', frame)
    assert sentence("no unit", 50) in refused(text)
    for unit, size in UNITS.items():
        if 0.001 <= 50 * size <= 100:
            (ring,) = read_outline(write(text), unit)
            assert np.ptp(ring[:, 0]) == pytest.approx(30 * size, rel=1e-12)


def test_a_size_in_pixels_is_named(refused):
    hint = "a width of 200px is no length: px takes 96 for an inch"
    assert hint in refused(svg('<rect width="30" height="40"/>', 'width="200px" height="100px"'))
    assert hint not in refused(svg('<rect width="30" height="40"/>', 'viewBox="0 0 200 100"'))


def test_the_users_unit_beats_the_files(write):
    (ring,) = read_outline(write(svg('<rect width="30" height="40"/>')), "in")
    assert np.ptp(ring[:, 0]) == pytest.approx(30 * 0.0254)


def test_an_unknown_unit(refused):
    assert "m, cm, mm, um, in, ft, px, pt" in refused(svg(""), unit="furlong")


@pytest.mark.parametrize(("code", "size"), [(1, 0.0254), (2, 0.3048), (4, 1e-3), (5, 0.01), (6, 1.0), (14, 0.1)])
def test_dxf_says_its_unit(write, code, size):
    (ring,) = read_outline(write(dxf(lambda _, m: m.add_lwpolyline([(0, 0), (1, 0), (1, 2)], close=True), code)))
    np.testing.assert_allclose(ring.max(axis=0), [size, 2 * size], rtol=1e-12)


@pytest.mark.parametrize(("code", "version"), [(0, "R2010"), (18, "R2010"), (4, "R12")])
def test_dxf_without_a_unit_asks(refused, code, version):
    """No unit, one of astronomers, and a version that has none: ezdxf would make meters of the last."""
    text = dxf(lambda _, m: m.add_line((0, 0), (3, 4)), code, version)
    assert version != "R12" or "INSUNITS" not in text
    assert sentence("no unit", 5) in refused(text)


def test_geojson_has_no_unit(refused):
    assert "give --boundary-unit" in refused(geojson(SQUARE))


@pytest.mark.parametrize(
    ("size", "unit", "phrase"),
    [
        ("200000", None, "300 m across"),
        ("2000000", None, "km"),
        ("0.1", None, "0.15 mm across"),
        ("200", "m", "300 m across with m for the unit; give another --boundary-unit"),
        ("200", "um", "0.3 mm across with um for the unit"),
    ],
)
def test_absurd_sizes_ask(refused, size, unit, phrase):
    message = refused(svg(f'<rect width="{float(size) * 0.9}" height="{float(size) * 1.2}"/>'), unit=unit)
    assert "1 mm to 100 m" in message
    assert phrase.replace("km", "3000 m") in message
