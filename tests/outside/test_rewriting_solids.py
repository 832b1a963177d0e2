"""Solids that FreeCAD opened and saved again pass, and what it measures of them is what the marker says."""

import json
import os
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from programs import program

from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.verification import verify

# Without names and colors: the reader that has these crashes in FreeCAD 0.20 now and then, without a window.
SCRIPT = """
import json, Mesh, Part
whole = Part.Shape()
whole.read({source!r})
whole.exportStep({out!r} + ".step")
whole.exportBrep({out!r} + ".brep")
mesh = Mesh.Mesh()
for each in whole.Solids:
    mesh.addMesh(Mesh.Mesh(each.tessellate(0.004)))
mesh.write({out!r} + ".stl")
box = whole.BoundBox
open({out!r} + ".json", "w").write(json.dumps([box.XLength, box.YLength, box.ZLength]))
"""


@pytest.fixture(scope="module", params=["inlaid", "milled", "engraved"])
def rewritten(request, make_marker, tmp_path_factory):
    """A marker, and the stem of the files that FreeCAD wrote of it."""
    freecad = program("freecad", "freecadcmd", "FreeCADCmd")
    folder = tmp_path_factory.mktemp("freecad")
    points = np.array([[0.03, 0.02], [-0.035, 0.018], [-0.01, -0.03], [0.036, -0.012], [0.0, 0.035]])
    holes = (Hole(-0.022, -0.008, 0.0034, name="M3"), Hole(0.016, -0.024, 0.0034, 0.0065, name="M3"))
    marker = replace(
        make_marker(points, 0.05, 0.012), substrate=Substrate(thickness=0.004, holes=holes),
        tag=Tag("aruco:DICT_4X4_50", 7, 0.02),
    )  # fmt: skip
    process = {"inlaid": "fdm", "milled": "cnc", "engraved": "laser"}[request.param]
    save(marker, [folder / "a.step"], ExportOptions(fabrication=Fabrication(process)))
    (folder / "a.py").write_text(SCRIPT.format(source=str(folder / "a.step"), out=str(folder / "b")))
    # FreeCAD brings a Python of its own.
    others = {key: value for key, value in os.environ.items() if key not in ("VIRTUAL_ENV", "PYTHONPATH", "PYTHONHOME")}
    command = ["timeout", "200", freecad, str(folder / "a.py")]
    run = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, env=others, check=False)
    assert (folder / "b.json").exists(), run.stdout + run.stderr
    return marker, folder / "b"


@pytest.mark.parametrize("suffix", [".step", ".brep", ".stl"])
def test_what_freecad_wrote_passes(rewritten, suffix):
    marker, stem = rewritten
    check = verify(marker, stem.with_suffix(suffix))
    assert check.passed, check.findings
    assert check.dots == 5
    assert check.largest < 1e-6


def test_freecad_measures_the_plate(rewritten):
    _, stem = rewritten
    width, height, thickness = json.loads(stem.with_suffix(".json").read_text())
    # The disk of the boundary and its edge of 2 mm; where a shape has a mesh, its box is that of the mesh.
    assert (width, height) == pytest.approx((104, 104), abs=5e-3)
    assert thickness == pytest.approx(4, abs=1e-3)
