"""Flat pieces of ink and substrate in space, and their outlines in the image."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.geometry.coverage import closing, unit_disk
from markergen.maths.projection import perspective
from markergen.model.camera import Camera

CIRCLE_VERTICES = 1024
"""Default number of vertices of a circle: enough for a radius of 30 px in the image (see `circle_vertices`)."""

CIRCLE_ERROR_PX = 1e-4
"""Maximum distance of a circle's polygon from the circle in the image, px."""

EDGE_ERROR_PX = 5e-4
"""Maximum distance of a subdivided straight edge from its distorted image, px."""

_UPRIGHT = 1e-9
"""z of a unit normal below which a patch stands upright, and shows no face to the front."""
_MARGIN_PX = 2.0
"""Width of the border around the image in px that is drawn as well, so that clipped edges are outside."""
_BORDER_POINTS = 32
"""Number of points per side of the image's border whose rays bound the view of a lens with distortion."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Flat piece of the scene, visible from the side to which its normal, of positive z, points.

    Outlines may be disjoint or nested (even-odd: the inner one is a hole), but must not cross. Abutting pieces of one
    color belong in one patch: if painted separately, their seam shows where both partially cover a pixel.

    Attributes
    ----------
    outlines : tuple of arrays (m, 3), m
        Closed coplanar polygons in the marker frame, reoriented here so that holes run opposite to the outlines around
        them. A vertical patch is visible from both sides.
    reflectance : float
        1 for the substrate, 0 for ink; values between or beyond them are allowed.
    """

    outlines: tuple[Array, ...]
    reflectance: float
    normal: Array = field(init=False)

    def __post_init__(self) -> None:
        outlines = [np.asarray(outline, dtype=float) for outline in self.outlines if len(outline) > 2]
        normal = np.zeros(3)
        if outlines:
            areas = _vector_areas(outlines)
            sizes = np.linalg.norm(areas, axis=-1)
            normal = areas[np.argmax(sizes)] / max(sizes.max(), np.finfo(float).tiny)
            normal = -normal if normal[2] < 0 else normal
            inward = (areas @ normal < 0) ^ (_nesting(outlines, sizes, normal) % 2 == 1)
            outlines = [o[::-1] if is_inward else o for o, is_inward in zip(outlines, inward, strict=True)]
        object.__setattr__(self, "outlines", tuple(outlines))
        object.__setattr__(self, "normal", normal)


def circle_polygon(center: Array, radius: float, count: int = CIRCLE_VERTICES) -> Array:
    """Polygon (count, 3) in m about a center (3,), parallel to the marker plane, with the area of the circle."""
    outline = np.empty((count, 3))
    outline[:, :2] = radius * unit_disk(count) + center[:2]
    outline[:, 2] = center[2]
    return outline


def circle_vertices(radius_px: float) -> int:
    """Number of vertices, a multiple of 8, that keeps a circle's polygon within `CIRCLE_ERROR_PX` of it in the image.

    A polygon of m vertices with the area of its circle of radius r deviates from it by at most r pi^2/(3 m^2).
    """
    count = np.pi * np.sqrt(max(radius_px, 1.0) / (3 * CIRCLE_ERROR_PX))
    return int(8 * np.ceil(count / 8))


def project_patches(
    patches: Sequence[Patch], camera: Camera, rotation: Array, translation: Array
) -> list[tuple[Array, ...]]:
    """Project each patch to distorted outlines (m, 2) in px from one pose T_camera_marker; none if it is not visible.

    Patches are clipped to the field of view in front of the camera. Edges that the lens bends by more than
    `EDGE_ERROR_PX` are subdivided.

    Parameters
    ----------
    rotation, translation : arrays (3, 3) and (3,), m
    """
    eye = -rotation.T @ translation
    visible = [patch for patch in patches if _faces(patch, eye)]
    outlines = [outline for patch in visible for outline in patch.outlines]
    if not outlines:
        return [() for _ in patches]
    vertices = np.concatenate(outlines) @ rotation.T + translation
    ends = np.cumsum([len(outline) for outline in outlines])
    cut = _cut(np.split(vertices, ends[:-1]), vertices, _view_planes(camera))
    images = iter(_through_lens(cut, camera))
    projected = []
    for patch in patches:
        projections = [next(images) for _ in patch.outlines] if _faces(patch, eye) else []
        projected.append(tuple(outline for outline in projections if len(outline)))
    return projected


def _faces(patch: Patch, eye: Array) -> bool:
    if not patch.outlines:
        return False
    return bool(patch.normal[2] < _UPRIGHT or patch.normal @ (eye - patch.outlines[0][0]) > 0)


def _cut(outlines: list[Array], vertices: Array, planes: Array) -> list[Array]:
    """Clip polygons (m, 3) to the inner side, plane @ point <= 0, of all planes through the camera center."""
    outside = vertices @ planes.T > 0
    if not outside.any():
        return outlines
    result, first = [], 0
    for outline in outlines:
        beyond = outside[first : first + len(outline)].any(axis=0)
        first += len(outline)
        # Sutherland-Hodgman clipping; the edges it leaves along the planes lie outside the image.
        for plane in planes[beyond]:
            outline = _cut_by_plane(outline, plane)
        result.append(outline)
    return result


def _cut_by_plane(outline: Array, plane: Array) -> Array:
    height = outline @ plane
    kept = height <= 0
    if kept.all():
        return outline
    if not kept.any():
        return outline[:0]
    following, next_height = np.roll(outline, -1, axis=0), np.roll(height, -1)
    crosses = kept != np.roll(kept, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = outline + (height / (height - next_height))[:, None] * (following - outline)
    pairs = np.stack([outline, crossings], axis=1).reshape(-1, 3)
    return pairs[np.stack([kept, crosses], axis=1).reshape(-1)]


@lru_cache(maxsize=8)
def _view_planes(camera: Camera) -> Array:
    """Outward normals (k, 3) of the planes through the camera center that bound its field of view.

    They span the hull of the rays to slightly outside the image border, so that no clipped edge is visible. Where the
    lens model has no ray to the border, rays nearer to the center form the hull.
    """
    import cv2

    low, high = np.full(2, -0.5 - _MARGIN_PX), np.array([camera.width, camera.height]) - 0.5 + _MARGIN_PX
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    if camera.ideal is not camera:
        steps = np.linspace(0, 1, _BORDER_POINTS, endpoint=False)[:, None, None]
        border = (corners + steps * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)
        middle = (low + high) / 2
        corners = np.concatenate([middle + share * (border - middle) for share in np.linspace(0.05, 1, 20)])
    rays = camera.from_pixels(corners)
    rays = rays[np.isfinite(rays).all(axis=-1)]
    # convexHull takes no doubles; only the indices of its corners are used.
    hull = cv2.convexHull(rays.astype(np.float32), returnPoints=False)[:, 0]
    rays = np.concatenate([rays[hull], np.ones((len(hull), 1))], axis=-1)
    normals = np.cross(rays, np.roll(rays, -1, axis=0))
    return np.asarray(normals * -np.sign(normals @ rays.mean(axis=0))[:, None])


def _through_lens(outlines: list[Array], camera: Camera) -> list[Array]:
    """Distorted images (m', 2) in px of closed polygons (m, 3) in the camera frame, all within the field of view."""
    lengths = np.array([len(outline) for outline in outlines])
    with np.errstate(invalid="ignore"):
        start = perspective(np.concatenate(outlines))
    pixels = camera.to_pixels(start)
    if camera.ideal is not camera:
        step = start[closing(outlines)[1]] - start
        end_pixels = camera.to_pixels(start + step)
        # Three probes, since a bend with a turning point in the middle has no deviation there.
        bend = np.zeros(len(start))
        for share in (0.25, 0.5, 0.75):
            straight = pixels + share * (end_pixels - pixels)
            bend = np.fmax(bend, np.linalg.norm(camera.to_pixels(start + share * step) - straight, axis=-1))
        # Each of k pieces of an edge bends by 1/k^2 as much.
        count = np.maximum(np.ceil(np.sqrt(bend / EDGE_ERROR_PX)), 1).astype(int)
        edge = np.repeat(np.arange(len(start)), count)
        share = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)) / count[edge]
        pixels = camera.to_pixels(start[edge] + share[:, None] * step[edge])
        lengths = np.array([part.sum() for part in np.split(count, np.cumsum(lengths)[:-1])])
    # Rays beyond what the lens model maps have no pixel.
    return [part[np.isfinite(part).all(axis=-1)] for part in np.split(pixels, np.cumsum(lengths)[:-1])]


def _vector_areas(outlines: list[Array]) -> Array:
    """Vector areas (k, 3), area times unit normal, of closed polygons (m, 3)."""
    first, following = closing(outlines)
    vertices = np.concatenate(outlines)
    x, y, z = (vertices - np.repeat(vertices[first], [len(outline) for outline in outlines], axis=0)).T
    cross = np.stack(
        [
            y * z[following] - z * y[following],
            z * x[following] - x * z[following],
            x * y[following] - y * x[following],
        ],
        axis=-1,
    )
    return np.asarray(np.add.reduceat(cross, first) / 2)


def _nesting(outlines: list[Array], sizes: Array, normal: Array) -> NDArray[np.intp]:
    """Number of larger outlines that contain each outline."""
    depth = np.zeros(len(outlines), dtype=np.intp)
    if len(outlines) == 1:
        return depth
    # Projected along the largest component of the normal, no outline collapses to a line.
    flat = [outline[:, np.arange(3) != np.argmax(np.abs(normal))] for outline in outlines]
    first, vertices = closing(outlines)[0], np.concatenate(flat)
    low, high = np.minimum.reduceat(vertices, first), np.maximum.reduceat(vertices, first)
    slack = 1e-9 * (high.max(axis=0) - low.min(axis=0))
    boxed = np.all((low[:, None] >= low - slack) & (high[:, None] <= high + slack), axis=-1)
    for inner, outer in np.argwhere(boxed & (sizes[:, None] < sizes)):
        depth[inner] += _holds(flat[outer], _inner_point(flat[inner]))
    return depth


def _inner_point(outline: Array) -> Array:
    """Return a point (2,) just inside the midpoint of the longest edge, clear of outlines that touch this one."""
    step = np.roll(outline, -1, axis=0) - outline
    k = int(np.argmax(np.sum(step**2, axis=-1)))
    # To the left of a counterclockwise edge, a millionth of its length.
    inward = np.array([-step[k, 1], step[k, 0]]) * 1e-6
    arms = outline - outline[0]
    left = np.sum(arms[:-1, 0] * arms[1:, 1] - arms[:-1, 1] * arms[1:, 0])
    return np.asarray(outline[k] + step[k] / 2 + (inward if left > 0 else -inward))


def _holds(outline: Array, point: Array) -> bool:
    """True if a point (2,) lies inside a polygon (m, 2): a ray to the right crosses it an odd number of times."""
    (x, y), (next_x, next_y) = outline.T, np.roll(outline, -1, axis=0).T
    spans = (y <= point[1]) != (next_y <= point[1])
    x, y, next_x, next_y = x[spans], y[spans], next_x[spans], next_y[spans]
    return bool(np.sum(point[0] < x + (point[1] - y) / (next_y - y) * (next_x - x)) % 2)
