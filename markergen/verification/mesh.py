"""Read meshes in a child process and reduce them to a plan view: shells, level faces, circles, balls."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.geometry.contour import area
from markergen.guard import MOST_TRIANGLES, Content, in_child, start_child
from markergen.model.marker import Marker
from markergen.verification.reading import READERS, Reading, round_shape
from markergen.verification.solids import reading_of
from markergen.verification.surface import Ball, Color, LevelFace, SolidPart, Surface, edge_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

PARSERS = Path(__file__).with_name("mesh_parsers.py")

TOLERANCE = 5e-6
"""Default tolerance of a mesh, m."""

LEVEL = 1e-4
"""Maximum difference of height within a level triangle, mm: single precision on a 1 m plate, rotated or not."""

ANGLE = 1e-3
"""Angle in rad below which two triangles around an edge count as touching."""

STEEPEST, FLATTEST = 0.02, 0.9995
"""Range of z of the normals of triangles that may belong to a ball; others are walls and level faces."""

BALL = 1e-3
"""Maximum deviation of corners from a ball, as a share of its radius."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles of one object of a file, in mm, with z pointing out of the printed face.

    Attributes
    ----------
    corners : array (m, 3, 3)
        Counterclockwise seen from outside.
    name : str
    color : (red, green, blue) or None
    paints : array (m,) of int
        Index of each triangle's own color in `palette`, or -1 for the object's color.
    palette : sequence of colors
    """

    corners: Array
    name: str = ""
    color: Color | None = None
    paints: NDArray[np.int64] | None = None
    palette: Sequence[Color] = ()


@READERS.register(".stl")
def read_stl(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Read the triangles of an STL in mm."""
    return _read("STL", data, name)


@READERS.register(".3mf")
def read_3mf(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Read the objects in the build of a 3MF, in mm, with the colors of their base materials."""
    return _read("3MF", data, name)


@READERS.register(".glb")
def read_glb(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Read the meshes in the scene of a GLB, in mm, marker frame."""
    return _read("GLB", data, name)


def _read(kind: str, data: bytes, name: str) -> Reading:
    return reading_of(kind, surface_of(triangles_of(kind, data, name), name), TOLERANCE)


def triangles_of(kind: str, data: bytes, name: str) -> list[Triangles]:
    """Read the objects of a mesh in a child process; raises InputError if it is not a complete one."""
    start_child(PARSERS, "mesh")
    # Imported early, to load while the child starts.
    import scipy.sparse.csgraph
    import scipy.spatial  # noqa: F401

    values, arrays = in_child(PARSERS, f"read_{kind.lower()}", Content(name, data), "mesh", f"a {kind} in {name}")
    objects = []
    for k, each in enumerate(values["objects"]):
        color, palette = each["color"], [(red, green, blue) for red, green, blue in each["palette"]]
        corners = arrays[f"corners{k}"].astype(float)
        objects.append(
            Triangles(corners, each["name"], tuple(color) if color else None, arrays.get(f"paints{k}"), palette)
        )
    return objects


def surface_of(objects: Sequence[Triangles], name: str) -> Surface:
    """Surface of the objects of a file, with each shell as a separate part.

    Raises
    ------
    InputError
        If there are no triangles, too many, or corners that are not finite or lie beyond 10 km.
    """
    count = sum(len(each.corners) for each in objects)
    if not count:
        raise InputError(f"triangles in {name}", "none", "export it again")
    if count > MOST_TRIANGLES:
        raise InputError(
            f"at most {MOST_TRIANGLES} triangles in {name}", str(count), "export it with a larger tolerance"
        )
    if not all((np.abs(each.corners) < 1e7).all() for each in objects):
        raise InputError(f"corners within 10 km in {name}", "numbers beyond that or not finite", "export it again")
    return Surface(tuple(part for each in objects for part in _parts(each)))


def _parts(each: Triangles) -> list[SolidPart]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Adding 0.0 makes -0.0 and 0.0 the same coordinate.
    places, index = np.unique(each.corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    a, b, c = triangles.T
    proper = (a != b) & (b != c) & (c != a)
    triangles = triangles[proper]
    paints = np.full(len(proper), -1) if each.paints is None else each.paints
    paints = paints[proper]
    if not len(triangles):
        return []
    p, q, r = np.moveaxis(places[triangles], 1, 0)
    inside_out = bool(np.einsum("ij,ij->", p - p[0], np.cross(q - p[0], r - p[0])) < 0)
    if inside_out:
        triangles = triangles[:, ::-1]
    neighbors = _neighbors(places, triangles)
    m = len(triangles)
    known = neighbors >= 0
    rows = np.repeat(np.arange(m), 3).reshape(m, 3)[known]
    links = coo_array((np.ones(len(rows), dtype=np.int8), (rows, neighbors[known])), shape=(m, m))
    total, shell = connected_components(links, directed=False)
    order = np.argsort(shell, kind="stable")
    groups = np.split(order, np.searchsorted(shell[order], np.arange(1, total)))
    level = _level(places, triangles)
    parts = []
    for group in groups:
        corners = places[triangles[group]]
        p, q, r = np.moveaxis(corners, 1, 0)
        volume = float(np.einsum("ij,ij->", p, np.cross(q, r)) / 6)
        faces = _faces(places, triangles, neighbors, level, paints, group, each.palette)
        low, high = corners.min(axis=(0, 1)).tolist(), corners.max(axis=(0, 1)).tolist()
        closed = bool(known[group].all())
        balls = _balls(places, triangles, neighbors, group, paints, each.palette)
        parts.append(
            SolidPart(
                each.name, each.color, volume, closed and not inside_out, closed,
                (low[0], low[1], low[2]), (high[0], high[1], high[2]), faces, balls,
            )
        )  # fmt: skip
    return parts


def _neighbors(places: Array, triangles: Indices) -> Indices:
    """Index (m, 3) of the triangle across each edge (corners 1 to 2, 2 to 3, 3 to 1); -1 for none.

    Where solids touch, four triangles meet at an edge: those with material between them are neighbors.
    """
    m = len(triangles)
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    owner = np.repeat(np.arange(m), 3)
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low * (int(triangles.max()) + 1) + high
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(key[order]) > 0])
    size = np.diff(np.r_[first, len(order)])
    found = np.full(3 * m, -1, dtype=np.int64)
    pair = first[size == 2]
    one, two = order[pair], order[pair + 1]
    opposed = start[one] != start[two]
    one, two = one[opposed], two[opposed]
    found[one], found[two] = owner[two], owner[one]
    for where, many in zip(first[size > 2], size[size > 2], strict=True):
        sides = order[where : where + many]
        for closing, opening in _wedges(places, triangles, sides, low[sides[0]], high[sides[0]], start, owner):
            found[closing], found[opening] = owner[opening], owner[closing]
    return found.reshape(m, 3)


def _wedges(
    places: Array, triangles: Indices, sides: Indices, low: int, high: int, start: Indices, owner: Indices
) -> list[tuple[int, int]]:
    """Pair the sides at one edge whose triangles have material between them.

    Seen along the edge, material starts at a triangle that traverses it backward and extends counterclockwise to the
    next that traverses it forward. In a tie the end comes before the start.
    """
    along = places[high] - places[low]
    along = along / np.linalg.norm(along)
    third = triangles[owner[sides]].sum(axis=1) - low - high
    away = places[third] - places[low]
    away -= np.outer(away @ along, along)
    u = away[0] / np.linalg.norm(away[0])
    angle = np.arctan2(away @ np.cross(along, u), away @ u)
    order = np.argsort(angle)
    # Directions closer than ANGLE coincide, also across the branch cut of the angle.
    step = np.cumsum(np.r_[0, np.diff(angle[order]) > ANGLE])
    if 2 * np.pi - angle[order[-1]] + angle[order[0]] < ANGLE:
        step[step == step[-1]] = 0
    begins = start[sides[order]] != low
    order = order[np.lexsort((begins, step))]
    begins = start[sides[order]] != low
    pairs, waiting = [], []
    for k in [*order[_from(begins) :], *order[: _from(begins)]]:
        if start[sides[k]] != low:
            waiting.append(k)
        elif waiting:
            pairs.append((int(sides[k]), int(sides[waiting.pop()])))
    return pairs


def _from(begins: NDArray[np.bool_]) -> int:
    """Index of the first start of material that follows an end."""
    starts = np.flatnonzero(begins & ~np.roll(begins, 1))
    return int(starts[0]) if len(starts) else 0


def _level(places: Array, triangles: Indices) -> NDArray[np.bool_]:
    """Tell which triangles are level and face up."""
    p, q, r = np.moveaxis(places[triangles], 1, 0)
    z = places[triangles, 2]
    u, v = (q - p)[:, :2], (r - p)[:, :2]
    return np.asarray((np.ptp(z, axis=1) < LEVEL) & (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0))


def _faces(
    places: Array, triangles: Indices, neighbors: Indices, level: NDArray[np.bool_], paints: Indices, group: Indices,
    palette: Sequence[Color],
) -> tuple[LevelFace, ...]:  # fmt: skip
    """Level faces of one shell: connected level triangles of one color."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    mine = group[level[group]]
    if not len(mine):
        return ()
    place = np.full(len(triangles), -1)
    place[mine] = np.arange(len(mine))
    across = neighbors[mine]
    inner = (across >= 0) & level[across] & (paints[across] == paints[mine][:, None])
    rows, _ = np.nonzero(inner)
    links = coo_array((np.ones(len(rows), dtype=np.int8), (rows, place[across[inner]])), shape=(len(mine),) * 2)
    total, face = connected_components(links, directed=False)
    starts = triangles[mine][~inner]
    ends = np.roll(triangles[mine], -1, axis=1)[~inner]
    of = face[np.nonzero(~inner)[0]]
    order = np.argsort(of, kind="stable")
    borders = np.split(order, np.searchsorted(of[order], np.arange(1, total)))
    found = []
    for number, border in enumerate(borders):
        member = mine[face == number] if total < 50 else mine[np.flatnonzero(face == number)]
        outlines = [places[ring, :2] for ring in _rings(starts[border], ends[border])]
        edges = sorted((edge_of(each, round_shape(each)) for each in outlines), key=lambda edge: -abs(area(edge)))
        paint = int(paints[member[0]])
        if edges:
            z = float(np.median(places[triangles[member], 2]))
            found.append(LevelFace(z, tuple(edges), palette[paint] if paint >= 0 else None))
    return tuple(found)


def _rings(starts: Indices, ends: Indices) -> list[Indices]:
    """Closed loops of edges, as indices of points."""
    following: dict[int, list[int]] = {}
    for a, b in zip(starts.tolist(), ends.tolist(), strict=True):
        following.setdefault(a, []).append(b)
    rings = []
    while following:
        first = next(iter(following))
        ring, at = [first], first
        while at in following:
            nexts = following[at]
            to = nexts.pop()
            if not nexts:
                del following[at]
            at = to
            if at == first:
                break
            ring.append(at)
        if at == first and len(ring) > 2:
            rings.append(np.array(ring))
    return rings


def _balls(
    places: Array, triangles: Indices, neighbors: Indices, group: Indices, paints: Indices, palette: Sequence[Color]
) -> tuple[Ball, ...]:
    """Fit a ball to the surface of a shell that is neither level nor vertical; empty if it is not a ball."""
    p, q, r = np.moveaxis(places[triangles[group]], 1, 0)
    normal = np.cross(q - p, r - p)
    up = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=-1), np.finfo(float).tiny)
    # Only the upper half of a ball faces up; its neck and base do not.
    chosen = group[(up > STEEPEST) & (up < FLATTEST)]
    if len(chosen) < 12:
        return ()
    corners = np.unique(triangles[chosen])
    points = places[corners]
    # A sphere passes through any two coaxial circles.
    if len(np.unique(np.round(points[:, 2], 3))) < 4:
        return ()
    middle = points.mean(axis=0)
    offset = points - middle
    rows = np.column_stack([2 * offset, np.ones(len(offset))])
    solved, *_ = np.linalg.lstsq(rows, (offset**2).sum(axis=-1), rcond=None)
    square = solved[3] + solved[:3] @ solved[:3]
    if not square > 0:
        return ()
    radius, center = float(np.sqrt(square)), middle + solved[:3]
    if np.abs(np.linalg.norm(points - center, axis=-1) - radius).max() > BALL * radius:
        return ()
    x, y, z = center.tolist()
    top = float(points[:, 2].max()) - z
    bottom = max(float(points[:, 2].min()) - z, 0.0)
    if top <= 0:
        return ()
    hole = _top_edge(places, triangles, neighbors, chosen, center, radius)
    rim = float(np.sqrt(max(radius**2 - bottom**2, 0.0)))
    paint = int(paints[chosen[0]])
    return (Ball(x, y, z, radius, hole, rim if rim > hole else radius, palette[paint] if paint >= 0 else None),)


def _top_edge(
    places: Array, triangles: Indices, neighbors: Indices, chosen: Indices, center: Array, radius: float
) -> float:
    """Radius of the upper edge of a piece of a ball; 0 if the pole is included."""
    inside = np.zeros(len(triangles), dtype=bool)
    inside[chosen] = True
    # Triangles near the pole are nearly level but still belong to the ball.
    on = np.abs(np.linalg.norm(places - center, axis=-1) - radius) < BALL * radius
    p, q, r = np.moveaxis(places[triangles], 1, 0)
    upright = np.abs(np.cross(q - p, r - p)[:, 2]) < STEEPEST * np.linalg.norm(np.cross(q - p, r - p), axis=-1)
    inside |= on[triangles].all(axis=1) & ~upright
    across = neighbors[chosen]
    edge = (across < 0) | ~inside[across]
    rows, columns = np.nonzero(edge)
    if not len(rows):
        return 0.0
    starts, ends = triangles[chosen[rows], columns], triangles[chosen[rows], (columns + 1) % 3]
    middles = (places[starts] + places[ends]) / 2
    high = middles[:, 2] - center[2] > 0.2 * radius
    if not high.any():
        return 0.0
    corner = places[starts[high]]
    return float(np.median(np.linalg.norm(corner[:, :2] - center[:2], axis=-1)))
