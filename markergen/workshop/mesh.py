"""Closed meshes of parts within a tolerance of their surface, made from their bodies without a CAD kernel; STL of them.

Walls of prisms and bodies of revolution get the fewest chords that keep to the tolerance, and level faces between them
are triangulated as polygons. The points of all parts lie on a common grid.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import pairwise
from math import acos, atan, atan2, ceil, cos, hypot, log2, pi, sin

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.arrays import Array
from markergen.errors import OutputError
from markergen.exporters import ExportOptions
from markergen.geometry.contour import Contour, Side, center_of, chord_counts, divided, offset
from markergen.geometry.region import Region
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.rig import Rig
from markergen.solid.primitives import COLORS, SAME, BodyPart, Part, Prism, Revolved, at_height
from markergen.workshop.assembly import made_of
from markergen.workshop.formats.solids import Designed, designed_of
from markergen.workshop.level_faces import PlanarFace, level_faces, signed_bodies

MATERIALS = tuple(COLORS)
"""Names of the materials, in the order in which the formats list them."""
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle of a binary STL: 50 bytes, little-endian, the attribute unused."""

Indices = NDArray[np.int64]

LEAST = 144
"""Minimum number of chords of a whole circle: cylinders lose at most 0.03 % of their volume and balls 0.1 %."""

LARGEST = 2 * pi / 64
"""Maximum angle in rad of a chord of other arcs, such as rounded corners of a tag, which lose less than 0.1 % by them.

The hundreds of letters on a back would make up most of a mesh with as many chords as whole circles.
"""

FINEST = -14
"""Exponent of 2, in mm, of the finest grid for points, 0.06 um; all markers of up to half a meter share it.

On this grid parts that touch have their points in common.
"""


@dataclass(frozen=True)
class Mesh:
    """A closed surface of triangles: that of the part of a name and a material.

    Attributes
    ----------
    points : array (n, 3)
        In mm, marker frame, without duplicates, exactly representable as 32-bit floats.
    triangles : array (m, 3)
        Indices of points, counterclockwise as seen from outside.
    marked : array (m,) of bool
        True for triangles of a face with the other material's color.
    up : array (3,)
        Direction of the plate's normal.
    """

    name: str
    material: str
    points: Array
    triangles: Indices
    marked: NDArray[np.bool_]
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))


# Several formats of one marker share its meshes.
@lru_cache(maxsize=2)
def meshes_of(parts: tuple[Part | BodyPart, ...], tolerance: float) -> tuple[Mesh, ...]:
    """Mesh all parts on a common grid; no point of their surfaces is farther than `tolerance` mm from the mesh.

    Raises
    ------
    OutputError
        If the primitives of a part overlap, or the tolerance is too coarse for gaps between them.
    """
    shells = []
    for part in parts:
        try:
            pieces = [(piece, *shell_of(piece.part, tolerance, part.is_block)) for piece in part.pieces]
        except ValueError as error:
            raise failed(part.name, str(error)) from None
        corners = np.concatenate([piece.to_body(corners) for piece, corners, _ in pieces])
        shells.append((corners, np.concatenate([marked for _, _, marked in pieces])))
    grid = grid_of(np.concatenate([corners.reshape(-1, 3) for corners, _ in shells]))
    return tuple(welded(part, *shell, grid) for part, shell in zip(parts, shells, strict=True))


def shell_of(part: Part, tolerance: float, face_only: bool = False) -> tuple[Array, NDArray[np.bool_]]:
    """Triangles (m, 3, 3) of the surface of a part, and whether each is on a marked face.

    With `face_only` the walls and the bottom of the part's first body are left out: one face of a block.

    Raises
    ------
    ValueError
        If the bodies of the part overlap.
    """
    pieces = [(wall, False) for wall in _walls_of(part, tolerance, face_only)]
    pieces += [(_filled(face, tolerance), face.marked) for face in level_faces(part, face_only)]
    marked = np.repeat([is_marked for _, is_marked in pieces], [len(piece) for piece, _ in pieces])
    return np.concatenate([piece for piece, _ in pieces]), marked


def welded(part: Part | BodyPart, corners: Array, marked: NDArray[np.bool_], grid: float) -> Mesh:
    """Closed mesh of a part from its triangles (m, 3, 3) on a grid of that spacing.

    Raises
    ------
    OutputError
        If they leave gaps.
    """
    ticks, index = _distinct(np.round(corners.reshape(-1, 3) / grid).astype(np.int64))
    triangles = index.reshape(-1, 3)
    # The lowest index first, then sorted.
    first = np.argmin(triangles, axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    order = np.lexsort(triangles.T[::-1])
    # On the grid a very short edge may have collapsed to a point.
    a, b, c = triangles[order].T
    order = order[(a != b) & (b != c) & (c != a)]
    if not is_closed(triangles[order]):
        raise failed(part.name, "gaps")
    up = np.array(part.pieces[0].rotation)[:, 2]
    return Mesh(part.name, part.material, np.asarray(ticks * grid, float), triangles[order], marked[order], up)


def is_closed(triangles: Indices) -> bool:
    """Tell whether every edge is shared by two triangles of the same orientation."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    count = int(triangles.max(initial=0)) + 1
    # One number for each directed edge; each must occur once, and its reverse as well.
    forward = np.sort(edges[:, 0] * count + edges[:, 1])
    backward = np.sort(edges[:, 1] * count + edges[:, 0])
    return bool(np.all(forward[1:] > forward[:-1])) and np.array_equal(forward, backward)


def kept_apart(meshes: Sequence[Mesh]) -> list[Mesh]:
    """Separate meshes with common points: such points of a later mesh move 0.1 um into their own part.

    An inlay fills its pocket without a gap. Programs that merge equal points would find edges with four triangles
    there and report a leak.
    """
    seen = np.zeros(0, "V24")
    apart = []
    for mesh in meshes:
        shared = np.isin(_keys(mesh.points), seen)
        points = mesh.points
        if shared.any():
            points = np.where(shared[:, None], points - _inward_step(mesh), points)
        seen = np.concatenate([seen, _keys(points)])
        apart.append(replace(mesh, points=points))
    return apart


def failed(name: str, problem: str) -> OutputError:
    """Return the error with what was found instead of bodies that make a closed mesh."""
    return OutputError(
        f"expected bodies that make a closed mesh of the part {name!r}, found {problem}; "
        "choose a finer or a coarser --tolerance"
    )


def _keys(points: Array) -> NDArray[np.void]:
    """Points (n, 3) as single values that can be compared."""
    return np.ascontiguousarray(points).view("V24").ravel()


def _distinct(rows: Indices) -> tuple[Indices, Indices]:
    """Distinct rows of an array (n, 3) in their order, and for each row its index among them."""
    order = np.lexsort(rows.T[::-1])
    rows = rows[order]
    new = np.concatenate([[True], np.any(rows[1:] != rows[:-1], axis=1)])
    index = np.empty(len(rows), dtype=np.int64)
    index[order] = np.cumsum(new) - 1
    return rows[new], index


def _inward_step(mesh: Mesh) -> Array:
    """Step of two grid units against each point's outward normal: level if possible, since heights are measured."""
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    faces, normals = np.cross(b - a, c - a), np.zeros_like(mesh.points)
    for axis in range(3):
        for corner in mesh.triangles.T:
            normals[:, axis] += np.bincount(corner, faces[:, axis], len(normals))
    level = normals - np.outer(normals @ mesh.up, mesh.up)
    upright = np.linalg.norm(level, axis=1) < 1e-6 * np.linalg.norm(normals, axis=1)
    ways = np.where(upright[:, None], normals, level)
    length = np.linalg.norm(ways, axis=1, keepdims=True)
    return np.round(2 * np.divide(ways, length, out=np.zeros_like(ways), where=length > 0)) * grid_of(mesh.points)


def grid_of(points: Array) -> float:
    """Grid spacing: twice that of 32-bit floats at the largest coordinate, so that points stay distinct in mm or m."""
    return 2.0 ** max(FINEST, ceil(log2(np.abs(points).max())) - 22)


def _walls_of(part: Part, tolerance: float, face_only: bool) -> Iterator[Array]:
    """Yield triangles (m, 3, 3) of all surfaces that are not level."""
    for body, sign, _ in list(signed_bodies(part))[face_only:]:
        for wall in _prism_walls(body, tolerance) if isinstance(body, Prism) else _revolved_walls(body, tolerance):
            yield wall if sign > 0 else wall[:, ::-1]


def _prism_walls(body: Prism, tolerance: float) -> Iterator[Array]:
    rim = body.top - body.chamfer
    for contour in (body.outer, *body.holes):
        ring = _ring(contour, contour, tolerance)
        slanted = bool(body.chamfer) and contour is body.outer
        yield _strip(at_height(ring, body.bottom), at_height(ring, rim if slanted else body.top))
        if slanted:
            inner = _ring(offset(contour, body.chamfer), contour, tolerance)
            yield _strip(at_height(ring, rim), at_height(inner, body.top))


def _revolved_walls(body: Revolved, tolerance: float) -> Iterator[Array]:
    for side in body.profile.sides:
        (r, z), (u, w), bulge = side
        if not bulge and (max(r, u) < SAME or abs(z - w) < SAME):
            continue  # on the axis, or level
        rings = _meridian(side, tolerance) if bulge else [(r, z, _count(r, tolerance)), (u, w, _count(u, tolerance))]
        points = [at_height(_circle(body.x, body.y, radius, count), height) for radius, height, count in rings]
        for low, high in pairwise(points):
            yield _strip(low, high)


def _meridian(side: Side, tolerance: float) -> list[tuple[float, float, int]]:
    """Radius, height and number of chords of the circles on an arc of a profile.

    Half the tolerance is for the chords along the arc, half for those across. On a ball the latter lie at an angle to
    the surface, and fewer suffice toward its poles.
    """
    (r, z), (u, w), bulge = side
    x, y = center_of(side)
    radius, angle = hypot(r - x, z - y), 4 * atan(bulge)
    is_ball = abs(x) < SAME
    # Chords along the meridian and around the axis share the tolerance.
    off = _off(radius, tolerance) if is_ball else tolerance / 2
    # A chord over the angle 2 h is off by r (1 - cos h).
    steps = max(1, ceil(abs(angle) / (2 * acos(max(1 - off / radius, 0.5)))))
    first = atan2(z - y, r - x)
    points = [(r, z, _count(r, tolerance))]
    for k in range(1, steps):
        at = first + angle * k / steps
        wide = x + radius * cos(at)
        points.append(
            # Where the surface slopes, a chord of a parallel is nearer to it than to its own circle, by the factor wide
            # / radius.
            (wide, y + radius * sin(at), _chords(wide**2 / radius, off) if is_ball else _count(wide, tolerance))
        )
    return [*points, (u, w, _count(u, tolerance))]


def _off(radius: float, tolerance: float) -> float:
    """Maximum distance of a chord of a whole circle from its arc: half the tolerance, or less if it is small."""
    return min(tolerance / 2, radius * (1 - cos(pi / LEAST)))


def _count(radius: float, tolerance: float) -> int:
    """Number of chords of a circle, the same in all parts; 1 for a point on the axis."""
    return _chords(radius, _off(radius, tolerance)) if radius >= SAME else 1


def _chords(radius: float, off: float) -> int:
    """Least multiple of four chords that are within a distance of their circle; four keep its width and height."""
    return 4 * ceil(pi / acos(max(1 - off / radius, 0.0)) / 4 - 1e-9)


def _circle(x: float, y: float, radius: float, count: int) -> Array:
    """Corners (count, 2) of a regular polygon on a circle, counterclockwise."""
    return np.array([x, y]) + (radius if count > 1 else 0.0) * _directions(count)


@lru_cache(maxsize=256)
def _directions(count: int) -> Array:
    angles = 2 * pi * np.arange(count) / count
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _ring(contour: Contour, like: Contour, tolerance: float) -> Array:
    """Corners (m, 2) of a polygon on a contour, in its direction, with the number of chords for a contour like it."""
    whole, model = contour.as_circle, like.as_circle
    if whole is None or model is None:
        return np.array(divided(contour, chord_counts(like, tolerance, LARGEST)))
    x, y, radius = whole
    ring = _circle(x, y, radius, _count(model[2], tolerance))
    return ring if contour.bulges[0] > 0 else ring[::-1]


def _strip(low: Array, high: Array) -> Array:
    """Triangles (m, 3, 3) between two rings with the same direction, their outside to the right of it."""
    return np.concatenate([low, high])[_stitches(len(low), len(high))]


@lru_cache(maxsize=1024)
def _stitches(low: int, high: int) -> Indices:
    """Triangles (m, 3) between rings of equally spaced points, as indices of the lower ones and then the upper ones.

    Of the two triangles possible next, the one with the shorter new edge is taken. Thus no angle at a ring is obtuse.
    """
    triangles, i, j = [], 0, 0
    # Around a point on the axis, only the other ring has chords.
    while (i < low and low > 1) or (j < high and high > 1):
        # Angles (i + 1) / low and j / high, times low high: the triangle whose new edge is closer to the meridian comes
        # next.
        along_low, along_high = abs((i + 1) * high - j * low), abs((j + 1) * low - i * high)
        if high == 1 or j == high or (low > 1 and i < low and along_low <= along_high):
            triangles.append((i, (i + 1) % low, low + j % high))
            i += 1
        else:
            triangles.append((i % low, low + (j + 1) % high, low + j % high))
            j += 1
    return np.array(triangles, dtype=np.int64)


def _filled(face: PlanarFace, tolerance: float) -> Array:
    """Triangles (m, 3, 3) of a level face."""
    outer, *holes = (_ring(rim.contour, rim.like, tolerance) for rim in face.rims)
    region = Region.polygon(outer, holes)
    if region.crosses_itself:
        raise ValueError(f"edges that cross at z = {face.z:.6g} mm")
    corners, _ = region.triangles()
    flat = np.concatenate([corners, np.full((*corners.shape[:2], 1), face.z)], axis=2)
    return flat[:, ::-1] if face.up else flat


def meshed(bodies: Sequence[Marker | Rig], options: ExportOptions, suffix: str) -> tuple[Designed, tuple[Mesh, ...]]:
    """Make the only marker of a mesh format, or a rig, with a note on its meshes, and these.

    Raises
    ------
    InputError
        If there is not exactly one marker, or it cannot be made as requested.
    OutputError
        If its parts make no closed meshes with that tolerance.
    """
    work, tolerance = designed_of(bodies, options, suffix), options.fabrication.tolerance * 1e3
    closeness = f"The mesh is within {tolerance * 1e3:.6g} um of the solid (--tolerance)."
    return replace(work, notes=(*work.notes, closeness)), meshes_of(work.made.parts, tolerance)


def parts_to_mesh(
    body: Marker | Rig, fabrication: Fabrication
) -> tuple[Sequence[Part | BodyPart], Callable[[float], tuple[Mesh, ...]]]:
    """Parts of a body as designed, and a function that meshes them within a tolerance in mm."""
    parts = made_of(body.as_designed, fabrication).parts
    return parts, partial(meshes_of, parts)


def stl_of(corners: Array, name: str, unit: str, record: str = "") -> bytes:
    """Write triangles (m, 3, 3) as one binary STL whose header has their name, unit and record, if it has room."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    facets = np.zeros(len(corners), FACET)
    # Triangles with collinear corners close the surface and have no normal.
    facets["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    facets["corners"] = corners
    # A text STL begins with "solid", so a binary one must not.
    # How fine and how thick it is, it shows, and marker.json mostly has its edge.
    left_out = ("tolerance", "tolerance|edge", "tolerance|edge|thickness")
    shorter = [re.sub(rf',?"(?:{keys})":[^,}}]*', "", record) for keys in left_out]
    headers = [f"{title}{unit} {text}" for text in (record, *shorter) if text for title in (f"{name}, ", "")]
    headers += [f"{name}, markergen {markergen.__version__}, {unit}", f"{name}, {unit}"][bool(record) :]
    header = next(text for text in headers if len(text) <= 80)
    return header.encode("ascii").ljust(80) + np.uint32(len(facets)).astype("<u4").tobytes() + facets.tobytes()
