"""The largest disk whose marker a page holds."""

import io
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sentences import sentence

from markergen.api.design import design, largest_that_fits, radius_limits
from markergen.cli import main
from markergen.drawing.paper import SheetOptions, find_paper
from markergen.drawing.sheet_layout import fits, pages_for
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker import Marker
from markergen.model.spec import AUTO, Spec
from markergen.model.substrate import Substrate, parse_mount
from markergen.read.outlines.boundary import parse_boundary
from markergen.read.spec_file import spec_from_mapping

PAGED = {"n": 4, "restarts": 1, "dot": "20mm", "poses": "cone:count=8"}
QUICK = {"n": 4, "dot": "8mm", "restarts": 1, "poses": "cone:count=8"}


def test_it_is_the_design_of_that_radius(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spec = 'n = 4\ndot = "8mm"\nrestarts = 1\nposes = "cone:count=8"\nradius = "fit"\npaper = "A5"\n'
    (tmp_path / "spec.toml").write_text(spec)
    for folder in ("fit", "explicit"):
        (tmp_path / folder).mkdir()
    camera = io.StringIO(json.dumps(PAPER_CAMERA.as_dict()))
    made = design(template="spec.toml", camera=camera, output="fit/marker.pdf")
    assert sentence("stands on", "A5 (148 x 210 mm)", "120 mm") in made.written[0].notes[0]
    assert made.marker.provenance["spec"]["boundary"] == Circle(0.06).as_dict()
    arguments = ["--n=4", "--dot=8mm", "--restarts=1", "--poses=cone:count=8", "--paper=A5"]
    assert main(["design", *arguments, "--radius=60mm", "-o", "explicit/marker.pdf"]) == 0
    for suffix in (".pdf", ".json"):
        assert (tmp_path / f"fit/marker{suffix}").read_bytes() == (tmp_path / f"explicit/marker{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("sheet", "dot", "limits"),
    [
        (SheetOptions("A4"), 0.036, (89, 89)),
        (SheetOptions("A4", "landscape"), 0.036, (61, 67)),
        (SheetOptions("A4", "landscape"), 0.01, (67, 67)),
        (SheetOptions("letter", margin=0.005), 0.036, (93, 98)),
    ],
)
def test_large_dots_need_room_for_their_quiet_zones(make_ngon, sheet, dot, limits):
    """Between the limits, whether a page holds a marker depends on where its dots are: bisection is exact."""

    def make(radius):
        return Spec(n=5, boundary=Circle(radius / 1e3), dot=dot)

    tried = {}

    def find(spec):
        tried[round(1e3 * spec.boundary.radius)] = marker = make_ngon(spec.n, spec.boundary.radius, dot)
        return SimpleNamespace(marker=marker, spec=spec)

    assert radius_limits(make, sheet) == limits
    result = largest_that_fits(make, limits, sheet, find)
    radius = round(1e3 * result.spec.boundary.radius)
    assert result.marker is tried[radius]
    assert len(pages_for([result.marker], sheet)) == 1
    assert not fits(make_ngon(5, (radius + 1) / 1e3, dot), sheet)


def test_the_best_number_of_dots_is_that_of_the_largest_disk():
    quick = {"n": "auto", "restarts": 1, "poses": "cone:count=8", "dot": "20mm"}
    actual = design(**quick, radius="fit", paper="A5")
    radius = actual.marker.boundary.radius
    assert actual.marker == design(**quick, radius=radius).marker
    assert fits(actual.marker, SheetOptions("A5"))


def test_it_is_tried_from_the_top(make_ngon):
    tried = []

    def find(spec):
        tried.append(round(1e3 * spec.boundary.radius))
        return SimpleNamespace(marker=make_ngon(5, spec.boundary.radius, 0.005))

    sheet = SheetOptions("letter", margin=0.005)
    limits = radius_limits(lambda radius: Spec(n=AUTO, boundary=Circle(radius / 1e3)), sheet)
    assert limits[0] < limits[1]
    largest_that_fits(lambda radius: Spec(boundary=Circle(radius / 1e3)), limits, sheet, find)
    assert tried == [limits[1]]


def test_holes_of_a_plate_larger_than_the_disk_must_fit_too(make_ngon):
    plate = Substrate(outline=parse_boundary("rect:200mmx20mm"), holes=parse_mount("2xM3@180mm/0"))

    def find(spec):
        marker = replace(make_ngon(4, spec.boundary.radius, 0.008), substrate=plate)
        return SimpleNamespace(marker=marker, spec=spec)

    def make(radius):
        return Spec(boundary=Circle(radius / 1e3))

    assert largest_that_fits(make, (60, 60), SheetOptions("A4"), find).spec == make(60)
    with pytest.raises(InputError, match="A5-portrait holds, found holes"):
        largest_that_fits(make, (60, 60), SheetOptions("A5-portrait"), find)


def test_what_cannot_fit_is_said():
    with pytest.raises(InputError, match="relief, found --radius fit"):
        design(**QUICK, radius="fit", relief="10mm")
    with pytest.raises(InputError, match="for markergen design"):
        spec_from_mapping({"radius": "fit"})
    with pytest.raises(InputError, match="a radius or a boundary"):
        design(radius="fit", boundary="rect:0.1x0.2")
    with pytest.raises(InputError, match="radius='fits'"):
        design(radius="fits")


@pytest.mark.parametrize(
    ("locale", "paper"),
    [("de_DE.UTF-8", "A4"), ("en_US.UTF-8", "letter"), pytest.param("C", "A4", marks=pytest.mark.long)],
)
def test_the_page_in_the_printer_is_the_room(tmp_path, monkeypatch, locale, paper):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LC_ALL", locale)
    arguments = ["design", "--n=4", "--dot=20mm", "--restarts=1", "--poses=cone:count=8", "--quiet"]
    assert main([*arguments, "-o", "page.pdf"]) == 0
    loaded = Marker.load("page.json")
    options = SheetOptions(paper)
    assert fits(loaded, options)
    width, height = np.ptp(loaded.boundary.outlines()[0], axis=0)
    page = find_paper(paper)
    assert 1e3 * width > page.width - 36
    assert 1e3 * height > page.height - 92
    assert main([*arguments, "--radius=60mm", "-o", "disk.pdf"]) == 0
    assert Marker.load("disk.json").boundary == Circle(0.06)


def test_python_does_not_depend_on_the_locale(monkeypatch):
    monkeypatch.setenv("LC_ALL", "en_US.UTF-8")
    assert design(**PAGED).marker.boundary == Circle(0.15)
    assert str(design(**PAGED, boundary="page").marker.boundary) == "rectangle of 178 mm x 217 mm"
