"""What DXF draws: entities, blocks, layers."""

import math

import ezdxf
import numpy as np
import pytest
from drawings import DATA, area, bounds, dxf, farthest, read_outline
from sentences import sentence

from markergen.read.outlines.boundary import read_contours


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

    assert "'B' inside itself" in refused(dxf(itself))
    assert "inside itself" in refused(dxf(each_other))
    assert "copies of a block" in refused(dxf(endless_grid))
    assert "copies of blocks" in refused(dxf(grids_in_grids))


def test_blocks_of_other_files(refused):
    def draw(document, model):
        document.add_xref_def("other.dxf", "OTHER")
        model.add_blockref("OTHER", (0, 0))

    assert "references to" in refused(dxf(draw))
    assert sentence("no block", "GONE") in refused(dxf(lambda d, m: m.add_blockref("GONE", (0, 0))))


@pytest.mark.parametrize(
    ("draw", "phrase"),
    [
        (lambda d, m: m.add_polyline3d([(0, 0, 0), (5, 0, 1), (5, 5, 0)], close=True), "heights z from 0 to 1"),
        (lambda d, m: m.add_text("hello"), "only TEXT"),
        (lambda d, m: m.add_polyface(), "a mesh"),
        (lambda d, m: m.add_circle((0, 0), 0), "outlines with an area"),
        (lambda d, m: m.add_circle((0, 0), -3), "a radius above 0"),
        (lambda d, m: m.add_arc((0, 0), -3, 0, 90), "found -3 for ARC on layer '0'"),
        (lambda d, m: m.add_lwpolyline([(0, 0), (9, 0), (9, 9)]), "open: a gap of 12.7279 mm"),
        (lambda d, m: m.add_circle((float("nan"), 0), 5), "nan, infinity"),
        (lambda d, m: m.add_circle((0, 0), 1e305), "m"),
    ],
)
def test_bad_dxf(refused, draw, phrase):
    assert phrase in refused(dxf(draw))


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


CIRCLE = "0\nCIRCLE\n5\n4D\n8\n0\n10\n0\n20\n0\n40\n50\n"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0\nEOF\n", ""),
        ("0\nEOF\n", "0\nEOF\n\x1a"),
        ("0\nEOF\n", "0\nEOF\nwritten by hand\n"),
        ("5\n4D", "5\nzz"),
        ("0\nENDSEC\n0\nEOF", "0\nEOF"),
        ("0\nSECTION", "\n\n0\nSECTION"),
    ],
)
def test_what_other_programs_read_is_read(write, old, new):
    text = f"0\nSECTION\n2\nENTITIES\n{CIRCLE}0\nENDSEC\n0\nEOF\n"
    assert old in text
    (ring,) = read_contours(write(text.replace(old, new)), "mm")
    assert ring.as_circle == pytest.approx((0, 0, 0.05))


@pytest.mark.parametrize(
    ("old", "new"), [("40\n50\n", ""), ("40\n50", "40\n5,0"), ("10\n0", "10\nabc"), ("40\n50", "40\n\0")]
)
def test_what_would_be_guessed_is_refused(refused, old, new):
    text = f"0\nSECTION\n2\nENTITIES\n{CIRCLE}0\nENDSEC\n0\nEOF\n"
    assert "DXF" in (message := refused(text.replace(old, new), unit="mm")) or "for CIRCLE" in message


def test_a_repair_that_would_drop_a_block_is_refused(refused):
    insert = "0\nINSERT\n8\n0\n2\nHOLE\n10\n0\n20\n0\n"
    text = f"0\nSECTION\n2\nENTITIES\n{CIRCLE}{insert}0\nENDSEC\n0\nEOF\n"
    assert sentence("no block", "HOLE") in refused(text, unit="mm")
    assert "expected DXF" in refused(text.replace("4D", "zz"), unit="mm")


def test_every_cut_of_a_dxf_is_refused(write, refused):
    text = (DATA / "librecad.dxf").read_bytes()
    for share in np.linspace(0.01, 0.99, 40):
        assert "DXF" in refused(text[: int(share * len(text))]) or share < 0.01


def test_code_pages(write):
    text = dxf(lambda d, m: (d.layers.add("Außen"), m.add_circle((0, 0), 5, dxfattribs={"layer": "Außen"})), 4, "R2000")
    path = write(text.encode("cp1252"))
    assert len(read_outline(path, layer="AUSSEN")) == 1


def test_binary_dxf_is_read_as_text_is(tmp_path, refused):
    document = ezdxf.new("R2010", units=4)
    document.modelspace().add_circle((3, 4), 20)
    document.saveas(tmp_path / "binary.dxf", fmt="bin")
    np.testing.assert_allclose(area(read_outline(tmp_path / "binary.dxf")), circle_area(20), rtol=1e-3)
    data = (tmp_path / "binary.dxf").read_bytes()
    assert "DXF" in refused(data[: len(data) // 2], unit="mm")
