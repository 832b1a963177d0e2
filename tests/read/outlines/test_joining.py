"""Segments are joined to outlines, or the gap is told."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from drawings import SQUARE, dxf, geojson, svg
from hypothesis import given, settings
from hypothesis import strategies as st
from sentences import sentence

from markergen.read.outlines.boundary import read_contours
from markergen.read.outlines.curves import Track, closed_contours


def track(name, points, closed):
    return Track(name, points, closed, np.zeros(len(points) - 1))


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
        tracks.append(track(f"line {i}", ends[::-1] if rng.random() < 0.5 else ends, False))
    rng.shuffle(tracks)
    (ring,) = closed_contours(tracks, 1e-6, "file")
    assert len(ring.points) == n
    assert not ring.has_arcs
    assert shapely.Polygon(ring.points).symmetric_difference(shapely.Polygon(corners)).area <= 1e-6 * 0.7


def test_two_rings_and_a_closed_one_keep_their_order():
    def half(x, up):
        return np.array([[x, 0], [x, up], [x + 1, up], [x + 1, 0]], dtype=float)

    square = np.array([[9, 0], [10, 0], [10, 1], [9, 1]], dtype=float)
    tracks = [track("a", half(3, 1), False), track("b", square, True), track("c", half(0, 1), False)]
    tracks += [track("d", half(0, -1), False), track("e", half(3, -1), False)]
    assert [min(x for x, _ in ring.points) for ring in closed_contours(tracks, 1e-6, "file")] == [3, 9, 0]


def test_an_open_outline_tells_where_and_how_wide(refused):
    message = refused(svg('<path id="outer" d="M10 10 H190 V90 H10 V10.35"/>'))
    assert "path 'outer' open: " + sentence("gap", "0.35 mm", "10 mm, 10 mm", "10 mm, 10.35 mm") in message
    lines = "".join(f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}"/>' for a, b, c, d in [(0, 0, 9, 0), (9, 0.02, 0, 5)])
    message = refused(svg(lines))
    assert sentence("gap", "0.02 mm", "9 mm, 0 mm", "9 mm, 0.02 mm") + ", and 1 more" in message


def test_a_branch_tells_where(refused):
    def draw(_, model):
        for start, end in [((0, 0), (9, 0)), ((9, 0), (9, 9)), ((9, 9), (0, 0)), ((9, 9), (20, 0)), ((20, 0), (9, 0))]:
            model.add_line(start, end)

    message = refused(dxf(draw))
    assert any(sentence("ends meet", place) in message for place in ("9 mm, 0 mm", "9 mm, 9 mm"))


def test_an_open_end_on_a_closed_chain_is_told(refused):
    """A line that ends where two others meet makes a branch there and a loose end on the other side."""
    ends = [((0, 0), (9, 0)), ((9, 0), (9, 9)), ((9, 9), (0, 0)), ((9, 0), (30, 0))]
    message = refused(dxf(lambda _, model: [model.add_line(*pair) for pair in ends]))
    assert "LINE on layer '0' open: a gap of 21 mm" in message


PLATE = ((0, 0), (90, 0), (90, 60), (0, 60))


def plate(model):
    for start, end in zip(PLATE, PLATE[1:] + PLATE[:1], strict=True):
        model.add_line(start, end)


@pytest.mark.parametrize(
    ("draw", "phrase"),
    [
        (lambda d, m: m.add_lwpolyline([(10, 10), (40, 40), (10, 10)], close=True), "LWPOLYLINE on layer '0', of zero"),
        (lambda d, m: (m.add_line((10, 10), (40, 40)), m.add_line((40, 40), (10, 10))), "LINE on layer '0', of zero"),
        (lambda d, m: sliver(d, m), "LWPOLYLINE on layer '0', of zero area"),
        (
            lambda d, m: m.add_line((-5, 30), (95, 30)),
            "LINE on layer '0', a line that bounds nothing, at (-5 mm, 30 mm)",
        ),
        (lambda d, m: (m.add_line((-5, 30), (95, 30)), m.add_line((45, -5), (45, 65))), "and 1 more"),
        (lambda d, m: m.add_lwpolyline([(-5, 30), (45, 30), (95, 30)]), "a line that bounds nothing"),
    ],
)
def test_what_is_plainly_no_outline_is_left_out_with_a_sentence(write, caplog, draw, phrase):
    contours = read_contours(write(dxf(lambda d, m: (plate(m), draw(d, m)))), "mm")
    assert [contour.points for contour in contours] == [tuple((x / 1e3, y / 1e3) for x, y in PLATE)]
    assert phrase in caplog.text


def sliver(document, model):
    block = document.blocks.new("SLIVER")
    block.add_lwpolyline([(10, 10), (40, 10), (40, 10.0000001)], close=True)
    model.add_blockref("SLIVER", (5, 5))


@pytest.mark.parametrize(
    "draw",
    [
        lambda m: m.add_line((100, 0), (100, 60)),  # Beside the plate: it may be a side of another part.
        lambda m: m.add_lwpolyline([(10, 10), (20, 30), (30, 10)]),
        lambda m: [m.add_line(*ends) for ends in SLOT],
        lambda m: [m.add_line((20, y), (70, y)) for y in (20, 40)],  # A slot without its ends.
    ],
)
def test_lines_that_may_bound_something_are_not_left_out(refused, draw):
    assert "open: a gap" in refused(dxf(lambda _, m: (plate(m), draw(m))))


SLOT = [((20, 20), (40, 20)), ((40.5, 20.5), (40.5, 24.5)), ((40, 25), (20, 25)), ((19.5, 24.5), (19.5, 20.5))]
"""A slot whose sides do not quite meet."""


@pytest.mark.parametrize(
    ("body", "phrase"),
    [
        ('<circle r="-3"/>', "-3 for circle"),
        ('<rect width="9" height="9"/><path id="far" d="M1 1A5 5 0 0 1 1e20 9z"/>', "far out, such as path 'far'"),
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
def test_bad_svg(refused, body, phrase):
    assert phrase in refused(svg(body))


@pytest.mark.parametrize(
    ("content", "phrase"),
    [
        (b"", "an empty file"),
        (b" \n\t", "an empty file"),
        (b"hello", "an unknown format; known formats: dxf: "),
        (b"\x89PNG\r\n\x1a\n\0\0", "a picture"),
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
        (b'{"type": "Topology"}', "TopoJSON"),
        (b'{"type": "Polygon"}', "a list"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1]]]}', "pairs of numbers"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, true], [3, 4]]]}', "pairs of numbers"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, NaN], [3, 4]]]}', "NaN, which is not finite"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, 1e999], [3, 4]]]}', "1e999, which is not finite"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, ' + b"9" * 400 + b"], [3, 4]]]}", "which is not finite"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, ' + b"9" * 9000 + b"], [3, 4]]]}", "which is not finite"),
        (b'{"type": "Polygon", "coordinates": []}', "a closed outline"),
        (b'{"type": "Feature", "geometry": null}', "a closed outline"),
        (b'{"type": "LineString", "coordinates": [[0, 0], [1, 1]]}', "only LineString"),
        (geojson(SQUARE[:-1]), "a gap of 10 mm between (0 mm, 0 mm) and (0 mm, 10 mm)"),
        (b"AutoCAD Binary DXF\r\n\x1a\0\0", "DXF"),
        (b"AC1032\0\0\0", "DWG"),
        (b"0\nSECTION\n2\nENTITIES\n0\nLINE\n", "DXF to its end"),
        (b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nabc\n0\nENDSEC\n0\nEOF\n", "DXF"),
        (b"0\nSECTION\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n", "a closed outline"),
        (b"0\nSECTION\n2\nENTITIES\0\n0\nEOF", "DXF"),
    ],
)
def test_bad_files(refused, content, phrase):
    assert phrase in refused(content, unit="mm")


def test_a_file_that_is_not_there(refused, tmp_path):
    assert "No such file" in refused(tmp_path / "missing.svg")
    assert "Is a directory" in refused(tmp_path)
    assert "null" in refused(Path("a\0b"))
    assert "name too long" in refused(Path("x" * 5000))


def test_files_too_large_to_be_outlines(refused, tmp_path):
    path = tmp_path / "large.svg"
    with path.open("wb") as file:
        file.write(b'<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 ')
        file.truncate(50_000_000)
    assert "at most 10 MB" in refused(path)
    assert "300 kB of path" in refused(svg(f'<path d="M0 0 {"1 1 " * 80_000}z"/>'))
    assert "10000 lines and curves" in refused(svg(f'<path d="M0 0 {"1 1 " * 20_000}z"/>'))
    assert "10000 lines and curves" in refused(svg(f'<path d="M0 0 {"h1z" * 20_000}"/>'))
    # A search for arcs would start at every digit.
    assert "path data" in refused(svg(f'<path d="M0 0A{"1" * 250_000}"/>'))
    assert "3 MB of GeoJSON" in refused(b'{"type": "' + b"a" * 3_000_000, unit="mm")
    assert "2 MB of DXF" in refused(b"0\nSECTION\n" + b" " * 3_000_000)
    assert "20000 entities" in refused(b"0\nSECTION\n2\nENTITIES\n" + b"0\nLINE\n" * 20_001 + b"0\nENDSEC\n0\nEOF\n")
