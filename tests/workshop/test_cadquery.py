"""A marker or a rig as a `cadquery.Assembly`, for people who build on it."""

import sys

import pytest

import markergen as mg
from markergen.errors import InputError, MissingLibraryError
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.solid.primitives import COLORS
from markergen.workshop.assembly import made_of
from tests.golden.record import INPUTS
from tests.support.cad_parts import cad_parts
from tests.support.rigs import cube, wall

MARKER = Marker.load(INPUTS / "tagged.json")


def check(assembly, parts, back):
    """Parts of an assembly, and of a file that was read back, have names, colors and volumes of those to make."""
    children = {child.name: child for child in assembly.children}
    assert list(children) == [part.name for part in parts]
    read = {part.name: part for part in back}
    for part in parts:
        child = children[part.name]
        assert child.color.toTuple()[:3] == pytest.approx(COLORS[part.material])
        assert child.obj.isValid()
        assert child.obj.Volume() == pytest.approx(part.volume, rel=1e-6)
        assert read[part.name].volume == pytest.approx(part.volume, rel=1e-6)
        assert read[part.name].color == pytest.approx(COLORS[part.material], abs=1e-3)
    assert len(read) == len(children)


@pytest.mark.parametrize("body", [MARKER, pytest.param(wall(), marks=pytest.mark.long)], ids=["marker", "wall"])
def test_parts_keep_names_colors_and_volumes_in_an_assembly_and_its_step(body, tmp_path):
    assembly = body.to_cadquery(engrave=False, thickness="4mm")
    plated = mg.export(body, tmp_path / "plated.json", thickness="4mm")[0].path
    loaded = (mg.Rig if body.frame == "rig" else Marker).load(plated)
    parts = made_of(loaded, Fabrication(engrave=False)).parts
    assembly.export(str(tmp_path / "saved.step"))
    check(assembly, parts, cad_parts((tmp_path / "saved.step").read_bytes()))


@pytest.mark.long
def test_a_block_is_one_body_with_inlays():
    rig = cube(0.08)
    assembly = rig.to_cadquery()
    assert assembly.name.startswith("markergen-rig-")
    names = [child.name for child in assembly.children]
    assert names[0] == "body"
    assert len(names) == 1 + len(rig) + 6
    assert assembly.toCompound().Volume() == pytest.approx(80**3, rel=1e-6)


def test_it_is_in_the_frame_of_the_marker():
    assembly = MARKER.to_cadquery(engrave=False)
    for point in MARKER.control_points:
        center = assembly[f"dot-{point.id}"].obj.BoundingBox().center
        assert (center.x, center.y) == pytest.approx((1e3 * point.x, 1e3 * point.y), abs=1e-6)
    assert assembly["plate"].obj.BoundingBox().zmax == pytest.approx(0, abs=1e-6)


def test_engraved_marks_have_the_color_of_the_other_material():
    assembly = MARKER.to_cadquery(process="laser", engrave=False)
    marks = assembly["plate"]._subshape_colors
    assert len(marks) >= len(MARKER)
    for color in marks.values():
        assert color.toTuple()[:3] == pytest.approx(COLORS["dark"])


def test_it_is_built_on(tmp_path):
    import cadquery  # Takes seconds, which every collection of the tests would.

    foot = cadquery.Workplane().box(20, 20, 10).translate((0, 0, -10))
    stand = cadquery.Assembly(name="stand").add(MARKER.to_cadquery(engrave=False), name="marker").add(foot, name="foot")
    stand.export(str(tmp_path / "stand.step"))
    assert {"foot", "plate"} <= {part.name for part in cad_parts((tmp_path / "stand.step").read_bytes())}


def test_what_cannot_be_made_is_refused_in_one_line():
    with pytest.raises(InputError, match="light dots"):
        Marker.load(INPUTS / "light.json").to_cadquery()
    with pytest.raises(InputError, match="--fit with"):
        MARKER.to_cadquery(fit="slip")


def test_without_cadquery_it_is_refused_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "cadquery", None)
    with pytest.raises(MissingLibraryError, match=r"cadquery\.Assembly needs cadquery.*\[solids\]") as error:
        MARKER.to_cadquery(engrave=False)
    assert "\n" not in str(error.value)
