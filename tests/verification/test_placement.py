"""Files of rigs, right and damaged: what is wrong is named."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from sentences import pattern, sentence

import markergen as mg
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.maths.rotation import exponential
from markergen.model.fabrication import Fabrication
from markergen.model.rig import Rig
from tests.support.rigs import cube, mounted, rig_of, wall

CUBE = cube(0.08)
WALL = wall(columns=2, rows=1)
COARSE = ExportOptions(fabrication=Fabrication(tolerance=5e-5, engrave=False))


def written(rig, folder, *suffixes, options=COARSE):
    save(rig, [folder / f"rig{suffix}" for suffix in suffixes], options)
    return [folder / f"rig{suffix}" for suffix in suffixes]


def said_of(rig, path):
    [check] = mg.verify(rig, path)
    assert not check.error, check.error
    return [finding.sentence for finding in check.findings]


def moved(rig, k, about=(0, 0, 0), translation=(0, 0, 0)):
    """The rig with one marker turned by a rotation vector and shifted, in its own frame."""
    plate, rotation = rig.markers[k], exponential(np.array(about, float))
    place = replace(
        plate,
        rotation=(plate.rotation_matrix @ rotation).tolist(),
        translation=tuple(plate.to_body(np.array(translation, float))),
    )
    return replace(rig, markers=tuple(place if j == k else other for j, other in enumerate(rig.markers)))


@pytest.mark.long
@pytest.mark.parametrize("process", ["fdm", "laser"])
def test_what_is_written_is_right(process, tmp_path):
    options = ExportOptions(fabrication=Fabrication(process=process, tolerance=5e-5, engrave=False))
    suffixes = (".step", ".brep", ".stl", ".3mf", ".glb", ".urdf", ".sdf", ".mjcf.xml")
    checks = mg.verify(CUBE, *written(CUBE, tmp_path, *suffixes, options=options))
    for check in checks:
        assert check.passed, (check.path, check.findings, check.error)
        assert check.dots == len(CUBE)
        assert check.largest < 1e-7
        assert check.worst is None or re.fullmatch(r"plate \d/\d", str(check.worst)) or ".mjcf" in check.path


def test_one_body_is_right(tmp_path):
    [check] = mg.verify(CUBE, *written(CUBE, tmp_path, ".glb"))
    assert check.passed, check.findings
    assert check.dots == len(CUBE)


@pytest.mark.long
def test_a_wall_is_right_too(tmp_path):
    for check in mg.verify(WALL, *written(WALL, tmp_path, ".stl", ".glb")):
        assert check.passed, check.findings
        assert check.dots == len(WALL)


@pytest.mark.long
@pytest.mark.parametrize("process", ["cnc", "dome"])
def test_other_processes_are_right(process, tmp_path):
    options = ExportOptions(fabrication=Fabrication(process=process))
    for check in mg.verify(CUBE, *written(CUBE, tmp_path, ".step", ".glb", options=options)):
        assert check.passed, (check.path, check.findings)


def test_plates_with_recesses_for_prints_are_compared_as_they_are(tmp_path):
    pair, options = wall(columns=2, rows=1), ExportOptions(fabrication=Fabrication(process="print", engrave=False))
    [path] = written(pair, tmp_path, ".stl", options=options)
    [check] = mg.verify(pair, path)
    assert check.passed, check.findings
    assert check.notes
    [finding] = said_of(moved(pair, 1, translation=[0.001, 0, 0]), path)
    assert "belongs to no plate" in finding


@pytest.mark.long
def test_a_moved_plate_is_named(tmp_path):
    [path] = written(WALL, tmp_path, ".stl")
    [finding] = said_of(moved(WALL, 1, translation=[0.001, 0, 0.002]), path)
    # One of two plates: either may be the one that moved.
    assert re.search(pattern("plate off", "[01]", r"2\.236 mm", "x [+-]1 mm and z [+-]2 mm"), finding)


@pytest.mark.long
def test_a_turned_face_is_named(tmp_path):
    [path] = written(CUBE, tmp_path, ".stl")
    assert said_of(moved(CUBE, 3, [0, 0, np.pi / 2]), path) == [sentence("plate turned", 3, 90, "-z")]


@pytest.mark.long
def test_a_tilted_plate_is_named(tmp_path):
    three = wall(columns=3, rows=1)
    [path] = written(moved(three, 1, [np.radians(3), 0, 0]), tmp_path, ".stl")
    [finding] = said_of(three, path)
    assert re.fullmatch(pattern("plate turned", 1, r"(2\.99\d|3)", "x"), finding)


@pytest.mark.long
def test_two_swapped_faces_are_named(tmp_path):
    [path] = written(CUBE, tmp_path, ".stl")
    markers = [plate.marker for plate in CUBE.markers]
    markers[0], markers[5] = markers[5], markers[0]
    places = [(plate.rotation_matrix, plate.translation_vector) for plate in CUBE.markers]
    assert said_of(mounted(markers, *zip(*places, strict=True)), path) == [sentence("plates swapped", 0, 5)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("factor", "phrase"),
    [
        (1 / 25.4, "inch taken for mm"),
        (1000, "mm taken for m"),
        (0.97, sentence("scaled", "0.97 along x and y")),
    ],
)
def test_a_wrong_scale_is_named(factor, phrase, tmp_path):
    [path] = written(CUBE, tmp_path, ".stl")
    mesh = trimesh.load(path)
    mesh.apply_scale(factor)
    mesh.export(path)
    [finding] = said_of(CUBE, path)
    assert phrase in finding


@pytest.mark.long
def test_a_mirrored_rig_is_named(tmp_path):
    [path] = written(CUBE, tmp_path, ".stl")
    mesh = trimesh.load(path)
    mesh.apply_transform(np.diag([-1, 1, 1, 1]))
    mesh.export(path)
    assert said_of(CUBE, path) == ["mirrored"]


@pytest.mark.long
def test_a_turned_file_is_told_and_in_a_model_an_error(tmp_path):
    path, model = written(CUBE, tmp_path, ".stl", ".mjcf.xml")
    motion = np.eye(4)
    motion[:3, :3] = exponential(np.array([0.3, -0.4, 0.5]))
    for file in (path, *(tmp_path / "meshes").iterdir()):
        mesh = trimesh.load(file)
        mesh.apply_transform(motion)
        mesh.export(file)
    [check] = mg.verify(CUBE, path)
    assert check.passed, check.findings
    assert "turned by 40.51 degrees" in check.notes[0]
    assert any("is not the mesh" in finding for finding in said_of(CUBE, model))


@pytest.mark.long
def test_a_missing_face_is_named(tmp_path):
    three = Rig(wall(columns=3, rows=1).markers[:2])
    [path] = written(three, tmp_path, ".stl")
    assert said_of(wall(columns=3, rows=1), path) == [sentence("plate missing", 2, 6)]


@pytest.mark.long
def test_another_rig_is_named(tmp_path):
    [path] = written(cube(0.08, seed=20), tmp_path, ".glb")
    assert said_of(CUBE, path) == [sentence("no plate")]


def test_a_table_is_no_file_of_a_rig(tmp_path):
    (tmp_path / "a.csv").write_text("id,x_m,y_m\n0,0,0\n")
    [check] = mg.verify(CUBE, tmp_path / "a.csv")
    assert "a.csv" in check.error or "of a rig" in check.error


@pytest.mark.long
def test_every_marker_is_found_on_its_page(tmp_path):
    markers = [plate.marker for plate in CUBE.markers]
    save(markers, [tmp_path / "all.pdf"])
    [check] = mg.verify(CUBE, tmp_path / "all.pdf")
    assert check.passed, check.findings
    assert check.dots == len(CUBE)
    save(markers[:-1], [tmp_path / "some.pdf"])
    assert said_of(CUBE, tmp_path / "some.pdf") == [sentence("plate unprinted", 5)]
    [path] = [tmp_path / "all.json"]
    assert mg.verify(CUBE, tmp_path / "all.pdf", json=path).written
    assert re.fullmatch(r"plate \d/\d", json.loads(path.read_text())[0]["worst_dot"])


@pytest.mark.long
def test_plates_that_differ_in_their_outlines_alone_are_on_pages_of_their_own(tmp_path):
    prism = rig_of("prism:8", edge=0.05, height=0.05)
    assert not said_of(prism, *written(prism, tmp_path, ".pdf"))


@pytest.mark.parametrize(
    ("rig", "name", "offset"),
    [
        pytest.param(CUBE, "on the face", 1.0, id="on a block"),
        pytest.param(WALL, "inside", -20.0, id="behind plates"),
        pytest.param(CUBE, "inside", -20.0, id="inside a block", marks=pytest.mark.long),
        pytest.param(WALL, "on the face", 1.0, id="on a plate", marks=pytest.mark.long),
    ],
)
def test_what_belongs_to_no_plate_is_extra(rig, tmp_path, name, offset):
    (path,) = written(rig, tmp_path, ".stl")
    mesh = trimesh.load(path)
    face = rig.markers[0]
    # In a corner of the first marker's face, above it or below.
    corner = np.array([*(face.marker.boundary.outlines()[0].max(axis=0) - 0.004), offset * 1e-3])
    block = trimesh.creation.box(np.full(3, 1.5))
    block.apply_translation(1e3 * face.to_body(corner[None])[0])
    trimesh.util.concatenate([mesh, block]).export(path)
    [check] = mg.verify(rig, path)
    assert [finding.kind for finding in check.findings] == ["extra"], (name, check.findings)
