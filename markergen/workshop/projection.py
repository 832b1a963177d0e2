"""Orthographic views and sections of parts, for the fabrication sheet.

Open CASCADE's own projections are not used: the sheet needs no CAD kernel, and consists of exact contours in a fixed
order. Polygons, where Booleans require them, are within `OFF` of the arcs.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from markergen.arrays import Array
from markergen.geometry.contour import Contour, Point, circle, flattened, offset
from markergen.geometry.outlines import polygon
from markergen.geometry.region import Region
from markergen.solid.primitives import OFF, OTHER, SAME, Box, Part, Primitive, Prism, Revolved
from markergen.workshop.drafting.drawing import ViewFace

CHAMFERED = 12
"""Number of steps of a section across a chamfer; straight chamfers are exact anyway."""

DUST = 1e-4
"""Area in mm^2 below which a piece only marks where bodies touch."""

BACK, FRONT = -1, 1
"""Viewing sides: the back is seen from -z, the front from +z."""


def seen(parts: Sequence[Part], side: int = FRONT) -> tuple[ViewFace, ...]:
    """Project parts as seen from +z (`FRONT`), or from -z (`BACK`), where x runs to the left.

    Faces are in painting order: later ones are nearer or lie within earlier ones. Hidden edges are omitted.
    """
    views: list[tuple[float, int, ViewFace]] = []
    for part in parts:
        inlay = 0 if part.is_plate else 2
        nearest = min(_end(body, side) for body in part.add)
        deepest = max(_end(body, -side) for body in part.add)
        views += [(_end(body, side), inlay, _top_view(body, part.material, side)) for body in part.add]
        for body, floor in (*((b, part.material) for b in part.cut), *((b, OTHER[part.material]) for b in part.marked)):
            if _end(body, side) > nearest - SAME:
                through = _end(body, -side) > deepest - SAME
                view = _top_view(body, "" if through else floor, side, hollow=True)
                views.append((_end(body, side), inlay + 1, view))
    # Painted from below; at one height plates first, then what is cut into them, then inlays.
    views.sort(key=lambda entry: (round(entry[0], 6), entry[1]))
    faces = tuple(face for _, _, face in views)
    return tuple(map(_mirrored, faces)) if side == BACK else faces


def elevation(parts: Sequence[Part]) -> tuple[ViewFace, ...]:
    """Project parts as seen from -y, x to the right and z up, in painting order; what lies inside plates is hidden."""
    plates = [part for part in parts if part.is_plate]
    foot = min(part.span[0] for part in plates)
    slabs: list[tuple[float, ViewFace]] = []
    standing: list[tuple[float, ViewFace]] = []
    hiding, outlines = [], {}
    for part in plates:
        for body in part.add:
            outline = _silhouette(body)
            low = body.span[0] < foot + SAME
            (slabs if low else standing).append((_distance(body), ViewFace(_contours(outline), part.material)))
            if low:
                hiding.append(outline)
            if isinstance(body, Revolved):
                outlines[body.x, body.y] = outline
    covered = Region.union(hiding)
    for part in parts:
        for body in () if part.is_plate else part.add:
            # A pillar also hides the dot that is flush with it.
            pillar = outlines.get((body.x, body.y)) if isinstance(body, Revolved) else None
            rest = _silhouette(body) - (covered if pillar is None else covered | pillar)
            standing += [(_distance(body), ViewFace(_contours(piece), part.material)) for piece in _pieces(rest)]
    return tuple(face for group in (standing, slabs) for _, face in sorted(group, key=lambda entry: -entry[0]))


def cut_along(parts: Sequence[Part], y: float, box: Box) -> tuple[ViewFace, ...]:
    """Section of parts by the plane at y, in (x, z), clipped to the box."""
    window = Region.rectangle(*box)

    def cut(bodies: Sequence[Primitive]) -> Region:
        boxes = [body.box for body in bodies]
        return _joined(
            _slice(body, y)
            for body, (left, bottom, right, top) in zip(bodies, boxes, strict=True)
            if bottom < y < top and left < box[2] and right > box[0]
        )

    return tuple(
        ViewFace(_contours(piece), part.material)
        for part in parts
        for piece in _pieces((cut(part.add) - cut((*part.cut, *part.marked))) & window)
    )


def plan(body: Primitive) -> Region:
    """Filled outline of a body in plan view."""
    return Region.of_contour(body.outline, (), OFF)


def _end(body: Primitive, side: int) -> float:
    """Extent of a body toward a viewer on that side: its top, or minus its bottom."""
    low, high = body.span
    return high if side == FRONT else -low


def _distance(body: Primitive) -> float:
    """Relative distance of a body from a viewer at -y."""
    return body.y if isinstance(body, Revolved) else body.box[1]


def _top_view(body: Primitive, material: str, side: int, hollow: bool = False) -> ViewFace:
    if isinstance(body, Prism):
        chamfer = (offset(body.outer, body.chamfer),) if body.chamfer and side == FRONT else ()
        return ViewFace((body.outer, *body.holes), material, chamfer)
    profile = flattened(body.profile, OFF)
    narrowest = min(r for r, _ in profile)
    end = _end(body, side) * side
    # Of a hollow, its rim and anything narrower below it is visible.
    widest = max(r for r, z in profile if not hollow or abs(z - end) < SAME)
    corners = {round(r, 6) for r, z in body.profile.points if _in_sight(profile, r, z, side, hollow)}
    inner = sorted(r for r in corners if narrowest + SAME < r < widest - SAME)
    rims, edges = (
        tuple(circle(r, body.x, body.y) for r in radii if r > SAME) for radii in ((widest, narrowest), inner)
    )
    return ViewFace(rims, material, edges)


def _in_sight(profile: Sequence[Point], r: float, z: float, side: int, hollow: bool) -> bool:
    """Tell whether nothing of a body lies above a corner of its profile; for a hollow, below it."""
    sign = -side if hollow else side
    for (u, v), (p, q) in zip(profile, (*profile[1:], profile[0]), strict=True):
        if min(u, p) - SAME < r < max(u, p) + SAME:
            heights = (v, q) if abs(p - u) < SAME else (v + (q - v) * (r - u) / (p - u),)
            if any(sign * (height - z) > SAME for height in heights):
                return False
    return True


def _mirrored(face: ViewFace) -> ViewFace:
    def flipped(contours: Iterable[Contour]) -> tuple[Contour, ...]:
        return tuple(
            Contour(tuple((-x, y) for x, y in contour.points), tuple(0.0 - bulge for bulge in contour.bulges))
            for contour in contours
        )

    return ViewFace(flipped(face.contours), face.material, flipped(face.edges))


def _silhouette(body: Primitive) -> Region:
    """Filled outline of a body as seen from -y."""
    low, high = body.span
    if isinstance(body, Prism):
        left, _, right, _ = body.box
        c = body.chamfer
        return Region.polygon(
            [(left, low), (right, low), (right, high - c), (right - c, high), (left + c, high), (left, high - c)]
        )
    inner, _ = body.radii
    # A ring's front hides its inside.
    core = [Region.rectangle(body.x - inner, low, body.x + inner, high)] if inner > SAME else []
    return Region.union([*_both_sides(_profile(body), body.x), *core])


def _slice(body: Primitive, y: float) -> Region:
    """Section of a body by the plane at y."""
    if isinstance(body, Revolved):
        return _revolved_slice(body, y)
    chords = _chords(body.outer, body.holes, y)
    if not body.chamfer:
        return _joined(Region.rectangle(left, body.bottom, right, body.top) for left, right in chords)
    levels = [body.top - body.chamfer * (1 - step / CHAMFERED) for step in range(CHAMFERED + 1)]
    pieces = [Region.rectangle(left, body.bottom, right, levels[0]) for left, right in chords]
    for step, (low, high) in enumerate(pairwise(levels), 1):
        above = _chords(offset(body.outer, body.chamfer * step / CHAMFERED), body.holes, y)
        if len(above) == len(chords):
            pieces += [
                Region.polygon([(a, low), (b, low), (d, high), (c, high)])
                for (a, b), (c, d) in zip(chords, above, strict=True)
            ]
        chords = above
    return _joined(pieces)


def _chords(outer: Contour, holes: Sequence[Contour], y: float) -> list[tuple[float, float]]:
    """Intervals of x in which the horizontal line at y is inside an outline."""
    region = Region.polygon(flattened(outer, OFF), [flattened(hole, OFF) for hole in holes], mend=True)
    left, _, right, _ = region.box
    runs = [sorted((run[0, 0], run[-1, 0])) for run in region.runs([(left - 1, y), (right + 1, y)])]
    # A line along an edge gives runs without length.
    return sorted((float(start), float(end)) for start, end in runs if end - start > SAME)


def _revolved_slice(body: Revolved, y: float) -> Region:
    """Section of a body of revolution at distance d from its axis: radius r of the profile is at sqrt(r^2 - d^2)."""
    away = abs(y - body.y)
    profile = _profile(body)
    if away > SAME:
        _, low, widest, high = profile.box
        if away >= widest:
            return Region()

        def moved(points: Array) -> Array:
            return np.stack([np.sqrt(np.maximum(points[:, 0] ** 2 - away**2, 0)), points[:, 1]], axis=-1)

        profile = profile & Region.rectangle(away, low - 1, widest + 1, high + 1)
        # Straight sides become hyperbolas, so they are divided.
        profile = profile.mapped(moved, step=max((widest - away) / 40, 10 * OFF))
    return _joined(_both_sides(profile, body.x))


def _profile(body: Revolved) -> Region:
    return Region.polygon(flattened(body.profile, OFF), mend=True)


def _both_sides(profile: Region, x: float) -> list[Region]:
    """Profile on both sides of an axis at x."""
    return [profile.mapped(lambda points: points + [x, 0]), profile.mapped(lambda points: points * [-1, 1] + [x, 0])]


def _joined(regions: Iterable[Region]) -> Region:
    # Snapped to a grid to close slits between neighbors.
    return Region.union(regions, grid=SAME)


def _pieces(region: Region) -> list[Region]:
    return [piece for piece in region.pieces if piece.area > DUST]


def _contours(region: Region) -> tuple[Contour, ...]:
    return tuple(map(polygon, region.rings))
