import io
from dataclasses import replace

import ezdxf
import numpy as np
import pytest

from markergen.drawing.sheet import SheetOptions
from markergen.export import EXPORTERS, ExportOptions
from markergen.export.dxf import write_dxf
from markergen.model.boundary import Circle
from markergen.model.tag import Tag

WRITTEN = 1e-6
"""mm: rounded to a picometer, and written with 16 digits."""


def read(marker):
    return ezdxf.read(io.StringIO(write_dxf(marker).decode()))


@pytest.fixture(scope="module")
def marker(make_ngon):
    keep_out = Circle(0.004, (0.02, -0.03))
    return replace(make_ngon(7, 0.1, 0.016), keep_outs=(keep_out,), tag=Tag("apriltag:36h11", 3, 0.03))


def test_is_r2010_in_mm_without_defects(marker):
    document = read(marker)
    assert document.dxfversion == "AC1024"
    assert (document.header["$INSUNITS"], document.header["$MEASUREMENT"]) == (4, 1)
    assert not document.audit().has_errors
    assert not document.audit().has_fixes
    assert {entity.dxf.layer for entity in document.modelspace()} == {"CUT", "ENGRAVE", "INFO"}
    assert {"CUT", "ENGRAVE", "INFO"} <= {layer.dxf.name for layer in document.layers}


def test_dots_are_exact_circles(marker):
    circles = list(read(marker).modelspace().query("CIRCLE[layer=='ENGRAVE']"))
    found = sorted((c.dxf.center.x, c.dxf.center.y, 2 * c.dxf.radius) for c in circles)
    expected = sorted(
        (point.x * 1e3, point.y * 1e3, diameter * 1e3)
        for point in marker.control_points
        for diameter in (point.feature.diameter, point.feature.inner_diameter)
        if diameter
    )
    np.testing.assert_allclose(found, expected, atol=WRITTEN, rtol=0)


def test_the_tag_is_closed_outlines_of_its_ink(marker):
    rings = [
        np.array(line.get_points("xy")) for line in read(marker).modelspace().query("LWPOLYLINE[layer=='ENGRAVE']")
    ]
    lines = read(marker).modelspace().query("LWPOLYLINE")
    assert all(line.closed for line in lines)
    # Even-odd: the signed areas of outlines and holes add up to the ink.
    ink = sum(map(_signed, rings))
    cell = marker.tag.side * 1e3 / marker.tag.cells
    assert abs(ink) == pytest.approx(marker.tag.ink.sum() * cell**2, rel=1e-9)
    assert np.concatenate(rings).max() == pytest.approx(15.0, abs=WRITTEN)


def _signed(ring: np.ndarray) -> float:
    x, y = ring.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def test_outline_and_keep_outs_are_to_be_cut(marker):
    circles = read(marker).modelspace().query("CIRCLE[layer=='CUT']")
    found = sorted((c.dxf.center.x, c.dxf.center.y, c.dxf.radius) for c in circles)
    np.testing.assert_allclose(found, [(0, 0, 100), (20, -30, 4)], atol=WRITTEN)


def test_any_boundary_is_closed_polylines_of_its_corners(shape, make_in):
    marker = make_in(shape, 5, 0.012)
    lines = list(read(marker).modelspace().query("LWPOLYLINE[layer=='CUT']"))
    assert all(line.closed for line in lines)
    outlines = shape.curves()[0]
    assert len(lines) == len(outlines)
    for line, outline in zip(lines, outlines, strict=True):
        np.testing.assert_allclose(np.array(line.get_points("xy")), outline * 1e3, atol=WRITTEN)


def test_words_say_which_marker_and_which_dot(marker):
    words = {entity.dxf.text: entity for entity in read(marker).modelspace().query("TEXT")}
    assert {"x", "y", *map(str, range(7))} < set(words)
    assert any("markergen-1a2b3c4d" in text and "millimeters" in text for text in words)
    for point in marker.control_points:
        _, place, _ = words[str(point.id)].get_placement()
        np.testing.assert_allclose((place.x, place.y), (point.x * 1e3, point.y * 1e3), atol=WRITTEN)


def test_ezdxf_is_left_as_it_was(marker):
    before = ezdxf.options.write_fixed_meta_data_for_testing
    write_dxf(marker)
    assert ezdxf.options.write_fixed_meta_data_for_testing == before


def test_a_measured_marker_is_made_as_it_was_designed(marker):
    stretched = replace(
        marker,
        control_points=tuple(replace(p, x=p.x * 0.99, y=p.y * 1.01) for p in marker.control_points),
        print_scale=(0.99, 1.01),
    )
    assert write_dxf(stretched) == write_dxf(marker)


def test_what_is_for_sheets_alone_is_told(marker):
    measured = replace(marker, print_scale=(0.993, 0.9955))
    plain, asked = (
        EXPORTERS[".dxf"]([measured], ExportOptions(SheetOptions(compensate=wanted))) for wanted in (False, True)
    )
    assert plain.data == asked.data
    assert asked.notes == (*plain.notes, "Drawn as designed: --compensate is for sheets.")
