"""Lists of plates: every form of a pose, and every mistake."""

import json

import numpy as np
import pytest

import markergen as mg
from markergen.errors import InputError
from markergen.model.body_json import to_json
from markergen.model.boundary import Circle
from markergen.model.marker import build_marker
from markergen.read.remarks import collected_remarks
from markergen.read.rig_plates import read_plates

SQUARE = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
MARKER = build_marker(SQUARE, Circle(0.06), diameter=0.02, clearance=0.002)

TOML = """
[[plates]]
name = "front"
marker = "front.json"
translation = [0, "10cm", 0.2]

[[plates]]
name = "side"
radius = "50mm"
rotation_vector = [0, 1.5707963267948966, 0]

[[plates]]
name = "back"
boundary = "rect:0.2x0.1"
euler_deg = [180, 0, 0]

[[plates]]
name = "top"
radius = 0.05
matrix = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "front.json").write_bytes(to_json(MARKER))
    return tmp_path


def test_plates_have_markers_or_room_and_poses_in_any_form(folder):
    (folder / "plates.toml").write_text(TOML)
    shape, markers = read_plates(folder / "plates.toml")
    front, side, back, top = shape.faces
    assert markers == {0: MARKER}
    assert front.boundary == MARKER.boundary
    assert front.translation == (0, 0.1, 0.2)
    assert side.rotation == ((0, 0, 1), (0, 1, 0), (-1, 0, 0))
    assert side.boundary == Circle(0.05)
    assert back.rotation == ((1, 0, 0), (0, -1, 0), (0, 0, -1))
    assert top.rotation == ((1, 0, 0), (0, 0, 1), (0, -1, 0))
    assert shape.poses.startswith("sphere:")


def test_csv_says_the_same(folder):
    (folder / "plates.csv").write_text(
        "# two plates\nname,marker,radius,x,y,z,roll,pitch,yaw\n"
        "front,front.json,,0,10cm,0.2,,,\nleft,,50mm,-0.2,,,,,90\n"
    )
    shape, markers = read_plates(folder / "plates.csv")
    assert markers == {0: MARKER}
    assert shape.faces[1].rotation == ((0, -1, 0), (1, 0, 0), (0, 0, 1))
    assert shape.faces[1].translation == (-0.2, 0, 0)
    assert shape.poses.startswith("cone:")


def test_columns_of_csv_have_units(folder):
    (folder / "plain.csv").write_text("name,radius,x,y,z,roll,yaw\nleft,0.05,-0.2,0.1,0,30,90\n")
    (folder / "units.csv").write_text(
        "name,radius [mm],x_mm,y (cm),z_in,roll_rad,yaw_deg\nleft,50,-200,10,0,0.5235987755982988,90\n"
    )
    plain, face = (read_plates(folder / f"{name}.csv")[0].faces[0] for name in ("plain", "units"))
    assert face.boundary == plain.boundary
    assert face.translation == plain.translation
    np.testing.assert_allclose(face.rotation, plain.rotation, atol=1e-12)


@pytest.mark.parametrize(
    ("header", "phrase"),
    [
        ("name,radius,x_parsec", "a column of plates in .*'x_parsec'"),
        ("name,radius,x [au]", r"one known unit of length at x \[au\]"),
        ("name,radius,yaw_mm", "a unit of angles in .*; known: rad"),
        ("name,boundary_mm,x", "a column of plates in .*'boundary_mm'; did you mean 'boundary'"),
        ("name,radius,x,x_mm", "every column once in .*, found x twice"),
    ],
)
def test_columns_of_csv_are_known_and_once(folder, header, phrase):
    (folder / "plates.csv").write_text(f"{header}\n{','.join('1' * len(header.split(',')))}\n")
    with pytest.raises(InputError, match=phrase):
        read_plates(folder / "plates.csv")


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"name": "twice"}, "the name twice twice"),
        ({"radius": 0.1, "boundary": "rect:0.1x0.1"}, "radius and boundary"),
        ({"radius": None}, "found none"),
        ({"marker": "none.json", "radius": None}, r"none\.json"),
        ({"euler_deg": [0, 0, 0], "rotation_vector": [0, 0, 0]}, "one form of the rotation"),
        ({"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "orthonormal rows"),
        ({"translation": [0, 0]}, "translation"),
        ({"diameter": 1}, "diameter"),
        ({"rotation": [0, 0, 0]}, r"plates\[0\]\.rotation: unknown key, did you mean 'rotation_vector'"),
    ],
)
def test_mistakes_are_told_with_their_places(folder, change, phrase):
    plate = {key: value for key, value in {"name": "a", "radius": 0.05, **change}.items() if value is not None}
    (folder / "p.json").write_text(json.dumps({"plates": [plate, {"name": "twice", "radius": 0.05}]}))
    with pytest.raises(InputError, match=phrase):
        read_plates(folder / "p.json")


def test_a_rig_from_a_list_keeps_the_markers_that_it_names(folder):
    other = build_marker(SQUARE * [1, 0.8], Circle(0.06), diameter=0.02, clearance=0.002)
    (folder / "other.json").write_bytes(to_json(other))
    (folder / "p.csv").write_text("name,marker,x\none,front.json,-0.1\ntwo,other.json,0.1\n")
    rig = mg.rig(str(folder / "p.csv"), poses="cone:distance=0.5..1,tilt=10..50,count=20", n=4)
    assert [marker.marker for marker in rig.rig.markers] == [MARKER, other]
    assert rig.rig.markers[1].translation == (0.1, 0, 0)
    assert "the given markers" in str(rig)
    with pytest.raises(InputError, match="--edge"):
        mg.rig(str(folder / "p.csv"), edge="10mm")


def test_a_plate_as_a_drawing(folder):
    shape = '<path d="M0,0 h200 v100 h-200 z"/><path d="M9,9 L50,60 L70,20" fill="none" stroke="#000"/>'
    drawing = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 100">{shape}</svg>'
    (folder / "plate.svg").write_text(drawing)
    text = f'[[plates]]\nname = "a"\nboundary = "{folder / "plate.svg"}"\nboundary_unit = "mm"\n'
    (folder / "open.toml").write_text(text)
    with pytest.raises(InputError, match="ignore-open"):
        read_plates(folder / "open.toml")
    (folder / "open.toml").write_text(text + "ignore_open = true\n")
    with collected_remarks() as remarks:
        (face,) = read_plates(folder / "open.toml")[0].faces
    assert "left out" in remarks[0]
    np.testing.assert_allclose(np.ptp(face.boundary.outlines()[0], axis=0), [0.2, 0.1])
