"""Outlines of drawings: what programs write is read to 5 um, and what cannot be read is told in one line."""

import io
import json
import math
import random
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.read.outlines import OUTLINE_FORMATS, TOLERANCE, UNITS, parse_boundary, read_outline
from markergen.read.outlines.curves import Arc, Bezier, Polyline, Spline, bulge
from markergen.read.outlines.rings import Track, close

DATA = Path(__file__).parent / "data"
# 200 x 100 mm with corners of radius 10 mm; a hole of 40 mm across, four of 6 mm.
PLATE = 0.2 * 0.1 - (4 - math.pi) * 0.01**2
HOLED = PLATE - math.pi * 0.02**2 - 4 * math.pi * 0.003**2


def area(rings):
    return sum(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 for x, y in (ring.T for ring in rings))


def region(rings):
    """The region by other means: symmetric difference is what even-odd means."""
    shape = shapely.Polygon()
    for ring in rings:
        shape = shape.symmetric_difference(shapely.Polygon(ring))
    return shape


@pytest.fixture
def write(tmp_path):
    def write(content, name="drawing"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def refused(write):
    """Words of the one line that reading ends with."""

    def refused(content, **options):
        path = content if isinstance(content, Path) else write(content)
        with pytest.raises(InputError) as caught:
            read_outline(path, **options)
        message = str(caught.value)
        assert "\n" not in message
        assert len(message) < 700
        return message

    return refused


def svg(body, frame='width="200mm" height="100mm" viewBox="0 0 200 100"'):
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" {frame}>{body}</svg>'
    )


def dxf(draw, unit=4, version="R2010"):
    """Text of a DXF that `draw` puts entities into."""
    import ezdxf

    document = ezdxf.new(version)
    document.units = unit
    draw(document, document.modelspace())
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def geojson(*rings):
    return json.dumps({"type": "Polygon", "coordinates": rings})


SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]


# --- whole files -----------------------------------------------------------------------------------------------------

# An editor's outline of 0.6 m, 4.5 um off at most, is this much off in area; Beziers for corners differ by 2.7e-4 r.
AREA_ERROR = 0.73 * 5e-6 + 2 * math.pi * 0.01 * 2.8e-6


@pytest.mark.parametrize(
    ("name", "unit", "count", "expected", "corner"),
    [
        ("inkscape.svg", None, 6, HOLED, (5, -120)),
        ("illustrator.svg", "pt", 1, PLATE, (28.228 / 72 * 25.4, -297.638 / 72 * 25.4)),
        ("libreoffice.svg", None, 1, PLATE, (30, -140)),
        ("autocad_r12.dxf", "mm", 6, HOLED, (0, 0)),
        ("librecad.dxf", None, 6, HOLED, (0, 0)),
        ("qgis.geojson", "mm", 3, 0.2 * 0.1 - 0.04**2 + 0.05**2, (0, 0)),
    ],
)
def test_files_as_programs_write_them(name, unit, count, expected, corner):
    rings = read_outline(DATA / name, unit)
    assert len(rings) == count
    # Illustrator writes a thousandth of a point, 0.35 um.
    assert area(rings) == pytest.approx(expected, abs=AREA_ERROR)
    np.testing.assert_allclose(rings[0].min(axis=0) * 1e3, corner, atol=1e-3)
    # Outer ones run counterclockwise, holes clockwise, so that the sum of areas is the area.
    assert area(rings) == pytest.approx(region(rings).area, rel=1e-12)
    assert all(len(np.unique(ring, axis=0)) == len(ring) for ring in rings)


def test_every_format_reads_the_same(write):
    """The same outline, a square with a square hole, in each format of the table."""
    hole = [[2, 3], [2, 5], [6, 5], [6, 3], [2, 3]]
    files = {
        "svg": svg('<path d="M0 0H10V-10H0z M2-3V-5H6V-3z"/>'),
        "dxf": dxf(lambda _, m: [m.add_lwpolyline(ring[:-1], close=True) for ring in (SQUARE, hole)]),
        "geojson": geojson(SQUARE, hole),
    }
    assert sorted(files) == OUTLINE_FORMATS.names()
    for content in files.values():
        outer, inner = read_outline(write(content), "mm")
        assert region([outer, inner]).equals(region([np.array(SQUARE) / 1e3, np.array(hole) / 1e3]))
        assert area([outer]) == pytest.approx(1e-4)
        assert area([inner]) == pytest.approx(-8e-6)


def test_each_file_is_of_one_format(write):
    from markergen.read.outlines.drawing import load

    for path in DATA.iterdir():
        if path.suffix in (".svg", ".dxf", ".geojson"):
            fitting = [name for name in OUTLINE_FORMATS if OUTLINE_FORMATS[name].fits(load(path))]
            assert fitting == [path.suffix[1:]]


# --- curves ----------------------------------------------------------------------------------------------------------


def farthest(points, polyline):
    """Largest distance of points from a polyline, by shapely."""
    # GEOS makes nan of segments shorter than the smallest normal number.
    polyline = np.round(polyline, 14)
    if not np.ptp(polyline, axis=0).any():
        return float(np.hypot(*(points - polyline[0]).T).max())
    return float(shapely.distance(shapely.points(points), shapely.LineString(polyline)).max())


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

    from markergen.read.outlines.drawing import OutlineFile
    from markergen.read.outlines.svg_shapes import Element, Shapes

    def numbers(count):
        return " ".join(f"{data.draw(st.floats(-60, 60)):.2f}" for _ in range(count))

    text = f"M{numbers(2)}"
    for _ in range(data.draw(st.integers(1, 5))):
        kind = data.draw(st.sampled_from("LlHhVvCcSsQqTtAa"))
        if kind in "Aa":
            radii = " ".join(f"{data.draw(st.floats(1, 60)):.2f}" for _ in range(2))
            flags = " ".join(str(data.draw(st.integers(0, 1))) for _ in range(2))
            text += f"{kind}{radii} {data.draw(st.integers(-180, 180))} {flags} {numbers(2)}"
        else:
            text += kind + numbers({"L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2}[kind.upper()])
    pieces = Shapes(OutlineFile("file", b"")).pieces(Element("path", {"d": text}), "path", (1, 1))
    polyline = np.concatenate([curve.flatten(1e-3) for piece in pieces for curve in piece.curves])
    points = [point for segment in SvgPath(text)[1:] for point in map(segment.point, np.linspace(0, 1, 41))]
    # svgelements' arcs are off by up to 1e-6 of their size.
    assert farthest(np.array([(point.x, point.y) for point in points]), polyline) <= 1e-3 + 1e-4


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


# --- joining ---------------------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(st.integers(3, 12), st.randoms(use_true_random=False), st.booleans())
def test_segments_in_any_order_and_direction_are_joined(n, rng, noisy):
    angles = 2 * math.pi * np.arange(n) / n
    corners = 0.1 * np.column_stack([np.cos(angles), np.sin(angles)])
    tracks = []
    for i in range(n):
        ends = np.stack([corners[i], corners[(i + 1) % n]])
        if noisy:  # Less than the tolerance of 1 um.
            ends = ends + np.array([[rng.uniform(-3e-7, 3e-7) for _ in range(2)] for _ in range(2)])
        tracks.append(Track(f"line {i}", ends[::-1] if rng.random() < 0.5 else ends, False))
    rng.shuffle(tracks)
    (ring,) = close(tracks, 1e-6, "file")
    assert len(ring) == n
    assert shapely.Polygon(ring).symmetric_difference(shapely.Polygon(corners)).area <= 1e-6 * 0.7


def test_two_rings_and_a_closed_one_keep_their_order():
    def half(x, up):
        return np.array([[x, 0], [x, up], [x + 1, up], [x + 1, 0]], dtype=float)

    square = np.array([[9, 0], [10, 0], [10, 1], [9, 1]], dtype=float)
    tracks = [Track("a", half(3, 1), False), Track("b", square, True), Track("c", half(0, 1), False)]
    tracks += [Track("d", half(0, -1), False), Track("e", half(3, -1), False)]
    assert [ring[:, 0].min() for ring in close(tracks, 1e-6, "file")] == [3, 9, 0]


def test_an_open_outline_tells_where_and_how_wide(refused):
    message = refused(svg('<path id="outer" d="M10 10 H190 V90 H10 V10.35"/>'))
    assert "path 'outer' open: a gap of 0.35 mm between (10 mm, 10 mm) and (10 mm, 10.35 mm)" in message
    lines = "".join(f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}"/>' for a, b, c, d in [(0, 0, 9, 0), (9, 0.02, 0, 5)])
    message = refused(svg(lines))
    assert "a gap of 0.02 mm between (9 mm, 0 mm) and (9 mm, 0.02 mm), and 1 more gap" in message


def test_a_branch_tells_where(refused):
    def draw(_, model):
        for start, end in [((0, 0), (9, 0)), ((9, 0), (9, 9)), ((9, 9), (0, 0)), ((9, 9), (20, 0)), ((20, 0), (9, 0))]:
            model.add_line(start, end)

    message = refused(dxf(draw))
    assert "three or more ends at (9 mm, 0 mm)" in message or "three or more ends at (9 mm, 9 mm)" in message


def test_an_open_end_on_a_closed_chain_is_told(refused):
    """A line that ends where two others meet makes a branch there and a loose end on the other side."""
    ends = [((0, 0), (9, 0)), ((9, 0), (9, 9)), ((9, 9), (0, 0)), ((9, 0), (30, 0))]
    message = refused(dxf(lambda _, model: [model.add_line(*pair) for pair in ends]))
    assert "LINE on layer '0' open: a gap of 21 mm between (30 mm, 0 mm)" in message


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('<path d="M10 10 L90 90 z"/>', "zero area at (10 mm, 10 mm)"),
        ('<path d="M10 10 L90 90 L10 10 z"/>', "zero area"),
        ('<path d="M10 10 H90 L90 10.0001 H10 z"/>', "zero area"),
        ('<path d="M10 10 L90 90 L90 10 L10 90 z"/>', "(50 mm, 50 mm)"),
        ('<path d="M10 10 H90 V90 H10 V10 H90 z"/>', "outline 1"),
        ('<rect width="50" height="50"/><rect x="20" y="-20" width="50" height="50"/>', "outlines 1 and 2"),
        ('<rect width="50" height="50"/><rect width="50" height="50"/>', "outlines 1 and 2"),
        ('<text x="3" y="4">hello</text>', "found only text"),
        ('<image href="data:image/png;base64,AAAA" width="9" height="9"/>', "found only images"),
        ("", "a closed outline"),
        ('<path d=""/>', "a closed outline"),
        ('<path d="M5 5z"/>', "a closed outline"),
        ('<path d="M5 5z"/><path d="M6 6z"/>', "a closed outline"),
        ('<path d="M0 0 L nan 5 L 5 5z"/>', "'n' in path"),
        ('<path d="M0 0 L 1e999 5 L 5 5z"/>', "nan, infinity"),
        ('<path d="M0 0 L 1e308 1e308 L -1e308 5z"/>', "near the file's origin"),
        ('<path d="M1e15 0 h5 v5z"/>', "near the file's origin"),
        ('<path d="L 1 5 L 5 5z"/>', "no move"),
        ('<path d="M0 0 L 5"/>', "path data"),
        ('<path d="M0 0 C 1 1 2 2"/>', "path data"),
        ('<polygon points="0 0 5 0 5"/>', "an odd number"),
        ('<polygon points="0 0 5 0 x 5"/>', "'x' in points"),
        ('<circle r="5furlong"/>', "'5furlong' as r of circle"),
        ('<g transform="rotate(5"><circle r="5"/></g>', "a transform"),
        ('<g transform="rotate(5 6)"><circle r="5"/></g>', "rotate of 2 numbers"),
        ('<g transform="scale(nan)"><circle r="5"/></g>', "'n' in transform"),
        ('<g style="transform:rotate(5deg)"><circle r="5"/></g>', "transforms as attributes"),
        ('<use href="#missing"/>', "a shape that is used"),
        ('<image href="photo.png"/><circle r="5"/>', "no references to other files"),
        ('<image xlink:href="file:///etc/passwd"/><circle r="5"/>', "'file:///etc/passwd' in 'image'"),
        ('<use xlink:href="other.svg#a"/><circle r="5"/>', "no references to other files"),
        ('<mask id="m"/><circle mask="url(#m)" r="5"/>', "cut by a clip or mask"),
        ('<clipPath id="c"><circle r="4"/></clipPath><g clip-path="url(#c)"><circle r="5"/></g>', "cut by a clip"),
        ("<g>" * 200 + '<circle r="5"/>' + "</g>" * 200, "levels of groups"),
        ('<g id="a"><use href="#a"/></g>', "levels of groups and uses"),
    ],
)
def test_bad_svg(refused, body, words):
    assert words in refused(svg(body))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "an empty file"),
        (b" \n\t", "an empty file"),
        (b"hello", "no format that is known; known formats: dxf: "),
        (b"\x89PNG\r\n\x1a\n\0\0", "no format that is known"),
        (b"<svg", "complete XML"),
        (b"<html/>", "an svg element"),
        (svg("<circle r='5'/>")[:-3], "complete XML"),
        ('<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + svg("<text>&x;</text>"), "document type"),
        ('<!DOCTYPE svg SYSTEM "http://example.com/x.dtd">' + svg("<text>&x;</text>"), "document type"),
        (svg("<text>&x;</text>"), "complete XML"),
        (b'<?xml version="1.0" encoding="klingon"?><svg/>', "XML"),
        (b"{", "complete JSON"),
        (b"[" * 100_000, "endless nesting"),
        (b"[1, 2]", "a GeoJSON object"),
        (b'{"type": "Topology"}', "a GeoJSON type"),
        (b'{"type": "Polygon"}', "a list"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1]]]}', "pairs of numbers"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, true], [3, 4]]]}', "pairs of numbers"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, NaN], [3, 4]]]}', "finite coordinates"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, 1e999], [3, 4]]]}', "nan, infinity"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, ' + b"9" * 400 + b"], [3, 4]]]}", "pairs of numbers"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, ' + b"9" * 9000 + b"], [3, 4]]]}", "endless number"),
        (b'{"type": "Polygon", "coordinates": []}', "a closed outline"),
        (b'{"type": "Feature", "geometry": null}', "a closed outline"),
        (b'{"type": "LineString", "coordinates": [[0, 0], [1, 1]]}', "only LineString"),
        (geojson(SQUARE[:-1]), "a gap of 10 mm between (0 mm, 0 mm) and (0 mm, 10 mm)"),
        (b"AutoCAD Binary DXF\r\n\x1a\0\0", "binary DXF"),
        (b"AC1032\0\0\0", "DWG"),
        (b"0\nSECTION\n2\nENTITIES\n0\nLINE\n", "DXF to its end"),
        (b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nabc\n0\nENDSEC\n0\nEOF\n", "DXF"),
        (b"0\nSECTION\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n", "a closed outline"),
        (b"0\nSECTION\n2\nENTITIES\0\n0\nEOF", "DXF"),
    ],
)
def test_bad_files(refused, content, words):
    assert words in refused(content, unit="mm")


def test_a_file_that_is_not_there(refused, tmp_path):
    assert "No such file" in refused(tmp_path / "missing.svg")
    assert "Is a directory" in refused(tmp_path)
    assert "null" in refused(Path("a\0b"))
    assert "File name too long" in refused(Path("x" * 5000))


def test_files_too_large_to_be_outlines(refused, tmp_path):
    path = tmp_path / "large.svg"
    with path.open("wb") as file:
        file.write(b'<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 ')
        file.truncate(50_000_000)
    assert "at most 10 MB" in refused(path)
    assert "300 kB of path data" in refused(svg(f'<path d="M0 0 {"1 1 " * 80_000}z"/>'))
    assert "10000 lines and curves" in refused(svg(f'<path d="M0 0 {"1 1 " * 20_000}z"/>'))
    assert "at most 20 closes" in refused(svg(f'<path d="M0 0 {"h1z" * 21}"/>'))
    assert "3 MB of GeoJSON" in refused(b'{"type": "' + b"a" * 3_000_000, unit="mm")
    assert "2 MB of DXF" in refused(b"0\nSECTION\n" + b" " * 3_000_000)
    assert "20000 entities" in refused(b"0\nSECTION\n2\nENTITIES\n" + b"0\nLINE\n" * 20_001 + b"0\nENDSEC\n0\nEOF\n")


# --- units -----------------------------------------------------------------------------------------------------------


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
    assert "none: the drawing is 50 units across; give --boundary-unit, one of m, cm, mm" in refused(text)
    for unit, size in UNITS.items():
        if 0.001 <= 50 * size <= 100:
            (ring,) = read_outline(write(text), unit)
            assert np.ptp(ring[:, 0]) == pytest.approx(30 * size, rel=1e-12)


def test_the_users_unit_beats_the_files(write):
    (ring,) = read_outline(write(svg('<rect width="30" height="40"/>')), "in")
    assert np.ptp(ring[:, 0]) == pytest.approx(30 * 0.0254)


def test_an_unknown_unit(refused):
    assert "known: m, cm, mm, um, in, ft, px, pt" in refused(svg(""), unit="furlong")


@pytest.mark.parametrize(("code", "size"), [(1, 0.0254), (2, 0.3048), (4, 1e-3), (5, 0.01), (6, 1.0), (14, 0.1)])
def test_dxf_says_its_unit(write, code, size):
    (ring,) = read_outline(write(dxf(lambda _, m: m.add_lwpolyline([(0, 0), (1, 0), (1, 2)], close=True), code)))
    np.testing.assert_allclose(ring.max(axis=0), [size, 2 * size], rtol=1e-12)


@pytest.mark.parametrize(("code", "version"), [(0, "R2010"), (18, "R2010"), (4, "R12")])
def test_dxf_without_a_unit_asks(refused, code, version):
    """No unit, one of astronomers, and a version that has none: ezdxf would make meters of the last."""
    text = dxf(lambda _, m: m.add_line((0, 0), (3, 4)), code, version)
    assert version != "R12" or "INSUNITS" not in text
    assert "none: the drawing is 5 units across" in refused(text)


def test_geojson_has_no_unit(refused):
    assert "give --boundary-unit" in refused(geojson(SQUARE))


@pytest.mark.parametrize(
    ("size", "unit", "words"),
    [
        ("200000", None, "300 m across"),
        ("2000000", None, "km"),
        ("0.1", None, "0.15 mm across"),
        ("200", "m", "300 m across with m for the unit; give another --boundary-unit"),
        ("200", "um", "0.3 mm across with um for the unit"),
    ],
)
def test_absurd_sizes_ask(refused, size, unit, words):
    message = refused(svg(f'<rect width="{float(size) * 0.9}" height="{float(size) * 1.2}"/>'), unit=unit)
    assert "a marker of 1 mm to 100 m" in message
    assert words.replace("km", "3000 m") in message


# --- SVG -------------------------------------------------------------------------------------------------------------


def bounds(rings):
    points = np.concatenate(rings) * 1e3
    return np.round([*points.min(axis=0), *points.max(axis=0)], 6).tolist()


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ('<rect x="1" y="2" width="30" height="40"/>', [1, -42, 31, -2]),
        ('<rect x="1mm" y="2" width="50%" height="10%"/>', [96 / 25.4, -12, 96 / 25.4 + 100, -2]),
        ('<rect x="1" y="2" width="30" height="40" rx="5"/>', [1, -42, 31, -2]),
        ('<circle cx="50" cy="40" r="7"/>', [43, -47, 57, -33]),
        ('<ellipse cx="50" cy="40" rx="7" ry="9"/>', [43, -49, 57, -31]),
        ('<polygon points="1,2 30,2 30,20"/>', [1, -20, 30, -2]),
        ('<polyline points="1 2 30 2 30 20 1 2"/>', [1, -20, 30, -2]),
        ('<path d="m1 2h29v18z"/>', [1, -20, 30, -2]),
        ('<g transform="translate(5,6)"><g transform="scale(2)"><circle r="1"/></g></g>', [3, -8, 7, -4]),
        ('<g transform="translate(5 6) scale(2 3)"><circle r="1"/></g>', [3, -9, 7, -3]),
        ('<rect width="4" height="2" transform="rotate(90)"/>', [-2, -4, 0, 0]),
        ('<rect width="4" height="2" transform="rotate(90 4 0)"/>', [2, 0, 4, 4]),
        ('<rect width="4" height="2" transform="skewX(45)"/>', [0, -2, 6, 0]),
        ('<rect width="4" height="2" transform="skewY(45)"/>', [0, -6, 4, 0]),
        ('<rect width="4" height="2" transform="matrix(0 1 1 0 5 6)"/>', [5, -10, 7, -6]),
        ('<defs><circle id="c" r="2"/></defs><use href="#c" x="5" y="6" transform="scale(2)"/>', [6, -16, 14, -8]),
        ('<symbol id="s" viewBox="0 0 2 2"><circle cx="1" cy="1" r="1"/></symbol>'
         '<use xlink:href="#s" x="5" y="6" width="10" height="20"/>', [5, -21, 15, -11]),
        ('<svg x="10" y="20" width="100" height="50" viewBox="0 0 10 10"><circle r="1"/></svg>', [30, -25, 40, -15]),
        ('<svg x="10" y="20"><circle r="1"/></svg>', [9, -21, 11, -19]),
        ('<svg viewBox="0 0 10 10" preserveAspectRatio="xMinYMax slice"><circle r="1"/></svg>', [-20, 80, 20, 120]),
        ('<switch><foreignObject/><g><circle r="2"/></g></switch>', [-2, -2, 2, 2]),
        ('<a href="http://example.com"><circle r="2"/></a>', [-2, -2, 2, 2]),
    ],
)  # fmt: skip
def test_where_shapes_lie(write, body, expected):
    # Sampled at quarter turns, circles have their extent to rounding.
    np.testing.assert_allclose(bounds(read_outline(write(svg(body)))), expected, atol=1e-5)


@settings(max_examples=25)
@given(st.lists(st.sampled_from(["translate(3,-4)", "rotate(30)", "rotate(-70 5 8)", "scale(1.5,-0.7)", "skewX(20)",
                                 "skewY(-10)", "matrix(1 .2 -.3 1 4 5)"]), min_size=1, max_size=4))  # fmt: skip
def test_transforms_as_svgelements_sees_them(tmp_path_factory, transforms):
    from svgelements import Matrix, Point

    path = tmp_path_factory.mktemp("svg") / "a.svg"
    corners = [(10, 10), (50, 10), (50, 30), (20, 45)]
    polygon = f'<polygon points="{" ".join(f"{x},{y}" for x, y in corners)}"/>'
    for transform in reversed(transforms):
        polygon = f'<g transform="{transform}">{polygon}</g>'
    path.write_text(svg(polygon))
    matrix = Matrix(" ".join(transforms))
    points = [matrix.point_in_matrix_space(Point(*corner)) for corner in corners]
    expected = shapely.Polygon([(point.x / 1e3, -point.y / 1e3) for point in points])
    assert expected.symmetric_difference(shapely.Polygon(read_outline(path)[0])).area <= 1e-14


@pytest.mark.parametrize(
    "hidden",
    [
        '<circle r="2" display="none"/>',
        '<circle r="2" style="fill:red; display: none"/>',
        '<g style="display:none"><circle r="2"/></g>',
        '<g visibility="hidden"><circle r="2"/></g>',
        '<circle r="2" fill="none"/>',
        '<circle r="2" class="a b"/>',
        '<circle r="2" id="x"/>',
        '<circle r="0"/>',
        '<rect width="5"/>',
        '<defs><circle r="2"/></defs><clipPath><circle r="2"/></clipPath><pattern><circle r="2"/></pattern>',
        '<path d="none"/>',
        '<title>a</title><metadata><b/></metadata>',
    ],
)  # fmt: skip
def test_what_is_not_seen_is_no_outline(write, hidden):
    style = "<style><![CDATA[/* .b{} */ .a, .c { display:none } #x{fill:none;stroke:none}]]></style>"
    seen = '<rect x="50" y="50" width="9" height="9" style="fill:none;stroke:#000"/>'
    assert bounds(read_outline(write(svg(style + hidden + seen)))) == [50, -59, 59, -50]


def test_layers_of_svg(write, refused):
    body = (
        '<g inkscape:groupmode="layer" inkscape:label="Cut" id="l1" style="display:none" transform="scale(2)">'
        '<g id="inner"><circle r="3"/></g></g>'
        '<g inkscape:groupmode="layer" inkscape:label="Rest" id="l2"><circle r="5"/><line x2="9"/></g>'
    )
    path = write(svg(body))
    for name in ("Cut", "l1", "inner"):
        assert bounds(read_outline(path, layer=name)) == [-6, -6, 6, 6]
    assert "a known layer" in refused(path, layer="cut")
    assert "found 'cuts'; known layers: 'Cut', 'Rest'" in refused(path, layer="cuts")
    assert "known layers: 'a'" in refused(svg('<g id="a"/>'), layer="b")
    assert "the file has no layers" in refused(svg('<circle r="5"/>'), layer="b")
    assert "the file has no layers" in refused(geojson(SQUARE), layer="b", unit="mm")
    assert "and 18 more" in refused(svg("".join(f'<g id="a{i}"/>' for i in range(30))), layer="b")


def test_clips_that_cut_nothing_are_left_alone(write):
    clip = '<clipPath id="c"><rect width="200" height="100"/></clipPath>'
    body = f'{clip}<g style="clip-path:url(#c)"><rect width="200" height="100"/><circle cx="50" cy="50" r="5"/></g>'
    assert bounds(read_outline(write(svg(body)))) == [0, -100, 200, 0]


def test_a_document_type_of_the_w3c_is_harmless(write):
    doctype = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    text = f'<?xml version="1.0" encoding="{{}}"?>{doctype}' + svg('<circle r="5"/>')
    for encoding in ("utf-8", "utf-16", "iso-8859-1"):
        assert len(read_outline(write(text.format(encoding).encode(encoding)))) == 1


def test_bombs_of_uses_and_entities_are_refused(refused):
    uses = "".join(f'<g id="u{i}">' + f'<use href="#u{i - 1}"/>' * 10 + "</g>" for i in range(1, 12))
    assert "10000 lines and curves" in refused(
        svg(f'<defs><path id="u0" d="M0 0h1v1z"/>{uses}</defs><use href="#u11"/>')
    )
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    doctype = f'<!DOCTYPE svg [<!ENTITY e0 "aaaaaaaaaa">{entities}]>'
    assert "declarations of entities" in refused(doctype + svg("<text>&e11;</text>"))


# --- DXF -------------------------------------------------------------------------------------------------------------


def circle_area(radius):
    return math.pi * (radius / 1e3) ** 2


@pytest.mark.parametrize(
    ("draw", "expected"),
    [
        (lambda d, m: m.add_circle((3, 4), 20), circle_area(20)),
        (lambda d, m: [m.add_arc((3, 4), 20, 30, 210), m.add_arc((3, 4), 20, 210, 30)], circle_area(20)),
        (lambda d, m: m.add_ellipse((0, 0), (0, 30), 0.5), 1e-6 * math.pi * 30 * 15),
        (lambda d, m: [m.add_ellipse((0, 0), (30, 9), 0.5, 0, 2), m.add_ellipse((0, 0), (30, 9), 0.5, 2, 2 * math.pi)],
         1e-6 * math.pi * 981 / 2),
        (lambda d, m: m.add_lwpolyline([(-5, 0, 1), (5, 0, 1)], format="xyb", close=True), circle_area(5)),
        (lambda d, m: m.add_polyline2d([(-5, 0, 1), (5, 0, 1)], format="xyb", close=True), circle_area(5)),
        (lambda d, m: m.add_polyline3d([(0, 0, 7), (5, 0, 7), (5, 5, 7)], close=True), 12.5e-6),
        # Drawn from below: mirrored, and run the other way round.
        (lambda d, m: m.add_circle((3, 4), 20, dxfattribs={"extrusion": (0, 0, -1)}), circle_area(20)),
        (lambda d, m: [m.add_arc((0, 0), 9, 0, 180, dxfattribs={"extrusion": (0, 0, -1)}), m.add_line((-9, 0), (9, 0))],
         circle_area(9) / 2),
        (lambda d, m: m.add_hatch().paths.add_polyline_path([(0, 0), (9, 0), (9, 9)]) and m.add_circle((3, 4), 20),
         circle_area(20)),
    ],
)  # fmt: skip
def test_areas_of_dxf_entities(write, draw, expected):
    rings = read_outline(write(dxf(draw)))
    assert area(rings) == pytest.approx(expected, abs=0.2 * 5e-6)


def test_mirrored_arcs_lie_where_they_should(write):
    """A half disk above the x axis, seen from below: x is mirrored, y is not."""

    def draw(_, model):
        model.add_arc((-20, 0), 9, 0, 180, dxfattribs={"extrusion": (0, 0, -1)})
        model.add_line((11, 0), (29, 0))

    assert bounds(read_outline(write(dxf(draw)))) == [11, 0, 29, 9]


@pytest.mark.parametrize("closed", [False, True])
def test_splines_of_dxf(write, closed):
    rng = np.random.default_rng(1)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 9))
    points = 60 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])

    def draw(_, model):
        if closed:
            model.add_spline().set_closed(points)
        else:
            spline = model.add_open_spline(points)
            spline.set_open_rational(points, rng.uniform(0.5, 2, len(points)))
            model.add_line(points[-1], points[0])
        entities.extend(model.query("SPLINE"))

    entities = []
    rings = read_outline(write(dxf(draw)))
    tool = entities[0].construction_tool()
    knots = tool.knots()
    t = np.linspace(knots[tool.order - 1], knots[tool.count], 5000)
    expected = np.array([(point.x, point.y) for point in tool.points(t)]) / 1e3
    # ezdxf's evaluation is another than ours.
    assert farthest(expected, np.concatenate([rings[0], rings[0][:1]])) <= 5e-6


def test_splines_through_points(write):
    angles = np.linspace(0, 2 * np.pi, 33)
    points = 50 * np.column_stack([np.cos(angles), np.sin(angles)])
    rings = read_outline(write(dxf(lambda _, m: m.add_spline(points))))
    # A cubic through 32 points of a circle is this near to it but for its ends.
    assert area(rings) == pytest.approx(circle_area(50), rel=1e-3)


def test_blocks_in_blocks(write):
    def draw(document, model):
        hole = document.blocks.new("HOLE", base_point=(1, 0))
        hole.add_circle((1, 0), 3)
        row = document.blocks.new("ROW")
        row.add_blockref("HOLE", (10, 0))
        row.add_blockref("HOLE", (-10, 0), dxfattribs={"xscale": 2, "yscale": 0.5})
        model.add_blockref("ROW", (100, 50), dxfattribs={"rotation": 90, "xscale": -1})

    rings = read_outline(write(dxf(draw)))
    # Mirrored, then turned by 90 deg: x to -y, y to -x.
    assert bounds(rings[:1]) == [97, 37, 103, 43]
    assert bounds(rings[1:]) == [98.5, 54, 101.5, 66]


def test_a_grid_of_blocks(write):
    def draw(document, model):
        document.blocks.new("B").add_circle((0, 0), 1)
        grid = {"row_count": 3, "column_count": 4, "row_spacing": 10, "column_spacing": 5, "rotation": 90}
        model.add_blockref("B", (0, 0), dxfattribs=grid)

    rings = read_outline(write(dxf(draw)))
    assert len(rings) == 12
    assert bounds(rings) == [-21, -1, 1, 16]


def test_layers_of_dxf(write, refused):
    def draw(document, model):
        for name in ("Cut", "Off", "Frozen"):
            document.layers.add(name)
        document.layers.get("Off").off()
        document.layers.get("Frozen").freeze()
        for name, x in (("Cut", 0), ("Off", 50), ("Frozen", 100), ("unlisted", 150)):
            model.add_circle((x, 0), 5, dxfattribs={"layer": name})
        model.add_circle((200, 0), 5, dxfattribs={"invisible": 1})
        block = document.blocks.new("B")
        block.add_circle((0, 50), 5)
        block.add_circle((0, 100), 5, dxfattribs={"layer": "Cut"})
        model.add_blockref("B", (50, 0), dxfattribs={"layer": "Off"})
        document.layout("Layout1").add_circle((300, 0), 5)

    path = write(dxf(draw))
    assert bounds(read_outline(path)) == [-5, -5, 155, 5]
    assert bounds(read_outline(path, layer="Off")) == [45, -5, 55, 55]
    assert bounds(read_outline(path, layer="frozen")) == [95, -5, 105, 5]
    assert bounds(read_outline(path, layer="CUT")) == [-5, -5, 55, 105]
    message = refused(path, layer="Cuts")
    assert "'Cut'" in message
    assert "'Frozen'" in message
    assert "'unlisted'" in message


def test_blocks_that_never_end(refused):
    def itself(document, model):
        document.blocks.new("B").add_blockref("B", (1, 1))
        model.add_blockref("B", (0, 0))

    def each_other(document, model):
        document.blocks.new("A").add_blockref("B", (1, 1))
        document.blocks.new("B").add_blockref("A", (1, 1))
        model.add_blockref("A", (0, 0))

    def endless_grid(document, model):
        document.blocks.new("B").add_circle((0, 0), 1)
        grid = {"row_count": 32000, "column_count": 32000, "row_spacing": 3, "column_spacing": 3}
        model.add_blockref("B", (0, 0), dxfattribs=grid)

    def grids_in_grids(document, model):
        names = ["A", "B", "C", "D"]
        for name, inner in zip(names, [None, *names], strict=False):
            block = document.blocks.new(name)
            if inner:
                grid = {"row_count": 50, "column_count": 50, "row_spacing": 3, "column_spacing": 3}
                block.add_blockref(inner, (0, 0), dxfattribs=grid)
        model.add_blockref("D", (0, 0))

    assert "the block 'B' inside itself" in refused(dxf(itself))
    assert "inside itself" in refused(dxf(each_other))
    assert "copies of a block" in refused(dxf(endless_grid))
    assert "copies of blocks" in refused(dxf(grids_in_grids))


def test_blocks_of_other_files(refused):
    def draw(document, model):
        document.add_xref_def("other.dxf", "OTHER")
        model.add_blockref("OTHER", (0, 0))

    assert "no references to other files" in refused(dxf(draw))
    assert "INSERT of 'GONE', which is missing" in refused(dxf(lambda d, m: m.add_blockref("GONE", (0, 0))))


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (lambda d, m: m.add_polyline3d([(0, 0, 0), (5, 0, 1), (5, 5, 0)], close=True), "heights z from 0 to 1"),
        (lambda d, m: m.add_text("hello"), "only TEXT"),
        (lambda d, m: m.add_polyface(), "a mesh"),
        (lambda d, m: m.add_circle((0, 0), 0), "outlines with an area"),
        (lambda d, m: m.add_lwpolyline([(0, 0), (9, 0), (9, 9)]), "open: a gap of 12.7279 mm"),
        (lambda d, m: m.add_circle((float("nan"), 0), 5), "nan, infinity"),
        (lambda d, m: m.add_circle((0, 0), 1e305), "m"),
    ],
)
def test_bad_dxf(refused, draw, words):
    assert words in refused(dxf(draw))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda spline: spline.knots.extend([1.0]),
        lambda spline: spline.dxf.set("degree", 30),
        lambda spline: setattr(spline, "weights", [1.0, 0.0, 1.0, 1.0, 1.0]),
        lambda spline: setattr(spline, "knots", [0.0] * len(spline.knots)),
        lambda spline: setattr(spline, "knots", list(spline.knots)[::-1]),
        lambda spline: setattr(spline, "control_points", [(0, 0, 0), (1, float("inf"), 0), (1, 1, 0), (2, 1, 0)]),
    ],
)
def test_splines_that_are_none(refused, spoil):
    def draw(_, model):
        spoil(model.add_open_spline([(0, 0), (10, 0), (10, 10), (0, 20), (5, 5)]))

    assert "SPLINE on layer '0'" in refused(dxf(draw))


def test_every_cut_of_a_dxf_is_refused(write, refused):
    text = (DATA / "librecad.dxf").read_bytes()
    for share in np.linspace(0.01, 0.99, 40):
        assert "DXF" in refused(text[: int(share * len(text))]) or share < 0.01


def test_code_pages(write):
    text = dxf(lambda d, m: (d.layers.add("Außen"), m.add_circle((0, 0), 5, dxfattribs={"layer": "Außen"})), 4, "R2000")
    path = write(text.encode("cp1252"))
    assert len(read_outline(path, layer="AUSSEN")) == 1


# --- boundaries ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "radius"), [("0.15", 0.15), (" 150mm ", 0.15), ("6in", 0.1524), ("circle:15cm", 0.15), ("circle:.2", 0.2)]
)
def test_circles_in_words(text, radius):
    assert parse_boundary(text) == Circle(radius)


@pytest.mark.parametrize("text", ["rect:0.2x0.1", "rect:200mmx100mm", "rect:20cm x 0.1"])
def test_rectangles_in_words(text):
    boundary = parse_boundary(text)
    assert boundary.area == pytest.approx(0.02)
    np.testing.assert_allclose(boundary.outlines()[0], [[-0.1, -0.05], [0.1, -0.05], [0.1, 0.05], [-0.1, 0.05]])


def test_shapes_with_a_place_are_keep_outs():
    assert parse_boundary("circle:3mm@40mm,-2cm", origin="file") == Circle(0.003, (0.04, -0.02))
    (ring,) = parse_boundary("rect:10mmx20mm@0.1,0", origin="file").outlines()
    np.testing.assert_allclose([ring.min(axis=0), ring.max(axis=0)], [[0.095, -0.01], [0.105, 0.01]], atol=1e-12)


def test_files_are_boundaries(write):
    path = DATA / "librecad.dxf"
    centered, as_drawn = parse_boundary(str(path)), parse_boundary(path, origin="file")
    np.testing.assert_allclose(np.mean([centered.outlines()[0].min(axis=0), centered.outlines()[0].max(axis=0)], 0), 0)
    np.testing.assert_allclose(as_drawn.outlines()[0].min(axis=0), 0)
    assert centered.area == pytest.approx(HOLED, abs=AREA_ERROR)
    # A name may start with a digit.
    copy = write((DATA / "qgis.geojson").read_bytes(), "2 plates.geojson")
    assert parse_boundary(copy, unit="mm").area == pytest.approx(0.0209)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("", {}, "a boundary"),
        ("0", {}, "a radius above 0"),
        ("-1", {}, "a radius above 0"),
        ("15 parsec", {}, "a length"),
        ("circle:", {}, "a length"),
        ("circle:0.1@1", {"origin": "file"}, "a place x,y"),
        ("circle:0.1@1,2", {}, "no place"),
        ("rect:0.1", {}, "a width and a height"),
        ("rect:0.1x0", {}, "sides above 0"),
        ("rect:0.1x-1", {}, "sides above 0"),
        ("rect:0.1x0.2x0.3", {}, "a width and a height"),
        ("rect:nanx1", {}, "a finite width"),
        ("missing.svg", {}, "a readable outline at missing.svg"),
        ("2missing.svg", {}, "a readable outline"),
        ("0.15", {"unit": "mm"}, "with an outline's file alone"),
        ("rect:1x1", {"layer": "a"}, "with an outline's file alone"),
        ("0.15", {"origin": "corner"}, "an origin of center or file"),
    ],
)
def test_bad_boundaries(text, options, words):
    with pytest.raises(InputError, match=words) as caught:
        parse_boundary(text, **options)
    assert "\n" not in str(caught.value)


def test_shuffled_lines_of_a_plate_still_close(write):
    """A whole drawing, its entities in another order."""
    head, entities = (DATA / "autocad_r12.dxf").read_text().split("ENTITIES\n")
    parts = entities.replace("  0\nENDSEC\n  0\nEOF\n", "").split("  0\n")[1:]
    random.Random(5).shuffle(parts)
    text = head + "ENTITIES\n  0\n" + "  0\n".join(parts) + "  0\nENDSEC\n  0\nEOF\n"
    assert area(read_outline(write(text), "mm")) == pytest.approx(HOLED, abs=AREA_ERROR)
