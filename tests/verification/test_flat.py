"""Damage that sheets take in other hands is named; what only looks like damage passes."""

from dataclasses import replace

import numpy as np
import pytest
from damaged_sheets import DAMAGE, DPI, drawn, grey, pages
from ezdxf.math import rational_bspline_from_arc

from markergen.drawing.colors import parse_colors
from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.boundary import Circle
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Substrate, parse_mount
from markergen.model.tag import Tag
from markergen.verification import verify
from markergen.verification.lines import seek_among

TABLE = [(suffix, damage) for suffix, table in DAMAGE.items() for damage in table]


@pytest.fixture(scope="module")
def marker(make_ngon):
    holes = Substrate(holes=parse_mount("4xM3@94mm"))
    return replace(make_ngon(5, 0.05, 0.012), tag=Tag("apriltag:36h11", 3, 0.02), substrate=holes)


@pytest.fixture(scope="module")
def sheets(marker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sheets")
    save(marker, [folder / f"a{suffix}" for suffix in DAMAGE], ExportOptions(dpi=DPI))
    return {suffix: (folder / f"a{suffix}").read_bytes() for suffix in DAMAGE}


def verified(marker, folder, suffix, data):
    path = folder / f"file{suffix}"
    path.write_bytes(data)
    return verify(marker, path)


@pytest.mark.parametrize(("suffix", "damage"), TABLE)
def test_every_damage_is_named_with_its_remedy(marker, sheets, tmp_path, suffix, damage):
    change, kind, phrase = DAMAGE[suffix][damage]
    data = sheets[suffix]
    changed = change(data.decode()).encode() if suffix == ".svg" else change(data)
    assert changed != data
    check = verified(marker, tmp_path, suffix, changed)
    named = [finding for finding in check.findings if finding.kind == kind]
    assert named, check.findings
    assert phrase in named[0].sentence
    assert named[0].remedy or kind == "tag"
    assert not any(finding.kind == "another marker" for finding in check.findings)


def below_the_marker(text):
    style = "font-size:4px;letter-spacing:0px;stroke:none"
    label = f'<text x="20" y="200" style="{style}"><tspan x="20" y="196">A</tspan></text>'
    return text.decode().replace("</svg>", f"{label}</svg>").encode()


def as_splines(document, space):
    for circle in space.query("CIRCLE[layer=='ENGRAVE']"):
        curve = rational_bspline_from_arc(circle.dxf.center, circle.dxf.radius, 0, 360)
        space.add_spline(dxfattribs={"layer": "ENGRAVE"}).apply_construction_tool(curve)
        space.delete_entity(circle)


def in_lower_case(document, space):
    for entity in space:
        entity.dxf.layer = entity.dxf.layer.lower()


CLEAN = {
    "label": (".svg", below_the_marker),
    "turned view": (".pdf", pages(lambda page: page.set_rotation(270))),
    "cropped margin": (".pdf", pages(lambda page: page.set_cropbox(20, 20, 400, 575))),
    "by PDFium": (".pdf", pages(lambda page: None)),
    "by ezdxf": (".dxf", drawn(lambda document, space: None)),
    "splines": (".dxf", drawn(as_splines)),
    "layers in lower case": (".dxf", drawn(in_lower_case)),
    "by OpenCV": (".png", grey(lambda levels: levels)),
}


@pytest.mark.parametrize("name", CLEAN)
def test_a_rewritten_file_passes(marker, sheets, tmp_path, name):
    suffix, change = CLEAN[name]
    check = verified(marker, tmp_path, suffix, change(sheets[suffix]))
    assert check.passed, check.findings
    assert check.largest < 2e-6


COLORS = {"inverted": ".png", "#003366,#ffee99": ".svg", "black,cut:CutContour": ".pdf"}
"""Colors, and the format in which the core has them."""


@pytest.mark.parametrize(
    ("colors", "suffix"),
    [
        pytest.param(colors, suffix, marks=() if suffix == first else pytest.mark.long)
        for colors, first in COLORS.items()
        for suffix in (".pdf", ".svg", ".png")
    ],
)
def test_colors_that_were_asked_for_pass(marker, tmp_path, colors, suffix):
    path = tmp_path / f"a{suffix}"
    save(marker, [path], ExportOptions(dpi=DPI, sheet=SheetOptions(colors=parse_colors(colors))))
    check = verify(marker, path)
    assert check.passed, check.findings
    assert any("--colors inverted" in note for note in check.notes) == (colors == "inverted")


def test_the_drawing_of_a_plate_for_a_laser_passes(marker, tmp_path):
    path = tmp_path / "a.dxf"
    save(marker, [path], ExportOptions(fabrication=Fabrication("laser")))
    assert verify(marker, path).passed


@pytest.mark.parametrize("suffix", [".svg", ".pdf"])
def test_a_hole_in_a_quiet_zone_is_looked_for(make_ngon, tmp_path, suffix):
    ngon = make_ngon(5, 0.05, 0.012)
    beside = f"M3:{1e3 * ngon.xyz[1, 0] + 9:.6g}mm,{1e3 * ngon.xyz[1, 1]:.6g}mm"
    save(ngon, [tmp_path / f"a{suffix}"])
    check = verify(replace(ngon, substrate=Substrate(holes=parse_mount(beside))), tmp_path / f"a{suffix}")
    assert [finding.kind for finding in check.findings] == ["hole"]


def test_an_extra_dot_in_a_keep_out_is_told(make_ngon, tmp_path):
    kept = replace(make_ngon(5, 0.05, 0.012), keep_outs=(Circle(0.006),))
    save(kept, [tmp_path / "a.dxf"])
    data = (tmp_path / "a.dxf").read_bytes()
    assert verify(kept, tmp_path / "a.dxf").passed
    more = drawn(lambda document, space: space.add_circle((0, 0), 6, dxfattribs={"layer": "ENGRAVE"}))
    (finding,) = verified(kept, tmp_path, ".dxf", more(data)).findings
    assert finding.kind == "extra"


def test_a_family_on_tiles_passes(make_ngon, tmp_path):
    marker, path = make_ngon(6, 0.1, 0.024), tmp_path / "a.pdf"
    family = [replace(marker, tag=Tag("apriltag:36h11", number, 0.03)) for number in range(2)]
    save(family, [path], ExportOptions(sheet=SheetOptions("A5")))
    check = verify(family[1], path)
    assert check.passed, check.findings
    assert check.copies == 2
    assert not verify(replace(marker, tag=Tag("apriltag:36h11", 7, 0.03)), path).passed


def test_a_pdf_that_unpacks_to_gigabytes_is_refused(marker, sheets, tmp_path, monkeypatch):
    import zlib

    from markergen import guard

    packer = zlib.compressobj(1)
    packed = b"".join(packer.compress(b"1 1 l\n" * (1 << 20)) for _ in range(40)) + packer.flush()
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Count 1 /Kids [3 0 R] >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 420 595] /Contents 4 0 R >>",
        b"<< /Length %d /Filter /FlateDecode >>\nstream\n" % len(packed) + packed + b"\nendstream",
    ]
    data = b"%PDF-1.5\n" + b"".join(b"%d 0 obj\n" % k + content + b"\nendobj\n" for k, content in enumerate(objects, 1))
    data += b"trailer << /Root 1 0 R /Size 5 >>\n%%EOF"
    with monkeypatch.context() as patch:
        patch.setitem(guard.KINDS, "PDF", replace(guard.KINDS["PDF"], seconds=0.5))
        with pytest.raises(InputError, match=r"takes more than|at most"):
            verified(marker, tmp_path, ".pdf", data)
    # The process that reads the next file is a new one.
    assert verified(marker, tmp_path, ".pdf", sheets[".pdf"]).passed


def test_the_figures_are_those_of_the_damage(marker, tmp_path):
    points = list(marker.control_points)
    for off, passed in ((15e-6, True), (30e-6, False)):
        moved = replace(points[2], x=points[2].x + off)
        save(replace(marker, control_points=(*points[:2], moved, *points[3:])), [tmp_path / "a.dxf"])
        check = verify(marker, tmp_path / "a.dxf")
        assert check.passed == passed
        # The best motion of all dots takes a part of a small error.
        np.testing.assert_allclose(check.largest, off, rtol=0.4)


def test_the_nearest_places_of_lines():
    lines = np.array([[[0.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [4.0, 2.0]]])
    points = np.array([[1.0, 0.5], [5.0, 1.5], [-3.0, -4.0], [4.0, 9.0]])
    places = seek_among(lines)(points, points)
    assert places.tolist() == [[1, 0], [4, 1.5], [0, 0], [4, 2]]
    assert np.isnan(seek_among(lines[:0])(points, points)).all()
