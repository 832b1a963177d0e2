"""PDFs of all kinds in programs that people open and print them with."""

import json
import subprocess
from dataclasses import replace

import pytest
from programs import program

from markergen.drawing.paper import SheetOptions
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.tag import Tag

KINDS = {"sheet.pdf": 1, "tiles.pdf": 5, "family.pdf": 2, "drawing.fab.pdf": None}
"""Files and their numbers of pages."""


@pytest.fixture(scope="module")
def folder(make_ngon, tmp_path_factory):
    path = tmp_path_factory.mktemp("pdf")
    small, large = make_ngon(5, 0.04, 0.008), make_ngon(5, 0.15, 0.036)
    tagged = [replace(small, tag=Tag("apriltag:36h11", number, 0.015)) for number in range(4)]
    save(small, [path / "sheet.pdf", path / "drawing.fab.pdf"])
    save(large, [path / "tiles.pdf"], ExportOptions(SheetOptions("A4")))
    save(tagged, [path / "family.pdf"])
    return path


def run(*command):
    return subprocess.run([str(item) for item in command], capture_output=True, check=True, text=True, timeout=60)


@pytest.mark.parametrize("name", KINDS)
def test_qpdf_has_no_objection_and_finds_the_preferences(folder, name):
    qpdf = program("qpdf")
    assert not run(qpdf, "--check", folder / name).stderr
    # Version 1 of the JSON is in all releases.
    objects = json.loads(run(qpdf, "--json=1", folder / name).stdout)["objects"]
    (catalog,) = (item for item in objects.values() if isinstance(item, dict) and item.get("/Type") == "/Catalog")
    preferences = objects[catalog["/ViewerPreferences"]]
    assert preferences["/PrintScaling"] == "/None"
    assert preferences["/PickTrayByPDFSize"] is True
    assert preferences.get("/Duplex") == (None if name.endswith(".fab.pdf") else "/Simplex")


@pytest.mark.parametrize("name", KINDS)
def test_mupdf_finds_the_preferences(folder, name):
    result = run(program("mupdf-tools", "mutool"), "show", folder / name, "trailer/Root/ViewerPreferences")
    assert "/PrintScaling /None" in result.stdout
    assert not result.stderr


@pytest.mark.parametrize("name", KINDS)
def test_poppler_finds_the_pages_and_no_error(folder, name):
    result = run(program("poppler-utils", "pdfinfo"), "-l", "99", folder / name)
    assert not result.stderr
    phrase = dict(line.split(":", 1) for line in result.stdout.splitlines())
    assert phrase["PDF version"].strip() == "1.7"
    assert KINDS[name] in (None, int(phrase["Pages"]))
