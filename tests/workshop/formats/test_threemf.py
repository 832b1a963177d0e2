import zipfile
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest
from rewritten_solids import meshes_of_3mf
from tetrahedra import plate_and_dot

from markergen.workshop.formats.meshes import MODEL, VOLUMES, write_3mf, write_3mf_of_parts

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
CORNERS = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [-1.5, 123.456787, -4]])
NAME = "markergen-12ab"


@pytest.fixture(scope="module")
def whole() -> bytes:
    return write_3mf(plate_and_dot(CORNERS), NAME)


@pytest.fixture(scope="module")
def apart() -> bytes:
    return write_3mf_of_parts(plate_and_dot(CORNERS), NAME)


def unpacked(data: bytes, path: str = MODEL) -> ElementTree.Element:
    with zipfile.ZipFile(BytesIO(data)) as archive:
        assert archive.testzip() is None
        return ElementTree.fromstring(archive.read(path))


def points(mesh: ElementTree.Element) -> np.ndarray:
    return np.array([[float(vertex.get(axis)) for axis in "xyz"] for vertex in mesh.iter(f"{CORE}vertex")])


def test_is_in_millimeters_with_both_materials(whole, apart):
    for model in map(unpacked, (whole, apart)):
        assert model.get("unit") == "millimeter"
        bases = model.findall(f".//{CORE}base")
        assert [(base.get("name"), base.get("displaycolor")) for base in bases] == [
            ("light", "#FFFFFFFF"),
            ("dark", "#0D0D0DFF"),
        ]


def test_whole_is_one_mesh_and_one_item(whole):
    model = unpacked(whole)
    (only,) = model.findall(f".//{CORE}object")
    (item,) = model.findall(f"{CORE}build/{CORE}item")
    assert (only.get("name"), only.get("pindex")) == (NAME, "0")
    assert item.get("objectid") == only.get("id")


def test_ranges_of_triangles_are_the_parts_with_their_extruders(whole):
    volumes = unpacked(whole, VOLUMES).findall("object[@id='2']/volume")
    result = [
        (volume.get("firstid"), volume.get("lastid"), *(item.get("value") for item in volume.iter("metadata")))
        for volume in volumes
    ]
    assert result == [("0", "3", "plate", "1"), ("4", "7", "dot-0", "2")]


def test_item_lies_on_the_bed_or_above(whole):
    (item,) = unpacked(whole).findall(f"{CORE}build/{CORE}item")
    # From -4 to 1: Cura adds the middle, -1.5, to heights before it looks for what is below the bed.
    assert item.get("transform") == "1 0 0 0 1 0 0 0 1 0 0 5.5"
    high = unpacked(write_3mf(plate_and_dot(np.abs(CORNERS) + [0, 0, 2]), NAME))
    assert high.find(f"{CORE}build/{CORE}item").get("transform").endswith(" 0")


def test_parts_are_named_objects_of_one_item(apart):
    model = unpacked(apart)
    plate, dot, group = model.findall(f".//{CORE}object")
    assert [(plate.get("name"), plate.get("pindex")), (dot.get("name"), dot.get("pindex"))] == [
        ("plate", "0"),
        ("dot-0", "1"),
    ]
    assert [entry.find(f"{CORE}metadatagroup/{CORE}metadata").text for entry in (plate, dot)] == ["0", "1"]
    assert group.get("name") == NAME
    members = [component.get("objectid") for component in group.iter(f"{CORE}component")]
    assert members == [plate.get("id"), dot.get("id")]
    assert [item.attrib for item in model.findall(f"{CORE}build/{CORE}item")] == [{"objectid": group.get("id")}]


def test_points_are_exact_as_32_bit_floats(whole, apart):
    plate, dot, _ = unpacked(apart).findall(f".//{CORE}object")
    for result, expected in (
        (plate, CORNERS),
        (dot, CORNERS + 1),
        (unpacked(whole), np.vstack([CORNERS, CORNERS + 1])),
    ):
        np.testing.assert_array_equal(np.float32(points(result)), expected.astype(np.float32))


def test_triangles_have_their_material(whole, apart):
    plate, dot, _ = unpacked(apart).findall(f".//{CORE}object")
    assert [triangle.get("p1") for triangle in plate.iter(f"{CORE}triangle")] == [None, "1", None, None]
    assert all(triangle.get("pid") is None for triangle in dot.iter(f"{CORE}triangle"))
    results = list(unpacked(whole).iter(f"{CORE}triangle"))
    assert [triangle.get("p1") for triangle in results] == [None, "1", None, None, *4 * ["1"]]
    assert {int(triangle.get(f"v{k}")) for triangle in results[4:] for k in (1, 2, 3)} == {4, 5, 6, 7}


def test_an_independent_reader_in_strict_mode_has_nothing_to_say(whole, apart):
    for data, names in ((whole, [NAME]), (apart, ["plate", "dot-0"])):
        assert [mesh.GetName() for mesh in meshes_of_3mf(data)] == names
