"""Files that are made to hang, to fill the memory, to say nothing or to be misunderstood: one line, and soon."""

import contextlib
import io
import os
import time

import numpy as np
import pytest
import shapely
from drawings import read_outline

from markergen.errors import InputError
from markergen.geometry.outlines import canonical_polygons
from markergen.read.cameras import read_camera
from markergen.read.cameras.covariance import read_camera_covariance
from markergen.read.outlines.boundary import parse_boundary, read_room
from markergen.read.poses import poses_from, read_poses

CAMERA = (
    "height: 480\nwidth: 640\ndistortion_model: equidistant\nd: [0.1, -0.02, 0.001, 0.0002]\n"
    "k: [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]\n"
    "roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}\n"
)
PLATE = '<rect x="10" y="10" width="50" height="20"/>'


def svg(body, frame='width="200mm" height="200mm" viewBox="0 0 200 200"'):
    return f'<svg xmlns="http://www.w3.org/2000/svg" {frame}>{body}</svg>'


def dxf(draw, change=lambda text: text):
    """Text of a DXF in mm that `draw` puts entities into."""
    import ezdxf

    document = ezdxf.new("R2000")
    document.units = 4
    draw(document)
    stream = io.StringIO()
    document.write(stream)
    return change(stream.getvalue())


@pytest.fixture
def area(tmp_path):
    """Area in mm^2 of the outlines of a file with that content."""

    def area(content, **options):
        (tmp_path / "file").write_text(content, encoding="utf-8")
        return parse_boundary(tmp_path / "file", **options).area * 1e6

    return area


@pytest.fixture
def refused(tmp_path):
    """Words of the one line that reading ends with; below 5 s, of which imports and a busy machine take most."""

    def refused(content, read=read_outline, **options):
        (tmp_path / "file").write_text(content, encoding="utf-8")
        start = time.process_time()
        with pytest.raises(InputError) as caught:
            read(tmp_path / "file", **options)
        assert time.process_time() - start < 5
        message = str(caught.value)
        assert message.isprintable()
        assert len(message.replace(str(tmp_path), "")) < 900  # The names and signs of all formats of cameras take 700.
        return message

    return refused


# --- what is no file to read ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("read", [read_outline, parse_boundary, read_camera, read_poses, poses_from])
def test_a_pipe_that_nobody_writes_to_is_not_waited_for(tmp_path, read):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(InputError, match="a pipe or"):
        read(str(path))


def test_a_name_that_is_too_long_is_no_path():
    name = "a" * 300 + "#cam1"
    with pytest.raises(InputError, match="name too long"):
        read_camera(name)
    with pytest.raises(InputError, match="name too long"):
        read_room("0.15", [name])


# --- outlines ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "phrase"),
    [
        # Each outline lies in all before it: three million pairs.
        (
            "".join(f'<rect width="{i * 0.05 + 1}" height="{i * 0.05 + 1}"/>' for i in range(2400)),
            "at most 50000 pairs",
        ),
        # Each group asks again whether its clip cuts something.
        (
            '<clipPath id="c"><rect width="200" height="200"/></clipPath>'
            + '<g clip-path="url(#c)">' * 90
            + "".join(f'<circle cx="{i % 90 * 2 + 1}" cy="{i // 90 * 2 + 1}" r=".9"/>' for i in range(4000))
            + "</g>" * 90,
            "at most 20000 curves in clips",
        ),
        (f'<rect width="9" height="9" class="{"a " * 500_000}"/>', "at most 1000 characters of class names"),
        (f"<style>{'.a{fill:none}' * 30_000}</style>{PLATE}", "at most 300 kB of style sheets"),
        (f'<rect width="9" height="9" transform="{"scale(1)" * 100_000}"/>', "at most 300 kB"),
        (f'<path d="{"M0 0h1zzzzzzzzz" * 20_000}"/>', "at most 10000 lines and curves"),
        (f'<path d="M0 0{"l1 1" * 70_000}z"/>', "at most 10000 lines and curves"),
    ],
    ids=["nested", "clips", "classes", "styles", "transforms", "closes", "lines"],
)
def test_what_would_take_long_is_refused_soon(refused, body, phrase):
    assert phrase in refused(svg(body))


def test_many_groups_of_one_name_do_not_take_long(tmp_path):
    others = '<g id="L"/>' * 40_000
    body = f'<defs>{others}</defs><g id="L">{PLATE}</g>' + "<path/>" * 9_000
    (tmp_path / "file").write_text(svg(body), encoding="utf-8")
    start = time.process_time()
    assert len(read_outline(tmp_path / "file", layer="L")) == 1
    # It took 35 s to look for each element among all groups.
    assert time.process_time() - start < 5


def test_a_plate_with_very_many_holes_is_read():
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    holes = [corners * 0.3 + [i % 50, i // 50] for i in range(2400)]
    rings = canonical_polygons([corners * [60, 60] - 5, *holes])
    # Outer ones run counterclockwise, holes clockwise.
    assert [bool(shapely.is_ccw(shapely.LinearRing(ring))) for ring in rings] == [True] + [False] * 2400


@pytest.mark.parametrize(
    "hidden",
    ['opacity="0"', 'fill="transparent"', 'fill-opacity="0"', 'style="fill:none;stroke:red;stroke-width:0"'],
)
def test_what_is_clear_is_no_outline(area, hidden):
    # 1e-9: the areas are sums of products of coordinates.
    assert area(svg(f'{PLATE}<circle cx="120" cy="50" r="10" {hidden}/>')) == pytest.approx(1000, rel=1e-9)


def test_the_root_has_a_style_too(area, refused):
    frame = 'width="200mm" height="200mm" viewBox="0 0 200 200" fill="none"'
    drawn = '<rect x="100" width="10" height="10" stroke="red"/>'
    assert area(svg(PLATE + drawn, frame)) == pytest.approx(100, rel=1e-9)
    assert "on a group" in refused(svg(PLATE, f'{frame} transform="scale(2)"'))


@pytest.mark.parametrize(
    ("body", "phrase"),
    [
        ('<style>@import url("http://a.b/c.css");</style>', "no references to other files"),
        ("<style>rect{fill:url(http://a.b/c.svg#d)}</style>", "no references to other files"),
        ('<rect width="9" height="9" fill="url(\'file:///a.svg#b\')"/>', "no references to other files"),
        ("<style>g.h path{display:none}</style>", "'g.h path'"),
        ("<style>.a{fill:red;transform:scale(2)}</style>", "transforms as attributes"),
    ],
)
def test_styles_from_elsewhere_or_too_clever(refused, area, body, phrase):
    assert phrase in refused(svg(body + PLATE))
    fonts = "<style>@font-face{src:url(https://a.b/c.woff)} .a , rect.b,#c{fill:url(#d)}</style>"
    assert area(svg(fonts + PLATE)) == pytest.approx(1000, rel=1e-9)


def test_a_style_sheet_beside_the_drawing(refused):
    assert "a style sheet" in refused('<?xml-stylesheet href="a.css"?>' + svg(PLATE))


def test_px_are_those_of_the_width(area):
    frame = 'width="400px" height="400" viewBox="0 0 200 200"'
    # Two px for each unit of the coordinates.
    assert area(svg(PLATE, frame), unit="px") == pytest.approx(4000 * (25.4 / 96) ** 2, rel=1e-9)
    assert area(svg(PLATE, frame), unit="mm") == pytest.approx(1000, rel=1e-9)


def test_what_ezdxf_mends_is_not_written_to_the_error_output(tmp_path, capfd):
    import logging

    path = tmp_path / "file"
    square = [(0, 0), (50, 0), (50, 20), (0, 20)]
    text = dxf(lambda document: document.modelspace().add_lwpolyline(square, close=True))
    # A table with an entry of another kind: ezdxf warns, and goes on.
    path.write_text(text.replace("  0\nAPPID\n", "  0\nLINE\n"), encoding="utf-8")
    root = logging.getLogger()
    handlers, root.handlers = root.handlers, []  # pytest's own would hide what users see.
    try:
        assert len(read_outline(path)) == 1
    finally:
        root.handlers = handlers
    assert capfd.readouterr() == ("", "")


def test_hidden_and_paper_space_are_named(refused):
    def hidden(document):
        document.layers.add("F").freeze()
        document.modelspace().add_circle((0, 0), 9, dxfattribs={"layer": "F"})

    assert "only hidden shapes" in refused(dxf(hidden))
    assert "in paper space" in refused(dxf(lambda document: document.layout("Layout1").add_circle((0, 0), 9)))
    assert "only hidden shapes" in refused(svg(f'<g style="display:none">{PLATE}</g>'))


def test_splines_through_very_many_points(refused):
    points = [(i * 0.1, i * i % 7, 0) for i in range(3000)]
    assert "at most 500 points" in refused(dxf(lambda document: document.modelspace().add_spline(points)))


@pytest.mark.parametrize(("old", "new"), [("LAYOUT\n", "LAYOUTNAME\n"), ("Layout1", "Layout9"), ("Model\n", "Modem\n")])
def test_damaged_layouts_are_no_surprise(tmp_path, old, new):
    text = dxf(lambda document: document.modelspace().add_circle((0, 0), 9))
    for count in (1, 2, 3):
        (tmp_path / "file").write_text(text.replace(old, new, count), encoding="utf-8")
        # Read all the same, or told in one line: ezdxf's own errors do not come through.
        with contextlib.suppress(InputError):
            assert len(read_outline(tmp_path / "file")) == 1


def test_damaged_dxf_is_told_in_words_of_the_file(refused):
    def draw(document):
        document.modelspace().add_circle((0, 0), 12.5)

    assert 'value="abc"' in refused(dxf(draw, lambda text: text.replace("\n12.5\n", "\nabc\n")))


def test_degrees_are_no_unit(refused):
    ring = '{"type": "Polygon", "coordinates": [[[11.5, 48.1], [11.6, 48.1], [11.6, 48.2], [11.5, 48.1]]]}'
    assert "longitude and latitude" in refused(ring)


def test_sizes_in_words_that_are_meant_in_mm():
    for text in ("150", "circle:150", "rect:200x100", "rect:1e300x1e300", "rect:0.2umx1um"):
        with pytest.raises(InputError, match=r"of 1 mm to 100 m, found .*"):
            parse_boundary(text)
    assert parse_boundary("circle:0.2mm@3mm,4mm", origin="file").radius == 2e-4


# --- cameras and poses ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "phrase"),
    [
        # A fisheye without coefficients is no pinhole camera.
        ("[0.1, -0.02, 0.001, 0.0002]", "[]", "4 coefficients of the distortion model 'equidistant' at d in"),
        ("x_offset: 0", "x_offset: 10", "a part of the image of 640x480 px at roi in"),
        ("500.0", "1e-300", "focal lengths in px plausible for an image of 640x480 px at k in"),
        ("500.0", "1e300", "focal lengths in px plausible for an image of 640x480 px at k in"),
        # What is misspelled must not become a camera without distortion.
        ("distortion_model: equidistant\nd:", "distortion_coeffizients:", "found only 'distortion_coeffizients'"),
    ],
)
def test_cameras_that_would_be_misunderstood(refused, old, new, phrase):
    assert phrase in refused(CAMERA.replace(old, new), read_camera)


def test_other_cameras_that_would_be_misunderstood(refused):
    row = "1 PINHOLE 640 480 500 500 320 240\n"
    assert "camera once in" in refused(row + row.replace("500", "400"), read_camera)
    # No damage: just another kind of file.
    assert "an unknown format" in refused(svg(PLATE + PLATE), read_camera)


def test_a_covariance_is_not_waited_for(tmp_path):
    from markergen.model.camera import PAPER_CAMERA

    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="a pipe or a device"):
        read_camera_covariance(tmp_path / "pipe", PAPER_CAMERA)


def test_more_poses_than_can_be_looked_at_in_time(refused):
    head, row = "tx,ty,tz,qx,qy,qz,qw\n", "0,0,1,1,0,0,0\n"
    assert "at most 100000 poses" in refused(head + row * 100_001, read_poses)
    assert "line 100001 of" in refused(head + row * 99_999 + row.replace("1,1", "1,2"), read_poses)


def test_lines_that_end_as_on_old_macs(tmp_path):
    (tmp_path / "file.csv").write_bytes(b"tx,ty,tz,qx,qy,qz,qw\r0,0,1,1,0,0,0\r0,0,2,1,0,0,0\r")
    np.testing.assert_array_equal(read_poses(tmp_path / "file.csv").translation, [[0, 0, 1], [0, 0, 2]])
