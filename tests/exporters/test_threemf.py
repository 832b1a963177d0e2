import zipfile
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest
from tetrahedra import plate_and_dot

from markergen.exporters.meshes import MODEL, write_3mf

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
CORNERS = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [-1.5, 123.456787, -4]])


@pytest.fixture(scope="module")
def data() -> bytes:
    return write_3mf(plate_and_dot(CORNERS), "markergen-12ab")


@pytest.fixture(scope="module")
def model(data) -> ElementTree.Element:
    with zipfile.ZipFile(BytesIO(data)) as archive:
        assert archive.testzip() is None
        return ElementTree.fromstring(archive.read(MODEL))


def test_is_in_millimeters_with_both_materials(model):
    assert model.get("unit") == "millimeter"
    bases = model.findall(f".//{CORE}base")
    assert [(base.get("name"), base.get("displaycolor")) for base in bases] == [
        ("light", "#FFFFFFFF"),
        ("dark", "#0D0D0DFF"),
    ]


def test_parts_are_named_objects_of_one_item(model):
    plate, dot, whole = model.findall(f".//{CORE}object")
    assert [(plate.get("name"), plate.get("pindex")), (dot.get("name"), dot.get("pindex"))] == [
        ("plate", "0"),
        ("dot-0", "1"),
    ]
    assert whole.get("name") == "markergen-12ab"
    members = [component.get("objectid") for component in whole.iter(f"{CORE}component")]
    assert members == [plate.get("id"), dot.get("id")]
    assert [item.get("objectid") for item in model.findall(f"{CORE}build/{CORE}item")] == [whole.get("id")]


def test_points_are_exact_as_32_bit_floats(model):
    plate = next(model.iter(f"{CORE}object"))
    found = [[float(vertex.get(axis)) for axis in "xyz"] for vertex in plate.iter(f"{CORE}vertex")]
    np.testing.assert_array_equal(np.float32(found), CORNERS.astype(np.float32))


def test_marked_triangles_have_the_other_material(model):
    plate, dot, _ = model.findall(f".//{CORE}object")
    assert [triangle.get("p1") for triangle in plate.iter(f"{CORE}triangle")] == [None, "1", None, None]
    assert all(triangle.get("pid") is None for triangle in dot.iter(f"{CORE}triangle"))


def test_an_independent_reader_in_strict_mode_has_nothing_to_say(data):
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(data)
    assert reader.GetWarningCount() == 0
    meshes = model.GetMeshObjects()
    assert meshes.Count() == 2
    while meshes.MoveNext():
        mesh = meshes.GetCurrentMeshObject()
        assert mesh.IsValid()
        assert mesh.IsManifoldAndOriented()
