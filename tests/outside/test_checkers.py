"""Our files in programs that check, repair or load them: they find nothing to repair, and load what the marker has."""

import json
import os
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from programs import program

from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.tag import Tag
from markergen.verification import verify
from markergen.workshop.processes import parts_of

FABRICATION = Fabrication(engrave=False, tolerance=2e-5)


@pytest.fixture(scope="module")
def marker(make_ngon):
    return replace(make_ngon(5, 0.05, 0.012), tag=Tag("apriltag:36h11", 3, 0.02))


@pytest.fixture(scope="module")
def folder(marker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("checked")
    suffixes = (".stl", ".3mf", ".glb", ".urdf", ".dxf")
    save(marker, [folder / f"a{suffix}" for suffix in suffixes], ExportOptions(fabrication=FABRICATION))
    return folder


def output(*command, **options):
    run = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL, check=False,
        **options,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout + run.stderr


def test_admesh_repairs_nothing(marker, folder, tmp_path):
    written = tmp_path / "b.stl"
    report = output(program("admesh"), f"--write-binary-stl={written}", folder / "a.stl")
    parts = parts_of(marker, FABRICATION).parts
    assert int(re.search(r"Number of parts\s*:\s*(\d+)", report)[1]) == len(parts)
    for repair in ("Edges fixed", "Facets removed", "Facets added", "Facets reversed", "Backwards edges"):
        assert int(re.search(rf"{repair}\s*:\s*(\d+)", report)[1]) == 0, report
    check = verify(marker, written)
    assert check.passed, check.findings


def test_what_openscad_wrote_passes(marker, folder, tmp_path):
    (tmp_path / "b.scad").write_text(f'import("{folder / "a.stl"}", convexity=10);')
    output(program("openscad"), "-o", tmp_path / "b.stl", tmp_path / "b.scad")
    check = verify(marker, tmp_path / "b.stl")
    assert check.passed, check.findings


def test_lib3mf_reads_the_package_strictly(folder):
    lib3mf = pytest.importorskip("lib3mf")
    for name in ("a.3mf", "a-parts.3mf"):
        reader = lib3mf.get_wrapper().CreateModel().QueryReader("3mf")
        reader.SetStrictModeActive(True)
        reader.ReadFromFile(str(folder / name))
        assert reader.GetWarningCount() == 0, [reader.GetWarning(k) for k in range(reader.GetWarningCount())]


VALIDATE = """
const validator = require('gltf-validator');
const bytes = new Uint8Array(require('fs').readFileSync(process.argv[1]));
validator.validateBytes(bytes).then(report => console.log(JSON.stringify(report.issues)));
"""


def test_gltf_validator_finds_nothing(folder):
    node = program("nodejs", "node", "nodejs")
    if subprocess.run([node, "-e", "require('gltf-validator')"], capture_output=True, check=False).returncode:
        pytest.skip("the npm package gltf-validator is not installed where NODE_PATH looks")
    issues = json.loads(output(node, "-e", VALIDATE, folder / "a.glb"))
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues


def test_pybullet_loads_the_model(marker, folder):
    pybullet = pytest.importorskip("pybullet")
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(folder / "a.urdf"), physicsClientId=client)
        mass = pybullet.getDynamicsInfo(body, -1, physicsClientId=client)[0]
        colors = {
            tuple(np.round(shape[7][:3], 3).tolist())
            for shape in pybullet.getVisualShapeData(body, physicsClientId=client)
        }
    finally:
        pybullet.disconnect(client)
    volume = sum(part.volume for part in parts_of(marker, FABRICATION).parts)
    assert mass == pytest.approx(1240e-9 * volume, rel=1e-3)
    assert colors == {(1.0, 1.0, 1.0), (0.05, 0.05, 0.05)}


IMPORT = """
import FreeCAD, importDXF, json
document = FreeCAD.newDocument()
FreeCAD.ParamGet("User parameter:BaseApp/Preferences/Mod/Draft").SetBool("dxfAllowDownload", False)
importDXF.readPreferences()
importDXF.insert({source!r}, document.Name)
edges = [edge for item in document.Objects if hasattr(item, "Shape") for edge in item.Shape.Edges]
rows = [(*edge.Curve.Center, edge.Curve.Radius) for edge in edges
        if edge.Curve.TypeId == "Part::GeomCircle" and edge.isClosed()]
open({out!r}, "w").write(json.dumps(rows))
"""


def test_freecad_imports_the_circles_of_a_drawing(marker, folder, tmp_path):
    freecad = program("freecad", "freecadcmd", "FreeCADCmd")
    (tmp_path / "a.py").write_text(IMPORT.format(source=str(folder / "a.dxf"), out=str(tmp_path / "b.json")))
    # FreeCAD brings a Python of its own.
    others = {key: value for key, value in os.environ.items() if key not in ("VIRTUAL_ENV", "PYTHONPATH", "PYTHONHOME")}
    report = output("timeout", "200", freecad, tmp_path / "a.py", env=others)
    assert (tmp_path / "b.json").exists(), report
    circles = np.array(json.loads((tmp_path / "b.json").read_text()))
    for point in marker.control_points:
        place = 1e3 * np.array([point.x, point.y, 0])
        for diameter in filter(None, (point.feature.diameter, point.feature.inner_diameter)):
            off = np.linalg.norm(circles - [*place, 500 * diameter], axis=1)
            assert off.min() < 1e-3
