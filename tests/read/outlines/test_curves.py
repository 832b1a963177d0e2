"""Curves are followed to the tolerance."""

import math

import numpy as np
import pytest
from drawings import area, farthest, read_outline, svg
from hypothesis import given, settings
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.geometry.outlines import TOLERANCE
from markergen.read.outlines.curves import Arc, Bezier, Polyline, Spline, bulge
from markergen.read.outlines.formats import OutlineFile
from markergen.read.outlines.svg import Element, Shapes

COORDINATE = st.floats(-0.3, 0.3).map(lambda x: round(x, 6))
POINT = st.tuples(COORDINATE, COORDINATE).map(np.array)


@settings(max_examples=60)
@given(st.lists(POINT, min_size=3, max_size=5).map(np.array), st.sampled_from([4.5e-6, 1e-4]))
def test_beziers_are_followed(points, tolerance):
    t = np.linspace(0, 1, 3001)[:, None]
    n = len(points) - 1
    curve = sum(math.comb(n, k) * t**k * (1 - t) ** (n - k) * points[k] for k in range(n + 1))
    polyline = Bezier(points).flatten(tolerance)
    np.testing.assert_array_equal(polyline[[0, -1]], points[[0, -1]])
    # The samples are exact to rounding.
    assert farthest(curve, polyline) <= tolerance + 1e-12


@settings(max_examples=60)
@given(POINT, POINT, POINT, st.floats(-7, 7), st.floats(-6.28, 6.28), st.sampled_from([4.5e-6, 1e-4]))
def test_arcs_are_followed_however_they_are_sheared(center, u, v, start, sweep, tolerance):
    t = start + sweep * np.linspace(0, 1, 3001)[:, None]
    curve = center + u * np.cos(t) + v * np.sin(t)
    polyline = Arc(center, u, v, start, sweep).flatten(tolerance)
    assert farthest(curve, polyline) <= tolerance + 1e-12


@pytest.mark.parametrize("seed", range(8))
def test_splines_are_followed(seed):
    from scipy.interpolate import BSpline

    rng = np.random.default_rng(seed)
    degree, n = int(rng.integers(1, 6)), int(rng.integers(6, 15))
    points, weights = rng.uniform(-0.1, 0.1, (n, 2)), rng.uniform(0.3, 3, n)
    inner = np.sort(rng.choice(np.arange(1.0, 6.0), n - degree - 1))
    knots = np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, 6.0)])
    curve = Spline(points, weights, knots, degree)
    homogeneous = BSpline(knots, np.column_stack([points * weights[:, None], weights]), degree)
    t = np.linspace(0, 6, 20001)
    values = homogeneous(t)
    samples = values[:, :2] / values[:, 2:]
    polyline = curve.flatten(4.5e-6)
    # A knot as often as the degree is a jump only beyond it.
    assert farthest(samples, polyline) <= 4.5e-6
    np.testing.assert_allclose(polyline[[0, -1]], points[[0, -1]], atol=1e-15)


@pytest.mark.parametrize("amount", [1.0, -1.0, 0.5, -0.2, 3.0, 1e-5])
def test_bulges_are_tangents_of_a_quarter_of_the_angle(amount):
    start, end = np.array([1.0, 2.0]), np.array([4.0, 6.0])
    points = bulge(start, end, amount).flatten(1e-6)
    np.testing.assert_allclose(points[[0, -1]], [start, end], atol=1e-9)
    # The arc's middle is `amount` half chords off, to the right of the way from start to end if it is positive.
    middle = points[len(points) // 2] - (start + end) / 2
    np.testing.assert_allclose(middle, 2.5 * amount * np.array([0.8, -0.6]), atol=1e-9)


def test_no_bulge_is_a_line():
    line = bulge(np.zeros(2), np.ones(2), 1e-9)
    assert isinstance(line, Polyline)
    np.testing.assert_array_equal(line.flatten(1e-6), [[0, 0], [1, 1]])


@settings(max_examples=40)
@given(st.data())
def test_path_data_as_svgelements_sees_it(data):
    """Points of svgelements' own curves are on the polygon; closed by the reader, so that any path has a ring."""
    from svgelements import Path as SvgPath

    def numbers(count):
        return " ".join(f"{data.draw(st.floats(-60, 60)):.2f}" for _ in range(count))

    text, kind = f"M{numbers(2)}", ""
    for _ in range(data.draw(st.integers(1, 5))):
        # After a curve of the other degree svgelements mirrors its control point, against the standard.
        others = {"C": "Tt", "S": "Tt", "Q": "Ss", "T": "Ss"}.get(kind.upper(), "")
        kind = data.draw(st.sampled_from([letter for letter in "LlHhVvCcSsQqTtAa" if letter not in others]))
        if kind in "Aa":
            radii = " ".join(f"{data.draw(st.floats(1, 60)):.2f}" for _ in range(2))
            flags = " ".join(str(data.draw(st.integers(0, 1))) for _ in range(2))
            text += f"{kind}{radii} {data.draw(st.integers(-180, 180))} {flags} {numbers(2)}"
        else:
            text += kind + numbers({"L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2}[kind.upper()])
    polyline = path_points(text)
    points = [point for segment in SvgPath(text)[1:] for point in map(segment.point, np.linspace(0, 1, 41))]
    # svgelements' arcs are off by up to 1e-6 of their size.
    assert farthest(np.array([(point.x, point.y) for point in points]), polyline) <= 1e-3 + 1e-4


@pytest.mark.parametrize(
    ("smooth", "plain"),
    [
        ("C 0 9 5 9 5 0 T 9 9", "C 0 9 5 9 5 0 Q 5 0 9 9"),
        ("Q 3 9 5 0 s 4 0 4 9", "Q 3 9 5 0 C 5 0 9 0 9 9"),
        ("c0-5 5-5 5 0 5 5 5 0", None),
        ("a4 4 0 0110 0", "A4 4 0 0 1 10 0"),
        ("a4 4 0 01.5.5", "A4 4 0 0 1 .5 .5"),
    ],
)
def test_path_data_as_the_standard_has_it(smooth, plain):
    """A smooth curve after one of another degree has no control point to mirror; flags need nothing between them."""
    if plain is None:
        with pytest.raises(InputError, match="path data"):
            path_points(f"M 0 0 {smooth}")
        return
    np.testing.assert_array_equal(path_points(f"M 0 0 {smooth}"), path_points(f"M 0 0 {plain}"))


def path_points(text):
    pieces = Shapes(OutlineFile("file", b"")).pieces(Element("path", {"d": text}), "path", (1, 1))
    return np.concatenate([curve.flatten(1e-3) for piece in pieces for curve in piece.curves])


def test_a_circle_of_two_arcs_meets_itself(write):
    (ring,) = read_outline(write(svg('<path d="M 60 50 a 40 40 0 0 1 80 0 a 40 40 0 0 1 -80 0 z"/>')))
    distance = np.hypot(*(ring - [0.1, -0.05]).T)
    np.testing.assert_allclose(distance, 0.04, rtol=1e-7)
    # A polygon inside a circle loses 2/3 of the sagitta along the rim.
    assert math.pi * 0.04**2 - area([ring]) <= 2 * math.pi * 0.04 * TOLERANCE


def test_small_drawings_are_followed_more_closely(write):
    (ring,) = read_outline(write(svg('<circle r="1"/>')))
    chord = np.hypot(*(ring - np.roll(ring, 1, axis=0)).T).max()
    assert 1e-3 - math.sqrt(1e-6 - chord**2 / 4) <= 1e-4 * 2.9e-3
