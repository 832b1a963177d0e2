"""Whatever stands in a drawing, the answer is closed outlines or one line."""

import io
import json
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
from drawings import read_outline
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mutants import replaced

from markergen.errors import InputError
from markergen.read.outlines.boundary import parse_boundary

DATA = Path(__file__).parent.parent / "read" / "data"
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="200mm" height="100mm" '
    'viewBox="0 0 200 100"><style>.a{fill:none;stroke:red}</style><clipPath id="c"><rect width="200" height="100"/>'
    '</clipPath><g id="L" transform="translate(10,5) rotate(10 3 4) scale(.5)" clip-path="url(#c)">'
    '<path class="a" d="M0 0h80v40a 10 10 0 0 1-10 10h-60q-10 0-10-10z m5 5c1 1 2 3 5 5s5-5 5-5t-3-3z"/>'
    '<polygon points="100,0 120,0 120,9"/><circle id="k" cx="20" cy="60" r="5"/><use href="#k" x="30"/>'
    '<symbol id="s" viewBox="0 0 9 9"><ellipse cx="4" cy="4" rx="4" ry="2"/></symbol>'
    '<use xlink:href="#s" x="130" width="20" height="20"/><rect x="40" y="90" width="10" height="8" rx="2"/></g></svg>'
)


def _rich_dxf():
    import ezdxf

    document = ezdxf.new("R2000")
    document.units = 4
    model = document.modelspace()
    block = document.blocks.new("B")
    block.add_circle((0, 0), 1)
    model.add_blockref("B", (3, 3), dxfattribs={"row_count": 2, "column_count": 2, "row_spacing": 4, "rotation": 10})
    model.add_open_spline([(20, 0, 0), (30, 0, 0), (30, 10, 0), (20, 10, 0)])
    model.add_line((20, 0), (20, 10))
    model.add_ellipse((50, 0), (5, 0), 0.5)
    model.add_spline([(60, 0), (70, 0), (70, 10), (60, 0)])
    model.add_polyline2d([(80, 0, 1), (90, 0, 1)], format="xyb", close=True)
    stream = io.StringIO()
    document.write(stream)
    # The rest is the same in all files, and would take most of the changes.
    sections = stream.getvalue().split("  0\nSECTION\n")[1:]
    kept = [section for section in sections if not section.startswith(("  2\nCLASSES", "  2\nOBJECTS"))]
    return "".join("  0\nSECTION\n" + section for section in kept) + "  0\nEOF\n"


SEEDS = [SVG.encode(), _rich_dxf().encode()]
SEEDS += [path.read_bytes() for path in sorted(DATA.iterdir()) if path.suffix in (".svg", ".dxf", ".geojson")]
TOKENS = [
    "0", "-1", "1e999", "nan", "1e-320", "1e308", "-1e15", "9" * 500, "", " ", "\n", "\r", "\t", "z", "M",
    "a1 1 0 0 1 ", "C", "<", ">", "/>", '"', "'", "</g>", "<g>", "&lt;", "&a;", "<!--", "<![CDATA[", "<!DOCTYPE svg>",
    'href="a.svg"', 'href="#L"', "scale(0)", "scale(1e200)", "rotate(", "matrix(1 1 1 1 1 1)", "%", "mm", "none",
    "{", "}", "[", "]", ",", "null", "true", "0\nINSERT\n2\nB\n", "SECTION", "ENDSEC", "EOF", "0\nEOF\n", "999\n",
    "10\n", "70\n1\n", "LINE", "SPLINE", "POLYLINE", "HATCH", "BLOCK", "\0", "\ufeff", "é", "😀", "230\n-1.0\n",
    "42\n1e9\n", "71\n32000\n", "41\n0.0\n",
]  # fmt: skip
UNITS = st.sampled_from([None, "mm", "px", "in"])


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("outline") / "file"


def outcome(path, data, unit):
    """Read the bytes; return the outlines, if there are any."""
    path.write_bytes(data)
    start = time.process_time()
    rings = None
    try:
        rings = read_outline(path, unit)
    except InputError as error:
        message = str(error)
        assert "\n" not in message
        assert len(message) < 1000
    else:
        check(rings)
    # The most that any file takes is below 5 s; these have a few kilobytes.
    assert time.process_time() - start < 2
    return rings


def check(rings):
    """What was read is a region: rings with corners and an area, none crossing another."""
    shape = shapely.Polygon()
    for ring in rings:
        assert ring.ndim == 2
        assert ring.shape[0] >= 3
        assert np.isfinite(ring).all()
        polygon = shapely.Polygon(ring)
        assert polygon.is_valid
        assert polygon.area > 0
        shape = shape.symmetric_difference(polygon)
    areas = [float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 for x, y in (ring.T for ring in rings)]
    # Holes run the other way, so that the region's area is the sum of theirs; 1e-9 for coordinates far out.
    assert sum(areas) == pytest.approx(shape.area, rel=1e-6, abs=1e-9 * max(map(abs, areas)))


def test_the_seeds_have_outlines(path):
    for data in SEEDS:
        assert outcome(path, data, None) is not None or outcome(path, data, "mm") is not None


FEW = settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=60)


@FEW
@given(
    st.sampled_from(SEEDS),
    st.lists(st.tuples(st.floats(0, 1), st.integers(0, 30), st.sampled_from(TOKENS)), min_size=1, max_size=3),
    UNITS,
)
def test_pieces_replaced_by_others(path, data, changes, unit):
    outcome(path, replaced(data, changes), unit)


@FEW
@given(
    st.sampled_from([seed for seed in SEEDS if b"SECTION" in seed]),
    st.lists(st.tuples(st.floats(0, 0.999), st.sampled_from(TOKENS)), min_size=1, max_size=4),
)
def test_values_of_dxf_replaced(path, data, changes):
    """Whole lines, so that the groups stay in step."""
    lines = data.decode().split("\n")
    for place, token in changes:
        lines[int(place * (len(lines) - 4)) | 1] = token.replace("\n", " ")
    outcome(path, "\n".join(lines).encode(), "mm")


@FEW
@given(st.sampled_from(SEEDS), st.floats(0, 1), UNITS)
def test_cut_off_anywhere(path, data, share, unit):
    outcome(path, data[: int(share * len(data))], unit)


@FEW
@given(
    st.sampled_from(SEEDS),
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    UNITS,
)
def test_bytes_flipped(path, data, changes, unit):
    changed = bytearray(data)
    for place, value in changes:
        changed[int(place * len(changed))] = value
    outcome(path, bytes(changed), unit)


@FEW
@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")), UNITS)
def test_anything(path, data, unit):
    outcome(path, data, unit)


NUMBER = st.integers(-50, 50) | st.floats(width=32) | st.sampled_from([1e300, -1e300, 1e-300, 2**70])


@FEW
@given(st.lists(st.tuples(st.sampled_from("MmZzLlHhVvCcSsQqTtAa"), st.lists(NUMBER, max_size=8)), max_size=8))
def test_any_path_data(path, commands):
    data = "M5 5" + "".join(command + " ".join(map(str, numbers)) for command, numbers in commands) + "z"
    outcome(path, f'<svg xmlns="http://www.w3.org/2000/svg"><path d="{data}"/></svg>'.encode(), "mm")


@FEW
@given(
    st.sampled_from(["rect", "circle", "ellipse", "line", "svg", "use", "symbol", "g"]),
    st.dictionaries(
        st.sampled_from(
            ["x", "y", "width", "height", "rx", "ry", "r", "cx", "x1", "transform", "viewBox", "style", "id"]
        ),
        st.sampled_from(
            ["1", "-3", "50%", "2mm", "1e200", "auto", "0 0 10 10", "scale(3)", "scale(1e-200)", "a", "1em"]
        ),
    ),
)
def test_any_attributes(path, tag, attributes):
    text = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    body = f'<{tag} {text}><circle r="3"/></{tag}><use href="#a"/>'
    outcome(path, f'<svg xmlns="http://www.w3.org/2000/svg">{body}</svg>'.encode(), "mm")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=9) | st.dictionaries(st.sampled_from(["type", "coordinates"]), inner),
    max_leaves=12,
)
RINGS = st.lists(st.lists(st.lists(NUMBER, min_size=1, max_size=3), max_size=6), max_size=3)


@FEW
@given(
    st.sampled_from(["Polygon", "MultiPolygon", "Feature", "FeatureCollection", "GeometryCollection", "Point"]),
    st.fixed_dictionaries(
        {}, optional={"coordinates": RINGS | JSON, "features": JSON, "geometry": JSON, "geometries": JSON}
    ),
)
def test_known_keys_with_any_values(path, kind, values):
    outcome(path, json.dumps({"type": kind} | values).encode(), "mm")


@FEW
@given(
    st.text(max_size=30)
    | st.sampled_from(["circle:", "rect:"]).flatmap(lambda a: st.text("0123.xme-@,", max_size=12).map(a.__add__))
)
def test_any_boundary_in_words(text):
    try:
        boundary = parse_boundary(text, origin="file")
    except InputError as error:
        message = str(error)
        assert "\n" not in message
        assert len(message) < 1000
    else:
        assert boundary.radius > 0
