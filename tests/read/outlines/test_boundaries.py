"""Boundaries in words and from files."""

import random

import numpy as np
import pytest
from drawings import AREA_ERROR, DATA, HOLED, area, read_outline

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.read.outlines.boundary import parse_boundary


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
    ("text", "options", "phrase"),
    [
        ("", {}, "a boundary"),
        ("0", {}, "a radius above 0"),
        ("-1", {}, "a radius above 0"),
        ("15 parsec", {}, "a length"),
        ("circle:", {}, "a length"),
        ("circle:0.1@1", {"origin": "file"}, "a position x,y"),
        ("circle:0.1@1,2", {}, "no position"),
        ("rect:0.1", {}, "a width and a height"),
        ("rect:0.1x0", {}, "sides above 0"),
        ("rect:0.1x-1", {}, "sides above 0"),
        ("rect:0.1x0.2x0.3", {}, "a width and a height"),
        ("rect:nanx1", {}, "a finite width"),
        ("missing.svg", {}, "a readable outline at missing.svg"),
        ("2missing.svg", {}, "a readable outline"),
        ("0.15", {"unit": "mm"}, "with an outline file only"),
        ("rect:1x1", {"layer": "a"}, "with an outline file only"),
        ("0.15", {"origin": "corner"}, "an origin of center or file"),
    ],
)
def test_bad_boundaries(text, options, phrase):
    with pytest.raises(InputError, match=phrase) as caught:
        parse_boundary(text, **options)
    assert "\n" not in str(caught.value)


def test_shuffled_lines_of_a_plate_still_close(write):
    """A whole drawing, its entities in another order."""
    head, entities = (DATA / "autocad_r12.dxf").read_text().split("ENTITIES\n")
    parts = entities.replace("  0\nENDSEC\n  0\nEOF\n", "").split("  0\n")[1:]
    random.Random(5).shuffle(parts)
    text = head + "ENTITIES\n  0\n" + "  0\n".join(parts) + "  0\nENDSEC\n  0\nEOF\n"
    assert area(read_outline(write(text), "mm")) == pytest.approx(HOLED, abs=AREA_ERROR)
