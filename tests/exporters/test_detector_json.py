"""marker.detector.json against the bodies that it is of."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from markergen.exporters import EXPORTERS, ExportOptions
from markergen.model.body import Plate
from markergen.model.boundary import Circle
from markergen.model.marker import JointCovariance, build_marker
from markergen.model.rig import Rig
from markergen.model.tag import FAMILIES, Tag

SQUARE = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
MARKER = build_marker(SQUARE, Circle(0.06), diameter=0.02, clearance=0.002)


def written(body, stem="board"):
    content = json.loads(EXPORTERS[".detector.json"](body, ExportOptions(stem=stem)).data)
    assert (content["format"], content["version"], content["unit"]) == ("markergen-detector", 1, "m")
    (only,) = content["bodies"]
    assert only["name"] == stem
    return only, content["tag_families"]


def test_a_marker_is_written_in_its_frame():
    body, families = written(MARKER)
    assert [dot["xyz"] for dot in body["dots"]] == MARKER.xyz.tolist()
    assert [dot["kind"] for dot in body["dots"]] == ["ring", "disk", "disk", "disk"]
    assert not any("place" in dot or "covariance" in dot for dot in body["dots"])
    assert (body["frame"], body["light"], body["tags"], families) == ("marker", False, [], {})


def test_tags_come_with_their_bits_and_the_codes_of_their_family():
    tag = Tag("apriltag:36h11", 7, 0.012)
    body, families = written(replace(MARKER, tag=tag, print_scale=(1.01, 0.99)))
    (entry,) = body["tags"]
    np.testing.assert_allclose(entry["corners"], np.column_stack([tag.corners * [1.01, 0.99], np.zeros(4)]))
    assert entry["bits"] == tag.ink.astype(int).tolist()
    codes = [int(code, 16) for code in families[tag.family]]
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[tag.family]))
    assert len(codes) == len(dictionary.bytesList) == len(set(codes))
    inner = 1 - cv2.aruco.Dictionary.getBitsFromByteList(dictionary.bytesList[7:8], 6)
    assert [codes[7] >> i & 1 for i in range(36)] == inner.ravel().tolist()


def test_rigs_are_numbered_through_and_turned():
    side = Plate("side", MARKER, ((0, 0, 1), (1, 0, 0), (0, 1, 0)), (0.1, 0, 0))
    relation = np.diag(np.arange(1, 13) * 1e-8)
    rig = Rig((Plate("front", MARKER, np.eye(3), (0, 0, 0.1)), side), relation=tuple(map(tuple, relation)))
    body, _ = written(rig)
    assert [dot["id"] for dot in body["dots"]] == list(range(8))
    assert [dot["plate"] for dot in body["dots"]] == [0] * 4 + [1] * 4
    np.testing.assert_allclose([dot["xyz"] for dot in body["dots"]], rig.xyz)
    np.testing.assert_allclose(body["plates"][1]["rotation"], side.rotation_matrix)
    np.testing.assert_allclose(body["relation_covariance"], relation)


@pytest.mark.parametrize("relief", [False, True])
def test_measured_places_have_their_covariances_in_the_body(relief):
    points = [
        replace(p, covariance=(1e-10, 2e-11, 3e-10), z=0.001 if relief else 1e-5, designed_z=0.001 if relief else 0.0)
        for p in MARKER.control_points[:2]
    ]
    marker = replace(MARKER, control_points=(*points, *MARKER.control_points[2:]))
    side = Plate("side", marker, ((0, 0, 1), (1, 0, 0), (0, 1, 0)), (0.1, 0, 0))
    body, _ = written(Rig((side,)))
    first, last = body["dots"][0], body["dots"][3]
    np.testing.assert_allclose(first.get("place", first["xyz"]), side.to_body(marker.xyz[0]))
    np.testing.assert_allclose(first["xyz"], side.to_body(marker.search_xyz[0])) if not relief else None
    local = side.rotation_matrix.T @ first["covariance"] @ side.rotation_matrix
    np.testing.assert_allclose(local[:2, :2], [[1e-10, 2e-11], [2e-11, 3e-10]])
    assert "covariance" not in last


def test_places_measured_together_have_one_covariance():
    matrix = np.diag(np.arange(1.0, 10)) * 1e-10
    marker = replace(MARKER, joint_covariance=JointCovariance((0, 2, 3), "xyz", tuple(map(tuple, matrix))))
    (part,) = written(marker)[0]["joint_covariances"]
    assert part["dots"] == [0, 2, 3]
    np.testing.assert_allclose(part["matrix"], matrix)
