"""Lists of points: marker.json, tables and configurations of detectors, read as plain text, JSON or YAML."""

import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from markergen.errors import InputError
from markergen.model.findings import brief
from markergen.model.marker import Marker
from markergen.verify.reading import READERS, Page, Reading, circles_of

LARGEST_LIST = 10_000_000

_MATRIX = re.compile(r"^object_points:[^\[]*\[([^\]]*)\]", re.MULTILINE)


@READERS.register(".csv")
def read_csv(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Places of a table with the columns x_m, y_m, z_m."""
    lines = [line for line in _text(data, name).splitlines() if line.strip() and not line.startswith("#")]
    header = [word.strip() for word in lines[0].split(",")] if lines else []
    try:
        columns = [header.index(key) for key in ("x_m", "y_m", "z_m")]
        rows = [[line.split(",")[column] for column in columns] for line in lines[1:]]
    except (ValueError, IndexError):
        raise InputError(
            f"columns x_m, y_m and z_m in {name}", brief(lines[0] if lines else ""), "export it again"
        ) from None
    return _reading("CSV", rows, name)


@READERS.register(".json")
def read_json(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Control points of a marker.json."""
    try:
        content = json.loads(_text(data, name))
        rows = [[point[key] for key in "xyz"] for point in content["control_points"]]
    except (ValueError, RecursionError, KeyError, TypeError):
        raise InputError(f"a marker.json in {name}", "something else", "export it again") from None
    return _reading("JSON", rows, name)


@READERS.register(".opencv.yaml")
def read_opencv(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Object points of an OpenCV FileStorage."""
    match = _MATRIX.search(_text(data, name))
    values = match[1].split(",") if match else []
    if not values or len(values) % 3:
        raise InputError(f"object_points of three columns in {name}", "none", "export it again")
    return _reading("OpenCV", [values[k : k + 3] for k in range(0, len(values), 3)], name)


@READERS.register(".kalibr.yaml")
def read_kalibr(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Points of a target in the style of Kalibr."""
    try:
        rows = [[point[key] for key in "xyz"] for point in _yaml(data, name)["points"]]
    except (KeyError, TypeError):
        raise InputError(f"points with x, y and z in {name}", "something else", "export it again") from None
    return _reading("Kalibr", rows, name)


@READERS.register(".ros2.yaml")
def read_ros2(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Landmarks of ROS 2 parameters."""
    try:
        nodes = [node["ros__parameters"] for node in _yaml(data, name).values()]
        (landmarks,) = [node for node in nodes if "ids" in node]
        rows = list(zip(*(landmarks[key] for key in "xyz"), strict=True))
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"landmarks with x, y and z in {name}", "something else", "export it again") from None
    return _reading("ROS 2", rows, name)


def _text(data: bytes, name: str) -> str:
    if len(data) > LARGEST_LIST:
        raise InputError(f"a list of at most {LARGEST_LIST // 10**6} MB in {name}", "a larger one", "check the path")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"text in {name}", "bytes that are not UTF-8 text", "check the path") from None


def _yaml(data: bytes, name: str) -> Any:
    import yaml

    try:
        return yaml.safe_load(_text(data, name))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InputError(f"complete YAML in {name}", brief(str(error)), "export it again") from None


def _reading(kind: str, rows: Sequence[Sequence[Any]], name: str) -> Reading:
    try:
        places = 1e3 * np.array([[float(value) for value in row] for row in rows], dtype=float).reshape(-1, 3)
    except (ValueError, TypeError, OverflowError):
        raise InputError(f"numbers in {name}", "something else", "export it again") from None
    if not len(places) or not (np.abs(places) < 1e7).all():
        raise InputError(f"places in m in {name}", "none, or numbers that are not finite", "export it again")
    bare = np.column_stack([places[:, :2], np.full(len(places), np.nan)])
    circles = circles_of([tuple(row) for row in bare.tolist()], name)
    return Reading(kind, (Page(circles, heights=places[:, 2]),), drawn=False)
