"""Lists of a rig's plates: TOML, JSON or CSV, each with a marker or room for one, and its pose T_rig_marker."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from markergen.errors import InputError, among
from markergen.guard import read, text_of
from markergen.model.body import Plate
from markergen.model.body_json import read_marker
from markergen.model.boundary import Boundary, Circle
from markergen.model.json_text import findings_of, in_one_line, parsed, parsed_toml
from markergen.model.marker import Marker
from markergen.model.marker_file import known_keys
from markergen.model.rig import MOST_MARKERS
from markergen.model.rig_shapes import Face, RigShape, distance_span
from markergen.read.outlines.boundary import parse_boundary
from markergen.read.poses.conventions import ANGLES, plain_name, unit_of
from markergen.read.poses.rows import RowsFile
from markergen.read.spec_file import Finite, Length

SUFFIXES = (".toml", ".json", ".csv")

WORDS, LENGTHS = ("name", "marker", "boundary"), ("radius", "x", "y", "z")
ROTATIONS = {"rotation_vector": (("rx", "ry", "rz"), "rad"), "euler_deg": (("roll", "pitch", "yaw"), "deg")}
"""Columns of each form of a rotation, and their unit."""

COLUMNS = ("name", "marker", "radius", "boundary", "x", "y", "z", "rx", "ry", "rz", "roll", "pitch", "yaw")

Three = Field(min_length=3, max_length=3)


class _PlateEntry(BaseModel):
    """One plate; what is missing of its pose is 0."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: Annotated[str, Field(min_length=1, max_length=40)]
    marker: str | None = None
    radius: Length | None = None
    boundary: str | None = None
    boundary_unit: str | None = None
    layer: str | None = None
    ignore_open: bool = False
    translation: Annotated[list[Length], Three] = [0.0, 0.0, 0.0]
    rotation_vector: Annotated[list[Finite], Three] | None = None
    euler_deg: Annotated[list[Finite], Three] | None = None
    matrix: Annotated[list[Annotated[list[Finite], Three]], Three] | None = None


class _Plates(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    plates: Annotated[list[_PlateEntry], Field(min_length=1, max_length=MOST_MARKERS)]


def read_plates(path: Path) -> tuple[RigShape, dict[int, Marker]]:
    """Read a list of plates.

    TOML and JSON have a table ``plates`` with ``name``; ``marker``, a marker.json beside the list, or ``radius`` or
    ``boundary``, in which one is designed, such as ``rect:0.2x0.1`` or a drawing with its ``boundary_unit``, ``layer``
    and ``ignore_open``; ``translation`` in m or with units; and ``rotation_vector`` in rad, ``euler_deg``,
    rotations about the rig's x, then y, then z axis, or ``matrix``, row by row.
    In CSV the columns are `COLUMNS`, of which those that are needed are given: rx, ry, rz in rad, or roll, pitch, yaw
    in degrees. A unit may follow a name, as in ``x_mm``.

    Returned are also the markers of the plates that have one, by the plate's number.

    Raises InputError if the file cannot be read, or is not such a list; the message lists the errors with their paths.
    """
    text, name = text_of(read(path, "list")), str(path)
    try:
        readers: dict[str, Callable[[str, str], Any]] = {".csv": _rows, ".json": parsed}
        reader: Callable[[str, str], Any] = readers.get(path.suffix.lower(), parsed_toml)
        content = reader(text, name)
        if not isinstance(content, dict) or "plates" not in content:  # What is no list of plates is not quoted.
            raise InputError(f"a table plates in {name}", "none", "write [[plates]] for each; see docs/rigs.md")
        plates = _Plates.model_validate(content).plates
    except ValidationError as error:
        problem = in_one_line(findings_of(error, partial(known_keys, root=_Plates)))
        raise InputError(f"a list of plates in {name}", problem, "correct these places") from None
    findings, faces, markers = list[str](), list[Face](), dict[int, Marker]()
    for k, plate in enumerate(plates):
        try:
            marker = read_marker(path.parent / plate.marker) if plate.marker else None
            face = Face(plate.name, _boundary(plate, marker), _rotation(plate), tuple(plate.translation))
            if marker is not None:
                markers[k] = marker
                Plate(face.name, marker, face.rotation, face.translation)
            faces.append(face)
        except InputError as error:
            findings.append(f"plates[{k}]: {error}")
    names = [plate.name for plate in plates]
    findings += [f"the name {twice} twice" for twice in dict.fromkeys(names) if names.count(twice) > 1]
    if findings:
        raise InputError(f"a list of plates in {name}", in_one_line(findings), "correct these places")
    normals = np.array([face.rotation for face in faces])[:, :, 2]
    reach = max(
        float(np.linalg.norm(face.translation)) + float(np.abs(np.concatenate(face.boundary.outlines())).max())
        for face in faces
    )
    front = (normals[:, 2] > 0.2).all()
    poses = f"cone:distance={distance_span(reach)},tilt=0..60" if front else f"sphere:distance={distance_span(reach)}"
    return RigShape("plates", tuple(faces), poses, {}), markers


def _rows(text: str, name: str) -> dict[str, Any]:
    lines = RowsFile(name, text.encode()).table()
    header, *rows = [[cell.strip() for cell in line] for _, line in lines if any(line)] or [[]]
    names = [plain_name(column)[0] for column in header]
    if not set(names) & set(COLUMNS):
        raise InputError(f"columns of plates in {name}", "others", f"known: {', '.join(COLUMNS)}")
    units = {plain: _unit_of(column, plain, name) for plain, column in zip(names, header, strict=True)}
    if len(units) < len(names):
        twice = next(column for column in names if names.count(column) > 1)
        raise InputError(f"every column once in {name}", f"{twice} twice", "correct the names")
    plates = []
    for number, row in enumerate(rows, 1):
        if len(row) != len(header):
            raise InputError(f"{len(header)} cells in row {number} of {name}", f"{len(row)}", "correct the row")
        cells = {column: cell for column, cell in zip(names, row, strict=True) if cell}
        cells |= {column: cells[column] + units[column] for column in LENGTHS if column in cells}
        plate: dict[str, Any] = {key: cells[key] for key in ("name", "marker", "radius", "boundary") if key in cells}
        plate["translation"] = [cells.get(key, "0") for key in "xyz"]
        for key, (columns, unit) in ROTATIONS.items():
            if any(column in cells for column in columns):
                try:
                    angles = [float(cells.get(column, 0)) for column in columns]
                except ValueError:
                    wanted = f"numbers for {', '.join(columns)} in row {number} of {name}"
                    raise InputError(wanted, "text", "correct it") from None
                is_other = [(units.get(column) or unit) != unit for column in columns]
                converted = np.degrees(angles) if unit == "deg" else np.radians(angles)
                plate[key] = np.where(is_other, converted, angles).tolist()
        plates.append(plate)
    return {"plates": plates}


def _unit_of(column: str, plain: str, name: str) -> str:
    """Unit at the end of a column's name, empty without one; raises InputError if the column or its unit is unknown."""
    unit = plain_name(column)[1]
    if plain not in COLUMNS or (unit and plain in WORDS):
        raise InputError(f"a column of plates in {name}", repr(column), among(plain, COLUMNS))
    if plain in LENGTHS:
        return unit_of([unit], f"{column} in {name}")
    if unit and unit not in ANGLES:
        raise InputError(f"a unit of angles in {name}", repr(column), f"known: {', '.join(ANGLES)}")
    return unit[:3]


def _boundary(plate: _PlateEntry, marker: Marker | None) -> Boundary:
    keys = [name for name in ("marker", "radius", "boundary") if getattr(plate, name) is not None]
    if len(keys) != 1:
        raise InputError("a marker, a radius or a boundary", " and ".join(keys) or "none", "give one of them")
    if marker is not None:
        return marker.boundary
    if not plate.boundary:
        return Circle(plate.radius or 0.0)
    return parse_boundary(plate.boundary, plate.boundary_unit, plate.layer, ignore_open=plate.ignore_open)


def _rotation(plate: _PlateEntry) -> tuple[tuple[float, ...], ...]:
    keys = [name for name in ("rotation_vector", "euler_deg", "matrix") if getattr(plate, name) is not None]
    if len(keys) > 1:
        raise InputError("one form of the rotation", " and ".join(keys), "leave out the others")
    from scipy.spatial.transform import Rotation

    if plate.matrix is not None:
        matrix = np.array(plate.matrix)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0:
            raise InputError("a rotation: orthonormal rows and determinant 1", "another matrix", "correct it")
        # Written with six digits or more; the nearest rotation has them all.
        left, _, right = np.linalg.svd(matrix)
        rotation = left @ right
    elif plate.euler_deg is not None:
        rotation = Rotation.from_euler("xyz", plate.euler_deg, degrees=True).as_matrix()
    else:
        rotation = Rotation.from_rotvec(plate.rotation_vector or np.zeros(3)).as_matrix()
    whole = np.round(rotation)
    return tuple(map(tuple, (np.where(np.abs(rotation - whole) < 1e-12, whole, rotation) + 0.0).tolist()))
