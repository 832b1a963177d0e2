"""The options of plates and processes, of ``markergen export`` and ``markergen design``."""

import json
import subprocess
import sys
from dataclasses import replace
from math import radians
from pathlib import Path

import pytest
from refusals import refused as refusal
from sentences import sentence

from markergen.api.export import choices_of
from markergen.cli import main
from markergen.exporters import EXPORTERS
from markergen.model.body_json import read_marker, to_json
from markergen.model.boundary import Circle, Polygon
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Substrate, parse_dowel, parse_mount

FEW = ["--restarts", "1", "--poses", "cone:count=8"]


@pytest.fixture
def here(tmp_path, monkeypatch, make_ngon) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "marker.json").write_bytes(to_json(make_ngon(5, 0.06, 0.014)))
    square = {"type": "Polygon", "coordinates": [[[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1]]]}
    (tmp_path / "plate.geojson").write_text(json.dumps(square))
    return tmp_path


def export(line: str) -> int:
    return main(["export", "marker.json", *line.split()])


def test_what_is_said_of_the_plate_takes_the_place_of_what_the_file_says(here):
    line = "--thickness 4mm --edge 1mm --corner-radius 2mm --chamfer 0.5mm --mount 2xM3c@60mm --dowel 2x4mm@80mm"
    assert export(f"-o one.json {line}") == 0
    one = Substrate(0.004, 0.001, 0.002, 0.0005, None, (*parse_mount("2xM3c@60mm"), *parse_dowel("2x4mm@80mm")))
    assert read_marker(here / "one.json").substrate == one
    # Mounting holes take the place of mounting holes, and leave the dowel holes alone.
    more = ["--mount", "M4:0,0", "--mount", "2xM3@40mm", "--outline", "rect:0.2x0.2"]
    assert main(["export", "one.json", "-o", "two.json", *more]) == 0
    two = read_marker(here / "two.json").substrate
    assert two.holes == (*parse_mount("M4:0,0"), *parse_mount("2xM3@40mm"), *parse_dowel("2x4mm@80mm"))
    assert isinstance(two.outline, Polygon)
    assert (two.thickness, two.chamfer) == (0.004, 0.0005)
    # Nothing said, nothing changed.
    assert main(["export", "two.json", "-o", "three.json"]) == 0
    assert (here / "three.json").read_bytes() == (here / "two.json").read_bytes()


def test_an_outline_from_a_drawing(here):
    assert export("-o one.json --outline plate.geojson --boundary-unit m") == 0
    assert read_marker(here / "one.json").substrate.outline.area == pytest.approx(0.04)


def test_choices_reach_the_exporter(here, monkeypatch):
    seen = []
    reference = EXPORTERS[".csv"]
    monkeypatch.setitem(
        EXPORTERS._entries,
        ".csv",
        replace(
            reference, write=lambda markers, options: seen.append(options.fabrication) or reference(markers, options)
        ),
    )
    assert export("-o m.csv") == 0
    line = "--process cnc --depth 1mm --gap 0.05mm --fit press --through --tool 2mm --draft 3 --foot 0.5mm"
    assert export(f"-o m.csv {line} --no-engrave --tolerance 10um") == 0
    assert export("-o m.csv --process dome --dome ball") == 0
    assert seen == [
        Fabrication(),
        Fabrication("cnc", 1e-3, 5e-5, "press", True, 2e-3, "half", radians(3), 5e-4, False, 1e-5),
        Fabrication("dome", dome="ball"),
    ]
    assert choices_of({"process": "dome", "dome": "half"}).fabrication == Fabrication("dome")


@pytest.mark.parametrize(
    ("line", "phrase"),
    [
        ("--process casting", "known: cnc, dome, fdm, laser, print"),
        ("--gap -0.1mm", "a gap of 0 or more, found gap=-0.0001 m"),
        ("--depth 0mm", "a depth above 0"),
        ("--depth deep", "--depth"),
        ("--tool -1mm", "a tool above 0"),
        ("--tolerance 0mm", "a tolerance of 0.1 um"),
        ("--draft 60", "a draft of 0 to below 45 degrees, found 60"),
        ("--foot -1mm", "a foot of 0 or more"),
        ("--fit slip", "--fit with --process cnc, found --process fdm"),
        ("--process cnc --fit loose", "slip or press"),
        ("--through --process laser", "--through with --process cnc"),
        ("--dome half", "--dome with --process dome, found --process fdm"),
        ("--process cnc --dome ball", "--dome with --process dome, found --process cnc"),
        ("--thickness 0mm", "thickness=0.0 m; give --thickness"),
        ("--thickness -3mm", "thickness=-0.003 m"),
        ("--thickness 3", "a thickness of 10 um to 1 m"),
        ("--edge -1mm", "edge=-0.001 m"),
        ("--corner-radius -1mm", "corner_radius=-0.001 m"),
        ("--chamfer 3mm", "below the thickness of 3 mm"),
        ("--outline circle:50mm", "over its edge"),
        ("--outline none.svg", "none.svg"),
        ("--boundary-unit mm", "a drawing for --boundary-unit"),
        ("--mount 4xM7@40mm", "known: M1.6, M2,"),
        ("--mount 4xM3@100mm", "over dot"),
        ("--mount 4xM3@1m", "over the edge of the plate"),
        ("--dowel 2xM4@40mm", "the diameter of a dowel pin"),
        ("--mount M3c:0,0 --thickness 1mm", "has a countersink 1.66 mm deep in a plate of 1 mm"),
    ],
)
def test_bad_requests_are_one_line_and_write_nothing(here, capsys, line, phrase):
    assert phrase in refusal(here, capsys, "export", "marker.json", "-o", "m.json", *line.split())


def test_limits_of_a_process_are_one_line_and_write_nothing(here, capsys):
    for line, phrase in (("--depth 3mm", "3 mm"), ("--gap 5mm", "gap"), ("--tool 20mm", "20 mm")):
        assert phrase in refusal(here, capsys, "export", "marker.json", "-o", "m.fab.pdf", *line.split())


def test_an_outline_is_not_written_over(here, capsys):
    complaint = refusal(here, capsys, "export", "marker.json", "-o", "plate.json", "--outline", "plate.json")
    assert "plate.json" in complaint
    (here / "m.dxf").write_bytes((here / "plate.geojson").read_bytes())
    phrase = ["-o", "m.dxf", "--outline", "m.dxf", "--boundary-unit", "m"]
    assert sentence("input overwritten") in refusal(here, capsys, "export", "marker.json", *phrase)


def test_a_design_has_its_plate_and_keeps_dots_off_the_holes(here, capsys):
    line = "--n 4 --radius 60mm --dot 12mm --thickness 5mm --mount 4xM5@100mm/0 --dowel 2x4mm@60mm"
    assert main(["design", *line.split(), *FEW, "-o", "m.json"]) == 0
    capsys.readouterr()
    marker = read_marker(here / "m.json")
    assert marker.substrate == Substrate(0.005, holes=(*parse_mount("4xM5@100mm/0"), *parse_dowel("2x4mm@60mm")))
    assert marker.provenance["spec"]["substrate"] == marker.substrate.as_dict()
    # Without them a dot would stand straight up, where a screw is.
    for hole in marker.substrate.holes:
        assert -hole.rim.depth(marker.xyz[:, :2]).max() >= 0.006 + marker.clearance - 1e-9


def test_a_plate_moves_with_the_boundary_that_it_is_drawn_with(here, capsys):
    for name, corners in (
        ("face", [[1, 1], [1.1, 1], [1.1, 1.1], [1, 1.1]]),
        ("all", [[0.9, 1], [1.2, 1], [1.2, 1.1], [0.9, 1.1]]),
    ):
        shape = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
        (here / f"{name}.geojson").write_text(json.dumps(shape))
    line = "--n 4 --dot 12mm --boundary face.geojson --outline all.geojson --boundary-unit m -o m.json"
    assert main(["design", *line.split(), *FEW]) == 0
    marker = read_marker(here / "m.json")
    assert marker.keep_outs == ()
    (ring,) = marker.substrate.outline.outlines()
    assert sorted(map(tuple, ring.round(9).tolist())) == [(-0.15, -0.05), (-0.15, 0.05), (0.15, -0.05), (0.15, 0.05)]


def test_options_go_before_the_plate_of_a_template(here, capsys):
    (here / "mine.toml").write_text(
        'n = 4\nradius = "60mm"\ndot = "12mm"\nrestarts = 1\nposes = "cone:count=8"\n'
        '[substrate]\nthickness = "5mm"\nmount = "4xM3@60mm"\noutline = "circle:80mm"\n'
    )
    assert main(["design", "--template", "mine.toml", "--mount", "2xM4@60mm", "--edge", "3mm", "-o", "m.json"]) == 0
    plate = read_marker(here / "m.json").substrate
    assert plate == Substrate(0.005, 0.003, outline=Circle(0.08), holes=parse_mount("2xM4@60mm"))


@pytest.mark.parametrize(
    ("line", "phrase"),
    [
        ("--mount 4xM3@1m", "over the edge of the plate"),
        ("--mount 4xM7@40mm", "known: M1.6, M2,"),
        ("--thickness 0mm", "--thickness from 0.01 mm"),
        ("--outline circle:100mm", "a plate's outline that holds the boundary"),
        ("--process casting", "known: cnc, dome"),
        ("--outline plate.geojson", "--boundary-unit"),
    ],
)
def test_plates_are_refused_before_any_search(here, capsys, line, phrase):
    assert phrase in refusal(here, capsys, "design", "-o", "m.json", *line.split())


WITHOUT_KERNEL = """
import sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("cadquery", "OCP"):
            raise ImportError("libGL.so.1: cannot open shared object file: No such file or directory")

sys.meta_path.insert(0, Finder())
from markergen.cli import main
from markergen.workshop.drafting import views

views.TRIES = 1
for words in sys.stdin.read().splitlines():
    print(main(words.split()), file=sys.stderr)
"""


def test_without_the_kernel_every_solid_is_one_line_and_all_else_works(here):
    drawn = [suffix for suffix in EXPORTERS if not EXPORTERS[suffix].kernel and suffix != ".apriltag.yaml"]
    made = [suffix for suffix in EXPORTERS if EXPORTERS[suffix].kernel]
    assert {".fab.pdf", ".stl", ".3mf", ".glb", ".sdf", ".urdf"} <= set(drawn)
    beside = {"m-light.stl", "m-dark.stl", "m-parts.3mf", "model.config", "meshes"}
    lines = [
        *(f"export marker.json -o m{suffix}" for suffix in drawn),
        *(f"export marker.json -o other.json -o m{suffix}" for suffix in made),
        # Before the search, not after it.
        "design --n 200 -o other.step",
    ]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_KERNEL], input="\n".join(lines), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    message = done.stderr.splitlines()
    assert message[: len(drawn)] == ["0"] * len(drawn)
    complaints, statuses = message[len(drawn) :: 2], message[len(drawn) + 1 :: 2]
    assert statuses == ["2"] * (len(made) + 1)
    for complaint in complaints:
        assert "libGL.so.1: cannot open" in complaint
        assert sentence("install solids") in complaint
    written = {path.name for path in here.iterdir()} - {"marker.json", "plate.geojson"}
    assert written - beside == {f"m{suffix}" for suffix in drawn}


INTERRUPTED_KERNEL = """
import importlib.abc, importlib.machinery, signal, sys

class Kernel(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(self, name, path=None, target=None):
        return importlib.machinery.ModuleSpec(name, self) if name == "OCP" else None

    def exec_module(self, module):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            # As a compiled module reports it.
            raise ImportError("initialization failed") from error

sys.meta_path.insert(0, Kernel())
from markergen.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_ctrl_c_while_the_kernel_loads_ends_cleanly(here):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_KERNEL, "export", "marker.json", "-o", "m.step"],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr, done.stdout) == (130, "markergen: error: interrupted\n", "")
    assert {path.name for path in here.iterdir()} == {"marker.json", "plate.geojson"}
