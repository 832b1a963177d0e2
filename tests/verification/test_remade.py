"""Files that only markergen writes: what passes, and what each damage is called."""

import contextlib
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence
from spoiled_solids import stl, triangles

import markergen as mg
from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.tag import Tag
from markergen.verification.check import verify
from markergen.verification.reading import Settings
from markergen.verification.remade import _text

MODELS = (".urdf", ".sdf", ".mjcf.xml")
LISTS = (".csv", ".json", ".detector.json", ".opencv.yaml", ".ros2.yaml", ".kalibr.yaml", ".apriltag.yaml")


@pytest.fixture(scope="module")
def marker(make_ngon):
    return replace(make_ngon(5, 0.06, 0.012), tag=Tag("apriltag:36h11", 3, 0.03, (0.004, -0.002)))


@pytest.fixture(scope="module")
def written(marker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("written")
    paths = [folder / f"m{suffix}" for suffix in (*LISTS, *MODELS)]
    save(marker, paths, ExportOptions(fabrication=Fabrication("cnc", engrave=False)))
    return folder


@pytest.fixture
def here(written, tmp_path):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    return tmp_path


def spoil(path, old, new, count=-1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))
    return path


def kinds(check):
    return {finding.kind for finding in check.findings}


def sentences(check):
    return " ".join(finding.sentence for finding in check.findings)


@pytest.mark.parametrize("suffix", [*LISTS, *MODELS])
def test_what_was_written_passes(suffix, written, marker):
    check = verify(marker, written / f"m{suffix}")
    assert check.passed
    assert check.dots == (0 if suffix == ".apriltag.yaml" else 5)
    assert check.largest == 0
    assert check.notes == ((sentence("tag alone"),) if suffix == ".apriltag.yaml" else ())


DAMAGES = [
    (".csv", "ring", "dot", "kind"),
    (".csv", "x_m", "y_m", None),
    (".csv", "\n1,", "\n0,", "twice missing"),
    (".json", '"kind": "ring"', '"kind": "dot"', "kind"),
    (".json", '"id": 3,\n    "side"', '"id": 4,\n    "side"', "tag"),
    (".opencv.yaml", "tag_dictionary: ", "tag_dictionary: 1", "tag"),
    (".opencv.yaml", 'unit: "m"', 'unit: "mm"', "value"),
    (".opencv.yaml", 'unit: "m"', 'unit: "m"\nids: 3', "twice"),
    (".opencv.yaml", "rows: 5", "rows: 4", "twice extra"),
    (".opencv.yaml", "dt: d", "dt: i", "shifted"),
    (".ros2.yaml", "w: 1.0", "w: 0.0", "value"),
    (".ros2.yaml", "translation: {x: 0.0", "translation: {x: .nan", "value"),
    (".kalibr.yaml", "x: 0.0", "x: false", "shifted"),
    (".ros2.yaml", "size: 0.03", "size: 0.3", "tag"),
    (".ros2.yaml", "child_frame_id: ", "child_frame_id: x", "value"),
    (".kalibr.yaml", "target_type: custom", "target_type: aprilgrid\ntagRows: 6", "value extra"),
    (".kalibr.yaml", "unit: m", "unit: mm", "value"),
    (".kalibr.yaml", "diameter: 0.012", "diameter: 0.12", "diameter"),
    (".apriltag.yaml", "id: 3", "id: 4", "missing extra"),
    (".apriltag.yaml", "size: 0.03", "size: 0.0301", "tag"),
    (".apriltag.yaml", "x: 0.004", "x: 0.0045", "tag"),
    (".apriltag.yaml", "qw: 0.0", "qw: 1.0", "tag"),
    (".apriltag.yaml", "x: 0.004", "x: .nan", "tag"),
    (".apriltag.yaml", "'tag36h11'", "'tag25h9'", "tag"),
    (".apriltag.yaml", "layout:\n", "layout:\n  - {id: 7, size: 1, x: 0}\n", "extra"),
    (".detector.json", '"print_sigma": ', '"print_sigma": 1', "value"),
    (".urdf", '<mass value="', '<mass value="-', "value"),
    (".urdf", 'rgba="0.05 0.05 0.05 1"', 'rgba="0.05 0.05 0.05 0"', "color"),
    (".urdf", 'rgba="0.05 0.05 0.05 1"', 'rgba="1 1 1 1"', "color"),
    (".urdf", "</robot>", '<link name="base"/></robot>', "extra"),
    (".urdf", "</robot>", "<gazebo><static>1</static></gazebo></robot>", "extra"),
    (".urdf", '.stl"', '.stl" scale="0.001 0.001 0.001"', "extra"),
    (".urdf", 'rpy="0 0 0"/>\n      <!--', 'rpy="0 0 3.14159"/>\n      <!--', "value"),
    (".urdf", '<material name="dark">', '<material name="dark"><texture filename="a.png"/>', "extra"),
    (".sdf", "</material>", "<emissive>1 1 1 1</emissive></material>", "extra"),
    (".sdf", "<link name", "<pose>0 0 0 0 0 1</pose><link name", "extra"),
    (".sdf", '<visual name="dark">', '<visual name="dark"><transparency>1</transparency>', "extra"),
    (".sdf", "<static>true", "<static>false", "value"),
    (".sdf", "<pose>0 0 0 0 0 0</pose>", '<pose degrees="true">0 0 0 0 0 180</pose>', "value extra"),
    (".sdf", "</uri>", "</uri><scale>0.001 0.001 0.001</scale>", "extra"),
    (".sdf", "<ixx>", "<ixx>1", "value"),
    (".sdf", "<inertial>", '<inertial auto="true">', "extra"),
    (".sdf", "</inertial>", "<fluid_added_mass><xx>9</xx></fluid_added_mass></inertial>", "extra"),
    (".sdf", "</material>", "<lighting>false</lighting></material>", "extra"),
    (".sdf", "<mesh>", '<mesh optimization="convex_hull">', "extra"),
    (".sdf", "</visual>", "<meta><layer>-1</layer></meta></visual>", "extra"),
    (".mjcf.xml", 'material="dark"', 'material="dark" rgba="1 1 1 1"', "extra"),
    (".mjcf.xml", 'name="dot-4"', 'name="dot-9"', "missing extra"),
    (".mjcf.xml", '<mesh name="light"', '<mesh scale="1000 1000 1000" name="light"', "extra"),
    (".mjcf.xml", '<body name="marker">', '<body name="marker" euler="0 0 90">', "extra"),
    (".mjcf.xml", "<inertial", "<freejoint/><inertial", "extra"),
    (".mjcf.xml", 'group="2"', 'group="5"', "value"),
    (".mjcf.xml", "</worldbody>", '<geom type="plane" size="1 1 1"/></worldbody>', "extra"),
    (".mjcf.xml", 'group="4"', 'group="0"', "value"),
]


@pytest.mark.parametrize(("suffix", "old", "new", "expected"), DAMAGES)
def test_each_damage_is_called_what_it_is(suffix, old, new, expected, here, marker):
    if expected is None:
        with pytest.raises((InputError, AssertionError)):
            verify(marker, spoil(here / f"m{suffix}", old, new, 1))
        return
    check = verify(marker, spoil(here / f"m{suffix}", old, new, 1 if suffix != ".urdf" else -1))
    assert kinds(check) == set(expected.split())


@pytest.mark.parametrize("suffix", [".csv", ".ros2.yaml", ".kalibr.yaml", ".opencv.yaml"])
def test_a_list_in_mm_is_scaled(suffix, here, marker):
    grown = replace(
        marker, tag=None, control_points=tuple(replace(p, x=1e3 * p.x, y=1e3 * p.y) for p in marker.control_points)
    )
    save(grown, [here / f"m{suffix}"])
    check = verify(replace(marker, tag=None), here / f"m{suffix}")
    assert not check.passed
    assert {"scaled", "shifted"} & kinds(check)


@pytest.mark.parametrize("suffix", [".csv", ".json", ".detector.json", ".ros2.yaml", ".kalibr.yaml", ".opencv.yaml"])
@pytest.mark.parametrize(
    ("axes", "phrase"),
    [("z", "mirrored through its plane: all heights have"), ("x", "mirrored: x of every dot has"), ("yz", "")],
)
def test_a_list_with_opposite_signs_along_one_axis_is_mirrored(suffix, axes, phrase, here, marker):
    points = tuple(replace(p, z=0.002 * k) for k, p in enumerate(marker.control_points))
    opposite = tuple(replace(p, **{axis: -getattr(p, axis) for axis in axes}) for p in points)
    relief = replace(marker, tag=None, control_points=points)
    save(replace(relief, control_points=opposite), [here / f"m{suffix}"])
    findings = verify(relief, here / f"m{suffix}").findings
    if phrase:
        [finding] = findings
        assert finding.kind == "mirrored"
        assert finding.sentence.startswith(phrase)
    else:
        assert not any(finding.kind == "mirrored" for finding in findings)


def test_order_digits_and_formatting_do_not_count(here, marker):
    lines = (here / "m.csv").read_text().splitlines()
    rows = [line for line in lines if not line.startswith("#")]
    (here / "m.csv").write_text("\r\n".join([rows[0], *reversed(rows[1:])]).replace(",", ";"))
    spoil(here / "m.apriltag.yaml", "qz: 1.0", "qz: -1.0")
    content = json.loads((here / "m.json").read_text())
    content["control_points"].reverse()
    (here / "m.json").write_text(json.dumps(content, sort_keys=True))
    spoil(here / "m.sdf", "<uri>", "<uri>model://marker/")
    spoil(here / "m.urdf", 'filename="', 'filename="package://somewhere/')
    spoil(here / "m.mjcf.xml", "<default>", '<compiler meshdir="meshes" angle="radian"/><default>', 1)
    spoil(here / "m.mjcf.xml", "meshes/", "")
    for suffix in (".csv", ".apriltag.yaml", ".json", *MODELS):
        assert verify(marker, here / f"m{suffix}").passed, suffix


def test_opencv_writes_it_again(here, marker):
    """Its own writer has other digits, line breaks and types than ours."""
    import cv2

    source = cv2.FileStorage(str(here / "m.opencv.yaml"), cv2.FILE_STORAGE_READ)
    target = cv2.FileStorage(str(here / "again.opencv.yaml"), cv2.FILE_STORAGE_WRITE)
    for key in list(source.root().keys()):
        node = source.getNode(key)
        if node.isString():
            target.write(key, node.string())
        elif node.isMap():
            target.write(key, node.mat())
        else:
            target.write(key, int(node.real()))
    source.release()
    target.release()
    assert verify(marker, here / "again.opencv.yaml").passed


@pytest.mark.parametrize(
    ("suffix", "old", "new"),
    [
        (".ros2.yaml", "frame_id: map", "frame_id: world"),
        (".kalibr.yaml", "target_type", "author: me\ntarget_type"),
        (".csv", "# Unit: m.", "# Unit: mm."),
        (".urdf", "</robot>", "<maintainer>me</maintainer></robot>"),
        (".sdf", "<static>", "<!-- mine --><static>"),
        (".json", '"clearance"', '"mine": 1, "clearance"'),
    ],
)
def test_unknown_keys_comments_and_the_place_in_the_map_are_listed(suffix, old, new, here, marker):
    check = verify(marker, spoil(here / f"m{suffix}", old, new, 1))
    assert check.passed
    assert len(check.notes) == 1


def test_a_tag_of_the_printer_and_of_no_marker(here, marker):
    printed = replace(marker, print_scale=(1.01, 1.03))
    save(printed, [here / "p.apriltag.yaml"])
    assert verify(printed, here / "p.apriltag.yaml").passed
    assert not verify(marker, here / "p.apriltag.yaml").passed
    with pytest.raises(InputError, match="AprilTag"):
        verify(replace(marker, tag=None), here / "m.apriltag.yaml")


# --- Models for simulators --------------------------------------------------------------------------------------------


def test_models_record_their_options(here, marker):
    assert 'markergen export {"process": "cnc", "engrave": false}' in (here / "m.urdf").read_text()
    save(marker, [here / "plain.urdf"])
    assert "markergen export" not in (here / "plain.urdf").read_text()
    assert verify(marker, here / "plain.urdf").passed


@pytest.mark.parametrize("suffix", MODELS)
def test_without_a_record_the_options_asked_for_are_tried(suffix, here, marker):
    path = here / f"m{suffix}"
    path.write_text(re.sub(r"<!-- markergen export .*-->\n", "", path.read_text()))
    check = verify(marker, path)
    assert not check.passed
    assert any("--process" in note for note in check.notes)
    assert verify(marker, path, Settings(fabrication=Fabrication("cnc", engrave=False))).passed
    [check] = mg.verify(marker, path, process="cnc", engrave=False)
    assert check.passed


@pytest.mark.parametrize("record", ["3", "{", '{"process": "gold"}', '{"a": 1}', '{"substrate": 3}'])
def test_a_record_that_says_nothing_is_refused(record, here, marker):
    spoil(here / "m.urdf", '{"process": "cnc", "engrave": false}', record)
    with pytest.raises(InputError):
        verify(marker, here / "m.urdf")


def test_a_thicker_plate_is_a_remark_and_another_one_is_not(here, marker):
    mg.export(marker, here / "t.urdf", thickness="5mm", engrave=False)
    check = verify(marker, here / "t.urdf")
    assert check.passed
    assert sentence("plate thickness", "5 mm", "3 mm") in check.notes
    mg.export(marker, here / "h.urdf", mount=["M3:0mm,-50mm"], engrave=False)
    assert kinds(verify(marker, here / "h.urdf")) == {"outline"}
    [check] = mg.verify(marker, here / "h.urdf", mount=["M3:0mm,-50mm"])
    assert check.passed


def change(path, motion):
    path.write_bytes(stl(motion(triangles(path.read_bytes()))))


@pytest.mark.parametrize(
    "motion",
    [
        lambda corners: corners + [0.001, 0, 0],
        lambda corners: corners * [-1, -1, 1],
        lambda corners: corners * 1000,
        lambda corners: corners[:-20],
        lambda corners: corners[:, ::-1],
    ],
)  # fmt: skip
def test_meshes_that_are_others(motion, here, marker):
    change(here / "meshes" / "m-dark.stl", motion)
    assert all(kinds(verify(marker, here / f"m{suffix}")) == {"mesh"} for suffix in MODELS)


@pytest.mark.parametrize(("axis", "signs"), [("x", [-1, 1, 1]), ("z", [1, 1, -1])])
def test_a_mirrored_mesh_is_named(axis, signs, here, marker):
    change(here / "meshes" / "m-dark.stl", lambda corners: corners[:, ::-1] * signs)
    [finding] = verify(marker, here / "m.urdf").findings
    assert finding.sentence == f"meshes/m-dark.stl is not the mesh of the marker: it is mirrored along {axis}"


def test_a_mesh_in_another_order_is_the_same(here, marker):
    order = np.random.default_rng(0)
    change(here / "meshes" / "m-dark.stl", lambda corners: np.roll(order.permutation(corners), 1, axis=1))
    assert verify(marker, here / "m.urdf").passed


@pytest.mark.parametrize("suffix", MODELS)
@pytest.mark.parametrize("name", ["/etc/passwd.stl", "../meshes/m-dark.stl", "meshes/m-dark.glb", "http://a/b.stl", ""])
def test_meshes_that_are_not_read(name, suffix, here, marker):
    spoil(here / f"m{suffix}", "meshes/m-dark.stl", name)
    with pytest.raises(InputError, match="meshes"):
        verify(marker, here / f"m{suffix}")


@pytest.mark.parametrize("suffix", MODELS)
def test_meshes_that_are_not_there(suffix, here, marker):
    (here / "meshes" / "m-dark.stl").unlink()
    with pytest.raises(InputError, match="meshes/m-dark"):
        verify(marker, here / f"m{suffix}")


@pytest.mark.parametrize("suffix", [*LISTS, *MODELS])
@pytest.mark.parametrize(
    "text",
    [
        "x", "[", "", "<a/>", "<a>", "<robot><link/></robot>", "<a>" * 100_000, "a: &a [*a]", '{"a": 1}', "a,b\n1,2",
        "<robot><link><visual/></link></robot>", "<sdf><link><visual/></link></sdf>",
        "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "tag_bundles: [{layout: [{id: x}]}]",
    ],
)  # fmt: skip
def test_what_is_none_does_not_pass(text, suffix, here, marker):
    (here / f"m{suffix}").write_text(text)
    with contextlib.suppress(InputError):
        assert not verify(marker, here / f"m{suffix}").passed


def test_numbers_are_shown_without_rounding_errors():
    assert _text([0.15000000000000002, -0.0, "x"]) == "'0.15 0 x'"
