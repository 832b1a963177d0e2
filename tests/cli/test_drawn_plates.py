"""A drawing's outline is the plate: its circles and arcs are the same from the drawing to every file."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from drawings import dxf, svg
from rewritten_solids import in_gmsh
from sentences import sentence

from markergen.cli import main
from markergen.geometry.contour import area
from markergen.model.body_json import read_marker
from markergen.model.boundary import Circle, Polygon, polygon_from
from markergen.model.fabrication import Fabrication
from markergen.read.outlines.boundary import read_contours
from markergen.read.spec_file import spec_from_mapping
from markergen.workshop.drafting import views
from markergen.workshop.drafting.content import workpiece
from markergen.workshop.processes import parts_of

THICK = 3.0
FEW = ("--restarts", "1", "--dot", "14mm", "--poses", "cone:distance=0.6..0.8m,tilt=10..40,count=12,seed=1")
"""Options that make a design quick."""
SHEETED = ("flange.dxf", "flange.svg")
"""Drawings whose fabrication sheet is drawn, which takes more than all else; of the plate its content is looked at."""
POINTS = "-80mm,0mm; -40mm,40mm; 10mm,-40mm; 40mm,40mm; 80mm,-35mm; 85mm,20mm"
"""A layout for the plate, whose search would take most of the time."""
BOLTS = [(100 * math.cos(a), 100 * math.sin(a)) for a in np.radians([45, 135, 225, 315])]


def flange(_, model):
    model.add_circle((10, 20), 125)
    model.add_circle((10, 20), 40)
    for x, y in BOLTS:
        model.add_circle((10 + x, 20 + y), 4.5)


def plate(_, model):
    """200 x 120 mm with fillets of 15 of lines and arcs, a slot, a D of radius 10 that is cut at 6, and a hole."""
    w, h, r = 200, 120, 15
    for start, end in [((r, 0), (w - r, 0)), ((w, h - r), (w, r)), ((w - r, h), (r, h)), ((0, h - r), (0, r))]:
        model.add_line(start, end)
    for x, y, start in [(r, r, 180), (w - r, r, 270), (w - r, h - r, 0), (r, h - r, 90)]:
        model.add_arc((x, y), r, start, start + 90)
    model.add_lwpolyline([(40, 20, 0), (80, 20, 1), (80, 30, 0), (40, 30, 1)], format="xyb", close=True)
    rotation = 2 * math.pi - 2 * math.acos(0.6)
    model.add_lwpolyline([(156, 52, 0), (156, 68, math.tan(rotation / 4))], format="xyb", close=True)
    model.add_circle((20, 100), 4.25)


CIRCLES = "".join(f'<circle cx="{150 + x!r}" cy="{150 + y!r}" r="4.5"/>' for x, y in BOLTS)
DISK = '<circle cx="150" cy="150" r="125"/><circle cx="150" cy="150" r="40"/>'
DRAWINGS = {
    "flange.dxf": dxf(flange, unit=0),
    "flange.svg": svg(DISK + CIRCLES, 'width="300mm" height="300mm" viewBox="0 0 300 300"'),
    "plate.dxf": dxf(plate),
}
FLANGE = math.pi * (125**2 - 40**2 - 4 * 4.5**2)
TURN = 2 * math.pi - 2 * math.acos(0.6)
PLATE = 200 * 120 - (4 - math.pi) * 15**2 - (400 + math.pi * 25) - (100 * TURN / 2 + 48) - math.pi * 4.25**2
WALLS = {"flange": [9.0] * 4 + [80.0, 250.0], "plate": [8.5] + [10.0] * 2 + [20.0] * 2 + [30.0] * 4}
"""Diameters of the walls that are cylinders; the D's is in two parts."""


@dataclass
class Made:
    kind: str
    folder: Path

    @property
    def marker(self):
        return read_marker(self.folder / "m.json")


@pytest.fixture(
    scope="module",
    params=["plate.dxf", *(pytest.param(name, marks=pytest.mark.long) for name in ("flange.dxf", "flange.svg"))],
)
def made(request, tmp_path_factory) -> Made:
    """Folder with the marker of a drawing, and its files."""
    folder = tmp_path_factory.mktemp("drawn")
    (folder / request.param).write_text(DRAWINGS[request.param])
    layout = ["--points", POINTS] if request.param == "plate.dxf" else ["--n", "6"]
    line = ["design", *layout, *FEW, "--boundary", str(folder / request.param)]
    line += ["--boundary-unit", "mm"] if request.param == "flange.dxf" else []
    assert main([*line, "-o", str(folder / "m.json"), "-o", str(folder / "m.dxf"), "-o", str(folder / "m.pdf")]) == 0
    suffixes = ("step", "svg", "stl", *(["fab.pdf"] if request.param in SHEETED else []))
    outputs = [word for suffix in suffixes for word in ("-o", str(folder / f"m.{suffix}"))]
    with pytest.MonkeyPatch.context() as patch:
        # Places of callouts are tried in 24 orders, which takes more than all else.
        patch.setattr(views, "TRIES", 1)
        assert main(["export", str(folder / "m.json"), "--no-engrave", *outputs]) == 0
    return Made(request.param.partition(".")[0], folder)


def measured(path: Path) -> tuple[float, list[float]]:
    """Volume in mm^3 of all solids, and diameters of upright cylinders as high as the plate, as gmsh has them."""
    with in_gmsh(path) as gmsh:
        volume = sum(gmsh.model.occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3))
        results = []
        for _, tag in gmsh.model.getEntities(2):
            low, _, high = (gmsh.model.getBoundingBox(2, tag)[k] for k in (2, 0, 5))
            if gmsh.model.getType(2, tag) == "Cylinder" and high - low > 0.9 * THICK:
                first, last = gmsh.model.getParametrizationBounds(2, tag)
                one, other, *_ = gmsh.model.getPrincipalCurvatures(tag, (first + last) / 2)
                results.append(2 / max(abs(one[0]), abs(other[0])))
        return volume, sorted(results)


def test_the_solid_has_the_drawing_s_cylinders_and_its_volume(made):
    volume, diameters = measured(made.folder / "m.step")
    # Inlays fill their pockets.
    assert volume == pytest.approx(THICK * {"flange": FLANGE, "plate": PLATE}[made.kind], rel=1e-12)
    assert diameters == pytest.approx(WALLS[made.kind], abs=1e-9)


def test_the_dxf_has_the_drawing_s_circles_and_arcs(made):
    space = ezdxf.readfile(made.folder / "m.dxf").modelspace()
    radii = sorted(entity.dxf.radius for entity in space.query("CIRCLE[layer=='CUT']"))
    assert radii == pytest.approx({"flange": [4.5] * 4 + [40, 125], "plate": [4.25]}[made.kind], abs=1e-9)
    lines = [line.get_points("b") for line in space.query("LWPOLYLINE[layer=='CUT']")]
    arcs = sorted(sum(bulge != 0 for (bulge,) in line) for line in lines)
    assert arcs == {"flange": [], "plate": [2, 2, 4]}[made.kind]
    # What is to be cut is the boundary, to the picometer.
    again = polygon_from(read_contours(made.folder / "m.dxf", layer="CUT"), "file")
    assert again.bulges == made.marker.boundary.bulges
    assert np.concatenate(again.rings) == pytest.approx(np.concatenate(made.marker.boundary.rings), abs=2e-12)


def test_the_fabrication_drawing_has_the_drawing_s_sizes(made):
    sheet = made.folder / "m.fab.pdf"
    assert made.kind == "plate" or sheet.stat().st_size > 1000
    fabrication = Fabrication(engrave=False)
    work = workpiece(made.marker, fabrication, parts_of(made.marker, fabrication))
    phrase = [line for callout in work.callouts for line in callout.lines]
    if made.kind == "flange":
        assert work.round
        assert work.size == pytest.approx((250, 250), abs=1e-9)
        # One of the four holes keeps the flange from turning: it is a datum, with a callout of its own.
        assert {"\xd880", "3x \xd89", "\xd89"} < set(phrase)
        assert sum("on a circle [\xd8200]" in line for line in phrase) == 2
    else:
        assert work.size == pytest.approx((200, 120), abs=1e-9)
        assert {"\xd88.5", "4x R15", "2x R5", "R10"} < set(phrase)
    (holes,) = [table for table in work.tables if table.title.startswith("Holes")]
    wanted = {"flange": ["80", "9", "9", "9", "9"], "plate": ["8.5"]}[made.kind]
    assert sorted(row[3].removeprefix("\xd8") for row in holes.rows) == sorted(wanted)
    assert {row[5] for row in holes.rows} == {"plain"}


def test_the_sheets_draw_the_circles_half_a_micrometer_off_at_most(made):
    from markergen.drawing.colors import Colors
    from markergen.drawing.figure import Figure
    from markergen.drawing.marker_artwork import cut_lines

    lines = cut_lines(Figure(made.marker), Colors(cut="#ff0000"))
    results = []
    for line in lines:
        points = np.array(line.points[:-1])
        middle = (points + np.roll(points, -1, axis=0)) / 2
        radii = np.hypot(*(points - points.mean(axis=0)).T), np.hypot(*(middle - points.mean(axis=0)).T)
        if np.ptp(np.concatenate(radii)) < 5.1e-4:
            results.append(radii[0].mean())
    assert sorted(results) == pytest.approx({"flange": [4.5] * 4 + [40, 125], "plate": [4.25]}[made.kind], abs=1e-6)


def test_all_files_verify(made, capsys):
    files = [str(made.folder / f"m.{suffix}") for suffix in ("step", "stl", "dxf", "pdf", "svg")]
    assert main(["verify", str(made.folder / "m.json"), *files]) == 0
    assert capsys.readouterr().out.count("   ok\n") == 5


def test_marker_json_carries_the_arcs_and_the_spec_that_asked_for_them(made):
    content = json.loads((made.folder / "m.json").read_text())
    assert content["version"] == 2
    assert content["substrate"] == {"thickness": 0.003, "edge": 0.0}
    circles = {"flange": 6, "plate": 1}[made.kind]
    assert sum(sorted(row) in ([-1, -1], [1, 1]) for row in content["boundary"]["bulges"]) == circles
    spec = spec_from_mapping(content["provenance"]["spec"], stored=True)
    assert spec.boundary == made.marker.boundary
    assert spec.hash == content["provenance"]["spec_hash"]


def test_no_edge_is_added_to_a_drawing(made, capsys):
    folder = made.folder
    before = {path: path.read_bytes() for path in folder.iterdir()}
    drawing = next(str(path) for path in before if path.name in DRAWINGS)
    unit = ["--boundary-unit", "mm"]
    for line in (
        ["export", str(folder / "m.json"), "--edge", "5mm", "-o", str(folder / "x.step")],
        ["design", "--n", "6", "--boundary", drawing, *unit, "--edge", "5mm", "-o", str(folder / "x.json")],
    ):
        assert main(line) == 2
        (complaint,) = capsys.readouterr().err.splitlines()
        assert sentence("edge on polygon") in complaint
        assert "leave out --edge" in complaint
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_another_outline_takes_the_plate_s_place(made, tmp_path):
    """Also for a disk, which had an edge."""
    (tmp_path / "round.svg").write_text(
        svg('<circle r="140" cx="150" cy="150"/>', 'width="300mm" height="300mm" viewBox="0 0 300 300"')
    )
    outputs = ["-o", str(tmp_path / "x.step"), "-o", str(tmp_path / "x.json"), "--no-engrave"]
    assert main(["export", str(made.folder / "m.json"), "--outline", "circle:130mm", *outputs]) == 0
    volume, diameters = measured(tmp_path / "x.step")
    marker = read_marker(tmp_path / "x.json")
    # The holes of the boundary go through the other plate, too.
    holes = [contour for contour in marker.boundary.contours() if area(contour) < 0]
    assert diameters == pytest.approx({"flange": [9] * 4 + [80, 260], "plate": [8.5, 10, 10, 20, 20, 260]}[made.kind])
    assert volume == pytest.approx((math.pi * 130**2 + 1e6 * sum(map(area, holes))) * THICK, rel=1e-9)
    assert marker.substrate.outline == Circle(0.13)
    assert marker.boundary == made.marker.boundary


def test_an_outline_from_a_drawing_keeps_its_arcs(tmp_path):
    (tmp_path / "flange.dxf").write_text(dxf(lambda _, model: [model.add_circle((0, 0), r) for r in (125, 4)]))
    line = ["design", "--n", "4", "--radius", "50mm", "--keep-out", "circle:6mm", *FEW]
    assert main([*line, "-o", str(tmp_path / "m.json")]) == 0
    line = ["export", str(tmp_path / "m.json"), "--outline", str(tmp_path / "flange.dxf"), "--no-engrave"]
    assert main([*line, "-o", str(tmp_path / "m.step")]) == 0
    volume, diameters = measured(tmp_path / "m.step")
    assert diameters == pytest.approx([8, 250], abs=1e-9)
    assert volume == pytest.approx(math.pi * (125**2 - 16) * THICK, rel=1e-12)


def test_a_rectangle_that_is_drawn_is_the_plate_and_one_that_is_written_has_an_edge(tmp_path):
    (tmp_path / "plate.svg").write_text(svg('<rect width="200" height="100"/>'))
    line = ["design", "--n", "4", *FEW]
    for boundary, edge, size in ((str(tmp_path / "plate.svg"), 0.0, 200), ("rect:200mmx100mm", None, 204)):
        assert main([*line, "--boundary", boundary, "-o", str(tmp_path / "m.json")]) == 0
        marker = read_marker(tmp_path / "m.json")
        assert isinstance(marker.boundary, Polygon)
        assert marker.substrate.edge == edge
        work = workpiece(marker, Fabrication(), parts_of(marker, Fabrication()))
        assert work.size[0] == pytest.approx(size, abs=1e-9)
