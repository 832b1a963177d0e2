"""How programs keep cameras where their keys alone do not say it: a row for each.

A row names the program, recognizes its files, and renames or converts what its reader would misunderstand.
"""

# tests: tests/read/test_camera_programs.py

import ast
import math
import re
import struct
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from markergen.errors import InputError, brief
from markergen.read.cameras import COVARIANCE, NAMES
from markergen.read.cameras.document import KEYS, Document, Fields, document_of, nested, plain
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


def _colmap(text: str) -> Values:
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
            raise InputError(f"a known camera model {place}", brief(model), f"known: {', '.join(COLMAP)}")
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
    return _colmap("\n".join(lines)) if lines and place == len(data) else {}


def _ost(text: str) -> Values:
    parts = re.findall(r"^([a-z ]+)\n+((?:[-+.\deE ]+\n)+)", text + "\n", re.MULTILINE)
    return {key: numbers.strip() for key, numbers in parts}


def _realsense_text(text: str) -> Values:
    form = rf"\[\s*(\d+)x(\d+)\s+p\[({_N}) ({_N})\]\s+f\[({_N}) ({_N})\]\s+(.+?)\s*\[([^\]]*)\]"
    width, height, cx, cy, fx, fy, model, terms = re.match(form, text.strip()).groups()  # type: ignore[union-attr]
    numbers = {"width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    return {**numbers, "model": model, "D": terms}


TEXTS: dict[str, tuple[str, Callable[[str], Values]]] = {
    "colmap": (r"\A(?:\s*+#[^\n]*+\n)*+\s*+\d++\s++[A-Z][A-Z0-9_]*+\s", _colmap),
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
            try:
                binary = b"\0" in document.data[:8]
                text = document.data.decode("latin-1") if binary else document.text.replace("\r\n", "\n")
                if values := read(text):
                    return name, dict(document_of(values, document.name).fields.values)
            except InputError as error:
                expected, problem, remedy = error.args
                raise InputError(f"{expected} in {document.name}", problem, remedy) from None
            except (ValueError, AttributeError):
                continue
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
