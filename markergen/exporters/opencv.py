"""OpenCV's FileStorage: object points for solvePnP, and the tag as a board of cv2.aruco."""

from collections.abc import Sequence

from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.configuration import diameters, heading, ids, points, tag_corners
from markergen.model.marker import Marker, marker_name
from markergen.model.tag import FAMILIES

SUFFIX = ".opencv.yaml"

BOARD = (
    "Tag: cv2.aruco.Board([tag_corners], cv2.aruco.getPredefinedDictionary(tag_dictionary), tag_ids), with each node",
    "read as fs.getNode(name).mat(), and the dictionary as int(fs.getNode(name).real()).",
)


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Object points and ids for OpenCV's FileStorage, with the tag as an ArUco board."""
    marker = only(markers, SUFFIX)
    return Output(write_opencv(marker).encode())


def write_opencv(marker: Marker) -> str:
    """Write what ``cv2.FileStorage`` reads: matrices ``object_points`` (n, 3), ``ids`` and ``diameters`` (n, 1).

    With a tag also ``tag_corners`` (4, 3) in 32-bit floats and ``tag_ids`` (1, 1), as ``cv2.aruco.Board`` wants them,
    and ``tag_dictionary``, OpenCV's number of the dictionary. As text, since what FileStorage writes, but not what it
    reads, depends on OpenCV's version.
    """
    remarks = [
        "Pose: cv2.solvePnP(object_points, image_points, K, distortion) gives X_camera = R X_marker + t;",
        "row k of object_points is the dot ids[k]; image points are dot centers, pixel (0, 0) the middle of the first.",
    ]
    parts = [
        "%YAML:1.0\n---\n",
        heading(marker, "Board for OpenCV.", *remarks, *(BOARD if marker.tag else ())),
        f'name: "{marker_name(marker)}"\nunit: "m"\n',
        _matrix("ids", [[number] for number in ids(marker)], "i"),
        _matrix("object_points", points(marker), "d"),
        _matrix("diameters", [[diameter] for diameter in diameters(marker)], "d"),
    ]
    if marker.tag is not None:
        import cv2

        dictionary = FAMILIES[marker.tag.family]
        parts += [
            f'tag_dictionary_name: "{dictionary}"\n',
            f"tag_dictionary: {int(getattr(cv2.aruco, dictionary))}\n",
            _matrix("tag_ids", [[marker.tag.id]], "i"),
            _matrix("tag_corners", tag_corners(marker), "f"),
        ]
    return "".join(parts)


def _matrix(name: str, values: Sequence[Sequence[float]], kind: str) -> str:
    size = f"   rows: {len(values)}\n   cols: {len(values[0])}\n   dt: {kind}\n"
    lines = [", ".join(map(repr, row)) for row in values]
    between = ",\n       " if len(values[0]) > 1 else ", "
    return f"{name}: !!opencv-matrix\n{size}   data: [ {between.join(lines)} ]\n"
