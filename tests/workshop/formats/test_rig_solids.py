"""Files of rigs as solids and for simulators, read back by other programs."""

import gmsh
import mujoco
import numpy as np
import pytest
import trimesh

from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.exporters.saving import save
from markergen.maths.rotation import exponential
from markergen.model.fabrication import Fabrication
from markergen.workshop.assembly import made_of
from markergen.workshop.formats.simulators import DENSITY, roll_pitch_yaw
from markergen.workshop.formats.solids import solids_of
from tests.support.cad_parts import cad_parts
from tests.support.rigs import corner, cube, rig_of, wall

CUBE = cube(0.08)
COUNT = 1 + len(CUBE) + 6
"""Body, inlays, and the cores of six rings."""

OPTIONS = ExportOptions(fabrication=Fabrication(tolerance=5e-5), stem="cube")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("cube")
    save(CUBE, [where / f"cube{suffix}" for suffix in (".stl", ".glb", ".3mf", ".urdf", ".mjcf.xml")], OPTIONS)
    return where


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    where = tmp_path_factory.mktemp("step") / "cube.step"
    save(CUBE, [where], OPTIONS)
    return where


@pytest.mark.long
def test_the_parts_of_a_step_keep_names_colors_and_places(step):
    parts = {part.name: part for part in cad_parts(step.read_bytes())}
    assert len(parts) == COUNT
    assert sum(part.volume for part in parts.values()) == pytest.approx(80**3, rel=1e-6)
    assert parts["body"].color == pytest.approx((1, 1, 1))
    for name, xyz, normal in zip(
        (f"{marker.name}/dot-{point.id}" for marker in CUBE.markers for point in marker.marker.control_points),
        1e3 * CUBE.xyz, CUBE.normals, strict=True,
    ):  # fmt: skip
        part = parts[name]
        assert not part.flawed
        assert max(part.color) < 0.2
        # The middle of a disc 0.6 mm thick is 0.3 mm below its face.
        np.testing.assert_allclose(part.middle, xyz - 0.3 * normal, atol=1e-4)


@pytest.mark.long
def test_a_step_of_a_rig_has_the_same_bytes_every_time(step):
    solids_of.cache_clear()
    made_of.cache_clear()
    assert EXPORTERS[".step"](CUBE, OPTIONS).data == step.read_bytes()


@pytest.mark.long
def test_in_another_kernel_body_and_inlays_touch_and_fill_the_cube(step):
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        for operation in (occ.fuse, occ.intersect):
            gmsh.clear()
            occ.importShapes(str(step))
            occ.synchronize()
            solids = sorted(gmsh.model.getEntities(3), key=lambda item: -occ.getMass(*item))
            assert len(solids) == COUNT
            made, _ = operation(solids[:1], solids[1:])
            occ.synchronize()
            volume = sum(occ.getMass(*item) for item in made)
            assert volume == pytest.approx(80**3 if operation == occ.fuse else 0, rel=1e-9, abs=1e-6)
    finally:
        gmsh.finalize()


@pytest.mark.parametrize(
    ("name", "size"),
    [
        pytest.param("cube.stl", 80, marks=pytest.mark.long),
        ("cube.glb", 0.08),
        pytest.param("cube.3mf", 80, marks=pytest.mark.long),
    ],
)
def test_meshes_of_a_cube_are_closed_and_as_large_as_it_is(name, size, folder):
    mesh = trimesh.load(folder / name, force="mesh")
    assert mesh.is_watertight
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), size, rtol=1e-5)
    assert mesh.volume == pytest.approx(size**3, rel=1e-4)


def test_mujoco_has_a_frame_for_every_marker_and_a_site_on_every_dot(folder):
    model = mujoco.MjModel.from_xml_path(str(folder / "cube.mjcf.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    sites = iter(CUBE.xyz)
    for marker in CUBE.markers:
        frame = data.site(f"{marker.name}/marker")
        np.testing.assert_allclose(frame.xpos, marker.translation_vector, atol=1e-8)
        np.testing.assert_allclose(frame.xmat.reshape(3, 3), marker.rotation_matrix, atol=1e-8)
        for point in marker.marker.control_points:
            np.testing.assert_allclose(data.site(f"{marker.name}/dot-{point.id}").xpos, next(sites), atol=1e-8)
    assert model.body("rig").mass[0] == pytest.approx(DENSITY * 0.08**3, rel=1e-4)
    np.testing.assert_allclose(model.body("rig").inertia, DENSITY * 0.08**5 / 6, rtol=1e-4)
    np.testing.assert_allclose(model.geom("collision").size, 0.04)
    # It welds the link to the world.
    assert mujoco.MjModel.from_xml_path(str(folder / "cube.urdf")).nmesh == 2


@pytest.mark.long
def test_every_plate_of_a_wall_has_its_own_box_to_collide_with(tmp_path):
    rig = wall(columns=2, rows=1)
    save(rig, [tmp_path / "wall.mjcf.xml"], OPTIONS)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "wall.mjcf.xml"))
    for marker in rig.markers:
        shape = model.geom(f"{marker.name}/plate/collision")
        np.testing.assert_allclose(shape.size, [0.042, 0.042, 0.0015])
        np.testing.assert_allclose(shape.pos, marker.translation_vector - [0, 0, 0.0015], atol=1e-9)


def test_plates_that_overlap_are_only_to_look_at(tmp_path):
    rig = corner(inward=False)
    [model, *_] = save(rig, [tmp_path / "corner.glb"], OPTIONS)
    assert any("overlap by 5 mm" in note for note in model.notes)
    with pytest.raises(InputError, match="overlap by 5 mm"):
        save(rig, [tmp_path / "corner.stl"], OPTIONS)


@pytest.mark.long
@pytest.mark.parametrize("text", ["cube", "prism:6", "wall 3x2", "pair"])
def test_shapes_of_default_sizes_are_made(text, tmp_path):
    rig = rig_of(text)
    save(rig, [tmp_path / "rig.step"], ExportOptions())
    names = [part.name for part in cad_parts((tmp_path / "rig.step").read_bytes())]
    assert len(names) == len(made_of(rig, Fabrication()).parts)


@pytest.mark.parametrize("angle", [-60, 0, 60, 90, 150])
def test_thick_plates_of_a_pair_do_not_overlap(angle):
    pair = rig_of("pair", angle=angle, thickness=0.008, edge=0.006)
    assert {plate.marker.substrate.thickness for plate in pair.plates} == {0.008}
    assert not made_of(pair, Fabrication()).overlap


@pytest.mark.parametrize("seed", range(5))
def test_roll_pitch_and_yaw_make_the_rotation(seed):
    rotation = (
        exponential(np.random.default_rng(seed).normal(size=3))
        if seed
        else np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    )
    made = [exponential(angle * axis) for angle, axis in zip(roll_pitch_yaw(rotation), np.eye(3), strict=True)]
    np.testing.assert_allclose(made[2] @ made[1] @ made[0], rotation, atol=1e-12)
