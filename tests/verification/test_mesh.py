"""Simulator models, read back with their meshes: what each damage is called."""

import re
import shutil

import numpy as np
import pytest
from sentences import sentence
from spoiled_solids import stl, triangles

from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.verification.check import verify

SUFFIXES = [".urdf", ".sdf", ".mjcf.xml"]
HALF_TURN = {
    ".urdf": ('rpy="0 0 0"/>\n      <!--', 'rpy="0 0 3.141592653589793"/>\n      <!--'),
    ".sdf": ("<pose>0 0 0 0 0 0</pose>", '<pose degrees="true">0 0 0 0 0 180</pose>'),
    ".mjcf.xml": ('class="seen" mesh=', 'quat="0 0 0 1" class="seen" mesh='),
}
QUARTER_TURN = {
    ".urdf": ('rpy="0 0 0"/>\n      <!--', 'rpy="1.5707963267948966 0 0"/>\n      <!--'),
    ".sdf": ("<pose>0 0 0 0 0 0</pose>", "<pose>0 0 0 1.5707963267948966 0 0</pose>"),
    ".mjcf.xml": ('class="seen" mesh=', 'euler="90 0 0" class="seen" mesh='),
}
SHIFT = {
    ".urdf": ('xyz="0 0 0" rpy="0 0 0"/>\n      <!--', 'xyz="0 0.002 0" rpy="0 0 0"/>\n      <!--'),
    ".sdf": ("<pose>0 0 0 0 0 0</pose>", "<pose>0 0.002 0 0 0 0</pose>"),
    ".mjcf.xml": ('class="seen" mesh=', 'pos="0 0.002 0" class="seen" mesh='),
}
IN_MM = {
    ".urdf": ('.stl"', '.stl" scale="0.001 0.001 0.001"'),
    ".sdf": ("</uri>", "</uri><scale>0.001 0.001 0.001</scale>"),
    ".mjcf.xml": ('.stl"', '.stl" scale="0.001 0.001 0.001"'),
}
INK = {
    ".urdf": ('rgba="0.05 0.05 0.05 1"', 'rgba="1 1 1 1"'),
    ".sdf": ("<diffuse>0.05 0.05 0.05 1<", "<diffuse>1 1 1 1<"),
    ".mjcf.xml": ('rgba="0.05 0.05 0.05 1"', 'rgba="1 1 1 1"'),
}


@pytest.fixture(scope="module")
def marker(make_ngon):
    return make_ngon(5, 0.06, 0.012)


@pytest.fixture(scope="module")
def written(marker, make_ngon, tmp_path_factory):
    """Folders with models of the marker, and of one with a dot more, by the names of the processes."""
    folder = tmp_path_factory.mktemp("models")
    others = {"cnc": marker, "laser": marker, "other": make_ngon(6, 0.06, 0.012)}
    for name, made in others.items():
        (folder / name).mkdir()
        process = "cnc" if name == "other" else name
        paths = [folder / name / f"m{suffix}" for suffix in SUFFIXES]
        save(made, paths, ExportOptions(fabrication=Fabrication(process, engrave=False)))
    return folder


@pytest.fixture
def here(written, tmp_path):
    shutil.copytree(written / "cnc", tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.fixture(params=SUFFIXES)
def suffix(request):
    return request.param


def spoil(path, old, new, count=-1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


def sentences(check):
    return [finding.sentence for finding in check.findings]


@pytest.mark.parametrize("process", ["cnc", "laser"])
def test_what_was_written_passes(process, suffix, written, marker):
    found = verify(marker, written / process / f"m{suffix}")
    assert found.passed
    assert found.kind == {".urdf": "URDF", ".sdf": "SDF", ".mjcf.xml": "MJCF"}[suffix]
    assert found.dots == 5
    assert found.largest < 2e-8


def test_in_a_package_and_with_other_links_the_meshes_are_found(written, here, marker):
    spoil(here / "m.urdf", 'filename="', 'filename="package://somewhere/')
    spoil(here / "m.urdf", "</robot>", '<link name="base"/></robot>')
    spoil(here / "m.sdf", "<uri>", "<uri>model://marker/")
    spoil(here / "m.mjcf.xml", "<default>", '<compiler meshdir="meshes" angle="radian"/><default>', 1)
    spoil(here / "m.mjcf.xml", "meshes/", "")
    assert all(verify(marker, here / f"m{suffix}").passed for suffix in SUFFIXES)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (HALF_TURN, sentence("mesh turned", "{}", 180)),
        (SHIFT, "meshes/m-{}.stl is 2 mm off in the frame of its link"),
    ],
)
def test_a_visual_that_is_elsewhere(damage, said, suffix, here, marker):
    spoil(here / f"m{suffix}", *damage[suffix])
    found = sentences(verify(marker, here / f"m{suffix}"))
    assert found == [said.format("light"), said.format("dark")]


def test_the_plate_alone_is_turned(suffix, here, marker):
    spoil(here / f"m{suffix}", *HALF_TURN[suffix], 1)
    found = sentences(verify(marker, here / f"m{suffix}"))
    assert sentence("mesh turned", "light", 180) in found
    assert not any("m-dark" in said for said in found)


def test_a_face_that_does_not_look_along_z(suffix, here, marker):
    spoil(here / f"m{suffix}", *QUARTER_TURN[suffix])
    found = sentences(verify(marker, here / f"m{suffix}"))
    assert sentence("mesh turned", "dark", 90) in found
    assert any("points along" in said for said in found)


def test_a_scale_of_mm(suffix, here, marker):
    spoil(here / f"m{suffix}", *IN_MM[suffix])
    (finding,) = verify(marker, here / f"m{suffix}").findings
    assert finding.kind == "scaled"
    assert "scaled by 0.001" in finding.sentence


def test_dots_as_light_as_the_plate(suffix, here, marker):
    spoil(here / f"m{suffix}", *INK[suffix])
    found = verify(marker, here / f"m{suffix}").findings
    assert [finding.kind for finding in found] == ["color"] * len(found)
    assert found


def change(path, motion):
    path.write_bytes(stl(motion(triangles(path.read_bytes()))))


def test_meshes_that_are_themselves_elsewhere(here, marker):
    """The pose of each visual says nothing about it."""
    for name in ("light", "dark"):
        change(here / "meshes" / f"m-{name}.stl", lambda corners: corners + [0.001, 0, 0])
    (finding,) = verify(marker, here / "m.urdf").findings
    assert finding.kind == "frame"
    assert "off by x +1 mm" in finding.sentence
    for name in ("light", "dark"):
        change(here / "meshes" / f"m-{name}.stl", lambda corners: (corners - [0.001, 0, 0]) * [-1, -1, 1])
    (finding,) = verify(marker, here / "m.urdf").findings
    assert re.search(r"turned by -?180 degrees", finding.sentence)
    for name in ("light", "dark"):
        change(here / "meshes" / f"m-{name}.stl", lambda corners: corners * [-1, -1, 1] + [0, 0, 0.001])
    assert {finding.kind for finding in verify(marker, here / "m.urdf").findings} == {"height"}


def test_meshes_of_another_marker(here, written, marker):
    shutil.copytree(written / "other" / "meshes", here / "meshes", dirs_exist_ok=True)
    assert not verify(marker, here / "m.urdf").passed


def test_a_dot_is_missing(here, marker):
    point = marker.control_points[2]

    def without(corners):
        away = np.linalg.norm(corners.mean(axis=1)[:, :2] - [point.x, point.y], axis=-1)
        return corners[away > point.feature.diameter]

    change(here / "meshes" / "m-dark.stl", without)
    assert "dot 2" in " ".join(sentences(verify(marker, here / "m.urdf")))


def test_sites_that_are_elsewhere(here, marker):
    text = (here / "m.mjcf.xml").read_text()
    place = re.search(r'name="dot-3" class="place" pos="(\S+) ', text)[1]
    spoil(here / "m.mjcf.xml", f'pos="{place} ', f'pos="{float(place) + 0.001:.9g} ')
    spoil(here / "m.mjcf.xml", 'name="dot-4"', 'name="extra"')
    found = sentences(verify(marker, here / "m.mjcf.xml"))
    assert found == [sentence("site off", "dot-3", "1 mm"), sentence("no site", "dot-4")]


def refused(marker, path):
    with pytest.raises(InputError) as error:
        verify(marker, path)
    return str(error.value)


def test_meshes_that_are_not_there(suffix, here, marker):
    (here / "meshes" / "m-dark.stl").unlink()
    assert "meshes/m-dark.stl" in refused(marker, here / f"m{suffix}")


@pytest.mark.parametrize("name", ["/etc/passwd.stl", "../meshes/m-dark.stl", "meshes/m-dark.glb", "http://a/b.stl", ""])
def test_meshes_that_are_not_read(name, suffix, here, marker):
    spoil(here / f"m{suffix}", "meshes/m-dark.stl", name)
    assert "meshes" in refused(marker, here / f"m{suffix}")


@pytest.mark.parametrize(
    "text",
    [
        "x", "<a/>", "<a>", "<robot><link/></robot>", "<a><link/><link/></a>", "<a>" * 100_000,
        "<robot><link><visual/></link></robot>", "<sdf><link><visual/></link></sdf>",
        "<mujoco><body><geom mesh='x'/></body></mujoco>",
        "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>",
    ],
)  # fmt: skip
def test_what_is_no_model_is_refused(text, suffix, here, marker):
    (here / f"m{suffix}").write_text(text)
    assert "meshes" in refused(marker, here / f"m{suffix}")


@pytest.mark.parametrize("numbers", ["0 0", "nan 0 0", "0 1e999 0", "a b c"])
def test_places_that_are_none(numbers, suffix, here, marker):
    spoil(here / f"m{suffix}", *(each.replace("0 0.002 0", numbers) for each in SHIFT[suffix]))
    assert "meshes" in refused(marker, here / f"m{suffix}")
