"""COLMAP's cameras.txt, one camera per line, CAMERA_ID MODEL WIDTH HEIGHT PARAMS, and its cameras.bin.

COLMAP measures pixels from the corner of the image, so that the center of the first is at (0.5, 0.5). It skips lines
that begin with #, where a covariance is written.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import re
import struct
from collections.abc import Sequence

import numpy as np

from markergen.errors import InputError, brief
from markergen.model.camera import Camera, Distortion
from markergen.read.cameras import CAMERA_FORMATS, CameraFormat, CameraRecord
from markergen.read.cameras.calibration import make_camera, with_place, without_k3
from markergen.read.cameras.document import Document, Fields

CORNER = 0.5
"""Coordinate in px of a pixel's center, measured from its corner."""

MODELS: dict[str, tuple[int, str, tuple[int, ...]]] = {
    "SIMPLE_PINHOLE": (1, "none", ()),
    "PINHOLE": (2, "none", ()),
    "SIMPLE_RADIAL": (1, "radtan", (0,)),
    "RADIAL": (1, "radtan", (0, 1)),
    "OPENCV": (2, "radtan", (0, 1, 2, 3)),
    "FULL_OPENCV": (2, "rational", tuple(range(8))),
    "SIMPLE_FISHEYE": (1, "equidistant", ()),
    "FISHEYE": (2, "equidistant", ()),
    "SIMPLE_RADIAL_FISHEYE": (1, "equidistant", (0,)),
    "RADIAL_FISHEYE": (1, "equidistant", (0, 1)),
    "OPENCV_FISHEYE": (2, "equidistant", (0, 1, 2, 3)),
}
"""Number of focal lengths, distortion model, and indices of its coefficients that are parameters; the rest are 0."""

NUMBERED = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
            "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE")  # fmt: skip
"""Models by their numbers in cameras.bin."""

MOST_CAMERAS = 10_000
"""Maximum number of cameras; a file may have a camera for every image."""

ORDER = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS"

_LENGTHS = {"none": 0, "radtan": 4, "rational": 8, "equidistant": 4}
_CAMERA = re.compile(r"\d+\s+[A-Z][A-Z0-9_]*\s")


def _unpacked(data: bytes) -> list[str] | None:
    """Lines of cameras.txt that hold what a cameras.bin does; None if it is none."""
    if len(data) < 32 or not 1 <= (count := int.from_bytes(data[:8], "little")) <= MOST_CAMERAS:
        return None
    lines, place = [], 8
    for _ in range(count):
        if len(data) < place + 24:
            return None
        number, model, width, height = struct.unpack_from("<IiQQ", data, place)
        if not 0 <= model < len(NUMBERED):
            return None
        focals, _, terms = MODELS.get(NUMBERED[model], (2, "", (0,) * (8 if NUMBERED[model][0] == "T" else 1)))
        parameters = focals + 2 + len(terms)
        place += 24 + 8 * parameters
        if place > len(data):
            return None
        values = struct.unpack_from(f"<{parameters}d", data, place - 8 * parameters)
        lines.append(" ".join(map(str, (number, NUMBERED[model], width, height, *values))))
    return lines if place == len(data) else None


def _lines(document: Document) -> list[str]:
    unpacked = _unpacked(document.data)
    if unpacked is not None:
        return unpacked
    for line in document.text.splitlines():
        header = re.findall(r"[A-Z_]{5,}", line.partition("#")[2].upper())
        if "CAMERA_ID" in header and header != ORDER.split():
            raise InputError(f"columns {ORDER} in {document.name}", brief(" ".join(header)), "reorder the columns")
    return document.lines


def _fits(document: Document) -> bool:
    if b"\0" in document.data[:8]:
        return _unpacked(document.data) is not None
    return bool(document.lines) and _CAMERA.match(document.lines[0]) is not None


def _read(document: Document, choice: str | None) -> Camera:
    lines = _lines(document)
    numbers = [line.split(maxsplit=1)[0] for line in lines]
    rows = dict(zip(numbers, lines, strict=True))
    if len(rows) < len(numbers):
        twice = next(number for i, number in enumerate(numbers) if number in numbers[:i])
        raise InputError(f"every camera once in {document.name}", f"{brief(twice)} twice", "remove one")
    if choice is None and len(rows) > 1:
        names = ", ".join(brief(key) for key in list(rows)[:10])
        expected = f"the camera's number after the path, such as {document.name}#{next(iter(rows))[:20]}"
        raise InputError(expected, f"{len(rows)} cameras: {names}", "choose one")
    number = next(iter(rows)) if choice is None else choice
    if number not in rows:
        names = ", ".join(brief(key) for key in list(rows)[:10])
        raise InputError(f"the camera {brief(number)} in {document.name}", f"only {names}", "check the number")
    return _camera(rows[number].split(), document.name, number)


def _camera(cells: Sequence[str], file: str, number: str) -> Camera:
    place = f"camera {number[:20]}"
    if len(cells) < 4:
        expected = f"CAMERA_ID MODEL WIDTH HEIGHT PARAMS at {place} in {file}"
        raise InputError(expected, brief(" ".join(cells)), "correct it")
    _, model, width, height, *parameters = cells
    if model not in MODELS:
        raise InputError(f"a known camera model at {place} in {file}", brief(model), f"known: {', '.join(MODELS)}")
    table = Fields(file, {"WIDTH": width, "HEIGHT": height, "PARAMS": parameters}, place)
    focals, name, places = MODELS[model]
    values = table.numbers("PARAMS")
    count = focals + 2 + len(places)
    if len(values) != count:
        raise InputError(f"{count} parameters of {model} at {table.place('PARAMS')}", str(len(values)), "correct it")
    (fx, *rest), (cx, cy) = values[:focals], values[focals : focals + 2]
    fy = rest[0] if rest else fx
    coefficients = [0.0] * _LENGTHS[name]
    for index, value in zip(places, values[focals + 2 :], strict=True):
        coefficients[index] = value
    with with_place(table.place("PARAMS")):
        distortion = Distortion(name, tuple(coefficients))
    return make_camera(
        table.whole("WIDTH"),
        table.whole("HEIGHT"),
        (fx, fy, cx - CORNER, cy - CORNER),
        distortion,
        table.place("PARAMS"),
        table.place("WIDTH HEIGHT"),
    )


def _table(document: Document, choice: str | None) -> Fields:
    del choice
    if b"\0" in document.data[:8]:
        return Fields(document.name, {})
    comments = (line.strip().lstrip("# ").partition(":") for line in document.text.splitlines() if line[:1] == "#")
    # With several cameras, a comment does not say whose it is.
    values = {key: value.strip() for key, _, value in comments} if len(document.lines) == 1 else {}
    return Fields(document.name, values)


def _write(record: CameraRecord, ending: str) -> str:
    del ending
    record = without_k3(record)
    camera, lens = record.camera, record.camera.distortion
    # Padded with zeros: a radial lens with k3 is a rational one without a denominator.
    model = next(
        name
        for name, (focals, kind, places) in MODELS.items()
        if focals == 2
        and (kind == lens.model or (kind == "rational" and lens.model == "radtan"))
        and len(places) >= len(lens.coefficients)
    )
    padding = [0.0] * (len(MODELS[model][2]) - len(lens.coefficients))
    parameters = [camera.fx, camera.fy, camera.cx + CORNER, camera.cy + CORNER, *lens.coefficients, *padding]
    lines = ["# Camera list with one line of data per camera:", "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for key, value in record.extras.items():
        lines.append(f"# {key}: {' '.join(map(str, np.ravel(value).tolist()))}")
    lines.append(f"1 {model} {camera.width} {camera.height} {' '.join(repr(float(value)) for value in parameters)}")
    return "\n".join(lines) + "\n"


CAMERA_FORMATS.register("colmap")(
    CameraFormat(
        "lines of CAMERA_ID MODEL WIDTH HEIGHT PARAMS",
        _fits,
        _read,
        _table,
        ("cameras.txt", ".colmap.txt"),
        lambda record: record.camera.distortion.model in _LENGTHS,
        _write,
    )
)
