"""``markergen export``: every suffix, the options of sheets, and what it refuses."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pypdfium2
import pytest
from PIL import Image
from refusals import refused

from markergen.cli import main
from markergen.exporters import EXPORTERS, catalog
from markergen.model.body_json import to_json
from markergen.model.tag import Tag


@pytest.fixture
def here(tmp_path, monkeypatch, make_ngon) -> Path:
    monkeypatch.chdir(tmp_path)
    marker = make_ngon(5, 0.06, 0.014)
    tagged = replace(marker, tag=Tag("apriltag:36h11", 3, 0.02))
    (tmp_path / "marker.json").write_bytes(to_json(marker))
    (tmp_path / "tagged.json").write_bytes(to_json(tagged))
    (tmp_path / "large.json").write_bytes(to_json(make_ngon(5, 0.15, 0.036)))
    return tmp_path


def run(line: str) -> int:
    return main(["export", *line.split()])


def refusal(here: Path, capsys, line: str) -> str:
    return refused(here, capsys, "export", *line.split())


def test_help_lists_every_suffix_with_a_word_about_it():
    # In a process of its own, whose width does not depend on the terminal.
    done = subprocess.run(
        [sys.executable, "-m", "markergen", "export", "--help"], capture_output=True, text=True, check=True
    )
    listed = [
        line.split() for line in done.stdout.split("Suffixes:")[1].split("Processes:")[0].splitlines() if line.split()
    ]
    assert {word for line in listed for word in line if word.startswith(".")} == set(EXPORTERS)
    # Long lines go on below.
    message = [word for line in listed for word in line]
    assert message == [word for suffixes, phrase in catalog() for word in (*suffixes, *phrase.split())]
    assert all(len(phrase.split()) >= 2 for _, phrase in catalog())


def test_every_suffix_at_once(here, capsys):
    suffixes = [suffix for suffix in EXPORTERS if EXPORTERS[suffix].holds != "solid"]
    assert run("tagged.json " + " ".join(f"-o out{suffix}" for suffix in suffixes)) == 0
    output = capsys.readouterr().out
    for suffix in suffixes:
        assert f"wrote out{suffix}" in output
        assert (here / f"out{suffix}").stat().st_size > 300


def test_dpi_and_colors_reach_the_picture(here):
    assert run("marker.json -o a.png --dpi 100 --paper A4") == 0
    assert run("marker.json -o b.png --dpi 200 --paper A4 --colors #ffffff,#003366") == 0
    with Image.open(here / "a.png") as small, Image.open(here / "b.png") as large:
        small.load()
        large.load()
    assert (small.mode, large.mode) == ("L", "RGB")
    assert small.size == (827, 1169)
    assert abs(large.size[0] - 2 * small.size[0]) <= 1
    assert (0, 0x33, 0x66) in {color for _, color in large.getcolors(1 << 20)}


def test_a_spot_color_reaches_the_pdf(here):
    assert run("marker.json -o a.pdf --colors black,cut:CutContour") == 0
    assert b"/Separation /CutContour" in (here / "a.pdf").read_bytes()


def test_orientation_and_custom_paper(here):
    assert run("marker.json -o a.svg --paper A3 --orientation landscape -o a.pdf") == 0
    assert 'width="420mm" height="297mm"' in (here / "a.svg").read_text()
    assert run("marker.json -o b.svg --paper 250x300mm") == 0
    assert 'width="250mm" height="300mm"' in (here / "b.svg").read_text()


def test_several_markers_go_into_one_pdf(here):
    assert run("marker.json large.json -o both.pdf") == 0
    document = pypdfium2.PdfDocument(here / "both.pdf")
    assert len(document) >= 1
    document.close()


@pytest.mark.parametrize(
    ("line", "phrase"),
    [
        ("marker.json -o m.xyz", ".opencv.yaml"),
        ("marker.json -o m.yaml", ".kalibr.yaml"),
        ("marker.json -o m.png --dpi 5", "dpi=5"),
        ("marker.json -o m.png --dpi 20000", "dpi of 10 to 10000"),
        ("marker.json -o m.png --dpi 1200 --paper A0", "below 2 GB"),
        ("marker.json -o m.png --dpi many", "--dpi"),
        ("large.json -o m.pdf -o m.svg --paper A4", "use .pdf"),
        ("large.json -o m.png --paper A4 --no-tile", "A4"),
        ("large.json -o m.pdf --paper A4 --no-tile", "A4"),
        ("marker.json -o m.pdf --paper A44", "letter"),
        ("marker.json -o m.pdf --orientation square", "portrait or landscape"),
        ("marker.json -o m.pdf --margin -5mm", "margin"),
        ("marker.json -o m.pdf --margin wide", "--margin"),
        ("marker.json -o m.pdf --overlap -1mm", "overlap"),
        ("marker.json -o m.pdf --colors red", "#rrggbb,#rrggbb"),
        ("marker.json -o m.pdf --colors #ffffff,#fffff0", "grey levels apart"),
        ("marker.json -o m.pdf --colors black,cut:", "CutContour"),
        ("marker.json -o m.apriltag.yaml", "--tag apriltag"),
        ("marker.json tagged.json -o m.dxf", "one marker for .dxf"),
        ("marker.json tagged.json -o m.csv", "one marker for .csv"),
        ("marker.json -o marker.json", "one of the inputs"),
    ],
)
def test_bad_requests_are_one_line_and_write_nothing(here, capsys, line, phrase):
    assert phrase in refusal(here, capsys, line)
