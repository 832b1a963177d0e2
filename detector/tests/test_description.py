"""Files, and what they become: bodies, cameras, models."""

import json

import numpy as np
import pytest
from markergen_detect import Camera, DescriptionError, Detector, read_bodies
from markergen_detect.core import constants
from markergen_detect.model import code_of, constellations, pack
from numpy.testing import assert_allclose

SQUARE = [[0.03, 0.03, 0], [-0.03, 0.03, 0], [-0.03, -0.03, 0], [0.03, -0.03, 0], [0.0, 0.04, 0]]
UPRIGHT = np.eye(3).tolist()
SIDE = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
BITS = [[1] * 6, [1, 0, 1, 1, 0, 1], [1, 0, 0, 1, 1, 1], [1, 1, 0, 0, 0, 1], [1, 0, 1, 0, 1, 1], [1] * 6]
CORNERS = [[-0.01, 0.01, 0], [0.01, 0.01, 0], [0.01, -0.01, 0], [-0.01, -0.01, 0]]
CAMERA = {"width": 640, "height": 480, "fx": 600, "fy": 600, "cx": 319.5, "cy": 239.5}


def dots(plate=0, first=0, places=SQUARE, **extra):
    kinds = ["ring"] + ["disk"] * 10
    return [
        {"id": first + i, "plate": plate, "kind": kinds[i], "diameter": 0.012, "xyz": xyz, **extra}
        for i, xyz in enumerate(places)
    ]


def plate(name="marker", rotation=None, translation=(0, 0, 0)):
    return {"name": name, "rotation": np.eye(3).tolist() if rotation is None else rotation, "translation": translation}


def entry(**changes):
    return {"name": "board", "plates": [plate()], "dots": dots(), **changes}


def content(*bodies, **extra):
    return {"format": "markergen-detector", "version": 1, "unit": "m", "bodies": list(bodies), **extra}


def marker_json(**changes):
    points = [
        {"id": i, "x": x, "y": y, "z": z, "feature": {"kind": "dot" if i else "ring", "diameter": 0.012}}
        for i, (x, y, z) in enumerate(SQUARE)
    ]
    return {"format": "markergen-marker", "version": 1, "control_points": points, "provenance": {}, **changes}


def test_a_file_is_named_by_its_stem(tmp_path):
    path = tmp_path / "board.json"
    path.write_text(json.dumps(marker_json()))
    (body,) = read_bodies(path)
    assert (body.name, body.frame, body.light, body.print_sigma) == ("board", "marker", False, 1e-4)
    assert body.rings.tolist() == [True, False, False, False, False]
    assert_allclose(body.xyz, SQUARE)


def test_marker_json_has_measured_places_and_a_printed_tag_without_bits():
    point = {"id": 1, "x": -0.0301, "y": 0.03, "z": 2e-5, "designed_z": 0.0, "covariance": [1e-10, 2e-11, 3e-10]}
    points = marker_json()["control_points"]
    points[1] = {**points[1], **point}
    tag = {"family": "aruco:DICT_4X4_50", "id": 3, "corners": CORNERS}
    correction = {"scale_x": 1.01, "scale_y": 0.99}
    (body,) = read_bodies(marker_json(control_points=points, tag=tag, print_correction=correction))
    assert_allclose(body.places[1], [-0.0301, 0.03, 2e-5])
    assert_allclose(body.xyz[1], [-0.0301, 0.03, 0])
    assert_allclose(body.measured[1, :2, :2], [[1e-10, 2e-11], [2e-11, 3e-10]])
    assert np.isnan(body.measured[0]).all()
    assert_allclose(body.tags[0].corners, np.array(CORNERS) * [1.01, 0.99, 1])
    assert body.tags[0].bits is None
    (note,) = Detector(body).notes
    assert "aruco:DICT_4X4_50:3" in note
    assert "marker.detector.json" in note


def test_rigs_are_numbered_through(tmp_path):
    (tmp_path / "face.json").write_text(json.dumps(marker_json()))
    markers = [
        {
            "name": "front",
            "T_rig_marker": {"rotation": np.eye(3).tolist(), "translation": [0, 0, 0.1]},
            "file": "face.json",
        },
        {"name": "side", "T_rig_marker": {"rotation": SIDE, "translation": [0.1, 0, 0]}, "marker": marker_json()},
    ]
    rig = {"format": "markergen-rig", "version": 1, "markers": markers, "relation_covariance": np.eye(12).tolist()}
    path = tmp_path / "cube.json"
    path.write_text(json.dumps(rig))
    (body,) = read_bodies(path)
    assert (body.frame, body.plate_names, body.ids.tolist()) == ("rig", ["front", "side"], list(range(10)))
    assert_allclose(body.xyz[5:], np.array(SQUARE) @ np.transpose(SIDE) + [0.1, 0, 0])
    assert_allclose(body.normals[[0, 5]], [[0, 0, 1], [1, 0, 0]])


def test_markers_on_several_plates_are_rigs():
    plates = [
        {
            "name": "low",
            "pose": {"rotation": np.eye(3).tolist(), "translation": [0, 0, 0]},
            "control_points": [0, 1, 2, 3],
        },
        {"name": "high", "pose": {"rotation": SIDE, "translation": [0, 0, 0.1]}, "control_points": [4, 5, 6, 7]},
    ]
    moved = (np.array(SQUARE[:4]) @ np.transpose(SIDE) + [0, 0, 0.1]).tolist()
    points = [
        {"id": i, "x": x, "y": y, "z": z, "feature": {"kind": "dot", "diameter": 0.012}}
        for i, (x, y, z) in enumerate(SQUARE[:4] + moved)
    ]
    (body,) = read_bodies(marker_json(control_points=points, plates=plates))
    assert body.frame == "rig"
    assert_allclose(body.xyz, SQUARE[:4] + moved, atol=1e-12)


def test_covariances_of_places_are_along_the_plate():
    places = np.array(SQUARE) @ np.transpose(SIDE) + [0.1, 0, 0]
    (body,) = read_bodies(content(entry(plates=[plate("side", SIDE, [0.1, 0, 0])], dots=dots(places=places.tolist()))))
    assert_allclose(body.print_blocks(1e-4), np.broadcast_to(np.diag([0, 1e-8, 1e-8]), (5, 3, 3)), atol=1e-20)
    raised = [[x, y, 0.01 * (i == 2)] for i, (x, y, _) in enumerate(SQUARE)]
    (body,) = read_bodies(content(entry(dots=dots(places=raised))))
    assert_allclose(body.print_blocks(1e-4), np.broadcast_to(1e-8 * np.eye(3), (5, 3, 3)))


def test_common_errors_add_up_to_the_joint_covariance(rng):
    root = rng.standard_normal((9, 9)) * 1e-5
    joint = [{"dots": [0, 2, 3], "matrix": (root @ root.T).tolist()}]
    relation = np.diag(rng.uniform(1e-8, 1e-6, 6))
    (body,) = read_bodies(content(entry(joint_covariances=joint, relation_covariance=relation.tolist())))
    moved, alone = body.common_errors(1e-4)
    whole = np.einsum("nic,mjc->nimj", moved, moved)
    for i in range(5):
        whole[i, :, i] += alone[i]
    rows = np.concatenate([np.hstack([-cross(xyz), np.eye(3)]) for xyz in body.places])
    expected = (rows @ relation @ rows.T).reshape(5, 3, 5, 3)
    index = np.array([0, 2, 3])
    expected[index[:, None, None, None], np.arange(3)[:, None, None], index[:, None], np.arange(3)] += (
        root @ root.T
    ).reshape(3, 3, 3, 3)
    for i in (1, 4):
        expected[i, :, i] += np.diag([1e-8, 1e-8, 0])
    assert_allclose(whole, expected, atol=1e-18)


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_a_scale_that_is_known_poorly_weighs_no_more_than_another_motion():
    points = np.array(SQUARE)
    grown = (points - points.mean(axis=0)).ravel()
    matrix = 1e-12 * np.eye(15) + 1e-4 * np.outer(grown, grown)
    joint = [{"dots": list(range(5)), "matrix": matrix.tolist()}]
    (body,) = read_bodies(content(entry(joint_covariances=joint)))
    assert np.sqrt(body.print_blocks(1e-4).diagonal(axis1=1, axis2=2).max()) < 2e-6


BROKEN = {
    "format": ({"format": "x"}, "found format 'x'"),
    "version": ({**content(entry()), "version": 2}, "version 2"),
    "no dots": (content(entry(dots=dots(places=SQUARE[:3]))), "board: expected 4 to"),
    "key": (content({"name": "board"}), "the key 'dots' is missing"),
    "numbers": (content(entry(dots=dots(places=[[0, 0, np.nan]] * 5))), "finite numbers for the dots' places"),
    "id": (content(entry(dots=[*dots(), *dots()])), "the same id"),
    "plate": (content(entry(dots=dots(plate=1))), "a plate that is not there"),
    "rotation": (content(entry(plates=[plate(rotation=(2 * np.eye(3)).tolist())])), "rotation"),
    "mirror": (content(entry(plates=[plate(rotation=np.diag([1, 1, -1]).tolist())])), "reflection"),
    "bits": (content(entry(tags=[{"family": "f", "id": 0, "corners": CORNERS, "bits": [[1, 0]]}])), "bits of a tag"),
    "joint": (content(entry(joint_covariances=[{"dots": [9], "matrix": np.eye(3).tolist()}])), "unknown dots"),
    "type": (content("body"), "board|body"),
    "empty": ([], "one body or more"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_is_said_in_one_line(name):
    source, message = BROKEN[name]
    with pytest.raises(DescriptionError, match=message) as error:
        read_bodies(source)
    assert "\n" not in str(error.value)


def test_unreadable_files_are_named(tmp_path):
    path = tmp_path / "x.json"
    with pytest.raises(DescriptionError, match=r"x\.json cannot be read"):
        read_bodies(path)
    path.write_text("[1]")
    with pytest.raises(DescriptionError, match="JSON object"):
        read_bodies(str(path))


def test_dots_on_a_line_are_refused():
    line = [[0.01 * i, 0, 0] for i in range(5)]
    with pytest.raises(DescriptionError, match="on a line"):
        Detector(content(entry(dots=dots(places=line))))


def test_constellations_are_of_one_plate_and_size():
    large = [
        {**dot, "diameter": 0.03, "id": 10 + i, "xyz": [3 * v for v in dot["xyz"]]} for i, dot in enumerate(dots())
    ]
    (body,) = read_bodies(content(entry(dots=[*dots(), *large])))
    assert [part.tolist() for part in constellations(body)] == [[5, 6, 7, 8, 9], [0, 1, 2, 3, 4]]
    (body,) = read_bodies(content(entry(dots=[*dots(), large[0]])))
    assert [part.tolist() for part in constellations(body)] == [[0, 1, 2, 3, 4, 5]]


def test_members_of_a_family_share_a_layout_and_light_dots_have_a_model_of_their_own():
    tags = [[{"family": "f", "id": k, "corners": CORNERS, "bits": np.roll(BITS, k, 1).tolist()}] for k in (0, 1)]
    bodies = read_bodies(content(*(entry(name=str(k), tags=tags[k]) for k in (0, 1)), entry(name="light", light=True)))
    dark, light = pack(bodies)
    assert (dark.bodies, light.bodies) == ((0, 1), (2,))
    assert (dark.struct["layout_count"][0], dark.struct["member_count"][0]) == (1, 2)
    assert (dark.struct["light"][0], light.struct["light"][0]) == (0, 1)


def test_codes_count_from_the_lowest_bit():
    bits = np.array(BITS, dtype=bool)
    assert [code_of(bits) >> i & 1 for i in range(16)] == bits[1:5, 1:5].astype(int).ravel().tolist()


def test_cameras_are_checked(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**CAMERA, "distortion": {"model": "plumb_bob", "coefficients": [0.1, 0, 0, 0, 0]}}))
    assert Camera.load(path).model == "radtan"
    lens = {"model": "radtan", "coefficients": [0.1]}
    for wrong in (
        {**CAMERA, "fx": 0},
        {**CAMERA, "width": 0},
        {**CAMERA, "distortion": lens},
        {"width": 3},
        {**CAMERA, "cx": "a"},
    ):
        with pytest.raises(DescriptionError):
            Camera.load(wrong)
    grid = np.zeros((4, 4, 2))
    with pytest.raises(DescriptionError, match="sample it finer"):
        Camera.load({**CAMERA, "distortion": {"model": "sampled", "map": grid, "error_px": 0.1}})
    packed = Camera.load({**CAMERA, "distortion": {"model": "sampled", "map": grid}}).packed()
    assert (packed["lens"][0], packed["rows"][0]) == (constants()["SAMPLED"], 4)


@pytest.mark.parametrize(
    ("model", "coefficients", "reach"),
    [
        ("radtan", (-0.3, 0, 0, 0), np.sqrt(1 / 0.9)),
        ("radtan", (0.1, 0, 0, 0), 1e6),
        ("equidistant", (-0.1, 0, 0, 0), np.tan(np.sqrt(1 / 0.3))) if (np.pi / 2) ** 2 > 1 / 0.3 else ("none", (), 1e6),
        ("rational", (0, 0, 0, 0, 0, -1, 0, 0), 1.0),
        ("rational", (0, 0, 0, 0, 0, 0, 0, 0, 0.1, 0, 0, 0), 5.0),
    ],
)
def test_a_lens_reaches_as_far_as_it_is_one_to_one(model, coefficients, reach):
    assert_allclose(Camera(640, 480, 600, 600, 320, 240, model, coefficients).reach, reach, rtol=1e-6)
