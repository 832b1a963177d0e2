import json
from io import BytesIO

import numpy as np
import pytest
from tetrahedra import plate_and_dot

from markergen.workshop.formats.meshes import write_glb

CORNERS = np.array([[0, 0, 0], [400, 0, 0], [0, 300, 0], [0, 0, 200.0]])


@pytest.fixture(scope="module")
def data() -> bytes:
    return write_glb(plate_and_dot(CORNERS), "markergen-12ab")


@pytest.fixture(scope="module")
def document(data) -> dict:
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def test_lengths_and_chunks_are_as_the_header_says(data):
    assert data[:4] == b"glTF"
    version, length, first = np.frombuffer(data, "<u4", 3, 4)
    assert (version, length) == (2, len(data))
    assert first % 4 == 0
    assert data[16:20] == b"JSON"
    second = int.from_bytes(data[20 + first : 24 + first], "little")
    assert data[24 + first : 28 + first] == b"BIN\0"
    assert second % 4 == 0
    assert 28 + first + second == len(data)


def test_bounds_of_positions_are_exact_floats(document):
    for accessor in document["accessors"]:
        assert document["bufferViews"][accessor["bufferView"]]["byteOffset"] % 4 == 0
        assert ("min" in accessor) == (accessor["type"] == "VEC3")
    assert np.float32(document["accessors"][0]["max"]).tolist() == document["accessors"][0]["max"]


def test_an_independent_reader_finds_meters_and_the_marker_face_up(data):
    import trimesh

    scene = trimesh.load_scene(BytesIO(data), file_type="glb")
    assert set(scene.geometry) >= {"dot-0"}
    # (x, y, z) in mm of the marker is (x, z, -y) in m of glTF, whose y is up.
    low, high = scene.bounds
    np.testing.assert_allclose(low, [0, 0, -0.301], atol=1e-7)
    np.testing.assert_allclose(high, [0.401, 0.201, 0], atol=1e-7)


def test_points_of_the_meshes_themselves_are_in_the_marker_frame(data):
    import trimesh

    dot = trimesh.load_scene(BytesIO(data), file_type="glb").geometry["dot-0"]
    np.testing.assert_allclose(dot.bounds, [[1e-3, 1e-3, 1e-3], [0.401, 0.301, 0.201]], atol=1e-7)
    assert dot.is_watertight


def test_parts_are_nodes_under_the_one_that_turns_them(document):
    root, *others = document["nodes"]
    assert root["name"] == "markergen-12ab"
    assert root["children"] == [1, 2]
    assert [node["name"] for node in others] == ["plate", "dot-0"]
    rotation = np.reshape(root["matrix"], (4, 4)).T
    assert np.linalg.det(rotation[:3, :3]) == pytest.approx(1)
    np.testing.assert_array_equal(rotation @ [1, 2, 3, 1], [1, 3, -2, 1])


def test_marked_triangles_are_a_primitive_of_the_other_material(document):
    plate, dot = document["meshes"]
    light, dark = plate["primitives"]
    counts = [document["accessors"][one["indices"]]["count"] for one in (light, dark)]
    assert counts == [9, 3]
    assert light["attributes"] == dark["attributes"]
    names = [document["materials"][one["material"]]["name"] for one in (light, dark, *dot["primitives"])]
    assert names == ["light", "dark", "dark"]


def test_materials_are_no_metal_and_have_their_colors_in_linear_light(document):
    light, dark = (material["pbrMetallicRoughness"] for material in document["materials"])
    assert light["baseColorFactor"] == [1, 1, 1, 1]
    # sRGB 0.05 is 0.05/1.055 + 0.055/1.055, to the power of 2.4.
    assert dark["baseColorFactor"][0] == pytest.approx(0.003936, abs=1e-6)
    assert light["metallicFactor"] == dark["metallicFactor"] == 0
