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
from markergen.read.cameras import format_of, split
from markergen.read.cameras.document import Document
from markergen.read.cameras.statements import refuse_lenses
from markergen.read.outlines.formats import OUTLINE_FORMATS, OutlineFile
from markergen.read.poses import POSE_FORMATS
from markergen.read.poses.rows import RowsFile
from markergen.read.unreadable import refuse_unreadable

KINDS = ("marker", "rig", "spec", "camera", "poses", "outline", "points")
GEOJSON = ("Feature", "FeatureCollection", "GeometryCollection", "Polygon", "MultiPolygon", "LineString")
_SPEC = re.compile(rb"^\s*(n|radius|boundary|dot|title|objective|tag|poses|restarts)\s*=", re.MULTILINE)


def kinds_of(path: Path) -> list[str]:
    """Return the kinds of a file, of `KINDS`: nerf's transforms.json has a camera and poses.

    Raises InputError if it cannot be read, is none of these, or is the calibration of a program that is not read.
    """
    name, data = read(split(path)[0], "file")
    content = _json(data)
    if isinstance(content, Mapping):
        if is_rig(content):
            return ["rig"]
        if "control_points" in content:
            return ["marker"]
        if content.get("type") in GEOJSON:
            return ["outline"]
    if _is_drawing(OutlineFile(name, data)):
        return ["outline"]
    document = Document(name, data)
    if path.suffix.lower() == ".toml" and _SPEC.search(data):
        return ["spec"]
    kinds = [
        kind for kind, fits in (("camera", _is_camera(document)), ("poses", _has_poses(name, data, content))) if fits
    ]
    if kinds:
        return kinds
    if _is_layout(data):
        return ["points"]
    refuse_unreadable(name, data)
    refuse_lenses(document)
    if path.suffix.lower() == ".toml":
        return ["spec"]
    known = "a marker.json, rig.json, spec .toml, camera, poses, outline .svg .dxf .geojson .kicad_pcb, or points .csv"
    raise InputError(known, brief(path.name), "give one of these; docs/formats.md lists the programs")


def _json(data: bytes) -> Any:
    try:
        return json.loads(data) if data.lstrip()[:1] in (b"{", b"[") else None
    except (ValueError, RecursionError):
        return None


def _is_drawing(file: OutlineFile) -> bool:
    # All XML may be SVG to its reader, and all JSON GeoJSON.
    if file.data.lstrip()[:1] in (b"{", b"["):
        return False
    if file.data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<":
        return re.search(rb"<(\w+:)?svg\b", file.data[:20_000]) is not None
    return any(OUTLINE_FORMATS[name].fits(file) for name in OUTLINE_FORMATS)


def _is_camera(document: Document) -> bool:
    try:
        return format_of(document) is not None
    except InputError:
        return False


def _has_poses(name: str, data: bytes, content: Any) -> bool:
    if data.lstrip()[:1] in (b"{", b"["):
        rows = [content.get(key) for key in ("poses", "frames")] if isinstance(content, Mapping) else [content]
        return any(isinstance(row, list) and all(isinstance(pose, dict) for pose in row) for row in rows)
    file = RowsFile(name, data.removeprefix(b"\xef\xbb\xbf"))
    try:
        return any(POSE_FORMATS[form].fits(file) for form in POSE_FORMATS) and not _is_layout(data)
    except InputError:
        return True


def _is_layout(data: bytes) -> bool:
    """Whether a table has the places of dots: poses have rotations as well."""
    headings = re.split(r"[,;\t]", data.partition(b"\n")[0].decode("latin-1").lower())
    names = {re.split(r"[\s_\[(/]", word.strip())[0] for word in headings}
    return {"x", "y"} <= names and not names & {"qw", "rx", "r11", "tilt"}
