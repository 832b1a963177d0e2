"""Every configuration, read back by what it is meant for, or by a reader of its language."""

import csv
import io
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from sentences import sentence

from markergen.errors import InputError
from markergen.exporters.formats.points import write_bundle, write_kalibr, write_opencv, write_ros2, write_table
from markergen.model.tag import Tag

WRITERS = {
    "opencv": write_opencv, "csv": write_table, "ros2": write_ros2, "kalibr": write_kalibr, "apriltag": write_bundle,
}  # fmt: skip


@pytest.fixture(scope="module")
def marker(make_ngon):
    return replace(rounded(make_ngon(7, 0.1, 0.016)), tag=Tag("apriltag:36h11", 3, 0.03, (0.001, -0.002)))


@pytest.fixture(scope="module")
def plain(make_ngon):
    return rounded(make_ngon(5, 0.1, 0.016))


def rounded(marker):
    """Points in whole picometers, as designs have them."""
    points = tuple(replace(p, x=round(p.x, 12) + 0.0, y=round(p.y, 12) + 0.0) for p in marker.control_points)
    return replace(marker, control_points=points)


def measured(marker):
    points = tuple(replace(p, x=p.x * 0.99, y=p.y * 1.01) for p in marker.control_points)
    return replace(marker, control_points=points, print_scale=(0.99, 1.01))


@pytest.fixture(params=WRITERS)
def writer(request):
    return WRITERS[request.param]


def test_comments_say_what_it_is_about(writer, marker):
    comments = [line for line in writer(marker).splitlines() if line.startswith("# ")]
    phrase = "\n".join(comments)
    assert "markergen-1a2b3c4d: 7 dots" in phrase
    assert sentence("frame") in phrase
    assert "Unit: m." in phrase
    assert "measured" not in phrase
    assert max(map(len, writer(marker).splitlines())) < 260


def test_rounding_errors_are_not_written(marker):
    first, *others = marker.control_points
    noisy = replace(marker, control_points=(replace(first, x=-1e-10, y=0.15000000000000002), *others))
    texts = [write(noisy) for write in (write_opencv, write_table, write_ros2, write_kalibr)]
    assert all("0.15" in text and "0000000" not in text and "e-10" not in text for text in texts)
    assert all("-0.0," not in text for text in texts)


def test_a_print_that_was_measured_is_told(writer, marker):
    assert "those measured on" in writer(measured(marker))


def open_storage(text: str) -> cv2.FileStorage:
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    assert storage.isOpened()
    return storage


def test_opencv_reads_points_to_the_last_bit(marker):
    storage = open_storage(write_opencv(marker))
    np.testing.assert_array_equal(storage.getNode("object_points").mat(), marker.xyz)
    assert storage.getNode("ids").mat().ravel().tolist() == [point.id for point in marker.control_points]
    assert storage.getNode("ids").mat().dtype == np.int32
    np.testing.assert_array_equal(storage.getNode("diameters").mat().ravel(), [0.016] * 7)
    assert storage.getNode("name").string() == "markergen-1a2b3c4d"
    assert storage.getNode("unit").string() == "m"


def test_opencv_without_a_tag_has_no_board(plain):
    storage = open_storage(write_opencv(plain))
    assert storage.getNode("tag_ids").empty()
    assert not storage.getNode("object_points").empty()


@pytest.mark.parametrize("family", ["apriltag:36h11", "aruco:DICT_4X4_50"])
def test_opencv_finds_the_tag_by_its_board(marker, family):
    """The corners that detection gives belong to the board's, so the pose of a drawn tag comes out."""
    tagged = replace(marker, tag=Tag(family, 7, 0.04))
    storage = open_storage(write_opencv(tagged))
    corners = storage.getNode("tag_corners").mat()
    assert corners.dtype == np.float32
    dictionary = cv2.aruco.getPredefinedDictionary(int(storage.getNode("tag_dictionary").real()))
    board = cv2.aruco.Board([corners], dictionary, storage.getNode("tag_ids").mat())
    # 10 px a mm, the marker's origin in the middle: image x along X, image y against Y.
    size, center = 400, 499.5
    picture = np.full((1000, 1000), 255, dtype=np.uint8)
    picture[300:700, 300:700] = cv2.aruco.generateImageMarker(dictionary, 7, size)
    finding, numbers, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(picture)
    assert np.ravel(numbers).tolist() == [7]
    object_points, image_points = board.matchImagePoints(finding, numbers)
    expected = object_points.reshape(-1, 3)[:, :2] * [1e4, -1e4] + center
    # Corners of a raster are found to half a pixel without refinement.
    np.testing.assert_allclose(image_points.reshape(-1, 2), expected, atol=1.0)


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in io.StringIO(text) if not line.startswith("#")))


def test_csv_has_every_point_to_the_last_bit(marker):
    rows = table(write_table(marker))
    result = np.array([[float(row[name]) for name in ("x_m", "y_m", "z_m")] for row in rows])
    np.testing.assert_array_equal(result, marker.xyz)
    assert [(int(row["id"]), row["feature"]) for row in rows] == [
        (point.id, point.feature.kind) for point in marker.control_points
    ]
    assert [float(row["inner_diameter_m"]) for row in rows] == [0.008] + [0.0] * 6
    assert list(rows[0]) == ["id", "x_m", "y_m", "z_m", "diameter_m", "inner_diameter_m", "feature"]
    assert "# Tag apriltag:36h11:3" in write_table(marker)
    numbers = np.loadtxt(io.StringIO(write_table(marker)), delimiter=",", skiprows=6, usecols=(1, 2, 3))
    np.testing.assert_array_equal(numbers, marker.xyz)


def test_csv_has_covariances_where_places_were_measured(plain):
    first, *rest = plain.control_points
    reference = replace(plain, control_points=(replace(first, covariance=(1e-10, -2e-11, 4e-10)), *rest))
    rows = table(write_table(reference))
    assert [float(rows[0][name]) for name in ("var_x_m2", "cov_xy_m2", "var_y_m2")] == [1e-10, -2e-11, 4e-10]
    assert rows[1]["var_x_m2"] == ""


def test_ros2_parameters_are_what_ros_allows(marker):
    nodes = yaml.safe_load(write_ros2(marker))
    assert list(nodes) == ["markergen_1a2b3c4d_transform", "markergen_1a2b3c4d_landmarks"]
    transform, landmarks = (node["ros__parameters"] for node in nodes.values())
    assert transform["child_frame_id"] == landmarks["frame_id"] == "markergen_1a2b3c4d"
    assert transform["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    np.testing.assert_array_equal(np.stack([landmarks[axis] for axis in "xyz"], axis=-1), marker.xyz)
    assert landmarks["ids"] == list(range(7))
    assert landmarks["tag"]["corner_x"] == [-0.014, 0.016, 0.016, -0.014]
    assert landmarks["tag"]["corner_y"] == [0.013, 0.013, -0.017, -0.017]

    def check(value):
        """Numbers, texts, and lists of one kind of them."""
        if isinstance(value, dict):
            for item in value.values():
                check(item)
        elif isinstance(value, list):
            assert {type(item) for item in value} in ({int}, {float}, {str})
        else:
            assert type(value) in (int, float, str)

    check(nodes)


def test_kalibr_is_honest_about_the_type(marker):
    target = yaml.safe_load(write_kalibr(marker))
    assert target["target_type"] == "custom"
    np.testing.assert_array_equal([[p["x"], p["y"], p["z"]] for p in target["points"]], marker.xyz)
    assert [p["id"] for p in target["points"]] == list(range(7))
    assert target["tag"]["corners"][0] == [-0.014, 0.013, 0.0]
    assert "circlegrid and aprilgrid" in write_kalibr(marker)


def test_the_bundle_has_the_tag_where_it_is(marker):
    settings = yaml.safe_load(write_bundle(marker))
    assert settings["standalone_tags"] == []
    (bundle,) = settings["tag_bundles"]
    assert bundle["name"] == "markergen_1a2b3c4d"
    place = {"x": 0.001, "y": -0.002, "z": 0.0, "qw": 0.0, "qx": 0.0, "qy": 0.0, "qz": 1.0}
    assert bundle["layout"] == [{"id": 3, "size": 0.03, **place}]
    assert "tag36h11" in write_bundle(marker)


def test_a_bundle_needs_an_apriltag(plain, marker):
    with pytest.raises(InputError, match=r"an AprilTag, found none; .* --tag apriltag"):
        write_bundle(plain)
    with pytest.raises(InputError, match="found aruco:DICT_4X4_50:7"):
        write_bundle(replace(marker, tag=Tag("aruco:DICT_4X4_50", 7, 0.03)))


def test_a_relief_and_bare_points_are_kept(plain, writer):
    if writer is write_bundle:
        return
    bare = replace(plain, control_points=tuple(replace(p, z=0.001 * p.id) for p in plain.control_points))
    assert "0.004" in writer(bare)


def test_corners_of_a_measured_tag_are_those_of_the_print(marker):
    storage = open_storage(write_opencv(measured(marker)))
    corners = storage.getNode("tag_corners").mat()
    np.testing.assert_allclose(corners[:, :2], marker.tag.corners * [0.99, 1.01], atol=1e-8)
