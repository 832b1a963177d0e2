"""Poses guessed from pairs of blobs: the first blob's outline gives the plane, the second the rotation in it.

The outline of a disk of known size is consistent with two poses, up to the rotation about its normal (the ambiguity of
a circle). The ray through another blob's center meets either plane where that blob lies if it belongs to the marker:
its distance from the first must occur in the layout, and its size and shape must be those of a disk there. Few wrong
pairs pass. Triples or quadruples of blobs are never enumerated: the cost is only quadratic in the number of blobs.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Ellipses
from markergen.errors import InputError
from markergen.model.marker import Marker

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_PAIRS = 240
"""Maximum number of ordered pairs of control points for guessing poses; all of them for up to 16 dots."""


@dataclass(frozen=True, eq=False)
class DotLayout:
    """Control points, their dots, and the pairs of them for guessing poses.

    Attributes
    ----------
    points : array (n, 3), m
    radii : array (n,), m
    rings : array (n,) of bool
    flat : bool
        True if all are at the same height.
    pairs : array (q, 2) of int
        Ordered pairs of control points.
    reach : float
        Distance, in radii of a dot, within which another point can be assigned to it and to no other.
    """

    points: Array
    radii: Array
    rings: NDArray[np.bool_]
    flat: bool
    pairs: Indices
    reach: float

    def __len__(self) -> int:
        return len(self.points)


def layout_of(marker: Marker) -> DotLayout:
    """Prepare a marker for the search.

    Raises
    ------
    InputError
        If its control points are fewer than four or on one line, or a dot has no size.
    """
    points = marker.xyz
    features = [point.feature for point in marker.control_points]
    radii = np.array([feature.diameter / 2 for feature in features])
    if len(points) < 4:
        raise InputError("4 or more control points", f"n={len(points)}", "a pose needs four")
    if radii.min() == 0:
        raise InputError("dots that can be seen", "a dot of diameter 0", "design the marker with --dot above 0")
    centered = points - points.mean(axis=0)
    scatter = np.linalg.eigvalsh(centered.T @ centered)
    if scatter[1] <= 1e-6 * scatter[2]:
        raise InputError(
            "control points that span a plane", "all of them on one line", "use a layout that spans the plane"
        )
    rings = np.array([feature.kind == "ring" for feature in features])
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(distance, np.inf)
    reach = min(2.0, 0.5 * float((distance.min(axis=-1) / radii).min()))
    flat = not np.ptp(points[:, 2])
    return DotLayout(points, radii, rings, flat, _pairs(points, rings), reach)


def _pairs(points: Array, rings: NDArray[np.bool_]) -> Indices:
    """Return ordered pairs of points apart from each other, those with one ring first, up to `MAX_PAIRS`."""
    pairs = np.array(list(permutations(range(len(points)), 2)), dtype=np.intp)
    lateral = np.linalg.norm(np.diff(points[pairs, :2], axis=1)[:, 0], axis=-1)
    # Short pairs determine the rotation badly. Of too many others, take a fixed random choice, fair to every dot.
    pairs = np.random.default_rng(0).permutation(pairs[lateral > 0.25 * lateral.max()])
    one_ring = rings[pairs].sum(axis=-1) == 1
    return pairs[np.argsort(~one_ring, kind="stable")[:MAX_PAIRS]]


MAX_POSES = 3000
"""Maximum number of poses to try, those of the most consistent pairs first."""

MAX_TRIALS = 1_000_000
"""Maximum number of pairs of blobs times pairs of control points; above it, fewer pairs of control points are used."""

_SLACK, _SLACK_PX = 0.2, 0.4
"""Tolerated error of a semi-axis: a share of it, which covers the change of perspective within a dot, plus px over the
smaller semi-axis, where the outline of small dots is blurred most."""


@dataclass(frozen=True, eq=False)
class PoseHypotheses:
    """K guessed poses: rotation (K, 3, 3), translation (K, 3) in m."""

    rotation: Array
    translation: Array

    def __len__(self) -> int:
        return len(self.translation)


def guess_poses(ellipses: Ellipses, layout: DotLayout, px: float, rings_tell: bool = True) -> PoseHypotheses:
    """Guess poses from all pairs of blobs that a pair of dots could be, the most consistent first.

    Parameters
    ----------
    px : float
        Pixels per unit of the normalized coordinates.
    rings_tell : bool
        True if rings match only rings, and disks only disks.
    """
    first, second = _neighbors(ellipses, layout)
    position, normal = circle_poses(ellipses.center, ellipses.shape)
    semi = np.sqrt(np.linalg.eigvalsh(ellipses.shape))
    slack = _SLACK + _SLACK_PX / (px * semi[:, 0])
    # m: pair of blobs, with either of the first one's normals. q: pair of control points.
    first, second = np.concatenate([first, first]), np.concatenate([second, second])
    side = np.repeat([0, 1], len(first) // 2)
    p, n = position[first, side], normal[first, side]
    ray = np.concatenate([ellipses.center[second], np.ones((len(second), 1))], axis=-1)
    toward = np.einsum("mi,mi->m", n, ray)
    allowed = np.hypot(slack[first], slack[second])
    fits = (toward < 0) & (_elongation(ellipses.shape[second], ellipses.center[second], n) < allowed)
    first, second, p, n, ray, toward, allowed = (each[fits] for each in (first, second, p, n, ray, toward, allowed))

    a, b = layout.pairs[: max(1, MAX_TRIALS // max(1, len(first)))].T
    step = layout.points[b] - layout.points[a]
    away = np.einsum("mi,mi->m", n, p)
    depth = (away[:, None] * layout.radii[a] + step[:, 2]) / toward[:, None]
    square = (
        depth**2 * np.sum(ray**2, axis=-1)[:, None]
        - 2 * depth * layout.radii[a] * np.einsum("mi,mi->m", ray, p)[:, None]
        + layout.radii[a] ** 2 * np.sum(p**2, axis=-1)[:, None]
        - step[:, 2] ** 2
    )
    area = np.sqrt(np.linalg.det(ellipses.shape))[second]
    with np.errstate(divide="ignore", invalid="ignore"):
        stretch = 0.5 * np.log(np.sum(step[:, :2] ** 2, axis=-1) / square)
        growth = 0.5 * np.log(layout.radii[b] ** 2 * -toward[:, None] / (depth**2 * area[:, None]))
        quality = np.hypot(stretch, growth) / allowed[:, None]
    good = (depth > 0) & (np.abs(stretch) < 1.5 * allowed[:, None]) & (np.abs(growth) < 1.5 * allowed[:, None])
    if rings_tell:
        good &= ellipses.ring[first][:, None] == layout.rings[a]
        good &= ellipses.ring[second][:, None] == layout.rings[b]
    m, q = np.nonzero(good)
    order = np.argsort(quality[m, q], kind="stable")[:MAX_POSES]
    m, q = m[order], q[order]
    return _turned(
        layout.points[a[q]],
        step[q],
        layout.radii[a[q], None] * p[m],
        depth[m, q, None] * ray[m],
        n[m],
        np.exp(stretch[m, q, None]),
    )


def circle_poses(center: Array, shape: Array) -> tuple[Array, Array]:
    """Return both poses of a disk of radius 1 that is seen as an ellipse, up to the rotation about its normal.

    The ellipse's dual conic D is proportional to I - n n' - P P' (see `conic_projection.outlines`). With eigenvalues
    m1 >= m2 > 0 > m3 of D and a = 1 - m2/m1, b = 1 - m3/m1, the normal is n = +-s v2 + sqrt(1 - s^2) v3 with
    s^2 = a (b - 1)/(b - a), and P follows from P P' = I - D/m1 - n n'.

    Parameters
    ----------
    center, shape : arrays (B, 2) and (B, 2, 2), normalized coordinates

    Returns
    -------
    position (B, 2, 3), normal (B, 2, 3)
        In the camera frame, in units of the radius; normals face the camera.
    """
    dual = np.empty((len(center), 3, 3))
    dual[:, :2, :2] = shape - center[:, :, None] * center[:, None, :]
    dual[:, :2, 2] = dual[:, 2, :2] = -center
    dual[:, 2, 2] = -1
    values, vectors = np.linalg.eigh(dual)
    a, b = (1 - values[:, i] / values[:, 2] for i in (1, 0))
    sine = np.sqrt(np.clip(a * (b - 1) / (b - a), 0, 1))[:, None]
    cosine = np.sqrt(1 - sine**2)
    normal = np.stack([sign * sine * vectors[..., 1] + cosine * vectors[..., 0] for sign in (1, -1)], axis=1)
    gram = (np.eye(3) - dual / values[:, 2, None, None])[:, None] - normal[..., :, None] * normal[..., None, :]
    depth = np.sqrt(np.maximum(gram[..., 2, 2], 1e-12))
    position = gram[..., 2] / depth[..., None]
    facing = np.sum(normal * position, axis=-1, keepdims=True)
    return position, np.where(facing > 0, -normal, normal)


def _neighbors(ellipses: Ellipses, layout: DotLayout) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return pairs of different blobs no farther apart, in radii of the first, than the dots can be."""
    lateral = layout.points[:, None, :2] - layout.points[:, :2]
    # The factor of 2 covers the perspective of near views, in which radii shrink toward the far side.
    most = 2 * np.linalg.norm(lateral, axis=-1).max() / layout.radii.min()
    if not layout.flat:
        most += 2 * np.ptp(layout.points[:, 2]) / layout.radii.min()
    offset = ellipses.center - ellipses.center[:, None]
    inverse = np.linalg.inv(ellipses.shape)
    distance = np.einsum("ijk,ikl,ijl->ij", offset, inverse, offset)
    np.fill_diagonal(distance, np.inf)
    first, second = np.nonzero(distance < most**2)
    return first, second


def _elongation(shape: Array, center: Array, normal: Array) -> Array:
    """Return the logarithm (m,) of the elongation of ellipses relative to that of disks with given normals.

    The image of a small disk is proportional to G = A (I - n n') A', A = [I, -x].
    """
    x, y = center[:, 0], center[:, 1]
    along_x = normal[:, 0] - x * normal[:, 2]
    along_y = normal[:, 1] - y * normal[:, 2]
    g11, g22 = 1 + x * x - along_x**2, 1 + y * y - along_y**2
    g12 = x * y - along_x * along_y
    determinant = np.maximum(g11 * g22 - g12**2, 1e-12)
    trace = (shape[:, 0, 0] * g22 + shape[:, 1, 1] * g11 - 2 * shape[:, 0, 1] * g12) / determinant
    ratio = trace / (2 * np.sqrt(np.linalg.det(shape) / determinant))
    return np.arccosh(np.maximum(ratio, 1))


def _turned(point: Array, step: Array, place: Array, other: Array, normal: Array, scale: Array) -> PoseHypotheses:
    """Return poses that map a point (K, 3) to `place`, and one at `step` (K, 3) from it in the direction of `other`."""
    along = other - place - step[:, 2:] * normal
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.cross(normal, along)
    length = np.linalg.norm(step[:, :2], axis=-1, keepdims=True)
    cosine, sine = step[:, :1] / length, step[:, 1:2] / length
    rotation = np.stack([cosine * along - sine * across, sine * along + cosine * across, normal], axis=-1)
    # The distance between dots tells the scale better than the size of one.
    return PoseHypotheses(rotation, scale * place - np.einsum("kij,kj->ki", rotation, point))
