"""Points: the marker itself, a table of its dots, and configurations for detection software.

Each format is its row and the function below it. All are short texts in m, in the marker frame, and need neither sheet
nor solid.
"""
# tests: tests/exporters/test_configurations.py tests/exporters/test_apriltag.py

import csv
from collections.abc import Callable, Sequence
from io import StringIO
from typing import Any

import markergen
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, Exporter, ExportOptions, Output, only
from markergen.model.body_json import body_to_json
from markergen.model.detector_json import detector_json
from markergen.model.marker import Marker, marker_name
from markergen.model.rig import Rig
from markergen.model.tag import FAMILIES
from markergen.read.cameras.document import opencv_matrix, yaml_text
from markergen.units import picometers

FRAME = (
    "Frame: the marker's, x right, y up, z out of the printed face toward the viewer.",
    "Unit: m.",
)

APRILTAG = "apriltag:"
"""Prefix of the names of AprilTag families."""

TURNED = {"qw": 0.0, "qx": 0.0, "qy": 0.0, "qz": 1.0}
"""Rotation of a tag in the marker frame as AprilTag's own library sees it: half a turn about z.

Tags are drawn as OpenCV has them, and its AprilTag families are the official ones turned by 180 degrees, every tag of
every family. OpenCV's detectors call such a tag upright; AprilTag's see it upside down.
"""

SEEN = "AprilTag's own library sees this tag turned by 180 degrees: what is top left here is bottom right there."

UNKNOWN_TO_ROS = ("36h10", "apriltag_ros does not know this family, only the AprilTag library does: 36h11 suits both.")
"""Family without its prefix, and what to say about it."""

NOT_KALIBR = "Kalibr knows three targets: checkerboard, circlegrid and aprilgrid, all of them grids; this is none."
"""Reason why Kalibr cannot use it. An aprilgrid has at least 3 x 3 tags, whose black border is two cells wide; a
circlegrid at least 3 x 3 equal dots, unlike the key ring.
"""

BOARD = (
    "Tag: cv2.aruco.Board([tag_corners], cv2.aruco.getPredefinedDictionary(tag_dictionary), tag_ids), with each node",
    "read as fs.getNode(name).mat(), and the dictionary as int(fs.getNode(name).real()).",
)

COLUMNS = ("id", "x_m", "y_m", "z_m", "diameter_m", "inner_diameter_m", "feature")
MEASURED = ("var_x_m2", "cov_xy_m2", "var_y_m2")


def write_record(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:  # noqa: ARG001  (same signature for every exporter)
    """Canonical marker.json or rig.json, the only complete format, including bare points; no option has an effect."""
    return Output(body_to_json(only(bodies, ".json")))


EXPORTERS.register(".json")(
    Exporter(write_record, "the marker itself", rig_description="the rig itself, all its markers in one file")
)


def write_detector(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """See `model.detector_json`; its name is the file's."""
    return Output(detector_json([only(bodies, ".detector.json")], [options.stem]))


EXPORTERS.register(".detector.json")(
    Exporter(
        write_detector,
        "all that markergen-detect needs to find it",
        rig_description="all that markergen-detect needs to find it",
    )
)


def _row(
    suffix: str,
    description: str,
    text_of: Callable[[Marker], str],
    notes_of: Callable[[Marker], tuple[str, ...]] = lambda _: (),
) -> None:
    """Register a format that is a text of one marker."""

    def write(markers: Sequence[Marker], options: ExportOptions) -> Output:  # noqa: ARG001  (same signature for every exporter)
        marker = only(markers, suffix)
        return Output(text_of(marker).encode(), notes_of(marker))

    EXPORTERS.register(suffix)(Exporter(write, description))


def write_table(marker: Marker) -> str:
    """Write comment lines (``#``), the column names, and a row for each control point.

    Covariances of measured positions have their own columns if there are any.
    """
    measured = any(point.covariance for point in marker.control_points)
    tag: tuple[str, ...] = ()
    if marker.tag is not None:
        corners = ", ".join(f"({x!r}, {y!r})" for x, y, _ in tag_corners(marker))
        tag = (f"Tag {marker.tag}: side {tag_side(marker)!r}, corners from the top left clockwise {corners}.",)
    text = StringIO()
    text.write(comment_lines(marker, "Control points.", *tag))
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(COLUMNS + MEASURED * measured)
    for point in marker.control_points:
        feature = point.feature
        lengths = (point.x, point.y, point.z, feature.diameter, feature.inner_diameter)
        row = [point.id, *map(picometers, lengths), feature.kind]
        lines.writerow([*row, *(point.covariance or ("", "", ""))] if measured else row)
    return text.getvalue()


def write_opencv(marker: Marker) -> str:
    """Write matrices for ``cv2.FileStorage``: ``object_points`` (n, 3), ``ids`` and ``diameters`` (n, 1).

    With a tag also ``tag_corners`` (4, 3) in 32-bit floats and ``tag_ids`` (1, 1), as ``cv2.aruco.Board`` expects them,
    and ``tag_dictionary``, OpenCV's number of the dictionary. Written as text, because the output of FileStorage,
    unlike the input that it accepts, depends on OpenCV's version.
    """
    remarks = [
        "Pose: cv2.solvePnP(object_points, image_points, K, distortion) gives X_camera = R X_marker + t;",
        "row k of object_points is the dot ids[k]; image points are dot centers, pixel (0, 0) the middle of the first.",
    ]
    parts = [
        "%YAML:1.0\n---\n",
        comment_lines(marker, "Board for OpenCV.", *remarks, *(BOARD if marker.tag else ())),
        f'name: "{marker_name(marker)}"\nunit: "m"\n',
        opencv_matrix("ids", [[number] for number in ids(marker)], "i"),
        opencv_matrix("object_points", points(marker), "d"),
        opencv_matrix("diameters", [[diameter] for diameter in diameters(marker)], "d"),
    ]
    if marker.tag is not None:
        import cv2

        dictionary = FAMILIES[marker.tag.family]
        parts += [
            f'tag_dictionary_name: "{dictionary}"\n',
            f"tag_dictionary: {int(getattr(cv2.aruco, dictionary))}\n",
            opencv_matrix("tag_ids", [[marker.tag.id]], "i"),
            opencv_matrix("tag_corners", tag_corners(marker), "f"),
        ]
    return "".join(parts)


def write_ros2(marker: Marker) -> str:
    """Write parameters of two nodes: ``<frame>_transform`` for tf2_ros' static broadcaster, ``<frame>_landmarks``.

    ROS 2 parameters support lists of numbers but not nested lists, so the landmarks are one list per coordinate.
    """
    frame = frame_name(marker)
    x, y, z = (list(values) for values in zip(*points(marker), strict=True))
    landmarks: dict[str, Any] = {
        "frame_id": frame, "ids": ids(marker), "x": x, "y": y, "z": z, "diameter": diameters(marker),
    }  # fmt: skip
    if marker.tag is not None:
        corner_x, corner_y, _ = (list(values) for values in zip(*tag_corners(marker), strict=True))
        family, tag = marker.tag.family, {"id": marker.tag.id, "size": tag_side(marker)}
        landmarks["tag"] = {"family": family, **tag, "corner_x": corner_x, "corner_y": corner_y}
    transform = {
        "frame_id": "map",
        "child_frame_id": frame,
        "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
        "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }
    remarks = (
        "Transform: parameters of tf2_ros::StaticTransformBroadcasterNode. It is the identity until translation and",
        "rotation say where in the map the marker hangs.",
        "Landmarks: dot ids[k] is at (x[k], y[k], z[k]) in the marker's frame.",
        *(("Tag: size is the side of its black square; corners are clockwise from the top left.",) * bool(marker.tag)),
        *_seen(marker),
    )
    nodes = {"transform": transform, "landmarks": landmarks}
    body = {f"{frame}_{name}": {"ros__parameters": values} for name, values in nodes.items()}
    return comment_lines(marker, "Parameters for ROS 2.", *remarks) + yaml_text(body)


def write_kalibr(marker: Marker) -> str:
    """Write ``target_type: custom`` and a list of points with id, position and diameter in m.

    Kalibr rejects all types other than its grids, and no layout designed by markergen is one of these, so the file uses
    a new type instead of claiming a wrong one.
    """
    body: dict[str, Any] = {
        "target_type": "custom",
        "unit": "m",
        "points": [
            {"id": number, "x": x, "y": y, "z": z, "diameter": diameter}
            for number, (x, y, z), diameter in zip(ids(marker), points(marker), diameters(marker), strict=True)
        ],
    }
    if marker.tag is not None:
        tag = {"family": marker.tag.family, "id": marker.tag.id, "size": tag_side(marker)}
        body["tag"] = {**tag, "corners": tag_corners(marker)}
    return comment_lines(marker, "Target in the style of Kalibr.", NOT_KALIBR, *_seen(marker)) + yaml_text(body)


def write_bundle(marker: Marker) -> str:
    """Write ``tag_bundles`` with the tag as its only member: the bundle's frame is the marker's.

    apriltag_ros has x to the right, y up and z toward the viewer in both frames, of the bundle and of an official tag;
    ours is `TURNED`.

    Raises
    ------
    InputError
        If the marker has no tag, or one that is not an AprilTag.
    """
    tag = marker.tag
    if tag is None or not tag.family.startswith(APRILTAG):
        tag_text = "none" if tag is None else str(tag)
        raise InputError("a marker with an AprilTag", tag_text, "design it with --tag apriltag:36h11:0, for example")
    x, y = (picometers(value * scale) for value, scale in zip(tag.center, marker.print_scale, strict=True))
    layout: list[dict[str, Any]] = [{"id": tag.id, "size": tag_side(marker), "x": x, "y": y, "z": 0.0, **TURNED}]
    body = {"standalone_tags": [], "tag_bundles": [{"name": frame_name(marker), "layout": layout}]}
    family = f"tag{tag.family.removeprefix(APRILTAG)}"
    title = "Tag bundle for apriltag_ros (tags.yaml)."
    remarks = (
        f"Set tag_family: '{family}' in settings.yaml; size is the side of the black square.",
        "The tag is printed as OpenCV has it, which is upside down for AprilTag's own library: hence qz: 1.",
        *_unknown(marker),
    )
    return comment_lines(marker, title, *remarks) + yaml_text(body)


def _unknown(marker: Marker) -> tuple[str, ...]:
    family, note = UNKNOWN_TO_ROS
    return (note,) if marker.tag and marker.tag.family == APRILTAG + family else ()


def _seen(marker: Marker) -> tuple[str, ...]:
    return (SEEN,) if marker.tag and marker.tag.family.startswith(APRILTAG) else ()


_row(".csv", "table of the dots, in m", write_table)
_row(".opencv.yaml", "OpenCV: object points and ids, tag as an ArUco board", write_opencv)
_row(
    ".ros2.yaml",
    "ROS 2: static transform and landmarks",
    write_ros2,
    lambda _: ("The transform from map is the identity: set it to where the marker hangs.",),
)
_row(".kalibr.yaml", "target in the style of Kalibr", write_kalibr, lambda _: (NOT_KALIBR,))
_row(".apriltag.yaml", "apriltag_ros: bundle of an AprilTag", write_bundle, _unknown)


def comment_lines(marker: Marker, title: str, *remarks: str) -> str:
    """Comment lines that identify the marker, its frame and unit, followed by remarks."""
    name = f"Marker {marker_name(marker)}: {len(marker)} dots, written by markergen {markergen.__version__}."
    corrected = () if marker.as_designed is marker else ("Places are those measured on the print.",)
    return "".join(f"# {line}\n" for line in (title, name, *FRAME, *corrected, *remarks))


def frame_name(marker: Marker) -> str:
    """Name for frames and nodes, ``markergen_<spec hash>``, of letters, digits and ``_``."""
    return "".join(letter if letter.isalnum() else "_" for letter in marker_name(marker))


def points(marker: Marker) -> list[list[float]]:
    """Positions (n, 3) of the control points in m, in the order of `ids`."""
    return [[*map(picometers, (point.x, point.y, point.z))] for point in marker.control_points]


def ids(marker: Marker) -> list[int]:
    """Identifiers of the control points."""
    return [point.id for point in marker.control_points]


def diameters(marker: Marker) -> list[float]:
    """Diameters of the dots in m."""
    return [picometers(point.feature.diameter) for point in marker.control_points]


def tag_side(marker: Marker) -> float:
    """Side of the tag's black square on the print in m; the geometric mean if the printer's scales differ."""
    x, y = marker.print_scale
    return picometers(marker.tag.side * (x * y) ** 0.5) if marker.tag else 0.0


def tag_corners(marker: Marker) -> list[list[float]]:
    """Corners (4, 3) of the tag's black square on the print, m: top left, top right, bottom right, bottom left."""
    if marker.tag is None:
        return []
    return [[*map(picometers, corner), 0.0] for corner in marker.tag.corners * marker.print_scale]
