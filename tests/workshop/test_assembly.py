"""Rigs as solids: blocks closed by their faces, and assemblies of plates."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import pattern, sentence
from tetrahedra import mesh_volume

from markergen.errors import InputError
from markergen.model.fabrication import Fabrication
from markergen.model.marker import build_marker
from markergen.model.substrate import Substrate
from markergen.objectives.criteria import regular_polygon
from markergen.workshop.assembly import BODY, block_of, check_no_overlap, made_of, volume_of
from markergen.workshop.mesh import is_closed, meshes_of
from markergen.workshop.processes import parts_of
from tests.support.rigs import corner, cube, mounted, plate, rectangle, rig_of, wall

FDM = Fabrication()
EIGHT = Substrate(thickness=0.008)


def prism(sides=6, width=0.06, height=0.1):
    """Plates on the sides of a prism about the y axis, whose two ends are bare."""
    turns = []
    for angle in 2 * np.pi * np.arange(sides) / sides:
        out, up = np.array([np.sin(angle), 0, np.cos(angle)]), np.array([0, 1.0, 0])
        turns.append(np.stack([np.cross(up, out), up, out], axis=1))
    distance = width / 2 / np.tan(np.pi / sides)
    return mounted(
        [plate(k, width, height) for k in range(sides)], turns, [distance * rotation[:, 2] for rotation in turns]
    )


@pytest.mark.parametrize("process", ["fdm", pytest.param("cnc", marks=pytest.mark.long), "laser"])
def test_body_and_inlays_of_a_cube_fill_it(process):
    made = made_of(cube(0.08), Fabrication(process=process, gap=0.0 if process == "cnc" else None))
    body, *inlays = made.parts
    assert body.name == BODY
    engraved = sum(item.volume for part in body.pieces for item in part.part.marked)
    assert sum(part.volume for part in made.parts) + engraved == pytest.approx(80**3, rel=1e-12)
    assert len(made.block) == 6
    assert {part.material for part in inlays} <= {"dark", "light"}
    mesh = meshes_of((body,), 0.005)[0]
    assert is_closed(mesh.triangles)
    np.testing.assert_allclose([mesh.points.min(axis=0), mesh.points.max(axis=0)], [[-40] * 3, [40] * 3], atol=1e-4)
    # Pockets of 144 chords are smaller by 0.03 %.
    assert mesh_volume(mesh) == pytest.approx(body.volume, rel=1e-3 * (80**3 - body.volume) / body.volume + 1e-9)
    assert mesh.marked.any() == bool(engraved)


def test_inlays_lie_flush_in_the_faces_of_a_cube():
    rig = cube(0.08)
    made = made_of(rig, FDM)
    meshes = meshes_of(made.parts, 0.005)
    seen = 0
    for marker in rig.markers:
        for point in marker.marker.control_points:
            [mesh] = [
                m for m, part in zip(meshes, made.parts, strict=True) if part.name == f"{marker.name}/dot-{point.id}"
            ]
            local = marker.to_marker(mesh.points / 1e3)
            low, high = local.min(axis=0), local.max(axis=0)
            np.testing.assert_allclose((low + high)[:2] / 2, [point.x, point.y], atol=2e-7)
            np.testing.assert_allclose([low[2], high[2]], [-0.0006, 0], atol=2e-7)
            seen += 1
    assert seen == len(rig)


def test_the_open_ends_of_a_prism_are_closed():
    made = made_of(prism(), FDM)
    assert [face.name for face in made.block[-2:]] == ["face-1", "face-2"]
    area = 3 * np.sqrt(3) / 2 * 60**2
    assert volume_of(made.block) == pytest.approx(area * 100, rel=1e-9)
    assert sum(part.volume for part in made.parts) == pytest.approx(area * 100, rel=1e-9)
    meshes = meshes_of(made.parts, 0.005)
    assert sum(map(mesh_volume, meshes)) == pytest.approx(area * 100, rel=1e-6)


def test_balls_lower_the_faces_of_a_block():
    square = build_marker(regular_polygon(4, 0.02), rectangle(0.08, 0.08), diameter=0.006, clearance=0.0006)
    whole, balls = cube(0.08), Fabrication(process="dome", dome="ball")
    turns, places = zip(*((marker.rotation_matrix, marker.translation_vector) for marker in whole.markers), strict=True)
    made = made_of(mounted([square] * 6, turns, places), balls)
    low = made.block[0].height
    assert low < 0
    assert volume_of(made.block) == pytest.approx((80 + 2 * low) ** 3, rel=1e-12)
    assert is_closed(meshes_of(made.parts[:1], 0.02)[0].triangles)
    with pytest.raises(InputError, match="balls lower it"):
        made_of(whole, balls)


def test_a_wall_is_an_assembly_of_the_plates_of_its_markers():
    rig = wall(columns=2, rows=1)
    made = made_of(rig, FDM)
    assert not block_of(rig)
    names = [part.name for part in made.parts]
    assert names[0] == "plate 0/plate"
    meshes = dict(zip(names, meshes_of(made.parts, 0.005), strict=True))
    for marker in rig.markers:
        for part in parts_of(marker.marker, FDM).parts:
            [alone], placed = meshes_of((part,), 0.005), meshes[f"{marker.name}/{part.name}"]
            np.testing.assert_allclose(
                placed.points.min(axis=0) / 1e3, marker.to_body(alone.points / 1e3).min(axis=0), atol=1e-6
            )
            assert mesh_volume(placed) == pytest.approx(mesh_volume(alone), rel=1e-5)


def test_faces_that_do_not_close_a_body_are_no_block():
    assert block_of(cube())
    assert not block_of(mounted(*three_faces_of_a_cube()))
    parallel = mounted([plate(0), plate(1)], [np.eye(3)] * 2, [[0, 0, 0], [0.08, 0, 0]])
    assert not block_of(parallel)


def three_faces_of_a_cube():
    whole = cube()
    chosen = whole.markers[::2]
    return (
        [item.marker for item in chosen],
        [item.rotation_matrix for item in chosen],
        [item.translation_vector for item in chosen],
    )


def test_plates_that_overlap_are_refused():
    rig = mounted(*three_faces_of_a_cube())
    made = made_of(rig, FDM)
    assert made.overlap == sentence("overlap", "plate 0 and plate 1", "5 mm")
    with pytest.raises(InputError, match=pattern("overlap", "plate 0 and plate 1", "5 mm")):
        check_no_overlap(made, rig)
    assert "overlap by 5 mm" in made_of(corner(inward=False), FDM).overlap


def test_the_remedy_for_thicker_plates_of_a_pair_is_one_that_works():
    thin = replace(rig_of("pair", plate=0.06), provenance={"shape": "pair"})
    thick = replace(thin, markers=tuple(replace(p, marker=replace_plate(p.marker, EIGHT)) for p in thin.markers))
    with pytest.raises(InputError, match="design the pair with --thickness 8mm --edge 2mm,"):
        check_no_overlap(made_of(thick, FDM), thick)
    again = rig_of("pair", plate=0.06, thickness=0.008, edge=0.002)
    check_no_overlap(made_of(again, FDM), again)


def test_plates_side_by_side_do_not_overlap():
    turns = [np.eye(3)] * 2
    rig = mounted([plate(0), plate(1)], turns, [[0, 0, 0], [0.084, 0, 0]])
    check_no_overlap(made_of(rig, FDM), rig)
    made = made_of(mounted([plate(0), plate(1)], turns, [[0, 0, 0], [0.08399, 0, 0]]), FDM)
    assert made.overlap.endswith("overlap by 0.01 mm")


def test_inlays_that_meet_inside_of_a_block_are_refused():
    rig = cube(0.08)
    thick = [replace_plate(marker.marker, Substrate(thickness=0.03)) for marker in rig.markers]
    rig = mounted(
        thick, [marker.rotation_matrix for marker in rig.markers], [marker.translation_vector for marker in rig.markers]
    )
    made_of(rig, Fabrication(depth=0.001))
    with pytest.raises(InputError, match="do not meet"):
        made_of(rig, Fabrication(depth=0.02))


def replace_plate(marker, substrate):
    return replace(marker, substrate=substrate)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"process": "print"}, "--process"),
        ({"process": "cnc", "through": True}, "another --process"),
    ],
)
def test_what_a_block_cannot_have_is_refused(options, message):
    with pytest.raises(InputError, match=message) as error:
        made_of(cube(), Fabrication(**options))
    assert "plate 0" in str(error.value)


def test_a_block_has_no_chamfer():
    rig = cube()
    cut = [replace_plate(marker.marker, Substrate(chamfer=0.001)) for marker in rig.markers]
    with pytest.raises(InputError, match="as one block"):
        made_of(
            mounted(
                cut,
                [marker.rotation_matrix for marker in rig.markers],
                [marker.translation_vector for marker in rig.markers],
            ),
            FDM,
        )
