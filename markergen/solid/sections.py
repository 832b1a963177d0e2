"""What is seen and what is cut of parts, as plain polygons: the views of a fabrication sheet, without a CAD kernel."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import ceil, cos, pi, sin, sqrt
from typing import Any

import numpy as np

from markergen.drawing.scene import Box
from markergen.drawing.workshop import Face, Ring
from markergen.geometry import contour
from markergen.geometry.contour import Contour as Path
from markergen.geometry.contour import flattened as flattened_to
from markergen.geometry.contour import inset
from markergen.solid.bodies import OFF, OTHER, SAME, Body, Part, Prism, Revolved


def flattened(path: Path) -> list[tuple[float, float]]:
    return flattened_to(path, OFF)


def span(body: Body) -> tuple[float, float]:
    return body.span


CHAMFERED = 12
"""Steps of a section across a chamfer, between which it is straight; one that is cut at a right angle is so anyway."""

BACK, FRONT = -1, 1


def seen(parts: Sequence[Part], side: int = FRONT) -> tuple[Face, ...]:
    """Parts as they are seen from +z (`FRONT`), or from -z (`BACK`), from where x runs to the left.

    Faces are in painting order: what comes later is nearer, or lies in what came before. Edges that are hidden are left
    out.
    """
    found: list[tuple[tuple[float, int], Face]] = []
    for part in parts:
        inlay = 0 if part.is_plate else 2
        nearest = min(_end(body, side) for body in part.add)
        deepest = max(_end(body, -side) for body in part.add)
        for body in part.add:
            found.append(((_end(body, side), inlay), _plan(body, part.material, side)))
        for body, floor in (*((b, part.material) for b in part.cut), *((b, OTHER[part.material]) for b in part.marked)):
            if _end(body, side) > nearest - SAME:
                through = _end(body, -side) > deepest - SAME
                found.append(((_end(body, side), inlay + 1), _plan(body, "" if through else floor, side, hollow=True)))
    found.sort(key=lambda each: (round(each[0][0], 6), each[0][1]))
    faces = [face for _, face in found]
    return tuple(_mirrored(face) for face in faces) if side == BACK else tuple(faces)


def elevation(parts: Sequence[Part]) -> tuple[Face, ...]:
    """Parts as they are seen from -y with x to the right and z up, in painting order; what lies in plates is hidden."""
    import shapely

    plates = [part for part in parts if part.is_plate]
    slabs: list[tuple[float, Face]] = []
    near: list[tuple[float, Face]] = []
    foot = min(_end(body, BACK) * -1 for part in plates for body in part.add)
    for part in plates:
        for body in part.add:
            face = Face(_rings(_silhouette(body)), part.material)
            if -_end(body, BACK) < foot + SAME:
                slabs.append((_depth(body), face))
            else:
                near.append((_depth(body), face))
    covered = shapely.union_all([_polygon(face.rings) for _, face in slabs])
    # A dot that is flush with its pillar is hidden by it, too.
    own = {(body.x, body.y): _silhouette(body) for part in plates for body in part.add if isinstance(body, Revolved)}
    for part in parts:
        for body in part.add if part not in plates else ():
            pillar = own.get((body.x, body.y)) if isinstance(body, Revolved) else None
            hidden = covered if pillar is None else shapely.union(covered, pillar)
            for piece in _pieces(shapely.difference(_silhouette(body), hidden)):
                near.append((_depth(body), Face(_rings(piece), part.material)))
    return tuple(face for found in (near, slabs) for _, face in sorted(found, key=lambda each: -each[0]))


def cut_along(parts: Sequence[Part], y: float, box: Box) -> tuple[Face, ...]:
    """Parts cut by the plane of that y, in (x, z), as far as they lie in the box (left, bottom, right, top)."""
    import shapely

    window = shapely.box(*box)
    faces = []

    def reached(bodies: Sequence[Body]) -> Any:
        boxes = [_box(body) for body in bodies]
        return _joined(
            [
                _slice(body, y)
                for body, (left, bottom, right, top) in zip(bodies, boxes, strict=True)
                if bottom < y < top and left < box[2] and right > box[0]
            ]
        )

    for part in parts:
        region, taken = reached(part.add), reached((*part.cut, *part.marked))
        left = shapely.intersection(shapely.difference(region, taken), window)
        faces += [Face(_rings(piece), part.material) for piece in _pieces(left)]
    return tuple(faces)


def size_of(bodies: Sequence[Body]) -> tuple[float, float]:
    """Width and height of bodies seen from above, exactly."""
    boxes = np.array([_box(body) for body in bodies])
    left, bottom = boxes[:, :2].min(axis=0).tolist()
    right, top = boxes[:, 2:].max(axis=0).tolist()
    return right - left, top - bottom


def _box(body: Body) -> Box:
    """Box around a body seen from above: corners, and where arcs run along an axis."""
    if isinstance(body, Revolved):
        r = max(r for r, _ in body.profile.points)
        return body.x - r, body.y - r, body.x + r, body.y + r
    return contour.box(body.outer)


def reach(parts: Sequence[Part]) -> tuple[float, float]:
    """Lowest and highest z of parts."""
    ends = [span(body) for part in parts for body in part.add]
    return min(low for low, _ in ends), max(high for _, high in ends)


def centered(body: Body, x: float, y: float) -> bool:
    """Whether a body is round about the upright axis through (x, y), to a micron."""
    return isinstance(body, Revolved) and abs(body.x - x) < 1e-3 and abs(body.y - y) < 1e-3


def widest(body: Body) -> float:
    """Largest radius of a body of revolution; 0 of others."""
    return max(r for r, _ in body.profile.points) if isinstance(body, Revolved) else 0.0


def _end(body: Body, side: int) -> float:
    """How near a body comes to whom looks from that side: its top, or its bottom with the other sign."""
    low, high = span(body)
    return high if side == FRONT else -low


def _depth(body: Body) -> float:
    """How far away a body is, seen from -y."""
    return body.y if isinstance(body, Revolved) else min(y for _, y in _ring(body.outer))


def _plan(body: Body, material: str, side: int, hollow: bool = False) -> Face:
    if isinstance(body, Prism):
        edges = (_ring(inset(body.outer, body.chamfer)),) if body.chamfer and side == FRONT else ()
        return Face((_ring(body.outer), *map(_ring, body.holes)), material, edges)
    profile = _ring(body.profile)
    narrowest = min(r for r, _ in profile)
    near = _end(body, side) * side
    # Of a hollow one sees its rim, and what is narrower farther down.
    rims = [r for r, z in profile if not hollow or abs(z - near) < SAME]
    widest = max(rims)
    corners = {round(r, 6) for r, z in body.profile.points if _in_sight(profile, r, z, side, hollow)}
    rings = tuple(_circle(body.x, body.y, r) for r in (widest, narrowest) if r > SAME)
    inner = sorted(r for r in corners if narrowest + SAME < r < widest - SAME)
    return Face(rings, material, tuple(_circle(body.x, body.y, r) for r in inner))


def _in_sight(profile: Ring, r: float, z: float, side: int, hollow: bool) -> bool:
    """Whether nothing of a body is above a corner of its profile; of a hollow, nothing of it is below."""
    sign = -side if hollow else side
    return all(sign * (other - z) < SAME for radius, other in profile if abs(radius - r) < SAME)


def _mirrored(face: Face) -> Face:
    def flip(rings: Iterable[Ring]) -> tuple[Ring, ...]:
        return tuple(tuple((-x, y) for x, y in ring) for ring in rings)

    return Face(flip(face.rings), face.material, flip(face.edges))


def _silhouette(body: Body) -> Any:
    """Outline of a body seen from -y."""
    import shapely

    if isinstance(body, Prism):
        xs = [x for x, _ in _ring(body.outer)]
        left, right, c = min(xs), max(xs), body.chamfer
        corners = [(left, body.bottom), (right, body.bottom), (right, body.top - c), (right - c, body.top)]
        return shapely.Polygon([*corners, (left + c, body.top), (left, body.top - c)])
    halves = [[(body.x + sign * r, z) for r, z in _ring(body.profile)] for sign in (1, -1)]
    regions = [shapely.make_valid(shapely.Polygon(half)) for half in halves]
    inner = min(r for r, _ in body.profile.points)
    if inner > SAME:
        # What a ring encloses is behind it.
        regions.append(shapely.box(body.x - inner, span(body)[0], body.x + inner, span(body)[1]))
    return shapely.union_all(regions)


def _slice(body: Body, y: float) -> Any:
    """A body cut by the plane of that y."""
    import shapely

    if isinstance(body, Revolved):
        return _revolved_slice(body, y)
    holes = [_ring(hole) for hole in body.holes]
    chords = _chords([_ring(body.outer), *holes], y)
    if not body.chamfer:
        return _joined([shapely.box(left, body.bottom, right, body.top) for left, right in chords])
    levels = [body.top - body.chamfer * (1 - step / CHAMFERED) for step in range(CHAMFERED + 1)]
    pieces = [shapely.box(left, body.bottom, right, levels[0]) for left, right in chords]
    for step, (low, high) in enumerate(pairwise(levels), 1):
        above = _chords([_ring(inset(body.outer, body.chamfer * step / CHAMFERED)), *holes], y)
        if len(above) == len(chords):
            pieces += [
                shapely.Polygon([(a, low), (b, low), (d, high), (c, high)])
                for (a, b), (c, d) in zip(chords, above, strict=True)
            ]
        chords = above
    return _joined(pieces)


def _chords(rings: Sequence[Ring], y: float) -> list[tuple[float, float]]:
    """Where the line of that y runs in a region: from x to x."""
    import shapely

    region = _polygon(rings)
    left, _, right, _ = shapely.bounds(region)
    found = shapely.get_parts(shapely.intersection(region, shapely.LineString([(left - 1, y), (right + 1, y)])))
    runs = [
        sorted((run.coords[0][0], run.coords[-1][0]))
        for run in found
        if run.geom_type == "LineString" and run.length > SAME
    ]
    return sorted((float(start), float(end)) for start, end in runs)


def _revolved_slice(body: Revolved, y: float) -> Any:
    """A point of the profile at radius r is sqrt(r^2 - d^2) aside of the axis in a plane that is d away from it."""
    import shapely

    away = abs(y - body.y)
    profile = shapely.make_valid(shapely.Polygon(_ring(body.profile)))
    if away > SAME:
        _, low, widest, high = shapely.bounds(profile)
        if away >= widest:
            return shapely.Polygon()
        profile = shapely.intersection(profile, shapely.box(away, low - 1, widest + 1, high + 1))
        profile = shapely.segmentize(profile, max((widest - away) / 40, 10 * OFF))
        profile = shapely.transform(
            profile, lambda p: np.stack([np.sqrt(np.maximum(p[:, 0] ** 2 - away**2, 0)), p[:, 1]], axis=-1)
        )
        profile = shapely.make_valid(profile)
    halves = [
        shapely.transform(profile, lambda p, sign=sign: np.stack([body.x + sign * p[:, 0], p[:, 1]], axis=-1))
        for sign in (1.0, -1.0)
    ]
    return _joined(halves)


def _joined(regions: Sequence[Any]) -> Any:
    import shapely

    # On a grid, so that no slit stays between neighbors.
    return shapely.union_all(list(regions), grid_size=SAME) if regions else shapely.Polygon()


def _polygon(rings: Sequence[Ring]) -> Any:
    import shapely

    return shapely.make_valid(shapely.Polygon(rings[0], rings[1:]))


def _pieces(region: Any) -> list[Any]:
    """Polygons of a region; what only touches something has no area and is left out."""
    import shapely

    return [each for each in shapely.get_parts(region) if each.geom_type == "Polygon" and each.area > 1e-4]


def _rings(region: Any) -> tuple[Ring, ...]:
    import shapely

    polygons = [each for each in shapely.get_parts(region) if each.geom_type == "Polygon"]
    return tuple(
        tuple((float(x), float(y)) for x, y in ring.coords[:-1])
        for polygon in polygons
        for ring in (polygon.exterior, *polygon.interiors)
    )


def _ring(path: Path) -> Ring:
    return tuple(flattened(path))


def _circle(x: float, y: float, radius: float) -> Ring:
    count = max(ceil(pi * sqrt(radius / (2 * OFF))), 24)
    return tuple((x + radius * cos(2 * pi * k / count), y + radius * sin(2 * pi * k / count)) for k in range(count))
