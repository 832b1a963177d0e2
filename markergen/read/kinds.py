"""What a file is, by its content: marker, rig, spec, camera, poses, outline, or a table of dots."""

# tests: tests/read/test_kinds.py

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markergen.errors import InputError, brief
from markergen.guard import read
from markergen.model.body_json import is_rig
from markergen.read.cameras import CAMERA_FORMATS
from markergen.read.cameras.document import Document
from markergen.read.cameras.statements import refuse_lenses
from markergen.read.formats import recognized, refuse_unreadable, split
from markergen.read.outlines.formats import OUTLINE_FORMATS, OutlineFile
from markergen.read.poses import POSE_FORMATS
from markergen.read.poses.rows import RowsFile
from markergen.registry import Registry

KINDS = ("marker", "rig", "spec", "camera", "poses", "outline", "points")
GEOJSON = ("Feature", "FeatureCollection", "GeometryCollection", "Polygon", "MultiPolygon", "LineString")
_SPEC = re.compile(rb"^\s*(n|radius|boundary|dot|title|objective|tag|poses|restarts)\s*=", re.MULTILINE)


def kinds_of(path: Path) -> list[str]:
    """Return the kinds of a file, of `KINDS`: nerf's transforms.json has a camera and poses.

    Raises InputError if it cannot be read, is none of these, or is the calibration of a program that is not read.
    """
    name, data = read(Path(split(str(path))[0]), "file")
    is_json, is_toml = data.lstrip()[:1] in (b"{", b"["), path.suffix.lower() == ".toml"
    try:
        content = json.loads(data) if is_json else None
    except (ValueError, RecursionError):
        content = None
    if isinstance(content, Mapping):
        if is_rig(content):
            return ["rig"]
        if "control_points" in content:
            return ["marker"]
    if content.get("type") in GEOJSON if isinstance(content, Mapping) else not is_json and _is_drawing(name, data):
        return ["outline"]
    document = Document(name, data)
    if is_toml and _SPEC.search(data):
        return ["spec"]
    kinds = ["camera"] * _has(CAMERA_FORMATS, document)
    rows = RowsFile(name, data.removeprefix(b"\xef\xbb\xbf"))
    if _has_list(content) if is_json else _has(POSE_FORMATS, rows, True) and not _is_layout(data):
        kinds.append("poses")
    if kinds:
        return kinds
    if _is_layout(data):
        return ["points"]
    refuse_unreadable(name, data)
    refuse_lenses(document)
    if is_toml:
        return ["spec"]
    expected = (
        "a marker.json, rig.json, spec .toml, camera, poses, outline .svg .dxf .geojson .kicad_pcb, or points .csv"
    )
    raise InputError(expected, brief(path.name), "give one of these; docs/formats.md lists the programs")


def _is_drawing(name: str, data: bytes) -> bool:
    # All XML may be SVG to its reader.
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<":
        return re.search(rb"<(\w+:)?svg\b", data[:20_000]) is not None
    return _has(OUTLINE_FORMATS, OutlineFile(name, data))


def _has(formats: Registry[Any], file: object, damaged: bool = False) -> bool:
    """Whether a file has one of the formats; `damaged` if one says that it is."""
    try:
        return recognized(formats, file) is not None
    except InputError:
        return damaged


def _has_list(content: Any) -> bool:
    rows = [content.get(key) for key in ("poses", "frames")] if isinstance(content, Mapping) else [content]
    return any(isinstance(row, list) and all(isinstance(pose, dict) for pose in row) for row in rows)


def _is_layout(data: bytes) -> bool:
    """Whether a table has the places of dots: poses have rotations as well."""
    headings = re.split(r"[,;\t]", data.partition(b"\n")[0].decode("latin-1").lower())
    names = {re.split(r"[\s_\[(/]", word.strip())[0] for word in headings}
    return {"x", "y"} <= names and not names & {"qw", "rx", "r11", "tilt"}
