"""Read a robot's poses at photographs: a table with a column that names them, or a file of a pose beside each.

Robots write poses in many ways, and a wrong reading often looks right. So direction, unit, and the order of rotations
are what the file says of itself, in names of columns and comments, or what the user states; what neither says is
asked for.
"""

# tests: tests/read/test_robot_poses.py

import glob
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, among, brief, enumerated
from markergen.files import exists
from markergen.guard import read
from markergen.read.cameras.document import Document
from markergen.read.images import SUFFIXES
from markergen.read.poses.conventions import PoseConvention, column_of, plain_name, scale_of, stated, unit_of
from markergen.read.poses.rows import MATRIX_COLUMNS, ROTATIONS, TRANSLATION, RowsFile, check_count, numbers_of, records
from markergen.read.remarks import remark
from markergen.units import METERS

FLANGE_IN_BASE, BASE_IN_FLANGE = "flange-in-base", "base-in-flange"
FRAMES = (FLANGE_IN_BASE, BASE_IN_FLANGE)
"""What ``--robot-frame`` takes: T_base_flange, X_base = R X_flange + t, or its inverse."""

PROGRAMS = {
    "abb": ("wxyz", ""),
    "fanuc": ("xyz", "deg"),
    "kawasaki": ("ZYZ", "deg"),
    "kuka": ("ZYX", "deg"),
    "staubli": ("XYZ", "deg"),
    "ur": ("rotvec", "rad"),
    "yaskawa": ("xyz", "deg"),
}
"""Rotation and angle as controllers show them: quaternion q1 to q4 of ABB; W P R of FANUC; O A T of Kawasaki; A B C of
KUKA; Rx Ry Rz of Staubli and Yaskawa; the rotation vector of Universal Robots."""

NOTATIONS = ("xyzw", "wxyz", "rotvec", "matrix")
ROTATION_FORMS = (
    f"{', '.join(NOTATIONS)}, Euler angles as ZYX about moving or zyx about fixed axes, {', '.join(PROGRAMS)}"
)
_EULER = re.compile(r"[XYZ]{3}|[xyz]{3}")

_FLANGE = r"(?:flange|tool0?|tcp|gripper|hand|ee|end[- _]?effector)"
_BASE = r"(?:(?:robot[- _]?)?base(?:[- _]?link)?|robot|world)"
_DIRECTIONS = {
    frame: re.compile(
        rf"\b(?:{inner}[- _]in[- _]{outer}|{outer}[- _]from[- _]{inner}|T_?{outer}_?{inner}|{outer}_T_{inner}|"
        rf"{inner}2{outer})\b",
        re.IGNORECASE,
    )
    for frame, inner, outer in ((FLANGE_IN_BASE, _FLANGE, _BASE), (BASE_IN_FLANGE, _BASE, _FLANGE))
}
"""How comments and names state a direction."""
_STATED_ROTATION = re.compile(
    r"\brotation\s*[:=]\s*(\w+)|\b(?:intrinsic|extrinsic)\s+([xyzXYZ]{3})\b|\b(rot(?:ation[ -])?vec)"
)

_ANGLES: dict[tuple[str, ...], str] = {
    ("rx", "ry", "rz"): "xyz",
    ("roll", "pitch", "yaw"): "xyz",
    ("w", "p", "r"): "xyz",
    ("euler_x", "euler_y", "euler_z"): "xyz",
    ("x", "y", "z"): "xyz",
    ("u", "v", "w"): "",
    ("a", "b", "c"): "",
    ("o", "a", "t"): "",
    ("alpha", "beta", "gamma"): "",
    ("r1", "r2", "r3"): "",
    ("e1", "e2", "e3"): "",
}
"""Names of three numbers of a rotation, and the axes that they are about; "": they follow the order stated."""

_PHOTO = re.compile(
    r"(photo|photograph|image|img|picture|file|frame|name|path|id|index|idx)s?[ _.-]?(name|file|id|path)?"
)
_PLACE = re.compile(r".*(pos|position|trans|translation|tvec|xyz|location|place|origin)|t|p")


@dataclass(frozen=True)
class RobotConvention:
    """What a user says of a robot's poses; None leaves it to the file.

    Attributes
    ----------
    frame, unit, rotation, angle : str or None
        One of `FRAMES`; unit of translations, such as mm; one of `ROTATION_FORMS`; deg or rad.
    """

    frame: str | None = None
    unit: str | None = None
    rotation: str | None = None
    angle: str | None = None

    def __post_init__(self) -> None:
        choices_of = {"frame": FRAMES, "unit": tuple(filter(None, METERS)), "angle": ("deg", "rad")}
        for name, choices in choices_of.items():
            if getattr(self, name) not in (None, *choices):
                value = getattr(self, name)
                raise InputError(f"a known --robot-{name}", brief(value), among(value, choices))
        if self.rotation is not None and not _is_rotation(self.rotation):
            raise InputError("a known --robot-rotation", brief(self.rotation), f"known: {ROTATION_FORMS}")


def _is_rotation(word: str) -> bool:
    return word in NOTATIONS or word in PROGRAMS or (bool(_EULER.fullmatch(word)) and not re.search(r"(.)\1", word))


def robot_poses(
    source: str | Path, photos: Sequence[Path], convention: RobotConvention
) -> dict[int, tuple[Array, Array]]:
    """Return T_base_flange, R (3, 3) and t (3,) in m, of the photographs that have one, by their index.

    The source is a table, a folder with a pose file for each photograph, or a pattern of such files.

    Raises InputError if a file is not as expected, names no photograph, or neither it nor the convention states
    direction, unit and rotation.
    """
    path = Path(source)
    if path.is_dir() or (glob.has_magic(str(source)) and not exists(path)):
        poses = _beside(source, photos, convention)
    else:
        poses = _of_table(path, photos, convention)
    if not poses:
        raise InputError(
            f"poses of the photographs in {source}",
            f"none that names {photos[0].name}",
            "name the photographs as their files, with or without their ending",
        )
    return poses


# --- Which photograph -------------------------------------------------------------------------------------------------


def _beside(source: str | Path, photos: Sequence[Path], convention: RobotConvention) -> dict[int, tuple[Array, Array]]:
    """Poses in files whose names are those of the photographs, with other endings."""
    path = Path(source)
    names = path.iterdir() if path.is_dir() else map(Path, glob.glob(str(source), recursive=True))  # noqa: PTH207
    files = sorted(name for name in names if name.suffix.lower() not in SUFFIXES and name.is_file())
    poses = {}
    for index, photo in enumerate(photos):
        form = re.compile(re.escape(photo.stem) + r"(?![A-Za-z0-9]).*", re.IGNORECASE)
        mine = [file for file in files if form.fullmatch(file.name)]
        if len(mine) > 1:
            listed = ", ".join(file.name for file in mine[:3])
            ending = mine[0].name[len(photo.stem) :]
            raise InputError(
                f"one pose file for {photo.name}", listed, f"give --robot as a pattern, such as '{path.name}/*{ending}'"
            )
        for file in mine:
            poses[index] = _poses_of(_single(file), convention)[0]
    return poses


def _of_table(path: Path, photos: Sequence[Path], convention: RobotConvention) -> dict[int, tuple[Array, Array]]:
    table = _table(path)
    candidates = [k for k, name in enumerate(table.names) if _PHOTO.fullmatch(plain_name(name)[0])]
    candidates.sort(key=lambda k: table.names[k].strip().lower() in ("id", "index", "idx"))
    indices: dict[str, int] = {}
    for index, photo in enumerate(photos):
        number = photo.stem.lstrip("0") or "0"
        for name in {photo.name, photo.stem, number if photo.stem.isdigit() else photo.stem}:
            indices[name.casefold()] = -1 if indices.get(name.casefold(), index) != index else index
    whose = [[indices.get(_key(row[column]), -1) for row in table.rows] for column in candidates]
    if not candidates:
        raise InputError(
            f"a column of {table.name} that names the photograph",
            f"the columns {brief(', '.join(table.names))}",
            "add a column photo with the names of the files",
        )
    owners = max(whose, key=lambda owners: sum(owner >= 0 for owner in owners))
    named = [k for k, owner in enumerate(owners) if owner >= 0]
    twice = next((k for n, k in enumerate(named) if owners[k] in [owners[m] for m in named[:n]]), None)
    if twice is not None:
        raise InputError(
            f"one pose for each photograph in {table.name}", f"two for {photos[owners[twice]].name}", "leave one"
        )
    if lost := len(table.rows) - len(named):
        remark(f"{table.name}: {lost} pose{'s' * (lost > 1)} of photographs that are not here")
    if not named:
        return {}
    kept = table._replace(rows=[table.rows[k] for k in named], places=[table.places[k] for k in named])
    return dict(zip((owners[k] for k in named), _poses_of(kept, convention), strict=True))


def _key(cell: str) -> str:
    """Name of a photograph as a cell has it: without folders, and leading zeros of a number."""
    name = re.split(r"[/\\]", cell.strip().strip("\"'"))[-1].casefold()
    return (name.lstrip("0") or "0") if name.isdigit() else name


# --- Tables -----------------------------------------------------------------------------------------------------------


class _PoseTable(NamedTuple):
    """Rows of cells with the names of their columns, and texts that may state what they mean."""

    name: str
    names: list[str]
    rows: list[list[str]]
    places: list[str]
    comments: list[str]


def _table(path: Path) -> _PoseTable:
    name, data = read(path, "poses")
    file = RowsFile(name, data.removeprefix(b"\xef\xbb\xbf"))
    if file.first[:1] in (b"[", b"{"):
        poses, around = records(file)
        flat = [dict(_flat(pose)) for pose in poses]
        names = list(flat[0])
        odd = next((k for k, pose in enumerate(flat) if list(pose) != names), None)
        if odd is not None:
            raise InputError(f"the keys of pose 0 at pose {odd} of {name}", "others", "correct the file")
        places = [f"pose {k} of {name}" for k in range(len(flat))]
        return _PoseTable(
            name, names, [list(pose.values()) for pose in flat], places, [f"{k}: {v}" for k, v in around.items()]
        )
    rows = list(file.table())
    names, body = (rows[0][1], rows[1:]) if rows else ([], [])
    if sum(bool(column_of(cell).kind) for cell in names) < len(TRANSLATION):
        raise InputError(
            f"a line of column names in {name}", brief(" ".join(names)), "add one, such as photo,x,y,z,qx,qy,qz,qw"
        )
    if not body:
        raise InputError(f"at least one pose in {name}", "none", "check the file")
    for line, cells in body:
        check_count(names, cells, file.place(line))
    return _PoseTable(name, names, [cells for _, cells in body], [file.place(line) for line, _ in body], file.comments)


def _single(path: Path) -> _PoseTable:
    """Table of one pose: keys and values, a header with a row, or numbers alone."""
    name, data = read(path, "poses")
    file = RowsFile(name, data.removeprefix(b"\xef\xbb\xbf"))
    lines = [line for _, line in file.table()] if file.first[:1] not in (b"[", b"{", b"<", b"%") else []
    numbers, comments = [cell for line in lines for cell in line], file.comments
    if numbers and all(_is_number(cell) for cell in numbers):
        flat = list(_flat(numbers))
    elif len(lines) == 2 and len(lines[0]) == len(lines[1]) > 2:
        flat = list(zip(*lines, strict=True))
    else:
        document = Document(name, data)
        values: Any = document.fields.values
        if not values:
            values = {"pose": records(file)[0][0]} if file.first[:1] == b"[" else {}
        flat = list(_flat(values))
        texts = (f"{key}: {'' if isinstance(value, list | dict) else value}" for key, value in values.items())
        comments = [*comments, *texts]
    return _PoseTable(name, [key for key, _ in flat], [[value for _, value in flat]], [name], comments)


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield names and texts of nested values; lists are vectors, quaternions, matrices, or whole poses."""
    if isinstance(value, Mapping) and "data" in value and ("rows" in value or "cols" in value):
        value = value["data"]
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _flat(item, f"{key}.{name}" if key else str(name))
        return
    if not isinstance(value, list):
        yield key, str(value)
        return
    numbers = [item for row in value for item in (row if isinstance(row, list) else [row])]
    place, quaternion, three = ["x", "y", "z"], ["q1", "q2", "q3", "q4"], ["r1", "r2", "r3"]
    names = {
        3: [f"t{axis}" for axis in place] if _PLACE.fullmatch(key.lower()) else three,
        4: quaternion,
        6: [*place, *three],
        7: [*place, *quaternion],
        9: list(ROTATIONS[2]),
        12: list(MATRIX_COLUMNS),
        16: [*MATRIX_COLUMNS, *(f"label{k}" for k in range(4))],
    }.get(len(numbers), [])
    yield from zip(names, map(str, numbers), strict=False)


# --- Poses ------------------------------------------------------------------------------------------------------------


class _Columns(NamedTuple):
    """Columns of place and rotation; the notation that their names state, or ""; the axes of three angles; units."""

    place: list[int]
    rotation: list[int]
    notation: str
    axes: str
    unit: str
    angle: str


def _columns_of(table: _PoseTable) -> _Columns:
    names = table.names
    last = [re.split(r"[./ ](?=[^\d\]\)])", plain_name(name)[0])[-1] for name in names]
    columns = [column_of(name) for name in names]
    kinds = [column.kind for column in columns]
    if not set(TRANSLATION) <= set(kinds):
        whole = [re.search("euler|rot|ori|angle", name.lower()) is None for name in names]
        kinds = [
            column.kind or (column_of(short).kind if free else "")
            for column, short, free in zip(columns, last, whole, strict=True)
        ]
    missing = [name for name in TRANSLATION if kinds.count(name) != 1]
    if missing:
        problem = " ".join(f"{kinds.count(name) or 'no'} {name}" for name in missing)
        raise InputError(f"the columns x y z in {table.name}", problem, "name each once")
    place = [kinds.index(name) for name in TRANSLATION]
    unit = unit_of([columns[k].unit for k in place], table.name)
    for notation, wanted in (("matrix", ROTATIONS[2]), ("xyzw", ROTATIONS[0])):
        if set(wanted) <= set(kinds):
            return _Columns(place, [kinds.index(name) for name in wanted], notation, "", unit, "")
    quaternion = [k for k, name in enumerate(last) if re.fullmatch(r"(?:q|quat|quaternion)_?[0-4]", name)]
    if len(quaternion) == 4:
        return _Columns(place, quaternion, "", "", unit, "")
    rest = {name: k for k, name in enumerate(last) if k not in place}
    group = next((group for group in _ANGLES if set(group) <= set(rest)), None)
    axes = "xyz" if group is None else _ANGLES[group]
    if group is not None:
        rotation = [rest[name] for name in group]
    else:
        rotation = [kinds.index(name) for name in ROTATIONS[1] if name in kinds]
        if len(rotation) != 3:
            raise InputError(
                f"columns of a rotation in {table.name}",
                brief(" ".join(names)),
                "such as qx qy qz qw, q1 q2 q3 q4, rx ry rz, a b c, w p r, roll pitch yaw, r11 to r33",
            )
    is_vector = all(re.search("rotvec|rodrigues|rvec", names[k].lower()) for k in rotation)
    angles = {plain_name(names[k])[1][:3] for k in rotation} & {"deg", "rad"}
    return _Columns(
        place, rotation, "rotvec" if is_vector else "", axes, unit, angles.pop() if len(angles) == 1 else ""
    )


def _poses_of(table: _PoseTable, convention: RobotConvention) -> list[tuple[Array, Array]]:
    """T_base_flange of the rows of a table."""
    columns = _columns_of(table)
    texts = [*table.comments, *table.names]
    statements = stated(table.comments, table.name)
    frames = [frame for frame in FRAMES if any(_DIRECTIONS[frame].search(text) for text in texts)]
    rotations = [next(filter(None, match)) for text in table.comments for match in _STATED_ROTATION.findall(text)]
    rotations = ["rotvec" if word.lower().startswith("rot") else word for word in rotations]
    rotations = [word for word in rotations if _is_rotation(word)]
    if len(columns.rotation) == 4 and not columns.notation and "order" in statements:
        rotations = [statements["order"], *rotations]
    notation = _one("rotation", convention.rotation, [columns.notation, *rotations], table.name)
    notation, angle = PROGRAMS.get(notation, (notation, "rad" if notation == "rotvec" else ""))
    frame = _one("frame", convention.frame, frames, table.name)
    unit = _one("unit", convention.unit, [columns.unit, statements.get("unit", "")], table.name)
    given_angle = _one("angle", convention.angle, [columns.angle, statements.get("angle", "")], table.name)
    angle = given_angle or angle
    is_euler = bool(_EULER.fullmatch(notation))
    missing = {
        "direction": ("" if frame else f"--robot-frame {FLANGE_IN_BASE}, of T_base_flange, or {BASE_IN_FLANGE}"),
        "unit": "" if unit else "--robot-unit mm or m",
        "rotation": "" if notation else f"--robot-rotation {_suggested(columns)}",
        "angle": "" if angle or not is_euler else "--robot-angle deg or rad",
    }
    if any(missing.values()):
        lacking = [name for name, option in missing.items() if option]
        raise InputError(
            f"{enumerated(lacking, 'and')} of the poses in {table.name} to be stated",
            "nothing about it" if len(lacking) == 1 else "nothing about them",
            f"give {enumerated(filter(None, missing.values()), 'and')}",
        )
    count = {"xyzw": 4, "wxyz": 4, "matrix": 9}.get(notation, 3)
    if len(columns.rotation) != count:
        raise InputError(
            f"{count} numbers of a rotation {notation} in {table.name}",
            f"{len(columns.rotation)}: {' '.join(table.names[k] for k in columns.rotation)}",
            f"give --robot-rotation {_suggested(columns)}",
        )
    values = np.array([[_value(row[k], place) for k in (*columns.place, *columns.rotation)]
                       for row, place in zip(table.rows, table.places, strict=True)])  # fmt: skip
    rotation, translation = values[:, 3:], values[:, :3] * scale_of(PoseConvention(), unit, table.name)
    if notation == "wxyz":
        rotation = rotation[:, [1, 2, 3, 0]]
    elif count == 3:
        rotation = _vectors(rotation, notation, angle, columns.axes, table)
    from scipy.spatial.transform import Rotation

    numbers = numbers_of(translation, rotation, lambda index: table.places[index], "--robot-unit")
    turns, translation = Rotation.from_quat(numbers[:, 3:]), numbers[:, :3]
    if frame == BASE_IN_FLANGE:
        turns = turns.inv()
        translation = -turns.apply(translation)
    return list(zip(turns.as_matrix(), translation, strict=True))


def _vectors(angles: Array, notation: str, angle: str, axes: str, table: _PoseTable) -> Array:
    """Rotation vectors in rad, or quaternions of Euler angles."""
    from scipy.spatial.transform import Rotation

    if angle == "rad" and np.abs(angles).max() > 2 * np.pi + 1e-3:
        raise InputError(f"angles in rad in {table.name}", f"{np.abs(angles).max():.6g}", "give --robot-angle deg")
    if notation == "rotvec":
        return np.deg2rad(angles) if angle == "deg" else angles
    if axes:
        if sorted(notation.lower()) != sorted(axes):
            raise InputError(
                f"an order of angles about x, y and z in {table.name}", notation, "give such as ZYX or xyz"
            )
        angles = angles[:, [axes.index(axis) for axis in notation.lower()]]
    return np.asarray(Rotation.from_euler(notation, angles, degrees=angle == "deg").as_quat())


def _one(aspect: str, wish: str | None, texts: Sequence[str], file: str) -> str:
    """Return what user and file agree on of an aspect; "" if neither says anything."""
    here = list(dict.fromkeys(text for text in texts if text))
    both = list(dict.fromkeys([*([wish] if wish else []), *here]))
    meant = {PROGRAMS.get(word, (word,))[0] for word in both}
    if len(meant) > 1:
        by = f"{both[0]} by --robot-{aspect}" if wish else both[0]
        raise InputError(
            f"one {aspect} of the poses in {file}", f"{by} and {both[1]} in the file", "correct the wrong one"
        )
    return both[0] if both else ""


def _suggested(columns: _Columns) -> str:
    programs = ", ".join(PROGRAMS)
    if len(columns.rotation) == 4:
        return "xyzw or wxyz"
    return f"rotvec, an Euler order such as ZYX about moving axes or zyx about fixed ones, or {programs}"


def _value(cell: str, place: str) -> float:
    if not _is_number(cell):
        raise InputError(f"a number at {place}", brief(cell), "correct it")
    return float(cell)
