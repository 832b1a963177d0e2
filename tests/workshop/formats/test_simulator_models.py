"""URDF, SDF and MJCF, loaded by yourdfpy and MuJoCo: one rigid body in the marker frame, dots up, in true colors."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

from markergen.exporters import EXPORTERS, ExportOptions, Output
from markergen.model.boundary import polygon_from
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Substrate
from markergen.workshop.formats.simulators import MOST_TRIANGLES, _shown

OPTIONS = ExportOptions(fabrication=Fabrication("cnc", engrave=False), stem="left & right")
RADIUS = 0.0648
"""Of the plate in m: that of the dots' centers, and a dot's diameter for its quiet zone."""
THICKNESS = 0.003
MESHES = ["meshes/left & right-light.stl", "meshes/left & right-dark.stl"]
CLOSE = 5e-6
"""Distance in m of a mesh from the solid, the default of --tolerance."""

Seen = dict[str, np.ndarray]
"""Corners (m, 3, 3) in m of the triangles of each color in the frame of the link: `light` and `dark`."""


@pytest.fixture(scope="module")
def marker(make_ngon) -> Marker:
    return make_ngon(4, 0.06, 0.012)


@pytest.fixture(scope="module")
def engraved(marker) -> Marker:
    """One that is engraved by a laser, with a plate of another shape than its boundary."""
    square = polygon_from([np.array([[-0.07, -0.07], [0.07, -0.07], [0.07, 0.07], [-0.07, 0.07]])])
    return replace(marker, substrate=Substrate(outline=square))


def outputs_of(marker: Marker, options: ExportOptions) -> dict[str, Output]:
    return {suffix: EXPORTERS[suffix]([marker], options) for suffix in (".urdf", ".sdf", ".mjcf.xml")}


@pytest.fixture(scope="module")
def outputs(marker) -> dict[str, Output]:
    return outputs_of(marker, OPTIONS)


def written(outputs: dict[str, Output], folder: Path) -> Path:
    (folder / "meshes").mkdir()
    for suffix, output in outputs.items():
        (folder / f"left & right{suffix}").write_bytes(output.data)
        for name, data in output.beside.items():
            (folder / name).write_bytes(data)
    return folder


@pytest.fixture(scope="module")
def folder(outputs, tmp_path_factory) -> Path:
    return written(outputs, tmp_path_factory.mktemp("models"))


@pytest.fixture(scope="module")
def engraved_folder(engraved, tmp_path_factory) -> Path:
    options = replace(OPTIONS, fabrication=Fabrication("laser", engrave=False))
    return written(outputs_of(engraved, options), tmp_path_factory.mktemp("engraved"))


def by_yourdfpy(folder: Path) -> Seen:
    robot = yourdfpy.URDF.load(str(folder / "left & right.urdf"))
    seen = {}
    for node in robot.scene.graph.nodes_geometry:
        transform, name = robot.scene.graph.get(node, robot.base_link)
        mesh = robot.scene.geometry[name]
        grey = mesh.visual.main_color[0]
        corners = trimesh.transform_points(mesh.vertices, transform)[mesh.faces]
        seen["light" if grey == 255 else "dark"] = corners
        assert grey in (255, 12)
    return seen


def by_mujoco(folder: Path, suffix: str) -> Seen:
    model = mujoco.MjModel.from_xml_path(str(folder / f"left & right{suffix}"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    seen = {}
    for index in range(model.ngeom):
        if model.geom_type[index] != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        assert not model.geom_contype[index]
        mesh = model.mesh(model.geom_dataid[index])
        rotation, offset = data.geom_xmat[index].reshape(3, 3), data.geom_xpos[index]
        points = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]] @ rotation.T + offset
        faces = model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
        material = model.geom_matid[index]
        color = model.geom_rgba[index] if material < 0 else model.mat_rgba[material]
        seen["light" if color[0] == 1 else "dark"] = points[faces]
    return seen


LOADERS = {
    "yourdfpy": by_yourdfpy,
    "mujoco, URDF": lambda folder: by_mujoco(folder, ".urdf"),
    "mujoco, MJCF": lambda folder: by_mujoco(folder, ".mjcf.xml"),
}


def level(corners: np.ndarray, z: float) -> np.ndarray:
    """Triangles at a height."""
    return corners[np.abs(corners[:, :, 2] - z).max(axis=1) < 1e-6]


def normals(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def bounds(corners: np.ndarray) -> np.ndarray:
    """Low and high corner (2, 3)."""
    return np.array([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])


def shows_the_dots(dark: np.ndarray, marker: Marker, z: float) -> bool:
    """Whether what is dark and level at a height consists of the marker's dots, dot 0 with its hole, facing +z."""
    face = level(dark, z)
    assert (normals(face)[:, 2] > 0).all()
    middles, total = face.mean(axis=1)[:, :2], 0
    for point in marker.control_points:
        mine = face[np.linalg.norm(middles - [point.x, point.y], axis=1) < point.feature.diameter / 2]
        total += len(mine)
        low, high = bounds(mine)[:, :2]
        np.testing.assert_allclose((low + high) / 2, [point.x, point.y], atol=CLOSE)
        np.testing.assert_allclose(high - low, point.feature.diameter, atol=2 * CLOSE)
        area = np.linalg.norm(normals(mine), axis=-1).sum() / 2
        ring = np.pi / 4 * (point.feature.diameter**2 - point.feature.inner_diameter**2)
        assert area == pytest.approx(ring, rel=2e-3)
    return total == len(face)


@pytest.mark.parametrize("loader", LOADERS)
def test_the_face_is_up_and_the_dots_are_where_they_belong(loader, folder, marker):
    seen = LOADERS[loader](folder)
    assert set(seen) == {"light", "dark"}
    plate = [[-RADIUS, -RADIUS, -THICKNESS], [RADIUS, RADIUS, 0]]
    np.testing.assert_allclose(bounds(np.concatenate(list(seen.values()))), plate, atol=2 * CLOSE)
    assert shows_the_dots(seen["dark"], marker, 0.0)
    # The plate faces up at its top and down at its bottom.
    assert (normals(level(seen["light"], 0.0))[:, 2] > 0).all()
    assert (normals(level(seen["light"], -THICKNESS))[:, 2] < 0).all()


@pytest.mark.parametrize("loader", ["yourdfpy", "mujoco, MJCF"])
def test_what_is_engraved_has_its_color(loader, engraved_folder, engraved):
    seen = LOADERS[loader](engraved_folder)
    assert shows_the_dots(seen["dark"], engraved, -1e-4)
    np.testing.assert_allclose(bounds(seen["light"]), [[-0.07, -0.07, -THICKNESS], [0.07, 0.07, 0]], atol=2 * CLOSE)


def test_mujoco_loads_the_urdf_of_what_is_engraved_without_its_meshes(engraved_folder):
    """It wants a volume of every mesh in a URDF, and flat marks have none."""
    assert by_mujoco(engraved_folder, ".urdf") == {}


def test_mujoco_has_a_site_on_every_dot(folder, marker):
    model = mujoco.MjModel.from_xml_path(str(folder / "left & right.mjcf.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.site("marker").xpos, [0, 0, 0])
    np.testing.assert_array_equal(data.site("marker").xmat, np.eye(3).ravel())
    for point in marker.control_points:
        np.testing.assert_allclose(data.site(f"dot-{point.id}").xpos, [point.x, point.y, point.z], atol=1e-10)
    assert model.nsite == len(marker) + 1


def test_several_can_be_attached_to_one_scene(folder):
    """Where the frame of one is turned, so is all that belongs to it."""
    scene = mujoco.MjSpec()
    for name, place in (("a/", [0, 0, 1.0]), ("b/", [1.0, 0, 0])):
        marker = mujoco.MjSpec.from_file(str(folder / "left & right.mjcf.xml"))
        frame = scene.worldbody.add_frame(pos=place, quat=[0, 1, 0, 0] if name == "a/" else [1, 0, 0, 0])
        scene.attach(marker, prefix=name, frame=frame)
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    one, other = data.site("a/dot-1").xpos, data.site("b/dot-1").xpos
    np.testing.assert_allclose(one * [1, -1, -1] + [0, 0, 1], other - [1, 0, 0], atol=1e-12)


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def test_poses_are_those_of_the_marker_frame(outputs):
    sdf, urdf = (ElementTree.fromstring(outputs[suffix].data) for suffix in (".sdf", ".urdf"))
    poses = [pose.text for pose in sdf.findall(".//visual/pose")]
    origins = urdf.findall(".//visual/origin")
    assert [numbers(pose) for pose in poses] == [[0] * 6] * 2
    assert [numbers(origin.get("xyz")) + numbers(origin.get("rpy")) for origin in origins] == [[0] * 6] * 2
    assert any("for Gazebo write .sdf" in note for note in outputs[".urdf"].notes)


@pytest.mark.parametrize("suffix", [".urdf", ".sdf", ".mjcf.xml"])
def test_the_meshes_that_are_named_are_there(suffix, outputs):
    root = ElementTree.fromstring(outputs[suffix].data)
    named = [element.text for element in root.iter("uri")]
    named += [mesh.get("filename") or mesh.get("file") for mesh in root.iter("mesh")]
    assert [name for name in named if name] == MESHES
    assert all(outputs[suffix].beside[name] == outputs[".urdf"].beside[name] for name in MESHES)


def test_another_mesh_is_another_file(outputs, marker):
    first, *rest = marker.control_points
    moved = replace(marker, control_points=(replace(first, x=first.x + 1e-5), *rest))
    assert all(EXPORTERS[suffix]([moved], OPTIONS).data != outputs[suffix].data for suffix in outputs)


def test_all_have_the_same_mass_and_shape(outputs, folder):
    sdf, urdf = (ElementTree.fromstring(outputs[suffix].data) for suffix in (".sdf", ".urdf"))
    mass = float(sdf.find(".//mass").text)
    assert mass == float(urdf.find(".//mass").get("value"))
    assert mass == pytest.approx(1240 * np.pi * RADIUS**2 * THICKNESS, rel=1e-3)
    moments = {name: float(value) for name, value in urdf.find(".//inertia").attrib.items()}
    assert moments == {element.tag: float(element.text) for element in sdf.find(".//inertia")}
    assert moments["izz"] == pytest.approx(mass * RADIUS**2 / 2, rel=1e-3)
    for cylinder in (
        {element.tag: float(element.text) for element in sdf.find(".//collision/geometry/cylinder")},
        {name: float(value) for name, value in urdf.find(".//collision/geometry/cylinder").attrib.items()},
    ):
        assert cylinder == {"radius": pytest.approx(RADIUS, abs=1e-6), "length": pytest.approx(THICKNESS, abs=1e-6)}
    middle = numbers(sdf.find(".//collision/pose").text)[:3]
    assert middle == numbers(urdf.find(".//collision/origin").get("xyz"))
    model = mujoco.MjModel.from_xml_path(str(folder / "left & right.mjcf.xml"))
    assert model.body("marker").mass[0] == mass
    np.testing.assert_allclose(sorted(model.body("marker").inertia), sorted(moments[f"i{a}{a}"] for a in "xyz"))
    shape = model.geom("collision")
    assert shape.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER
    np.testing.assert_allclose(shape.size[:2], [RADIUS, THICKNESS / 2], atol=1e-6)
    np.testing.assert_allclose(shape.pos, middle, atol=1e-12)


def test_a_plate_with_corners_bumps_as_a_box(engraved_folder):
    sdf = ElementTree.parse(engraved_folder / "left & right.sdf")
    size = numbers(sdf.find(".//collision/geometry/box/size").text)
    assert size == pytest.approx([0.14, 0.14, THICKNESS], abs=1e-6)
    shape = mujoco.MjModel.from_xml_path(str(engraved_folder / "left & right.mjcf.xml")).geom("collision")
    assert shape.type[0] == mujoco.mjtGeom.mjGEOM_BOX
    np.testing.assert_allclose(2 * shape.size, size, atol=1e-9)


def test_meshes_too_large_for_mujoco_are_put_in_several_files(monkeypatch, marker):
    from markergen.workshop.mesh import meshed

    _, parts = meshed([marker], OPTIONS, ".stl")
    whole = _shown(parts, "name", "stem")
    largest = max(len(part.triangles) for part in parts if part.material == "dark")
    monkeypatch.setattr("markergen.workshop.formats.simulators.MOST_TRIANGLES", largest)
    several = _shown(parts, "name", "stem")
    assert all((len(item.stl) - 84) // 50 <= largest < MOST_TRIANGLES for item in several)
    assert [item.name for item in several if item.material == "dark"][:2] == ["dark", "dark-2"]
    assert len({item.path for item in several}) == len(several)
    for item in whole:
        pieces = [other.stl[84:] for other in several if other.material == item.material]
        assert b"".join(pieces) == item.stl[84:]


def test_the_model_folder_says_which_file_is_the_model(outputs):
    output = outputs[".sdf"]
    assert set(output.beside) == {"model.config", *MESHES}
    config = ElementTree.fromstring(output.beside["model.config"])
    assert config.find("sdf").text == "left & right.sdf"
    model = ElementTree.fromstring(output.data)
    assert config.find("sdf").get("version") == model.get("version")
    assert config.find("name").text == model.find("model").get("name") == "markergen-1a2b3c4d"
