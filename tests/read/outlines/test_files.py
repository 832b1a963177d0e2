"""Whole files as programs write them."""

import numpy as np
import pytest
from drawings import AREA_ERROR, DATA, HOLED, PLATE, SQUARE, area, dxf, geojson, read_outline, region, svg

from markergen.read.outlines.formats import OUTLINE_FORMATS


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
        "kicad": "(kicad_pcb "
        + " ".join(
            f"(gr_poly (pts {' '.join(f'(xy {x} {-y})' for x, y in ring[:-1])}) (layer Edge.Cuts))"
            for ring in (SQUARE, hole)
        )
        + ")",
    }
    assert sorted(files) == OUTLINE_FORMATS.names()
    for content in files.values():
        outer, inner = read_outline(write(content), "mm")
        assert region([outer, inner]).equals(region([np.array(SQUARE) / 1e3, np.array(hole) / 1e3]))
        assert area([outer]) == pytest.approx(1e-4)
        assert area([inner]) == pytest.approx(-8e-6)


def test_each_file_is_of_one_format(write):
    from markergen.guard import read
    from markergen.read.outlines.formats import OutlineFile

    for path in DATA.iterdir():
        if path.suffix in (".svg", ".dxf", ".geojson"):
            fitting = [
                name for name in OUTLINE_FORMATS if OUTLINE_FORMATS[name].fits(OutlineFile(*read(path, "outline")))
            ]
            assert fitting == [path.suffix[1:]]
