"""Rigs: frames, files, and what is refused."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import markergen as mg
from markergen.errors import InputError
from markergen.maths.rotation import exponential
from markergen.model.body import Plate
from markergen.model.body_json import rig_to_json, to_json
from markergen.model.boundary import Circle
from markergen.model.marker import build_marker
from markergen.model.rig import Rig

SQUARE = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
MARKER = build_marker(SQUARE, Circle(0.06), diameter=0.02, clearance=0.002)
SIDE = ((0, 0, 1), (1, 0, 0), (0, 1, 0))
RIG = Rig((Plate("front", MARKER, np.eye(3), (0, 0, 0.1)), Plate("side", MARKER, SIDE, (0.1, 0, 0))))

vectors = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


@given(vectors, vectors, vectors, vectors)
def test_points_go_through_the_rig_frame_as_through_the_camera_frame(w, t, other_w, other_t):
    mounted = Plate("a", MARKER, exponential(w), t)
    rotation, translation = exponential(other_w), other_t
    points = MARKER.xyz
    assert mounted.to_marker(mounted.to_body(points)) == pytest.approx(points, abs=1e-14)
    rotated, moved = mounted.camera_pose(rotation, translation)
    assert points @ rotated.T + moved == pytest.approx(mounted.to_body(points) @ rotation.T + translation, abs=1e-13)


def test_dots_are_numbered_through_the_markers():
    assert RIG.xyz[4:] == pytest.approx(RIG.markers[1].to_body(MARKER.xyz))
    assert RIG.owner.tolist() == [0] * 4 + [1] * 4
    assert (RIG.normals[4:] == [1, 0, 0]).all()
    assert (RIG.radii == 0.01).all()
    assert RIG.radius == pytest.approx(np.hypot(0.1, 0.06))


def test_a_file_comes_back_the_same(tmp_path):
    relation = np.diag(np.arange(12.0)).tolist()
    rig = Rig(RIG.markers, relation, {"seed": 0}, {"org.example": [1]})
    rig.save(tmp_path / "rig.json")
    for source in (tmp_path / "rig.json", json.loads(rig_to_json(rig)), rig):
        assert Rig.load(source) == rig
    assert (tmp_path / "rig.json").read_bytes() == rig_to_json(Rig.load(tmp_path / "rig.json"))


def test_markers_are_files_beside_the_rig(tmp_path):
    (tmp_path / "faces").mkdir()
    (tmp_path / "faces" / "m.json").write_bytes(to_json(MARKER))
    content = json.loads(rig_to_json(RIG))
    for item in content["markers"]:
        del item["marker"]
        item["file"] = "faces/m.json"
    (tmp_path / "rig.json").write_text(json.dumps(content))
    assert mg.Rig.load(tmp_path / "rig.json") == RIG


def broken(change):
    content = json.loads(rig_to_json(RIG))
    change(content)
    return content


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        (lambda c: c.update(format="markergen-marker"), '"format": "markergen-rig"'),
        (lambda c: c.update(version=2), "update markergen"),
        (lambda c: c.update(version=True), "version True"),
        (lambda c: c["markers"][1].update(name="front"), "'front' twice"),
        (lambda c: c["markers"][1].update(name=" "), "a name of 1 to 40"),
        (lambda c: c["markers"][1].pop("marker"), "markers[1]: expected a marker, or the file of one"),
        (lambda c: c["markers"][0]["marker"].update(clearance=-1), "markers[0]: expected a valid marker in front"),
        (lambda c: c["markers"][0].update(file="no.json"), "markers[0]: expected a marker, or the file of one"),
        (lambda c: c["markers"][0]["T_rig_marker"]["rotation"].reverse(), "determinant 1"),
        (lambda c: c["markers"][0]["T_rig_marker"].update(translation=[1e400, 0, 0]), "finite numbers"),
        (lambda c: c["markers"][0]["T_rig_marker"].update(quaternion=[1, 0, 0, 0]), "unknown key"),
        (lambda c: c["markers"][0]["T_rig_marker"].update(transl=[1, 0, 0]), "unknown key, did you mean 'translation'"),
        (lambda c: c.update(markers=[]), "markers"),
        (lambda c: c.update(relation_covariance=[[1.0]]), "12 x 12"),
        (lambda c: c.update(relation_covariance=(-np.eye(12)).tolist()), "positive semidefinite"),
    ],
)
def test_bad_files_are_refused_in_one_line(change, phrase):
    with pytest.raises(InputError) as error:
        Rig.load(broken(change))
    assert phrase in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_marker_file_is_named(tmp_path):
    content = broken(lambda c: (c["markers"][0].pop("marker"), c["markers"][0].update(file="no.json")))
    (tmp_path / "rig.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"markers\[0\]: expected a readable marker.json"):
        Rig.load(tmp_path / "rig.json")
