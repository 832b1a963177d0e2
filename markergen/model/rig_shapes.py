"""Shapes of rigs: cube, prism, wall and pair, as named faces with their places; markers are mounted on these later."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, isfinite, pi, radians, sin, tan

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, among, brief
from markergen.model.body import Plate, Rows
from markergen.model.boundary import Boundary, Polygon
from markergen.model.marker import Marker
from markergen.model.rig import MOST_MARKERS
from markergen.model.substrate import Substrate
from markergen.units import format_length

KINDS = ("cube", "prism", "wall", "pair")
FORMS = ("cube", "prism:6", "wall 3x2", "pair", "plates.toml, .json or .csv")

SHAPE_HELP = (
    "faces +x -x +y -y +z -z; see --edge, --without",
    "side 1 to 6 from -y on, +z, -z; see --edge, --height, --without",
    "3 columns and 2 rows of square plates, row 1 column 1 top left; see --pitch, --plate",
    "left and right plate at an angle; see --plate, --angle, --thickness, --edge",
    "a list of plates, each with a marker or room for one, and its pose; see docs/rigs.md",
)
"""What each of the forms is."""

OPTIONS = {
    "cube": ("edge", "without"),
    "prism": ("edge", "height", "without"),
    "wall": ("pitch", "plate"),
    "pair": ("plate", "angle", "thickness", "edge"),
}
"""Measures of each kind."""


@dataclass(frozen=True)
class Face:
    """A place for a marker: its name, boundary and pose T_rig_marker, as those of a `Plate`."""

    name: str
    boundary: Boundary
    rotation: Rows
    translation: tuple[float, ...]

    def mounted(self, marker: Marker) -> Plate:
        """Return a marker on this face."""
        return Plate(self.name, marker, self.rotation, self.translation)


@dataclass(frozen=True)
class RigShape:
    """Faces of a rig.

    Attributes
    ----------
    text : str
        Such as ``cube`` or ``prism:6``.
    poses : str
        Poses T_camera_rig of a camera around it, by default.
    measures : mapping of str to float
        Given and default measures.
    substrate : Substrate
        What carries the dots of each face.
    """

    text: str
    faces: tuple[Face, ...]
    poses: str
    measures: dict[str, float]
    substrate: Substrate = field(default_factory=Substrate)


def rig_shape(text: str, without: Sequence[str] = (), **measures: float | None) -> RigShape:
    """Return the shape of a text such as ``cube``, ``prism:6``, ``wall 3x2`` or ``pair``, with its measures in m.

    Frames of faces: z out of the face; x and y such that text on a side face stands upright where the rig's z is up.
    The rig's origin is in the middle of the body; of a wall, in the middle of its plane, with z out of it; of a pair,
    in the middle of the line in which the planes of the plates meet, with z between their normals and y along the line.

    Parameters
    ----------
    edge, height : float
        Edge of a cube, or of a prism's polygon, and height of the prism; `edge` of a pair as of a `Substrate`.
    pitch, plate : float
        Distance between the middles of a wall's plates, and side of the square plates of a wall or pair.
    angle : float
        Angle in degrees between the normals of a pair; negative: the plates face each other.
    thickness : float
        That of the plates of a pair.
    without : sequence of str
        Names of faces of a body to leave out.

    Raises
    ------
    InputError
        If the text or a measure is none of these, or has no use for the shape.
    """
    kind, _, rest = " ".join(text.replace(":", " ", 1).split()).partition(" ")
    if kind not in KINDS:
        raise InputError("a known shape of a rig", brief(text), among(kind, KINDS, FORMS))
    useless = [name for name, value in measures.items() if value is not None and name not in OPTIONS[kind]]
    if useless:
        raise InputError(
            f"measures of a {kind}: {', '.join('--' + name for name in OPTIONS[kind])}",
            f"--{useless[0]}",
            "leave it out",
        )
    if without and "without" not in OPTIONS[kind]:
        raise InputError(f"all plates of a {kind}", "--without", "leave it out; it is for bodies")
    sizes = {name: float(value) for name, value in measures.items() if value is not None}
    for name, value in sizes.items():
        if not (isfinite(value) and value > 0) and (kind != "pair" or name == "plate"):
            raise InputError(f"a length above 0 for --{name}", f"{name}={value} m", "write such as 80mm")
    if kind == "cube":
        _no_rest(kind, rest)
        edge = sizes.setdefault("edge", 0.08)
        return _body("cube", _prism(4, edge, edge, _CUBE), without, sizes)
    if kind == "prism":
        sides = _count(rest, r"(\d{1,3})", "prism:6")[0]
        if not 3 <= sides <= MOST_MARKERS - 2:
            raise InputError(f"a prism of 3 to {MOST_MARKERS - 2} sides", brief(text), "write such as prism:6")
        edge = sizes.setdefault("edge", 0.06)
        height = sizes.setdefault("height", edge)
        names = [f"side {number + 1}" for number in range(sides)]
        return _body(f"prism:{sides}", _prism(sides, edge, height, names), without, sizes)
    if kind == "wall":
        columns, rows = _count(rest, r"(\d{1,3}) ?x ?(\d{1,3})", "wall 3x2")
        if not 1 <= columns * rows <= MOST_MARKERS:
            raise InputError(f"a wall of 1 to {MOST_MARKERS} plates", brief(text), "write such as wall 3x2")
        return _wall(columns, rows, sizes)
    _no_rest(kind, rest)
    return _pair(sizes)


def _no_rest(kind: str, rest: str) -> None:
    if rest:
        measure = rest if re.fullmatch(r"[\d.]+ ?[a-z]+", rest) else "80mm"
        remedy = f"write {kind}, and measures as options, such as --{OPTIONS[kind][0]} {measure}"
        raise InputError(f"nothing behind {kind}", brief(rest), remedy)


def _count(rest: str, form: str, example: str) -> list[int]:
    match = re.fullmatch(form, rest.strip())
    if not match:
        raise InputError(f"a shape such as {example}", brief(rest) if rest else "no number", f"write {example}")
    return [int(digits) for digits in match.groups()]


_CUBE = ("-y", "+x", "+y", "-x")
"""Names of the sides of a cube, in the order of those of a prism."""


def _prism(count: int, edge: float, height: float, names: Sequence[str]) -> list[Face]:
    """Sides, the first one with its normal along -y, counterclockwise seen from above; then top and bottom."""
    inner, outer = edge / (2 * tan(pi / count)), edge / (2 * sin(pi / count))
    side = rectangle_outline(edge, height)
    faces = []
    for name, angle in zip(names, -pi / 2 + 2 * pi * np.arange(count) / count, strict=True):
        normal = np.array([cos(angle), sin(angle), 0.0])
        up = np.array([0.0, 0.0, 1.0])
        faces.append(_face(name, side, np.column_stack([np.cross(up, normal), up, normal]), inner * normal))
    # The first side's edge is straight below the middle of the top, and straight above that of the bottom.
    angles = -pi / 2 - pi / count + 2 * pi * np.arange(count) / count
    x, y = np.round(outer * np.cos(angles), 12).tolist(), np.round(outer * np.sin(angles), 12).tolist()
    top = rectangle_outline(edge, edge) if count == 4 else Polygon((tuple(zip(x, y, strict=True)),))
    bottom = top if count == 4 else Polygon((tuple((a, -b) for a, b in zip(x, y, strict=True)),))
    faces.append(_face("+z", top, np.eye(3), np.array([0, 0, height / 2])))
    faces.append(_face("-z", bottom, np.diag([1.0, -1.0, -1.0]), np.array([0, 0, -height / 2])))
    return faces


def _body(text: str, faces: list[Face], without: Sequence[str], sizes: dict[str, float]) -> RigShape:
    names = [face.name for face in faces]
    if text == "cube":
        faces.sort(key=lambda face: ("+x", "-x", "+y", "-y", "+z", "-z").index(face.name))
    for name in without:
        if name not in names:
            raise InputError(f"a face of a {text}", brief(name), among(name, names))
    kept = tuple(face for face in faces if face.name not in without)
    if not kept:
        raise InputError("a face or more", "none", "leave out fewer of them")
    reach = max(float(np.linalg.norm(corners(face), axis=-1).max()) for face in faces)
    return RigShape(text, kept, f"sphere:distance={distance_span(reach)}", sizes)


def _wall(columns: int, rows: int, sizes: dict[str, float]) -> RigShape:
    pitch = sizes.setdefault("pitch", 0.5)
    plate = sizes.setdefault("plate", 0.4 * pitch)
    if (columns > 1 or rows > 1) and plate > pitch:
        raise InputError(
            "plates that do not overlap",
            f"plates of {format_length(plate)} with a pitch of {format_length(pitch)}",
            "use a smaller --plate or a larger --pitch",
        )
    square = rectangle_outline(plate, plate)
    faces = tuple(
        _face(
            f"row {row + 1} column {column + 1}",
            square,
            np.eye(3),
            np.array([(column - (columns - 1) / 2) * pitch, ((rows - 1) / 2 - row) * pitch, 0.0]),
        )
        for row in range(rows)
        for column in range(columns)
    )
    reach = max(float(np.linalg.norm(corners(face), axis=-1).max()) for face in faces)
    return RigShape(f"wall:{columns}x{rows}", faces, f"cone:distance={distance_span(reach, 1.5, 5)},tilt=0..60", sizes)


def _pair(sizes: dict[str, float]) -> RigShape:
    plate, angle = sizes.setdefault("plate", 0.15), sizes.setdefault("angle", 90.0)
    if not -170 <= angle <= 170:
        raise InputError("an angle of -170 to 170 degrees", f"{angle:g}", "give --angle such a number")
    square, half = rectangle_outline(plate, plate), radians(angle) / 2
    substrate = Substrate(sizes.get("thickness", Substrate.thickness), sizes.get("edge"))
    # So far from the line in which their faces' planes meet, plates touch: in front if they face each other, at their
    # backs otherwise.
    setback = substrate.edge_around(square) + substrate.thickness * max(tan(half), 0.0)
    faces = []
    for name, side in (("left", -1), ("right", 1)):
        angle_y = side * half
        rotation = np.array([[cos(angle_y), 0, sin(angle_y)], [0, 1, 0], [-sin(angle_y), 0, cos(angle_y)]])
        faces.append(_face(name, square, rotation, rotation[:, 0] * side * (plate / 2 + setback)))
    return RigShape("pair", tuple(faces), f"cone:distance={distance_span(plate)},tilt=0..60", sizes, substrate)


def rectangle_outline(width: float, height: float) -> Polygon:
    """Rectangle around the origin, sides in m."""
    x, y = width / 2, height / 2
    return Polygon((((x, y), (-x, y), (-x, -y), (x, -y)),))


def corners(face: Face) -> Array:
    """Return the corners (k, 3) in m of a face in the frame of its rig."""
    points = np.concatenate(face.boundary.outlines())
    return points @ np.array(face.rotation).T[:2] + face.translation


def distance_span(reach: float, nearest: float = 3.5, farthest: float = 9.0) -> str:
    """Distances from the origin of a rig of that size, as in the text of a pose source: ``0.24..0.62m``."""
    return "..".join(f"{float(f'{reach * factor:.2g}'):g}" for factor in (nearest, farthest)) + "m"


def _face(name: str, boundary: Boundary, rotation: Array, translation: Array) -> Face:
    rows = np.where(np.abs(rotation - np.round(rotation)) < 1e-12, np.round(rotation), rotation) + 0.0
    # Rounded to a picometer, so that the faces of a cube have whole numbers.
    return Face(name, boundary, tuple(map(tuple, rows.tolist())), tuple((np.round(translation, 12) + 0.0).tolist()))
