"""Read meshes in a child process and reduce them to a plan view: shells, level faces, circles, balls."""

# tests: tests/verification/test_solid_readers.py

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import markergen.read.meshes
from markergen.arrays import Array
from markergen.errors import InputError
from markergen.guard import MOST_TRIANGLES, Content, in_child, start_child
from markergen.model.body import Body
from markergen.read.meshes import MeshObject
from markergen.read.meshes.step_parser import MOST_SIDES, SMALLEST_SIDE
from markergen.verification.reading import READERS, Reading, Settings
from markergen.verification.solids import level_face, reading_of
from markergen.verification.surface import (
    Ball,
    Color,
    LevelFace,
    SolidPart,
    Surface,
    rotation_up,
)  # fmt: skip

Indices = NDArray[np.int64]

PARSER = Path(markergen.read.meshes.__file__).with_name("mesh_parser.py")

LEVEL = 1e-4
"""Maximum difference of height within a level triangle, mm: single precision on a 1 m plate, rotated or not."""

ANGLE = 1e-3
"""Angle in rad below which two triangles around an edge count as touching."""

STEEPEST, FLATTEST = 0.02, 0.9995
"""Range of z of the normals of triangles that may belong to a ball; others are walls and level faces."""

BALL = 1e-3
"""Maximum deviation of corners from a ball, as a share of its radius."""

SLANT = 0.8
"""Minimum cosine of the angle between a triangle's normal and that of its ball."""

FLATTEST_BALL = 0.02
"""Minimum ratio of the height of a squashed ball to its width."""

RELATIVE = 4e-6
"""As `LEVEL`, relative to the largest coordinate, for views from the side."""

COARSE, SNAP = 1e-3, 2e-4
"""Width in rad of the groups of parallel triangles, and angle below which a direction is one that is expected."""

MOST_PARTS, MOST_LEVEL, MOST_SHARED = 20_000, 100_000, 200_000
"""Maximum numbers of shells, of level faces, and of triangles' sides at edges where more than two triangles meet."""


def _read(kind: str, data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read the triangles of an STL, the objects in the build of a 3MF, or the meshes in the scene of a GLB, in mm."""
    objects, flaws = mesh_of(kind, data, name)
    twice = sum(map(_doubled, objects))
    flaws += [f"{twice} triangles are there twice"] if twice else []
    reading = reading_of(kind, views_of(objects, body, name), body)
    return replace(reading, flaws=(*flaws, *reading.flaws))


for _kind in ("STL", "3MF", "GLB"):
    READERS.register(f".{_kind.lower()}")(partial(_read, _kind))


def mesh_of(kind: str, data: bytes, name: str) -> tuple[list[MeshObject], list[str]]:
    """Read a mesh in a child process: its objects, and what is not drawn or made as they are.

    Raises
    ------
    InputError
        If it is not a complete one.
    """
    start_child(PARSER, "mesh")
    # Imported early, to load while the child starts.
    import scipy.sparse.csgraph
    import scipy.spatial  # noqa: F401

    values, arrays = in_child(PARSER, f"read_{kind.lower()}", Content(name, data), "mesh", f"a {kind} in {name}")
    objects = []
    for k, mesh in enumerate(values["objects"]):
        color, palette = mesh["color"], [(red, green, blue) for red, green, blue in mesh["palette"]]
        corners, paints = arrays[f"corners{k}"].astype(float), arrays.get(f"paints{k}")
        objects.append(
            MeshObject(corners, mesh["name"], tuple(color) if color else None, paints, palette, mesh["tool"])
        )
    return objects, values["flaws"]


def _doubled(mesh: MeshObject) -> int:
    """Number of triangles that are there before, with the same side outside."""
    sides = mesh.corners[:, 1] - mesh.corners[:, 0], mesh.corners[:, 2] - mesh.corners[:, 0]
    rows = np.round(np.column_stack([mesh.corners.sum(axis=1), np.cross(*sides)]), 5)
    # One number instead of six: sorting takes a fifth of the time.
    return len(rows) - len(np.unique(rows @ np.sqrt([2.0, 3, 5, 7, 11, 13])))


def surface_of(objects: Sequence[MeshObject], name: str, level: float = LEVEL) -> Surface:
    """Surface of the objects of a file, with each shell as a separate part; level to within `level` mm.

    Raises
    ------
    InputError
        If there are no triangles, too many, or corners that are not finite or lie beyond 10 km.
    """
    count = sum(len(mesh.corners) for mesh in objects)
    if not count:
        raise InputError(f"triangles in {name}", "none", "export it again")
    if count > MOST_TRIANGLES:
        raise InputError(
            f"at most {MOST_TRIANGLES} triangles in {name}", str(count), "export it with a larger tolerance"
        )
    if not all((np.abs(mesh.corners) < 1e7).all() for mesh in objects):
        raise InputError(f"corners within 10 km in {name}", "numbers beyond that or not finite", "export it again")

    def mapped(matrix: Array) -> Surface:
        return surface_of([mesh.mapped(matrix) for mesh in objects], name, level)

    def views() -> list[Surface]:
        rotations = [rotation_up(normal) for normal in _widest(objects)]
        return [replace(mapped(rotation), rotation=rotation) for rotation in rotations if rotation[2, 2] < 1 - LEVEL]

    left = MOST_PARTS
    parts: list[SolidPart] = []
    for mesh in objects:
        parts += _parts(mesh, left, name, level)
        left = MOST_PARTS - len(parts)
    return Surface(tuple(parts), views, mapped, triangles=np.concatenate([mesh.corners for mesh in objects]))


def _widest(objects: Sequence[MeshObject]) -> list[Array]:
    """Unit normals of the largest area of parallel triangles, and the opposite one: the two faces of a plate."""
    areas = np.concatenate([np.cross(mesh.corners[:, 1] - mesh.corners[:, 0], mesh.corners[:, 2] - mesh.corners[:, 0])
                            for mesh in objects])  # fmt: skip
    size = np.linalg.norm(areas, axis=1)
    areas, size = areas[size > 0], size[size > 0]
    if not len(size):
        return []
    # Opposite normals together, since a plate's back is larger than its face.
    ways = areas / size[:, None]
    ways *= np.where(ways[np.arange(len(ways)), np.argmax(np.abs(ways), axis=1)] < 0, -1.0, 1.0)[:, None]
    _, group = np.unique(np.round(ways, 2), axis=0, return_inverse=True)
    chosen = group.ravel() == np.argmax(np.bincount(group.ravel(), weights=size))
    way = np.sum(ways[chosen] * size[chosen, None], axis=0)
    way /= np.linalg.norm(way)
    return [way, -way]


def views_of(objects: Sequence[MeshObject], body: Body, name: str) -> list[Surface]:
    """Plan view of the objects of a file or, for a body of several plates, the views from all sides."""
    if body.frame == "marker":
        return [surface_of(objects, name)]
    return _sides_of(objects, np.array([plate.rotation_matrix[:, 2] for plate in body.plates]), name)


def _sides_of(objects: Sequence[MeshObject], ways: Array, name: str) -> list[Surface]:
    """Views with each of the larger level areas up, which may be one of the unit vectors (k, 3) that are expected."""
    corners = np.concatenate([mesh.corners for mesh in objects])
    if not len(corners):
        return []
    # Rotated, coordinates in single precision are off a plane by up to 4e-7 of the largest one.
    level = max(LEVEL, RELATIVE * float(np.abs(corners).max()))
    views = []
    for way in _sides(corners, ways):
        rotation = rotation_up(way)
        view = surface_of([mesh.mapped(rotation) for mesh in objects], name, level)
        views.append(replace(view, rotation=rotation))
    return views


def _sides(corners: Array, ways: Array) -> list[Array]:
    """Unit normals of the larger areas of parallel triangles, the largest first; expected ones (k, 3) as they are."""
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(areas, axis=1)
    areas, size = areas[size > 0], size[size > 0]
    if not len(size):
        return []
    _, group = np.unique(np.round(areas / size[:, None] / COARSE), axis=0, return_inverse=True)
    sums = np.stack([np.bincount(group.ravel(), weights=axis) for axis in areas.T], axis=1)
    total = np.linalg.norm(sums, axis=1)
    sums, total = (array[np.argsort(-total, kind="stable")] for array in (sums, total))
    normals: list[Array] = []
    for sum_, area in zip(sums, total, strict=True):
        if area < SMALLEST_SIDE * total[0] or len(normals) == 2 * MOST_SIDES:
            break
        way = sum_ / area
        snapped = ways[np.linalg.norm(ways - way, axis=1) < SNAP] if len(ways) else ways
        way = snapped[0] if len(snapped) else way
        if all(np.linalg.norm(way - normal) > SNAP for normal in normals):
            normals.append(way)
    return normals


def _parts(mesh: MeshObject, most: int, name: str, flat: float) -> list[SolidPart]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    places, index = _welded(mesh.corners)
    triangles = index.reshape(-1, 3)
    a, b, c = triangles.T
    proper = (a != b) & (b != c) & (c != a)
    triangles = triangles[proper]
    paints = np.full(len(proper), -1) if mesh.paints is None else mesh.paints
    paints = paints[proper]
    if not len(triangles):
        return []
    p, q, r = np.moveaxis(places[triangles], 1, 0)
    inside_out = bool(np.einsum("ij,ij->", p - p[0], np.cross(q - p[0], r - p[0])) < 0)
    if inside_out:
        triangles = triangles[:, ::-1]
    neighbors = _neighbors(places, triangles, name)
    m = len(triangles)
    is_shared = neighbors >= 0
    rows = np.repeat(np.arange(m), 3).reshape(m, 3)[is_shared]
    links = coo_array((np.ones(len(rows), dtype=np.int8), (rows, neighbors[is_shared])), shape=(m, m))
    total, shell = connected_components(links, directed=False)
    if total > most:
        raise InputError(f"at most {MOST_PARTS} separate bodies in {name}", "more", "export the marker alone")
    faces, backs = (_faces(places, triangles, neighbors, level, paints, mesh.palette, name)
                    for level in _level(places, triangles, flat))  # fmt: skip
    fronts_of: list[list[LevelFace]] = [[] for _ in range(total)]
    backs_of: list[list[LevelFace]] = [[] for _ in range(total)]
    for level_faces, of in ((faces, fronts_of), (backs, backs_of)):
        for first, face in level_faces:
            of[shell[first]].append(face)
    parts = []
    for number, group in enumerate(_grouped(shell, total)):
        corners = places[triangles[group]]
        p, q, r = np.moveaxis(corners, 1, 0)
        volume = float(np.einsum("ij,ij->", p, np.cross(q, r)) / 6)
        low, high = corners.min(axis=(0, 1)).tolist(), corners.max(axis=(0, 1)).tolist()
        closed = bool(is_shared[group].all())
        painted = np.bincount(paints[group] + 1, minlength=1)
        main = int(np.argmax(painted)) - 1
        parts.append(
            SolidPart(
                mesh.name, mesh.palette[main] if main >= 0 else mesh.color, volume, closed and not inside_out, closed,
                (low[0], low[1], low[2]), (high[0], high[1], high[2]), tuple(fronts_of[number]),
                _balls(corners, mesh.palette[main] if main >= 0 else None), tuple(backs_of[number]),
                mesh.tool,
            )
        )  # fmt: skip
    return parts


def _welded(corners: Array) -> tuple[Array, Indices]:
    """Different points (n, 3) among corners (m, 3, 3), and the index of each corner's point.

    Points are distinguished by a hash of 64 bits, in a fifth of the time that sorting them takes.
    """
    # Adding 0.0 makes -0.0 and 0.0 the same coordinate.
    points = np.ascontiguousarray(corners.reshape(-1, 3) + 0.0)
    bits = points.view(np.uint64) >> np.uint64(20) ^ points.view(np.uint64) << np.uint64(44)
    key = bits @ np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    return points[first], index


def _grouped(label: Indices, total: int) -> list[Indices]:
    """Indices of the items with each label from 0."""
    order = np.argsort(label, kind="stable")
    return np.split(order, np.searchsorted(label[order], np.arange(1, total)))


def _neighbors(places: Array, triangles: Indices, name: str) -> Indices:
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
    across = np.full(3 * m, -1, dtype=np.int64)
    pair = first[size == 2]
    first_side, second_side = order[pair], order[pair + 1]
    opposed = start[first_side] != start[second_side]
    first_side, second_side = first_side[opposed], second_side[opposed]
    across[first_side], across[second_side] = owner[second_side], owner[first_side]
    if np.sum(size[size > 2]) > MOST_SHARED:
        raise InputError(
            f"at most {MOST_SHARED // 4} edges in {name} that bodies share", "more", "export each body on its own"
        )
    for where, many in zip(first[size > 2], size[size > 2], strict=True):
        sides = order[where : where + many]
        for closing, opening in _wedges(places, triangles, sides, low[sides[0]], high[sides[0]], start, owner):
            across[closing], across[opening] = owner[opening], owner[closing]
    return across.reshape(m, 3)


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


def _level(places: Array, triangles: Indices, within: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which triangles are level to within a distance in mm and face up, and which are and face down."""
    p, q, r = np.moveaxis(places[triangles], 1, 0)
    z = places[triangles, 2]
    u, v = (q - p)[:, :2], (r - p)[:, :2]
    flat, area = np.ptp(z, axis=1) < within, u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return flat & (area > 0), flat & (area < 0)


def _faces(
    places: Array, triangles: Indices, neighbors: Indices, level: NDArray[np.bool_], paints: Indices,
    palette: Sequence[Color], name: str,
) -> list[tuple[int, LevelFace]]:  # fmt: skip
    """Level faces, each of connected level triangles of one color, with the index of one of these."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    mine = np.flatnonzero(level)
    if not len(mine):
        return []
    place = np.full(len(triangles), -1)
    place[mine] = np.arange(len(mine))
    across = neighbors[mine]
    inner = (across >= 0) & level[across] & (paints[across] == paints[mine][:, None])
    rows, _ = np.nonzero(inner)
    links = coo_array((np.ones(len(rows), dtype=np.int8), (rows, place[across[inner]])), shape=(len(mine),) * 2)
    total, face = connected_components(links, directed=False)
    if total > MOST_LEVEL:
        raise InputError(f"at most {MOST_LEVEL} level faces in {name}", "more", "export the marker alone")
    starts = triangles[mine][~inner]
    ends = np.roll(triangles[mine], -1, axis=1)[~inner]
    borders = _grouped(face[np.nonzero(~inner)[0]], total)
    faces = []
    for border, members in zip(borders, _grouped(face, total), strict=True):
        rings = [places[ring, :2] for ring in _rings(starts[border], ends[border])]
        paint = int(paints[mine[members[0]]])
        if rings:
            z = float(np.median(places[triangles[mine[members]], 2]))
            face_color = palette[paint] if paint >= 0 else None
            faces.append((int(mine[members[0]]), level_face(z, [(ring, None, True) for ring in rings], face_color)))
    return faces


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


def _balls(corners: Array, color: Color | None) -> tuple[Ball, ...]:
    """Fit a ball to the surface of a shell (m, 3, 3) that is neither level nor vertical; empty if it is not a ball."""
    p, q, r = np.moveaxis(corners, 1, 0)
    normal = np.cross(q - p, r - p)
    size = np.maximum(np.linalg.norm(normal, axis=-1), np.finfo(float).tiny)
    up = normal[:, 2] / size
    # Only the upper half of a ball faces up; its neck and base do not.
    chosen = (up > STEEPEST) & (up < FLATTEST)
    if np.sum(chosen) < 12:
        return ()
    points = _welded(corners[chosen])[0]
    # A sphere passes through any two coaxial circles.
    if len(np.unique(np.round(points[:, 2], 3))) < 4:
        return ()
    fitted = _sphere(points) or _spheroid(points)
    if fitted is None:
        return ()
    center, radius, flatness = fitted
    # Through the rims of a tilted disk there are balls too.
    outward = (corners[chosen].mean(axis=1) - center) / np.array([1, 1, flatness**2])
    slant = np.sum(outward * normal[chosen], axis=1) / (np.linalg.norm(outward, axis=1) * size[chosen])
    if slant.min() < SLANT:
        return ()
    top = (float(points[:, 2].max()) - center[2]) / flatness
    bottom = max((float(points[:, 2].min()) - center[2]) / flatness, 0.0)
    if top <= 0:
        return ()
    # Triangles near the pole are nearly level but still belong to the ball.
    shape = np.array([1, 1, 1 / flatness])
    away = np.linalg.norm((corners - center) * shape, axis=-1) - radius
    part = chosen | ((np.abs(away) < BALL * radius).all(axis=1) & (np.abs(up) >= STEEPEST))
    hole = _top_edge(corners[part], center, radius, flatness)
    rim = float(np.sqrt(max(radius**2 - bottom**2, 0.0)))
    x, y, z = center.tolist()
    return (Ball(x, y, z, radius, hole, rim if rim > hole else radius, color, flatness),)


def _sphere(points: Array) -> tuple[Array, float, float] | None:
    """Center, radius and flatness 1 of the sphere through points (m, 3); None if there is none."""
    middle = points.mean(axis=0)
    offset = points - middle
    rows = np.column_stack([2 * offset, np.ones(len(offset))])
    solved, *_ = np.linalg.lstsq(rows, (offset**2).sum(axis=-1), rcond=None)
    square = solved[3] + solved[:3] @ solved[:3]
    if not square > 0:
        return None
    radius, center = float(np.sqrt(square)), middle + solved[:3]
    if np.abs(np.linalg.norm(points - center, axis=-1) - radius).max() > BALL * radius:
        return None
    return center, radius, 1.0


def _spheroid(points: Array) -> tuple[Array, float, float] | None:
    """Center, mean radius in plan view, and flatness of a ball that was scaled along some axis; None for others."""
    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max()) / 2
    x, y, z = ((points - middle) / size).T
    rows = np.column_stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z])
    if len(rows) < 20:
        return None
    (a, b, c, d, e, f, *line), *_ = np.linalg.lstsq(rows, np.ones(len(x)), rcond=None)
    shape = np.array([[a, d / 2, e / 2], [d / 2, b, f / 2], [e / 2, f / 2, c]])
    shape = shape if np.trace(shape) > 0 else -shape
    sign = 1.0 if a + b + c > 0 else -1.0
    if not np.linalg.eigvalsh(shape).min() > 0:
        return None
    center = -np.linalg.solve(shape, sign * np.array(line)) / 2
    scale = sign + center @ shape @ center
    if not scale > 0:
        return None
    axes = np.linalg.inv(shape) * scale
    offset = np.stack([x, y, z], axis=-1) - center
    off = np.sqrt(np.einsum("mi,ij,mj->m", offset, shape, offset) / scale) - 1
    radius = float(np.linalg.det(axes[:2, :2]) ** 0.25)
    flatness = float(np.sqrt(axes[2, 2])) / radius
    if np.abs(off).max() > BALL or not FLATTEST_BALL < flatness < 1 / FLATTEST_BALL:
        return None
    return middle + size * center, size * radius, flatness


def _top_edge(corners: Array, center: Array, radius: float, flatness: float) -> float:
    """Radius of the upper edge of a piece of a ball, triangles (m, 3, 3); 0 if the pole is included."""
    _, index = _welded(corners)
    starts, ends = index.reshape(-1, 3).ravel(), np.roll(index.reshape(-1, 3), -1, axis=1).ravel()
    count = int(index.max()) + 1
    edge = ~np.isin(starts * count + ends, ends * count + starts)
    first, last = corners.reshape(-1, 3)[edge], np.roll(corners, -1, axis=1).reshape(-1, 3)[edge]
    high = (first + last)[:, 2] / 2 - center[2] > 0.2 * radius * flatness
    if not high.any():
        return 0.0
    return float(np.median(np.linalg.norm(first[high][:, :2] - center[:2], axis=-1)))
