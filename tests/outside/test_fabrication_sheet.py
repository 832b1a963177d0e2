"""The fabrication sheet in the programs that a shop opens and prints it with."""

import subprocess

import pytest
from programs import program
from workpieces import MARKERS

from markergen.exporters import EXPORTERS, ExportOptions
from markergen.model.fabrication import Fabrication

KINDS = {"disk": "cnc", "relief": "cnc", "many": "fdm", "corner": "laser", "apart": "dome"}


@pytest.fixture(scope="module", params=KINDS)
def sheet(request, tmp_path_factory):
    options = ExportOptions(fabrication=Fabrication(process=KINDS[request.param]))
    path = tmp_path_factory.mktemp("drawing") / f"{request.param}.fab.pdf"
    path.write_bytes(EXPORTERS[".fab.pdf"]([MARKERS[request.param]], options).data)
    return path


def run(*command):
    return subprocess.run([str(item) for item in command], capture_output=True, check=True, text=True, timeout=120)


def test_ghostscript_prints_it_without_a_warning(sheet):
    done = run(program("ghostscript", "gs"), "-q", "-dNOPAUSE", "-dBATCH", "-sDEVICE=nullpage", sheet)
    assert not done.stdout + done.stderr


def test_poppler_draws_it_and_reads_its_words_and_fonts(sheet, tmp_path):
    done = run(program("poppler-utils", "pdftoppm"), "-r", "40", "-png", sheet, tmp_path / "page")
    assert not done.stdout + done.stderr
    phrase = run(program("poppler-utils", "pdftotext"), "-layout", sheet, "-").stdout
    for item in ("ISO 2768-mK", "Datums", "Tolerances, mm", "date of issue", "revision", "first angle", "±"):
        assert item in phrase
    rows = run(program("poppler-utils", "pdffonts"), sheet).stdout.splitlines()[2:]
    # Embedded, a subset, and with the characters for searching.
    assert [row.split()[-5:-2] for row in rows] == [["yes", "yes", "yes"]] * 2
