"""Read lists of points: marker.json, tables and detector configurations, from plain text, JSON or YAML."""

# tests: tests/verification/test_points.py tests/verification/test_check.py

import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.guard import Content, check_size, text_of
from markergen.model.body import Body
from markergen.model.marker import Marker
from markergen.model.tag import FAMILIES
from markergen.verification.reading import READERS, Page, Reading, circles_of
from markergen.verification.words import listed_ids

StatedTag = tuple[object, object, object]
"""Family, id and corners of a tag as the file states them."""

TOLERANCE = 1e-6
"""Default tolerance of a list in m, also for the corners of its tag: nothing rounds it."""

TAG_ANGLE = 1e-4
"""Maximum error of a tag's orientation in a bundle, degrees."""

APRILTAG = "apriltag:"
"""Prefix of the names of AprilTag families."""


@READERS.register(".csv")
def read_csv(data: bytes, name: str, body: Body) -> Reading:
    """Read points from a table with the columns x_m, y_m, z_m."""
    marker = body.plates[0].marker
    lines = [line for line in _text(data, name).splitlines() if line.strip() and not line.startswith("#")]
    header = [word.strip() for word in lines[0].split(",")] if lines else []
    try:
        columns = [header.index(key) for key in ("x_m", "y_m", "z_m")]
        rows = [[line.split(",")[column] for column in columns] for line in lines[1:]]
        ids = [line.split(",")[header.index("id")] for line in lines[1:]] if "id" in header else None
    except (ValueError, IndexError):
        raise InputError(
            f"columns x_m, y_m and z_m in {name}", brief(lines[0] if lines else ""), "export it again"
        ) from None
    return _reading("CSV", rows, name, gaps=_id_gaps(marker, ids, rows))


@READERS.register(".json")
def read_json(data: bytes, name: str, body: Body) -> Reading:
    """Read the control points of a marker.json."""
    marker = body.plates[0].marker
    try:
        content = json.loads(_text(data, name))
        rows = [[point[key] for key in "xyz"] for point in content["control_points"]]
        ids = [point["id"] for point in content["control_points"]]
        tag = content.get("tag")
        stated = tag and (tag["family"], tag["id"], [corner[:2] for corner in tag["corners"]])
    except (ValueError, RecursionError, KeyError, TypeError):
        raise InputError(f"a marker.json in {name}", "something else", "export it again") from None
    # The file's tag is the designed one, regardless of any measurement of a print.
    gaps = _tag_gaps(marker.as_designed, marker.tag.family if marker.tag else None, stated)
    return _reading("JSON", rows, name, gaps, _id_gaps(marker, ids, rows))


@READERS.register(".opencv.yaml")
def read_opencv(data: bytes, name: str, body: Body) -> Reading:
    """Read the object points and the tag of an OpenCV FileStorage."""
    marker = body.plates[0].marker
    text = _text(data, name)
    values = _matrix(text, "object_points")
    if not values or len(values) % 3:
        raise InputError(f"object_points of three columns in {name}", "none", "export it again")
    family = re.search(r'^tag_dictionary_name: *"(\w+)"', text, re.MULTILINE)
    corners = _matrix(text, "tag_corners")
    stated = (
        (family[1], ",".join(_matrix(text, "tag_ids")).strip(), [corners[k : k + 2] for k in range(0, len(corners), 3)])
        if family
        else None
    )
    gaps = _tag_gaps(marker, FAMILIES[marker.tag.family] if marker.tag else None, stated)
    rows = [values[k : k + 3] for k in range(0, len(values), 3)]
    return _reading("OpenCV", rows, name, gaps, _id_gaps(marker, _matrix(text, "ids"), rows))


@READERS.register(".kalibr.yaml")
def read_kalibr(data: bytes, name: str, body: Body) -> Reading:
    """Read the points of a target in the style of Kalibr."""
    marker = body.plates[0].marker
    try:
        points = _yaml(data, name)["points"]
        rows, ids = [[point[key] for key in "xyz"] for point in points], [point.get("id") for point in points]
    except (KeyError, TypeError, AttributeError):
        raise InputError(f"points with x, y and z in {name}", "something else", "export it again") from None
    return _reading("Kalibr", rows, name, gaps=_id_gaps(marker, ids, rows))


@READERS.register(".ros2.yaml")
def read_ros2(data: bytes, name: str, body: Body) -> Reading:
    """Read the landmarks and the tag of ROS 2 parameters."""
    marker = body.plates[0].marker
    try:
        nodes = [node["ros__parameters"] for node in _yaml(data, name).values()]
        (landmarks,) = [node for node in nodes if "ids" in node]
        rows = list(zip(*(landmarks[key] for key in "xyz"), strict=True))
        tag = landmarks.get("tag")
        stated = tag and (tag["family"], tag["id"], list(zip(tag["corner_x"], tag["corner_y"], strict=True)))
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"landmarks with x, y and z in {name}", "something else", "export it again") from None
    gaps = _tag_gaps(marker, marker.tag.family if marker.tag else None, stated)
    return _reading("ROS 2", rows, name, gaps, _id_gaps(marker, landmarks["ids"], rows))


@READERS.register(".apriltag.yaml")
def read_bundle(data: bytes, name: str, body: Body) -> Reading:
    """Read the bundles of apriltag_ros, which have tags but no dots."""
    marker = body.plates[0].marker
    content = _yaml(data, name)
    try:
        tags = [tag for bundle in content["tag_bundles"] for tag in bundle["layout"]]
        ids = [int(tag["id"]) for tag in tags]
        numbers = [[float(tag[key]) for key in ("size", "x", "y", "z", "qx", "qy", "qz", "qw")] for tag in tags]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError(f"a bundle of tags in {name}", "something else", "export it again") from None
    if not np.isfinite(numbers).all() or not all(any(row[4:]) for row in numbers):
        raise InputError(f"finite places and unit quaternions in {name}", "others", "export it again")
    family = re.search(r"tag_family: *'tag(\w+)'", _text(data, name))
    gaps = _bundle_gaps(marker, family and family[1], ids, numbers)
    return Reading("AprilTag", (), TOLERANCE, drawn=False, tag_gaps=gaps)


def _bundle_gaps(
    marker: Marker, family: str | None, ids: Sequence[int], numbers: Sequence[Sequence[float]]
) -> tuple[str, ...]:
    tag = marker.tag
    if tag is None or not tag.family.startswith(APRILTAG):
        return (f"the marker has {'no tag' if tag is None else f'the tag {tag}'}, and the file an AprilTag",)
    family_name = tag.family.removeprefix(APRILTAG)
    if family not in (None, family_name):
        return (f"its tags are of the family {family}, not {family_name}",)
    if tag.id not in ids:
        return (f"its tag is {', '.join(map(str, ids[:5])) or 'missing'}, not {tag.id}",)
    gaps = [f"it has {len(ids)} tags, and the marker one"] if len(ids) > 1 else []
    size, *place = numbers[ids.index(tag.id)]
    wanted = tag.side * (marker.print_scale[0] * marker.print_scale[1]) ** 0.5
    if abs(size - wanted) > TOLERANCE:
        gaps.append(f"the tag {tag} is {1e3 * size:.6g} mm large, not {1e3 * wanted:.6g} mm")
    off = np.array(place[:3]) - np.append(tag.center * np.array(marker.print_scale), 0.0)
    if np.linalg.norm(off) > TOLERANCE:
        axes = ", ".join(f"{axis} {1e3 * value:+.4g} mm" for axis, value in zip("xyz", off, strict=True))
        gaps.append(f"the tag {tag} is off by {axes}")
    quaternion = np.array(place[3:]) / np.linalg.norm(place[3:])
    # AprilTag's own library sees the tag upside down: half a turn about z is the quaternion (0, 0, 1, 0).
    angle = 2 * np.degrees(np.arctan2(np.linalg.norm(quaternion[[0, 1, 3]]), abs(quaternion[2])))
    if angle > TAG_ANGLE:
        gaps.append(f"the tag {tag} is turned by {angle:.4g} degrees against the way AprilTag's own library sees it")
    return tuple(gaps)


def _matrix(text: str, key: str) -> list[str]:
    """Numbers of a FileStorage matrix, row by row; empty if it is missing."""
    match = re.search(rf"^{key}:[^\[]*\[([^\]]*)\]", text, re.MULTILINE)
    return match[1].split(",") if match else []


def _tag_gaps(marker: Marker, family: str | None, stated: StatedTag | None) -> tuple[str, ...]:
    """Errors of a tag as a file states it; `family` is the format's name for the marker's family."""
    tag = marker.tag
    if tag is None or not stated:
        return () if (tag is None) == (not stated) else (f"the tag {tag} is missing" if tag else "an extra tag",)
    if (stated[0], str(stated[1])) != (family, str(tag.id)):
        return (f"its tag is {brief(str(stated[0]))}:{brief(str(stated[1]))}, not {family}:{tag.id}",)
    try:
        corners = np.array(stated[2], dtype=float)
    except (ValueError, TypeError, OverflowError):
        return ("the corners of the tag are not numbers",)
    # Negated, so that nan fails too.
    if corners.shape != (4, 2) or not (np.abs(corners - tag.corners[:, :2] * marker.print_scale) <= TOLERANCE).all():
        return (f"the corners of the tag {tag} are elsewhere",)
    return ()


def _text(data: bytes, name: str) -> str:
    check_size(Content(name, data), "list")
    return text_of(Content(name, data))


def _yaml(data: bytes, name: str) -> Any:
    import yaml

    try:
        return yaml.safe_load(_text(data, name))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InputError(f"complete YAML in {name}", brief(str(error)), "export it again") from None


def _id_gaps(marker: Marker, stated: object, rows: Sequence[Sequence[Any]]) -> tuple[str, ...]:
    """Dots that have the ids of others; another number of rows is reported elsewhere."""
    wanted = {point.id: np.array([point.x, point.y]) for point in marker.control_points}
    if not isinstance(stated, list) or not stated:
        return ()
    try:
        ids = [int(value) for value in stated]
        places = np.array([[float(value) for value in row[:2]] for row in rows])
    except (ValueError, TypeError, OverflowError):
        return ("its ids are not whole numbers",)
    if len(ids) != len(places) or len(set(ids)) != len(ids) or not set(ids) <= wanted.keys():
        return ("its ids are not the marker's",)
    names, centers = list(wanted), np.array(list(wanted.values()))
    off = np.linalg.norm(places[:, None] - centers, axis=2)
    nearest = [names[k] for k in off.argmin(axis=1)]
    wrong = [
        name for name, here, away in zip(ids, nearest, off.min(axis=1), strict=True) if name != here and away < 1e-4
    ]
    return (f"{listed_ids(wrong)} at the place of another",) if wrong else ()


def _reading(
    kind: str, rows: Sequence[Sequence[Any]], name: str, tag_gaps: tuple[str, ...] = (), gaps: tuple[str, ...] = ()
) -> Reading:
    try:
        places = 1e3 * np.array([[float(value) for value in row] for row in rows], dtype=float).reshape(-1, 3)
    except (ValueError, TypeError, OverflowError):
        raise InputError(f"numbers in {name}", "something else", "export it again") from None
    if not len(places) or not (np.abs(places) < 1e7).all():
        raise InputError(f"coordinates in m in {name}", "none, or numbers that are not finite", "export it again")
    bare = np.column_stack([places[:, :2], np.full(len(places), np.nan)])
    circles = circles_of([tuple(row) for row in bare.tolist()], name)
    pages = (Page(circles, heights=places[:, 2]),)
    return Reading(kind, pages, TOLERANCE, drawn=False, placed=True, tag_gaps=tag_gaps, id_gaps=gaps)
