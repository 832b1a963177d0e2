"""SDF and URDF: one rigid body in the marker frame, whatever their readers do with a GLB whose y is up."""

from dataclasses import replace
from io import BytesIO
from math import cos, sin
from xml.etree import ElementTree

import numpy as np
import pytest

from markergen.exporters import EXPORTERS, ExportOptions, Output
from markergen.model.boundary import polygon_from
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Substrate

OPTIONS = ExportOptions(fabrication=Fabrication("cnc", engrave=False), stem="left & right")
RADIUS = 0.0648
"""Of the plate in m: that of the dots' centers, and a dot's diameter for its quiet zone."""


@pytest.fixture(scope="module")
def marker(make_ngon) -> Marker:
    return make_ngon(4, 0.06, 0.012)


@pytest.fixture(scope="module", params=[".sdf", ".urdf"])
def output(request, marker) -> Output:
    return EXPORTERS[request.param]([marker], OPTIONS)


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def roll_about_x(angle: float) -> np.ndarray:
    return np.array([[1, 0, 0], [0, cos(angle), -sin(angle)], [0, sin(angle), cos(angle)]])


def test_the_mesh_that_is_named_is_there_and_is_the_glb(output, marker):
    root = ElementTree.fromstring(output.data)
    named = [element.text for element in root.iter("uri")] + [mesh.get("filename") for mesh in root.iter("mesh")]
    assert [name for name in named if name] == ["meshes/left & right.glb"]
    assert output.beside["meshes/left & right.glb"] == EXPORTERS[".glb"]([marker], OPTIONS).data


def test_another_mesh_is_another_file(output, marker):
    suffix = ".sdf" if b"<sdf" in output.data else ".urdf"
    first, *rest = marker.control_points
    moved = replace(marker, control_points=(replace(first, x=first.x + 1e-5), *rest))
    assert EXPORTERS[suffix]([moved], OPTIONS).data != output.data


def test_gazebo_which_takes_y_up_as_it_comes_is_told_to_turn_it(marker):
    import trimesh

    output = EXPORTERS[".sdf"]([marker], OPTIONS)
    x, y, z, roll, pitch, yaw = numbers(ElementTree.fromstring(output.data).find(".//visual/pose").text)
    assert (x, y, z, pitch, yaw) == (0, 0, 0, 0, 0)
    scene = trimesh.load_scene(BytesIO(output.beside["meshes/left & right.glb"]), file_type="glb")
    points = np.concatenate([mesh.vertices for mesh in scene.dump()]) @ roll_about_x(roll).T
    # The marker frame: the face is z = 0, and the plate, 3 mm thick and with a quiet zone around each dot, is below.
    np.testing.assert_allclose(points.min(axis=0), [-RADIUS, -RADIUS, -0.003], atol=1e-5)
    np.testing.assert_allclose(points.max(axis=0), [RADIUS, RADIUS, 0], atol=1e-5)
    key = points[np.abs(points[:, 2]) < 1e-9]
    ring = marker.control_points[0]
    near = np.linalg.norm(key[:, :2] - [ring.x, ring.y], axis=1)
    assert (np.abs(near - ring.feature.inner_diameter / 2) < 1e-6).sum() > 50


def test_rviz_which_turns_y_up_itself_is_told_nothing(marker):
    output = EXPORTERS[".urdf"]([marker], OPTIONS)
    origin = ElementTree.fromstring(output.data).find(".//visual/origin")
    assert numbers(origin.get("xyz")) == numbers(origin.get("rpy")) == [0, 0, 0]
    assert any("for Gazebo write .sdf" in note for note in output.notes)


def test_both_have_the_same_mass_and_shape(marker):
    sdf, urdf = (ElementTree.fromstring(EXPORTERS[suffix]([marker], OPTIONS).data) for suffix in (".sdf", ".urdf"))
    mass = float(sdf.find(".//mass").text)
    assert mass == float(urdf.find(".//mass").get("value"))
    assert mass == pytest.approx(1240 * np.pi * RADIUS**2 * 0.003, rel=1e-3)
    moments = {name: float(value) for name, value in urdf.find(".//inertia").attrib.items()}
    assert moments == {element.tag: float(element.text) for element in sdf.find(".//inertia")}
    assert moments["izz"] == pytest.approx(mass * RADIUS**2 / 2, rel=1e-3)
    for cylinder in (
        {element.tag: float(element.text) for element in sdf.find(".//collision/geometry/cylinder")},
        {name: float(value) for name, value in urdf.find(".//collision/geometry/cylinder").attrib.items()},
    ):
        assert cylinder == {"radius": pytest.approx(RADIUS, abs=1e-6), "length": pytest.approx(0.003, abs=1e-6)}
    assert numbers(sdf.find(".//collision/pose").text)[:3] == numbers(urdf.find(".//collision/origin").get("xyz"))


def test_a_plate_with_corners_bumps_as_a_box(marker):
    square = polygon_from([np.array([[-0.07, -0.07], [0.07, -0.07], [0.07, 0.07], [-0.07, 0.07]])])
    other = replace(marker, substrate=Substrate(outline=square))
    size = ElementTree.fromstring(EXPORTERS[".sdf"]([other], OPTIONS).data).find(".//collision/geometry/box/size")
    assert numbers(size.text) == pytest.approx([0.14, 0.14, 0.003], abs=1e-6)


def test_the_model_folder_says_which_file_is_the_model(marker):
    output = EXPORTERS[".sdf"]([marker], OPTIONS)
    assert set(output.beside) == {"model.config", "meshes/left & right.glb"}
    config = ElementTree.fromstring(output.beside["model.config"])
    assert config.find("sdf").text == "left & right.sdf"
    model = ElementTree.fromstring(output.data)
    assert config.find("sdf").get("version") == model.get("version")
    assert config.find("name").text == model.find("model").get("name") == "markergen-1a2b3c4d"
