import io
from dataclasses import replace

import ezdxf
import numpy as np
import pytest
from sentences import sentence

from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.geometry.contour import Contour, circle
from markergen.model.boundary import Circle, polygon_from
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.workshop.formats.dxf import write_dxf, write_laser_dxf

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
    result = sorted((c.dxf.center.x, c.dxf.center.y, 2 * c.dxf.radius) for c in circles)
    expected = sorted(
        (point.x * 1e3, point.y * 1e3, diameter * 1e3)
        for point in marker.control_points
        for diameter in (point.feature.diameter, point.feature.inner_diameter)
        if diameter
    )
    np.testing.assert_allclose(result, expected, atol=WRITTEN, rtol=0)


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


def test_any_boundary_is_closed_polylines_of_its_corners(shape, make_in):
    marker = make_in(shape, 5, 0.012)
    lines = list(read(marker).modelspace().query("LWPOLYLINE[layer=='CUT']"))
    assert all(line.closed for line in lines)
    outlines = shape.outlines()
    assert len(lines) == len(outlines)
    for line, outline in zip(lines, outlines, strict=True):
        np.testing.assert_allclose(np.array(line.get_points("xy")), outline * 1e3, atol=WRITTEN)


def test_circles_of_an_outline_are_circles_and_its_arcs_are_bulges(make_in):
    slot = Contour(((-0.02, -0.005), (0.02, -0.005), (0.02, 0.005), (-0.02, 0.005)), (0, 1, 0, 1))
    marker = make_in(polygon_from([circle(0.125), slot, circle(0.0045, 0.07, 0.07)]), 5, 0.012)
    laser = ezdxf.read(io.StringIO(write_laser_dxf(marker, Fabrication("laser")).decode()))
    for document in (read(marker), laser):
        result = sorted(
            (c.dxf.center.x, c.dxf.center.y, c.dxf.radius) for c in document.modelspace().query("CIRCLE[layer=='CUT']")
        )
        np.testing.assert_allclose(result, [(0, 0, 125), (70, 70, 4.5)], atol=WRITTEN)
        (line,) = document.modelspace().query("LWPOLYLINE[layer=='CUT']")
        assert line.closed
        assert sorted(bulge for (bulge,) in line.get_points("b")) == [-1, -1, 0, 0]
        points = np.array(line.get_points("xy"))
        np.testing.assert_allclose(np.abs(points), np.tile([20, 5], (4, 1)), atol=WRITTEN)


def test_words_say_which_marker_and_which_dot(marker):
    phrase = {entity.dxf.text: entity for entity in read(marker).modelspace().query("TEXT")}
    assert {"x", "y", *map(str, range(7))} < set(phrase)
    assert any("markergen-1a2b3c4d" in text and "millimeters" in text for text in phrase)
    for point in marker.control_points:
        _, place, _ = phrase[str(point.id)].get_placement()
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
    assert asked.notes == (*plain.notes, sentence("drawn as designed"))


LASER = Fabrication("laser")


def by_layer(data: bytes, layer: str):
    space = ezdxf.read(io.StringIO(data.decode())).modelspace()
    circles = {
        (round(c.dxf.center.x, 9), round(c.dxf.center.y, 9), round(c.dxf.radius, 9))
        for c in space.query(f"CIRCLE[layer=='{layer}']")
    }
    return circles, list(space.query(f"LWPOLYLINE[layer=='{layer}']"))


def test_a_laser_gets_the_whole_plate(marker):
    holes = (Hole(0.06, 0.0, 0.0034, 0.0068, name="M3"), Hole(-0.06, 0.0, 0.004, use="dowel"))
    mounted = replace(marker, tag=None, substrate=Substrate(edge=0.03, holes=holes))
    data = EXPORTERS[".dxf"]([mounted], ExportOptions(fabrication=LASER)).data
    assert data == write_laser_dxf(mounted, LASER) != write_dxf(mounted)
    assert by_layer(data, "CUT") == ({(0, 0, 130), (60, 0, 1.7), (-60, 0, 2)}, [])
    assert by_layer(data, "ENGRAVE") == by_layer(write_dxf(mounted), "ENGRAVE")
    assert by_layer(data, "INFO")[0] == {(60, 0, 3.4), (20, -30, 4)}


def test_a_laser_gets_arcs_of_corners_and_a_tag_in_pieces(marker):
    square = polygon_from([[[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]])
    plate = replace(marker, boundary=square, substrate=Substrate(edge=0.01, corner_radius=0.005))
    data = write_laser_dxf(plate, LASER)
    assert not ezdxf.read(io.StringIO(data.decode())).audit().has_errors
    circles, (outline,) = by_layer(data, "CUT")
    assert not circles
    points = np.array(outline.get_points("xyb"))
    assert outline.closed
    assert np.abs(points[:, :2]).max() == pytest.approx(110, abs=WRITTEN)
    # Four quarters of a turn: the bulge is the tangent of a quarter of the angle.
    assert sorted(points[:, 2]) == pytest.approx([0.0] * 4 + [np.tan(np.pi / 8)] * 4, abs=1e-9)
    # Where cells meet in a corner both corners are round.
    tag = [np.array(line.get_points("xyb")) for line in by_layer(data, "ENGRAVE")[1]]
    sharp = read(plate).modelspace().query("LWPOLYLINE[layer=='ENGRAVE']")
    ink = marker.tag.ink
    a, b, c, d = ink[:-1, :-1], ink[:-1, 1:], ink[1:, :-1], ink[1:, 1:]
    meeting = 2 * int(np.sum((a & d & ~b & ~c) | (b & c & ~a & ~d)))
    assert sum((corners[:, 2] != 0).sum() for corners in tag) == meeting > 0
    assert sum(map(len, tag)) == sum(len(line.get_points()) for line in sharp) + meeting


def test_a_laser_engraves_relief_in_plan(marker):
    points = tuple(replace(p, z=0.01 * (p.id % 2)) for p in marker.control_points)
    raised = replace(marker, control_points=points)
    data = write_laser_dxf(raised, LASER)
    assert by_layer(data, "ENGRAVE")[0] == by_layer(write_dxf(marker), "ENGRAVE")[0]
    phrase = {entity.dxf.text for entity in ezdxf.read(io.StringIO(data.decode())).modelspace().query("TEXT")}
    assert {"0", "1, z = 10 mm", "2", "3, z = 10 mm"} < phrase
    with pytest.raises(InputError, match="a flat marker"):
        write_dxf(raised)


def test_a_laser_refuses_what_it_cannot_make(marker):
    with pytest.raises(InputError, match="engraving"):
        EXPORTERS[".dxf"]([marker], ExportOptions(fabrication=replace(LASER, depth=0.0029)))
