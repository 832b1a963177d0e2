"""Shapes of rigs: where the faces are, and which way is up on them."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.rig_shapes import rig_shape

TEXTS = ["cube", "prism:3", "prism:6", "prism 4", "wall 3x2", "wall:1x4", "pair"]


def corners(face):
    return face.boundary.outlines()[0] @ np.array(face.rotation).T[:2] + face.translation


@pytest.mark.parametrize("text", TEXTS)
def test_frames_are_rotations_out_of_the_body(text):
    for face in rig_shape(text).faces:
        rotation = np.array(face.rotation)
        assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        if text.startswith(("cube", "prism")):
            assert rotation[:, 2] @ face.translation == pytest.approx(np.linalg.norm(face.translation))
            if abs(rotation[2, 2]) < 0.5:
                # Text on a side face stands upright.
                assert rotation[:, 1] == pytest.approx([0, 0, 1])


@pytest.mark.parametrize(("text", "count"), [("cube", 8), ("prism:3", 6), ("prism:6", 12)])
def test_the_faces_of_a_body_close_it(text, count):
    faces = rig_shape(text, edge=0.06).faces
    points = np.round(np.concatenate([corners(face) for face in faces]), 9)
    distinct, times = np.unique(points, axis=0, return_counts=True)
    assert len(distinct) == count
    assert (times == 3).all()


def test_names_and_measures():
    cube = rig_shape("cube", edge=0.08, without=["-z"])
    assert [face.name for face in cube.faces] == ["+x", "-x", "+y", "-y", "+z"]
    for face in cube.faces:
        axis = np.zeros(3)
        axis["xyz".index(face.name[1])] = 0.04 if face.name[0] == "+" else -0.04
        assert face.translation == tuple(axis)
    wall = rig_shape("wall 3x2", pitch=0.5)
    assert wall.faces[0].name == "row 1 column 1"
    assert wall.faces[0].translation == (-0.5, 0.25, 0)
    assert wall.faces[5].translation == (0.5, -0.25, 0)
    left, right = (np.array(face.rotation)[:, 2] for face in rig_shape("pair", angle=60.0).faces)
    assert left @ right == pytest.approx(0.5)
    assert left[0] < 0 < right[0]


@pytest.mark.parametrize(("angle", "setback"), [(-60, 2), (0, 2), (90, 5), (120, 2 + 3 * 3**0.5)])
def test_plates_of_a_pair_are_set_back_from_where_their_planes_meet(angle, setback):
    for face in rig_shape("pair", angle=angle).faces:
        distances = np.linalg.norm(corners(face)[:, [0, 2]], axis=1)
        assert distances.min() == pytest.approx(1e-3 * setback)
        assert distances.max() - distances.min() == pytest.approx(0.15)


@pytest.mark.parametrize(("angle", "setback"), [(-60, 10), (90, 22)])
def test_thick_plates_with_a_wide_edge_are_set_back_farther(angle, setback):
    pair = rig_shape("pair", angle=angle, thickness=0.012, edge=0.01)
    assert (pair.substrate.thickness, pair.substrate.edge) == (0.012, 0.01)
    for face in pair.faces:
        assert np.linalg.norm(corners(face)[:, [0, 2]], axis=1).min() == pytest.approx(1e-3 * setback)


@pytest.mark.parametrize(
    ("text", "measures", "phrase"),
    [
        ("dodecahedron", {}, "known shape"),
        ("cube 3", {}, "nothing behind cube"),
        ("cube 60mm", {}, "such as --edge 60mm"),
        ("prism", {}, "prism:6"),
        ("prism:2", {}, "3 to 98 sides"),
        ("wall 3", {}, "wall 3x2"),
        ("wall 20x20", {}, "1 to 100 plates"),
        ("wall 3x2", {"pitch": 0.1, "plate": 0.2}, "do not overlap"),
        ("wall 3x2", {"edge": 0.1}, "--edge"),
        ("wall 3x2", {"without": ["-z"]}, "--without"),
        ("cube", {"edge": 0.0}, "above 0 for --edge"),
        ("cube", {"without": ["z"]}, "a face of a cube"),
        ("pair", {"angle": 180.0}, "-170 to 170"),
        ("pair", {"thickness": 0.0}, "--thickness"),
        ("pair", {"edge": -0.001}, "--edge"),
        ("wall 3x2", {"thickness": 0.004}, "--thickness"),
    ],
)
def test_others_are_refused(text, measures, phrase):
    with pytest.raises(InputError, match=phrase):
        rig_shape(text, **measures)
