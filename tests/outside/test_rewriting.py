"""Sheets that other programs have saved again: what they rewrite cleanly passes, with the figure told."""

import subprocess
from dataclasses import replace

import pytest
from programs import program

from markergen.exporters.saving import save
from markergen.model.substrate import Substrate, parse_mount
from markergen.model.tag import Tag
from markergen.verification import verify


@pytest.fixture(scope="module")
def marker(make_ngon):
    holes = Substrate(holes=parse_mount("4xM3@94mm"))
    return replace(make_ngon(5, 0.05, 0.012), tag=Tag("apriltag:36h11", 3, 0.02), substrate=holes)


@pytest.fixture(scope="module")
def folder(marker, tmp_path_factory):
    path = tmp_path_factory.mktemp("rewriting")
    save(marker, [path / "a.pdf", path / "a.svg"])
    return path


REWRITERS = {
    "qpdf": ("qpdf", "qpdf", "a.pdf", "b.pdf", ["--object-streams=generate", "{source}", "{target}"]),
    "qpdf, unpacked": ("qpdf", "qpdf", "a.pdf", "b.pdf", ["--qdf", "{source}", "{target}"]),
    "mutool": ("mupdf-tools", "mutool", "a.pdf", "b.pdf", ["clean", "-gggg", "-s", "{source}", "{target}"]),
    "Ghostscript": (
        "ghostscript", "gs", "a.pdf", "b.pdf",
        ["-q", "-dNOPAUSE", "-dBATCH", "-sDEVICE=pdfwrite", "-sOutputFile={target}", "{source}"],
    ),
    "Inkscape": ("inkscape", "inkscape", "a.svg", "b.svg", ["{source}", "-o", "{target}"]),
    "Inkscape, plain": ("inkscape", "inkscape", "a.svg", "b.svg", ["{source}", "-l", "-o", "{target}"]),
    "Inkscape to PDF": ("inkscape", "inkscape", "a.svg", "b.pdf", ["{source}", "-o", "{target}"]),
}  # fmt: skip
"""Package, executable, source, target and arguments of programs that save sheets again."""


@pytest.mark.parametrize("name", REWRITERS)
def test_a_rewritten_sheet_passes(marker, folder, tmp_path, name):
    package, executable, source, target, arguments = REWRITERS[name]
    command = [argument.format(source=folder / source, target=tmp_path / target) for argument in arguments]
    subprocess.run([program(package, executable), *command], check=True, capture_output=True, timeout=120)
    check = verify(marker, tmp_path / target)
    assert check.passed, check.findings
    # What was measured of these programs: 0.1 nm to 2 um.
    assert check.largest < 5e-6


def test_a_sheet_that_a_program_fits_to_its_page_is_named(marker, folder, tmp_path):
    # pdftocairo rounds A5 to whole points, and fits the sheet to that.
    pdftocairo = program("poppler-utils", "pdftocairo")
    subprocess.run([pdftocairo, "-pdf", folder / "a.pdf", tmp_path / "b.pdf"], check=True, timeout=60)
    check = verify(marker, tmp_path / "b.pdf")
    assert [finding.kind for finding in check.findings] == ["scaled"]
    assert 0.998 < check.scale[0] < 0.9995
