"""Camera files of keys and values: found wherever their numbers are, as programs mean them, and written.

A camera is a table with a matrix or focal lengths. Where a file has one, all that is around it and about a camera
belongs to it; where it has several, in a list, in tables of their own or under keys such as K_1 and D_1, each has a
name for ``path#NAME``. Where the keys alone do not say it, a row of `PROGRAMS` names the program, recognizes its files,
and renames or converts what would be misunderstood.

A file is written in the format that its name says, as text, because the output of OpenCV's FileStorage, unlike the
input that it accepts, depends on its version.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py tests/read/test_camera_programs.py

import ast
import json
import math
import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from markergen.errors import InputError, among, brief, with_place
from markergen.files import write_atomic
from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, COVARIANCE, NAMES, CameraFormat, CameraRecord
from markergen.read.cameras.calibration import calibrated_camera, without_k3
from markergen.read.cameras.covariance import read_camera_covariance
from markergen.read.cameras.document import (
    KEYS,
    KNOWN,
    SIDES,
    Document,
    Fields,
    document_of,
    endings_of,
    nested,
    opencv_matrix,
    plain,
    tables_in,
    yaml_text,
)
from markergen.read.formats import written_format
from markergen.read.remarks import remark

Values = dict[str, Any]

# --- Texts without keys -----------------------------------------------------------------------------------------------

_N = r"[-+.\deE]+"


def _dso(text: str) -> Values:
    first, size = (line.split() for line in text.splitlines()[:2])
    model = first.pop(0) if first[0].isalpha() else "FOV" if len(first) == 5 and float(first[4]) else "Pinhole"
    fx, fy, cx, cy = map(float, first[:4])
    width, height = map(float, size)
    if cx < 1 and cy < 1:  # Relative to the image, whose pixels then begin at integers.
        fx, fy, cx, cy = fx * width, fy * height, cx * width - 0.5, cy * height - 0.5
    terms = [] if model == "Pinhole" else first[4:]
    return {"model": model, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "image_size": size, "D": terms}


def _matrix(text: str) -> Values:
    rows = [[float(word) for word in line.replace(",", " ").split()] for line in text.splitlines() if line.strip()]
    # A matrix alone, or in the corner of a 4 x 4 one.
    is_whole = [len(row) for row in rows] in ([3] * 3, [4] * 4) and rows[3:] in ([], [[0, 0, 0, 1]])
    zeros = [rows[0][1], rows[1][0], *rows[2][:2], *(row[3] for row in rows[:3] if len(row) > 3)] if is_whole else [1]
    return {} if any(zeros) or rows[0][0] < 2 else {"K": [row[:3] for row in rows[:3]]}


def _mrcal(text: str) -> Values:
    # A Python dict; what it was optimized from may have megabytes.
    text = re.sub(r"['\"]optimization_inputs['\"]\s*:\s*b(['\"])[^'\"]*\1\s*,?", "", text)
    try:
        values = ast.literal_eval(text.strip())
        intrinsics, lens = list(map(float, values.pop("intrinsics"))), str(values.pop("lensmodel"))
    except (ValueError, SyntaxError, RecursionError, MemoryError, KeyError, TypeError, AttributeError):
        raise InputError("a Python dict with lensmodel and intrinsics", "a damaged one", "write it again") from None
    model = re.fullmatch(r"LENSMODEL_(PINHOLE|OPENCV(4|5|8|12))", lens)
    count = 4 + int((model and model[2]) or 0)
    if model and len(intrinsics) != count:
        raise InputError(f"{count} intrinsics of {lens}", str(len(intrinsics)), "correct the file")
    # Thin prisms of zero are none.
    numbers = dict(zip(("fx", "fy", "cx", "cy"), intrinsics, strict=False))
    return {**values, **numbers, "D": intrinsics[4:], "lensmodel": "opencv" if count == 16 else lens}


def _middlebury(text: str) -> Values:
    lines = (line.partition("=") for line in text.split("\n") if "=" in line)
    values = {key.strip(): value.strip() for key, _, value in lines}
    return {
        key: {"K": value.strip("[]").replace(";", " ")} if key[:3] == "cam" else value for key, value in values.items()
    }


COLMAP: dict[str, tuple[int, str, tuple[int, ...], int]] = {
    "SIMPLE_PINHOLE": (1, "none", (), 0),
    "PINHOLE": (2, "none", (), 0),
    "SIMPLE_RADIAL": (1, "radtan", (0,), 4),
    "RADIAL": (1, "radtan", (0, 1), 4),
    "OPENCV": (2, "radtan", (0, 1, 2, 3), 4),
    "OPENCV_FISHEYE": (2, "equidistant", (0, 1, 2, 3), 4),
    "FULL_OPENCV": (2, "rational", tuple(range(8)), 8),
    "FOV": (2, "FOV", (0,), 1),
    "SIMPLE_RADIAL_FISHEYE": (1, "equidistant", (0,), 4),
    "RADIAL_FISHEYE": (1, "equidistant", (0, 1), 4),
    "THIN_PRISM_FISHEYE": (2, "THIN_PRISM_FISHEYE", tuple(range(8)), 8),
    "SIMPLE_FISHEYE": (1, "equidistant", (), 4),
    "FISHEYE": (2, "equidistant", (), 4),
}
"""Number of focal lengths, lens, which of its coefficients are parameters (the rest are 0), and how many there are; the
first eleven in the order of their numbers in cameras.bin."""
COLMAP_ORDER = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS"


def _colmap_text(text: str) -> Values:
    """Cameras of a cameras.txt by number; with a single one also what stands beside it as ``# key: value``."""
    comments = [line.strip().lstrip("# ") for line in text.splitlines() if line.lstrip()[:1] == "#"]
    lines = [line.split() for line in text.splitlines() if line.strip() and line.lstrip()[:1] != "#"]
    for comment in comments:
        header = re.findall(r"[A-Z_]{5,}", comment.upper())
        if "CAMERA_ID" in header and header != COLMAP_ORDER.split():
            raise InputError(f"columns {COLMAP_ORDER}", brief(" ".join(header)), "reorder the columns")
    cameras: Values = {}
    for line in lines:
        place = f"at camera {line[0][:20]}"
        if len(line) < len(COLMAP_ORDER.split()):
            raise InputError(f"{COLMAP_ORDER} {place}", brief(" ".join(line)), "correct it")
        number, model, width, height, *parameters = line
        if model not in COLMAP:
            raise InputError(f"a known camera model {place}", brief(model), among(model, COLMAP))
        focals, lens, places, length = COLMAP[model]
        count = focals + 2 + len(places)
        if len(parameters) != count:
            raise InputError(f"{count} parameters of {model} {place}", str(len(parameters)), "correct it")
        if number in cameras:
            raise InputError("every camera once", f"{brief(number)} twice", "remove one")
        terms = dict(zip(places, parameters[focals + 2 :], strict=True))
        numbers = dict(zip(("fx", "fy", "cx", "cy"), [parameters[0], *parameters[focals - 1 :]], strict=False))
        cameras[number] = {"width": width, "height": height, **numbers, "distortion_model": lens,
                           "D": [terms.get(index, "0") for index in range(length)]}  # fmt: skip
    pairs = [comment.partition(":") for comment in comments if len(cameras) == 1]
    return cameras | {key: value.strip() for key, _, value in pairs if key in (NAMES, COVARIANCE)}


def _colmap_bytes(text: str) -> Values:
    """Cameras of a cameras.bin, whose bytes are the characters of a text; none if it is something else."""
    data, lines, place = text.encode("latin-1"), [], 8
    numbered = list(COLMAP)[:11]
    for _ in range(int.from_bytes(data[:8], "little")):
        if len(data) < place + 24:
            return {}
        number, model, width, height = struct.unpack_from("<IiQQ", data, place)
        if not 0 <= model < len(numbered):
            return {}
        focals, _, places, _ = COLMAP[numbered[model]]
        count = focals + 2 + len(places)
        place += 24 + 8 * count
        if place > len(data):
            return {}
        values = struct.unpack_from(f"<{count}d", data, place - 8 * count)
        lines.append(" ".join(map(str, (number, numbered[model], width, height, *values))))
    return _colmap_text("\n".join(lines)) if lines and place == len(data) else {}


def _ost(text: str) -> Values:
    parts = re.findall(r"^([a-z ]+)\n+((?:[-+.\deE ]+\n)+)", text + "\n", re.MULTILINE)
    return {key: numbers.strip() for key, numbers in parts}


def _realsense_text(text: str) -> Values:
    form = rf"\[\s*(\d+)x(\d+)\s+p\[({_N}) ({_N})\]\s+f\[({_N}) ({_N})\]\s+(.+?)\s*\[([^\]]*)\]"
    width, height, cx, cy, fx, fy, model, terms = re.match(form, text.strip()).groups()  # type: ignore[union-attr]
    numbers = {"width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    return {**numbers, "model": model, "D": terms}


TEXTS: dict[str, tuple[str, Callable[[str], Values]]] = {
    "colmap": (r"\A(?:\s*+#[^\n]*+\n)*+\s*+\d++\s++[A-Z][A-Z0-9_]*+\s", _colmap_text),
    "colmap cameras.bin": (r"\A[\s\S]{2}\0{6}", _colmap_bytes),
    "dso": (rf"\A(?:(?:Pinhole|RadTan|EquiDistant|KannalaBrandt|FOV) )?{_N}(?: {_N}){{3,8}} *\n\d+ \d+ *\n"
            rf"(?:crop|full|none|{_N} {_N})", _dso),
    "matrix": (r"\A[-+.\deE,\s]{17,}\Z", _matrix),
    "mrcal": (r"\A(?:\s|#[^\n]*\n)*\{\s*(?:#[^\n]*\n\s*)*['\"]lensmodel['\"]", _mrcal),
    "middlebury": (r"\Acam0=\[", _middlebury),
    "ros ost.txt": (r"(?:\A|\n)\[image\]\s+width\s+\d", _ost),
    "realsense text": (rf"\A\s*\[\s*\d+x\d+\s+p\[{_N} {_N}\]\s+f\[", _realsense_text),
}  # fmt: skip
"""Texts that are no YAML, JSON, TOML or XML: how they are recognized, and what makes keys and values, or none."""

_BEGINNING = 20_000
"""Number of characters at the beginning of a text that are looked at: their headers come first, COLMAP's with a
covariance."""


def _of_text(document: Document) -> tuple[str, Values]:
    """Return the name in `TEXTS` of a file and its keys and values; none if it is no such text."""
    beginning = document.data[:_BEGINNING].decode("latin-1").replace("\r\n", "\n")
    for name, (form, read) in TEXTS.items():
        if re.search(form, beginning):
            with suppress(ValueError, AttributeError), with_place(f"in {document.name}"):
                binary = b"\0" in document.data[:8]
                text = document.data.decode("latin-1") if binary else document.text.replace("\r\n", "\n")
                if values := read(text):
                    return name, dict(document_of(values, document.name).fields.values)
    return "", {}


@lru_cache(maxsize=1)  # Every format asks for the same document.
def values_of(document: Document) -> tuple[str, Values]:
    """Return the name of the program that a file with keys is of, and its keys and values, as the program means them.

    Raises InputError if it has no keys and values, or the program's are incomplete.
    """
    name, values = _of_text(document)
    if not name:
        values = dict(document.fields.values)
        name = next((name for name, row in PROGRAMS.items() if row.fits(values)), "keys")
        values = PROGRAMS[name].fix(document, nested(values))
    return name, values


# --- Keys -------------------------------------------------------------------------------------------------------------


def _camodocal(document: Document, values: Values) -> Values:
    del document
    projection = values["projection_parameters"]
    if not (isinstance(projection, dict) and "mu" in projection):
        return values
    # Kannala-Brandt's coefficients count from that of the angle itself, which is 1.
    angles = {"k2": "k1", "k3": "k2", "k4": "k3", "k5": "k4", "mu": "fx", "mv": "fy", "u0": "cx", "v0": "cy"}
    return {**values, "projection_parameters": {angles.get(key, key): item for key, item in projection.items()}}


def _matlab(document: Document, values: Values) -> Values:
    """Rows come before columns, in K if it is transposed and in ImageSize; the center of the first pixel is (1, 1)."""
    key = Fields(document.name, values).key(*KEYS["matrix"])
    numbers = Fields(document.name, values).numbers(key)
    columns = [*numbers[::3], *numbers[1::3], *numbers[2::3]] if len(numbers) == 9 and not numbers[2] else numbers
    others = {name: value for name, value in values.items() if name not in (key, "ImageSize") and name[:4] != "Esti"}
    return {**others, "K": columns, "image_shape": values["ImageSize"]}


def _nerf(document: Document, values: Values) -> Values:
    root = Fields(document.name, values, size=document.size)
    if _has_single(values):
        return values
    values = {key: value for key, value in values.items() if key != "frames"}
    angles = {axis: root.number(f"camera_angle_{axis}") for axis in "xy" if root.find(f"camera_angle_{axis}")}
    if angles and (root.size or root.find(*KEYS["width"])):
        sides = root.size or (
            root.whole(*KEYS["width"]),
            root.whole(*KEYS["height"]) if root.find(*KEYS["height"]) else 0,
        )
        for (axis, angle), side in zip(angles.items(), sides, strict=False):
            if not 0 < angle < math.pi:
                raise InputError(f"a camera_angle_{axis} of 0 to pi in {document.name}", f"{angle:g}", "correct it")
            focal = side / 2 / math.tan(angle / 2)
            key = f"fl_{axis}"
            stated = root.number(key if root.find(key) else "fl_x") if root.find("fl_x") else focal
            if not math.isclose(stated, focal, rel_tol=1e-3):
                problem = f"{stated:.6g} and {focal:.6g}"
                raise InputError(f"{key} as of camera_angle_{axis} in {document.name}", problem, "remove the wrong one")
            values.setdefault(key, str(focal))
        values = {"cx": str(sides[0] / 2), "cy": str(sides[1] / 2), **values}
    if "fl_x" in values and "fl_y" not in values:
        values["fl_y"] = values["fl_x"]
        remark(f"{document.name}: no fl_y, which is taken as fl_x")
    return values


def _opensfm(document: Document, values: Values) -> Values:
    """Lengths are shares of the longer side, from the center of the image."""
    cameras = {}
    for key, camera in values.items():
        table = Fields(document.name, camera, key)
        width, height = table.whole("width"), table.whole("height")
        longer = max(width, height)
        focal = [table.number(*names) * longer for names in (("focal_x", "focal"), ("focal_y", "focal"))]
        names = ("c_x", "c_y") if table.find("focal_x", "c_x", "c_y") else ()
        off = [table.number(name) * longer for name in names] or [0.0, 0.0]
        numbers = {"fx": focal[0], "fy": focal[1], "cx": (width - 1) / 2 + off[0], "cy": (height - 1) / 2 + off[1]}
        others = {name: value for name, value in camera.items() if name[:2] != "c_" and name[:5] != "focal"}
        cameras[key] = {**others, **{name: repr(value) for name, value in numbers.items()}}
    return cameras


def _realsense(document: Document, values: Values) -> Values:
    # Its inverse lens is none where nothing is distorted.
    if "inverse" in str(values.get("model", "")).lower() and not any(Fields(document.name, values).numbers("coeffs")):
        return {**values, "model": "none", "coeffs": []}
    return values


def _has(*keys: str) -> Callable[[Mapping[str, Any]], bool]:
    return lambda values: set(keys) <= values.keys()


def _any(*keys: str) -> Callable[[Mapping[str, Any]], bool]:
    return lambda values: any(plain(key) in set(map(plain, keys)) for key in values)


class Program(NamedTuple):
    """Typical contents, whether values are the program's, their conversion, the coordinate of a pixel's center."""

    signs: str
    fits: Callable[[Mapping[str, Any]], bool]
    fix: Callable[[Document, Values], Values] = lambda _, values: values
    corner: float = 0.0


OWN = {"width", "height", "fx", "fy", "cx", "cy", "distortion", "camera_parameters", "camera_covariance",
       "avg_reprojection_error"}  # fmt: skip
"""Keys of markergen's own table."""


def _is_own(values: Mapping[str, Any]) -> bool:
    camera = values.get("camera")
    return ("fx" in values and values.keys() <= OWN) or (isinstance(camera, dict) and _is_own(camera))


PROGRAMS: dict[str, Program] = {
    "kalibr": Program("cam0 with camera_model, intrinsics, resolution",
                      lambda values: any(re.fullmatch(r"cam\d{1,3}", key) for key in values)),
    "basalt": Program("value0 with intrinsics, resolution", _has("value0")),
    "camodocal": Program("model_type, projection_parameters", _has("projection_parameters"), _camodocal),
    "depthai": Program("cameraData", _has("cameraData")),
    "matlab": Program("RadialDistortion, ImageSize", _has("RadialDistortion", "ImageSize"), _matlab, 1.0),
    "nerf": Program(
        "fl_x, cx, w, frames",
        lambda values: "fl_x" in values or {"camera_angle_x", "frames"} <= values.keys() or _has_single(values),
        _nerf, 0.5),
    "opensfm": Program(
        "projection_type, focal_x, c_x",
        lambda values: bool(values) and all(isinstance(v, dict) and "projection_type" in v for v in values.values()),
        _opensfm),
    "photonvision": Program("cameraIntrinsics, distCoeffs", _has("cameraIntrinsics")),
    "realsense": Program("fx, ppx, coeffs", _has("fx", "ppx"), _realsense),
    "markergen": Program("width, height, fx, fy, cx, cy, distortion", _is_own),
    "ros": Program(
        "camera_matrix or K, and distortion_model",
        lambda values: _any("camera_info")(values) or (_any(*KEYS["matrix"])(values) and _any(*KEYS["model"])(values))),
    "opencv": Program("camera_matrix, distortion_coefficients, image_width", _any(*KEYS["matrix"])),
    "orb-slam": Program("Camera.fx, Camera.width", _any("Camera.fx", "Camera1.fx")),
    **{name: Program(name, lambda _: False) for name in TEXTS},
    **{name: Program(f"{COLMAP_ORDER}{what}", lambda _: False, corner=0.5)
       for name, what in (("colmap", " in lines"), ("colmap cameras.bin", " as bytes"))},
    "keys": Program("a matrix or fx, fy, cx, cy under any key", bool),
}  # fmt: skip
"""Programs by name; the last takes what no other has."""


def _has_single(values: Mapping[str, Any]) -> bool:
    frames = values.get("frames")
    return isinstance(frames, list) and any(isinstance(frame, dict) and "fl_x" in frame for frame in frames)


MOST_CAMERAS = 10_000
"""Maximum number of tables and cameras of a file: nerf's may have a camera for every image."""

PART = re.compile(
    r"^(?!.*(board|pattern|target|grid|extrin|pose|stereo|imu|depth)).*?(intrin|distor|calib|cam|param|projection|lens|"
    r"fisheye|(?<![a-z])size$|(img|image)_?size$|resolution|focal|principal|matrix|model$|colou?r$|rgb$|left$|right$|"
    r"value0|data$|result|optics)",
    re.IGNORECASE,
)
"""Keys of tables that belong to the camera around them."""
WHOLE = ("roi", NAMES, COVARIANCE)
"""Keys of tables that have keys such as width for something else."""
_ABOUT = re.compile("model|type", re.IGNORECASE)
_SIDE = r"left|right|cam\d{1,3}|l|r|a|b|\d{1,3}"
_GROUPED = (re.compile(rf"(.+?)_?({_SIDE})", re.IGNORECASE), re.compile(rf"({_SIDE})_(.+)", re.IGNORECASE))
"""Keys of one of several cameras beside each other."""
_LABELS = ("name", "camera_name", "label", "serial", "serialnumber", "id")


@dataclass
class _Found:
    """A camera: the names on the way to it, and its values by their places, some of which have other names."""

    way: tuple[str, ...]
    values: dict[str, Any] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)


def cameras_of(document: Document) -> dict[str, Fields]:
    """Return the cameras of a file by name; the name of a single one is empty."""
    _, values = values_of(document)
    root = Fields(document.name, values, size=document.size)
    document.tables[:] = [root]
    cameras = _search(values, (), set())
    ways = [camera.way for camera in cameras]
    # The first words that differ, or all of them.
    parting = next((i for i in range(20) if len({way[i : i + 1] for way in ways}) == len(ways)), 0)
    labels = [".".join(way[parting : parting + 1] if parting else way[:1]) if len(ways) > 1 else "" for way in ways]
    labels = labels if len(set(labels)) == len(labels) else [".".join(way) for way in ways]
    return {
        label: Fields(document.name, camera.values, "", root.used, document.size, camera.names)
        for label, camera in zip(labels, cameras, strict=True)
    }


def _search(node: Mapping[str, Any], way: tuple[str, ...], visited: set[int]) -> list[_Found]:
    """Find the cameras in a table; each table is visited once, since aliases of YAML may be endless."""
    if id(node) in visited or len(visited) > MOST_CAMERAS:
        return []
    visited.add(id(node))
    inner: list[_Found] = []
    for key, value in node.items():
        for index, (name, child) in enumerate(tables_in(value) if key not in WHOLE else ()):
            cameras = _search(child, (*way, key, *([name] if name else [])), visited)
            for camera in cameras if name else []:
                # A list beside a list of cameras has an item for each.
                camera.values |= _items(node, value, index, way)
            inner += cameras
    groups = _groups(node, way)
    if groups or (not inner and _is_camera(node, way[-1:])):
        inner += groups or [_Found(way)]
    if len(inner) == 1 and not groups:
        inner[0].values |= dict(_leaves(node, way))
    else:
        grouped = {place for camera in groups for place in camera.values}
        scalars = {key: value for key, value in node.items() if not isinstance(value, dict)}
        leaves = [(place, value) for place, value in _leaves(scalars, way) if place not in grouped]
        around = {place: value for place, value in leaves if _ABOUT.search(place) or KNOWN & {*endings_of(place)}}
        for camera in inner:
            camera.values |= around
    return inner


def _leaves(node: Mapping[str, Any], way: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Places and values of what belongs to a camera, in this table and in those that are parts of it."""
    for key, value in node.items():
        here = (*way, key)
        if isinstance(value, dict) and "data" not in value and key not in WHOLE:
            if PART.search(key):
                yield from _leaves(value, here)
        elif not (isinstance(value, list) and any(True for _ in tables_in(value))):
            yield ".".join(here), value


def _items(node: Mapping[str, Any], cameras: Sequence[Any], index: int, way: tuple[str, ...]) -> dict[str, Any]:
    lists = {
        key: value for key, value in node.items() if plain(key) in KNOWN and isinstance(value, list)
        and len(value) == len(cameras) and value is not cameras and all(isinstance(item, list) for item in value)
    }  # fmt: skip
    return {".".join((*way, key)): value[index] for key, value in lists.items()}


def _is_camera(node: Mapping[str, Any], parent: tuple[str, ...]) -> bool:
    """True for a table with a matrix or focal lengths, or one that lacks them beside a size and coefficients."""
    keys = {name: value for key, value in node.items() for name in endings_of(".".join((*parent, key)))}

    def has(*kinds: str) -> bool:
        return any(
            not isinstance(keys.get(plain(name), {}), dict) or "data" in keys.get(plain(name), {})
            for kind in kinds
            for name in KEYS[kind]
        )

    return has("matrix", "fx", "focal") or (has("size", "width") and has("coefficients") and has("model"))


def _groups(node: Mapping[str, Any], way: tuple[str, ...]) -> list[_Found]:
    """Cameras whose keys end or begin with a number or a side, such as K_00 and D_00."""
    matrices, groups = set(map(plain, KEYS["matrix"])), dict[str, _Found]()
    if any(plain(key) in matrices for key in node):
        return []
    for key, value in node.items():
        several = isinstance(value, list | dict) or (isinstance(value, str) and len(value.split()) > 1)
        for form, base in ((_GROUPED[0], 1), (_GROUPED[1], 2)):
            match = form.fullmatch(key)
            if match and plain(match[base]) in (KNOWN if several else SIDES):
                camera = groups.setdefault(match[3 - base].lower(), _Found((*way, match[3 - base])))
                place = ".".join((*way, key))
                camera.values[place], camera.names[place] = value, match[base]
                break
    return [camera for camera in groups.values() if matrices & set(map(plain, camera.names.values()))]


def camera_table(document: Document, choice: str | None) -> Fields:
    """Return the table of the camera after ``#``, or of the only one, or of cam0; raises InputError."""
    cameras = cameras_of(document)
    names = list(cameras)
    if choice is None and (len(names) == 1 or "cam0" in names or len({_numbers(cameras[name]) for name in names}) == 1):
        return cameras["cam0" if "cam0" in names else names[0]]
    listed = ", ".join(brief(name)[1:-1] for name in names[:20])
    if choice is None:
        raise InputError(f"a camera's name after {document.name}, such as #{names[0][:40]}", listed, "choose one")
    for name, table in cameras.items():
        stated = [str(table.values[key]).strip("\"'") for label in _LABELS if (key := table.find(label))]
        ways = {word for place in table.values for word in place.split(".")} if len(names) == 1 else set()
        if choice in (name, f"cam{name}", *stated, *ways) or name in (f"cam{choice}", f"cam_{choice}"):
            return table
    if len(names) == 1:
        raise InputError(f"no camera name after {document.name}", brief(choice), "leave it out: it holds one camera")
    raise InputError(f"the camera {brief(choice)} in {document.name}", listed, f"add #{names[0][:40]} to the path")


def _numbers(table: Fields) -> str:
    """All that is known of a camera, to compare it: nerf may repeat one for every image."""
    names = ((endings_of(table.names.get(place, place))[-1], value) for place, value in table.values.items())
    return repr(sorted((name, str(value)) for name, value in names if name in KNOWN))


def keyed(name: str, **written: Any) -> CameraFormat:
    """Return the format of a program in `PROGRAMS`, with the endings, `holds` and `write` of one that is written."""

    def fits(document: Document) -> bool:
        return values_of(document)[0] == name and bool(cameras_of(document))

    def read(document: Document, choice: str | None) -> Camera:
        return calibrated_camera(camera_table(document, choice), PROGRAMS[name].corner)

    return CameraFormat(PROGRAMS[name].signs, fits, read, table=camera_table, **written)


def camera_file(
    camera: Camera, path: str | os.PathLike[str], covariance: ArrayLike | None = None, rms: float | None = None
) -> None:
    """Write a camera to a file; see `Camera.save`."""
    write_atomic(Path(path), camera_bytes(camera, path, covariance, rms))


def camera_bytes(
    camera: Camera, path: str | os.PathLike[str], covariance: ArrayLike | None = None, rms: float | None = None
) -> bytes:
    """Return what `camera_file` writes, for a caller that replaces several files together."""
    form, ending = check_camera_path(path)
    checked = None if covariance is None else read_camera_covariance(np.asarray(covariance), camera)
    if rms is not None and not (isfinite(rms) and rms >= 0):
        raise InputError("the RMS of the residuals in px", brief(rms), "give 0 or more, or leave it out")
    record = CameraRecord(camera, checked, None if rms is None else float(rms))
    assert form.write is not None
    if not form.holds(record):
        name = Path(path).name
        stem = name[: -len(ending)].rstrip(".") or "camera"
        forms = [CAMERA_FORMATS[name] for name in CAMERA_FORMATS]
        able = [form.endings[0].lstrip(".") for form in forms if form.write and form.holds(record)]
        raise InputError(
            f"a lens that {name} can hold",
            f"{camera.distortion.model} with {' '.join(camera.distortion.names)}",
            "write " + " or ".join(ending if ending == "cameras.txt" else f"{stem}.{ending}" for ending in able),
        )
    return form.write(record, ending).encode()


def check_camera_path(path: str | os.PathLike[str]) -> tuple[CameraFormat, str]:
    """Return the format that a file name stands for, and its ending, before any work is done for it."""
    return written_format(CAMERA_FORMATS, "a camera file", path)


# --- Formats ----------------------------------------------------------------------------------------------------------

LENSES = ("none", "radtan", "rational", "equidistant")
"""Models that OpenCV and ROS have."""


def _opencv(record: CameraRecord, ending: str) -> str:
    camera = record.camera
    values = {
        "image_width": camera.width,
        "image_height": camera.height,
        "fisheye_model": int(camera.distortion.model == "equidistant"),
        "camera_matrix": camera.matrix,
        "distortion_coefficients": camera.cv2_distortion[:, None],
        **record.extras,
    }
    syntax = {".xml": _xml, ".json": _json}.get(ending, _yaml)
    return syntax({key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()})


def _is_matrix(value: Any) -> bool:
    return isinstance(value, list) and isinstance(value[0], list)


def _yaml(values: Mapping[str, Any]) -> str:
    items = values.items()
    lines = [opencv_matrix(key, it, "d") if _is_matrix(it) else f"{key}: {json.dumps(it)}\n" for key, it in items]
    return "%YAML:1.0\n---\n" + "".join(lines)


def _json(values: Mapping[str, Any]) -> str:
    def stored(value: Any) -> Any:
        if not _is_matrix(value):
            return value
        size = {"type_id": "opencv-matrix", "rows": len(value), "cols": len(value[0]), "dt": "d"}
        return {**size, "data": [entry for row in value for entry in row]}

    return json.dumps({key: stored(value) for key, value in values.items()}, indent=1) + "\n"


def _xml(values: Mapping[str, Any]) -> str:
    lines = []
    for key, value in values.items():
        if _is_matrix(value):
            size = f"<rows>{len(value)}</rows><cols>{len(value[0])}</cols><dt>d</dt>"
            rows = "\n".join(" ".join(map(repr, row)) for row in value)
            lines.append(f'<{key} type_id="opencv-matrix">{size}<data>\n{rows}</data></{key}>\n')
        else:
            lines.append(f"<{key}>{' '.join(map(str, value)) if isinstance(value, list) else repr(value)}</{key}>\n")
    return f'<?xml version="1.0"?>\n<opencv_storage>\n{"".join(lines)}</opencv_storage>\n'


ROS_MODELS = {"none": "plumb_bob", "radtan": "plumb_bob", "rational": "rational_polynomial"}
"""Names that sensor_msgs has for our lens models, where they differ."""


def _ros(record: CameraRecord, _: str) -> str:
    """A camera_info, in which the rectified image has the matrix of the raw one."""
    camera, coefficients = record.camera, record.camera.cv2_distortion
    if len(coefficients) == 4 and camera.distortion.model == "radtan":
        # camera_info's plumb_bob has five coefficients.
        coefficients = np.append(coefficients, 0.0)
    return yaml_text(
        {
            "image_width": camera.width,
            "image_height": camera.height,
            "camera_name": "camera",
            "camera_matrix": camera.matrix,
            "distortion_model": ROS_MODELS.get(camera.distortion.model, camera.distortion.model),
            "distortion_coefficients": coefficients[None],
            "rectification_matrix": np.eye(3),
            "projection_matrix": np.column_stack([camera.matrix, np.zeros(3)]),
            **record.extras,
        }
    )


def _kalibr_holds(record: CameraRecord) -> bool:
    lens = without_k3(record).camera.distortion
    return lens.model in ("none", "equidistant") or (lens.model == "radtan" and len(lens.coefficients) == 4)


def _kalibr(record: CameraRecord, _: str) -> str:
    record = without_k3(record)
    camera = record.camera
    # Kalibr takes floats alone as intrinsics, and does not read a chain without a topic.
    table = {
        "cam_overlaps": [],
        "camera_model": "pinhole",
        "distortion_coeffs": list(camera.distortion.coefficients),
        "distortion_model": camera.distortion.model,
        "intrinsics": [float(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy)],
        "resolution": [camera.width, camera.height],
        "rostopic": "/cam0/image_raw",
        **record.extras,
    }
    return yaml_text({"cam0": table})


def _markergen(record: CameraRecord, _: str) -> str:
    values = record.camera.as_dict() | record.extras
    lens = values.pop("distortion", None)
    if COVARIANCE in values:
        values[COVARIANCE] = values[COVARIANCE].tolist()
    # Numbers, texts and lists are the same in TOML and JSON.
    lines = [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    lines += ["", "[distortion]", *(f"{key} = {json.dumps(value)}" for key, value in lens.items())] if lens else []
    return "\n".join(lines) + "\n"


def _colmap(record: CameraRecord, _: str) -> str:
    record = without_k3(record)
    camera, lens, corner = record.camera, record.camera.distortion, PROGRAMS["colmap"].corner
    # Padded with zeros: a radial lens with k3 is a rational one without a denominator.
    model = next(
        name
        for name, (focals, kind, places, _) in COLMAP.items()
        if focals == 2
        and (kind == lens.model or (kind == "rational" and lens.model == "radtan"))
        and len(places) >= len(lens.coefficients)
    )
    padding = [0.0] * (len(COLMAP[model][2]) - len(lens.coefficients))
    parameters = [camera.fx, camera.fy, camera.cx + corner, camera.cy + corner, *lens.coefficients, *padding]
    lines = ["# Camera list with one line of data per camera:", "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for key, value in record.extras.items():
        lines.append(f"# {key}: {' '.join(map(str, np.ravel(value).tolist()))}")
    lines.append(f"1 {model} {camera.width} {camera.height} {' '.join(repr(float(value)) for value in parameters)}")
    return "\n".join(lines) + "\n"


def _is_opencv(record: CameraRecord) -> bool:
    return record.camera.distortion.model in LENSES


WRITTEN: dict[str, dict[str, Any]] = {
    "opencv": {"endings": (".yaml", ".yml", ".xml", ".json"), "holds": _is_opencv, "write": _opencv},
    "ros": {"endings": (".ros.yaml", ".ros.yml"), "holds": _is_opencv, "write": _ros},
    "kalibr": {"endings": (".kalibr.yaml", ".kalibr.yml"), "holds": _kalibr_holds, "write": _kalibr},
    "colmap": {"endings": ("cameras.txt", ".colmap.txt"), "holds": _is_opencv, "write": _colmap},
    "markergen": {"endings": (".toml",), "write": _markergen},
}
"""Formats that are written."""

for _name in PROGRAMS:
    CAMERA_FORMATS.register(_name)(keyed(_name, **WRITTEN.get(_name, {})))
