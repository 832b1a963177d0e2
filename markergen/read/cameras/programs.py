"""Cameras as other programs keep them: a row for each says where its numbers are, and a pixel's center.

Every row makes a table that `calibrated_camera` reads: the lens under any name, coefficients as a list or one by one.
"""

# tests: tests/read/test_camera_programs.py

import ast
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.read.cameras import CAMERA_FORMATS, CameraFormat
from markergen.read.cameras.calibration import COEFFICIENTS, FX, HEIGHT, WIDTH, calibrated_camera, no_choice
from markergen.read.cameras.document import Document, Fields, document_of
from markergen.read.remarks import remark


def _plain_values(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if not isinstance(value, dict)}


def _merged(document: Document, *tables: Mapping[str, Any]) -> dict[str, Any]:
    """Join tables of one camera, which must not have a key in common."""
    values: dict[str, Any] = {}
    for table in tables:
        if twice := values.keys() & table.keys():
            raise InputError(f"every number once in {document.name}", f"{brief(min(twice))} twice", "remove one")
        values |= table
    return values


def _chosen(document: Document, choice: str | None, cameras: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the name and values of the camera after ``#``, or of the only one; ``cam1`` and ``1`` are the same."""
    name = next(iter(cameras), "") if choice is None else choice.removeprefix("cam")
    values = cameras.get(name)
    if not isinstance(values, dict) or (choice is None and len(cameras) > 1):
        listed = ", ".join(f"#{brief(key)[1:-1]}" for key in list(cameras)[:10]) or "none"
        raise InputError(f"a camera's number after {document.name}, such as #0", listed, "choose one")
    return name, values


def _basalt(document: Document) -> Callable[[str | None], Fields]:
    value = document.fields.fields("value0")
    cameras, sizes = value.values.get("intrinsics"), value.values.get("resolution")
    document.fields.used.update(("value0.intrinsics", "value0.resolution"))
    if not (isinstance(cameras, list) and isinstance(sizes, list) and len(cameras) == len(sizes)):
        raise InputError(f"as many intrinsics as resolutions in {document.name}", "others", "correct the file")

    def table(choice: str | None) -> Fields:
        name, camera = _chosen(document, choice, {str(i): camera for i, camera in enumerate(cameras)})
        inner = Fields(document.name, camera, f"value0.intrinsics.{name}").fields("intrinsics")
        values = _merged(document, _plain_values(camera), inner.values, {"resolution": sizes[int(name)]})
        return document.table(values, f"value0.intrinsics.{name}")

    return table


def _camodocal(document: Document) -> Callable[[str | None], Fields]:
    root = document.fields
    projection = root.fields("projection_parameters").values
    distortion = root.fields("distortion_parameters").values if root.find("distortion_parameters") else {}
    # Kannala-Brandt's coefficients count from that of the angle itself, which is 1.
    angles = {"k2": "k1", "k3": "k2", "k4": "k3", "k5": "k4", "mu": "fx", "mv": "fy", "u0": "cx", "v0": "cy"}
    renamed = {angles[key] if "mu" in projection and key in angles else key: item for key, item in projection.items()}
    return _single(document, _merged(document, _plain_values(root.values), distortion, renamed))


def _depthai(document: Document) -> Callable[[str | None], Fields]:
    document.fields.used.add("cameraData")
    sockets = [item for item in document.fields.values["cameraData"] if isinstance(item, list) and len(item) == 2]
    cameras = {item[0]: item[1] for item in sockets if isinstance(item[0], str)}

    def table(choice: str | None) -> Fields:
        name, camera = _chosen(document, choice, cameras)
        fields = Fields(document.name, camera, f"cameraData.{name}", document.fields.used)
        kind = {0: "perspective", 1: "fisheye"}.get(fields.whole("cameraType"), "equirectangular")
        values = {**camera, "cameraType": kind}
        if kind == "fisheye" and isinstance(camera.get("distortionCoeff"), list):
            values["distortionCoeff"] = camera["distortionCoeff"][:4]
        return document.table(values, f"cameraData.{name}")

    return table


def _mrcal(document: Document) -> Callable[[str | None], Fields]:
    # A Python dict; what it was optimized from may have megabytes.
    text = re.sub(r"['\"]optimization_inputs['\"]\s*:\s*b(['\"])[^'\"]*\1\s*,?", "", document.text)
    try:
        values = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        values = None
    if not isinstance(values, dict):
        raise InputError(f"a Python dict in {document.name}", "a damaged one", "write it again")
    fields = document_of({str(key): value for key, value in values.items()}, document.name).fields
    intrinsics, lens = fields.numbers("intrinsics"), fields.text("lensmodel")
    known = re.fullmatch(r"LENSMODEL_(PINHOLE|OPENCV(4|5|8|12))", lens)
    count = 4 + int((known and known[2]) or 0)
    if known and len(intrinsics) != count:
        raise InputError(f"{count} intrinsics of {lens} in {document.name}", str(len(intrinsics)), "correct the file")
    others = {key: value for key, value in fields.values.items() if key != "intrinsics"}
    numbers = dict(zip(("fx", "fy", "cx", "cy"), intrinsics, strict=False))
    coefficients = {"D": intrinsics[4:]} if len(intrinsics) > 4 else {}
    # Thin prisms of zero are none.
    return _single(document, {**others, "lensmodel": "opencv" if count == 16 else lens, **numbers, **coefficients})


def _nerf(document: Document) -> Callable[[str | None], Fields]:
    root = document.fields
    frames = root.values.get("frames", [])
    single = next((key for frame in frames if isinstance(frame, dict) for key in FX if key in frame), None)
    if single is not None:
        raise InputError(f"one camera for all frames in {document.name}", f"{single} in a frame", "write it alone")
    values = {key: value for key, value in root.values.items() if key != "frames"}
    root.used.update(("frames",))
    if root.find("fl_x") and not root.find("fl_y"):
        values["fl_y"] = values["fl_x"]
        remark(f"{document.name}: no fl_y, which is taken as fl_x")
    if root.find(*FX) is None:
        width, height = root.size or (root.number(*WIDTH), root.number(*HEIGHT))
        focal = width / 2 / math.tan(root.number("camera_angle_x") / 2)
        values = {"cx": width / 2, "cy": height / 2, "fl_x": focal, **values}
    table = document.table(values)
    for axis, side in (("x", WIDTH), ("y", HEIGHT)):
        if table.find(f"camera_angle_{axis}") and table.find(*side):
            focal = table.number(f"fl_{axis}" if table.find(f"fl_{axis}") else "fl_x")
            stated = table.number(*side) / 2 / math.tan(table.number(f"camera_angle_{axis}") / 2)
            if not math.isclose(stated, focal, rel_tol=1e-3):
                raise InputError(
                    f"fl_{axis} as of camera_angle_{axis} in {document.name}",
                    f"{focal:.6g} and {stated:.6g}",
                    "remove the wrong one",
                )
    return _checked_choice(document, table)


def _orb(document: Document) -> Callable[[str | None], Fields]:
    """ORB-SLAM's settings, whose keys have a prefix: Camera.fx, or Camera1.fx beside Camera.width."""
    shared = _prefixed(document, "Camera.")
    numbered = {number: _prefixed(document, f"Camera{number}.") for number in ("1", "2")}
    cameras = {number: {**shared, **values} for number, values in numbered.items() if values} or {"1": shared}

    def table(choice: str | None) -> Fields:
        name, values = _chosen(document, choice, cameras)
        return document.table(values, "Camera" if name == "1" and not numbered["1"] else f"Camera{name}")

    return table


def _prefixed(document: Document, prefix: str) -> dict[str, Any]:
    items = document.fields.values.items()
    return {key[len(prefix) :]: value for key, value in items if key.lower().startswith(prefix.lower())}


def _photonvision(document: Document) -> Callable[[str | None], Fields]:
    values = dict(document.fields.values)
    # Until 2024 its coefficients had this name.
    if document.fields.find(*COEFFICIENTS) is None and "cameraExtrinsics" in values:
        values["D"] = values.pop("cameraExtrinsics")
        document.fields.used.add("cameraExtrinsics")
    return _single(document, values)


def _realsense(document: Document) -> Callable[[str | None], Fields]:
    values = dict(document.fields.values)
    # Its inverse lens is none where nothing is distorted.
    if "inverse" in str(values.get("model", "")).lower() and not any(document.fields.numbers("coeffs")):
        values |= {"model": "none", "coeffs": []}
    return _single(document, values)


def _single(document: Document, values: Mapping[str, Any], path: str = "") -> Callable[[str | None], Fields]:
    return _checked_choice(document, document.table(values, path))


def _checked_choice(document: Document, table: Fields) -> Callable[[str | None], Fields]:
    def chosen(choice: str | None) -> Fields:
        no_choice(document.name, choice)
        return table

    return chosen


Row = tuple[str, Callable[[Fields], object], Callable[[Document], Callable[[str | None], Fields]], float]
"""Typical contents, whether a file has them, its table by a camera's name, and the coordinate of a pixel's center."""


def _has(*keys: str) -> Callable[[Fields], bool]:
    return lambda fields: set(keys) <= fields.values.keys()


PROGRAMS: dict[str, Row] = {
    "basalt": ("value0 with intrinsics, resolution", _has("value0"), _basalt, 0.0),
    "camodocal": ("model_type, projection_parameters", _has("projection_parameters"), _camodocal, 0.0),
    "depthai": ("cameraData", lambda fields: isinstance(fields.values.get("cameraData"), list), _depthai, 0.0),
    "nerf": (
        "fl_x, cx, w, frames",
        lambda fields: _has("fl_x")(fields) or _has("camera_angle_x", "frames")(fields), _nerf, 0.5,
    ),
    "orb-slam": (
        "Camera.fx, Camera.width", lambda fields: {"Camera.fx", "Camera1.fx"} & fields.values.keys(), _orb, 0.0,
    ),
    "photonvision": ("cameraIntrinsics, distCoeffs", _has("cameraIntrinsics"), _photonvision, 0.0),
    "realsense": ("fx, ppx, coeffs", _has("fx", "ppx"), _realsense, 0.0),
    "single numbers": (
        "fx, fy, cx, cy, k1, k2", lambda fields: _has("fx", "cx")(fields) and fields.find("k1", *COEFFICIENTS),
        lambda document: _single(document, document.fields.values), 0.0,
    ),
    "stella_vslam": (
        "Camera with fx, cols, rows",
        lambda fields: isinstance(fields.values.get("Camera"), dict) and "fx" in fields.values["Camera"],
        lambda document: _single(document, document.fields.fields("Camera").values, "Camera"), 0.0,
    ),
}  # fmt: skip
"""Programs by name; mrcal's files are no YAML."""


def _format(row: Row, fits: Callable[[Document], bool]) -> CameraFormat:
    signs, _, table, corner = row

    def read(document: Document, choice: str | None) -> Camera:
        chosen = table(document)(choice)
        around = [] if row[2] is _mrcal else [document.fields]
        return calibrated_camera(chosen, around, corner)

    return CameraFormat(signs, fits, read, lambda document, choice: table(document)(choice))


def _fits(row: Row) -> Callable[[Document], bool]:
    return lambda document: bool(row[1](document.fields))


def _is_mrcal(document: Document) -> bool:
    return re.search(rb"^\s*\{\s*(#[^\n]*\n\s*)*['\"]lensmodel['\"]", document.data, re.MULTILINE) is not None


for _name, _row in PROGRAMS.items():
    CAMERA_FORMATS.register(_name)(_format(_row, _fits(_row)))
CAMERA_FORMATS.register("mrcal")(_format(("lensmodel, intrinsics, imagersize", bool, _mrcal, 0.0), _is_mrcal))
