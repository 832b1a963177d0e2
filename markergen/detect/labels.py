"""Which blob is which dot: hypothesize from four dots, verify on all, and insist that the answer is the only one."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Blobs
from markergen.detect.correction import correct_centers
from markergen.errors import InputError
from markergen.estimators.decomposition import decompose_homography
from markergen.maths.conic import circle_image
from markergen.maths.projection import apply_homography, plane_homography
from markergen.model.camera import Camera
from markergen.model.marker import Marker

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_HYPOTHESES = 300_000
MAX_CANDIDATES = 24
"""Control points among which the four of the basis are sought; more would only cost time."""
_CHUNK = 20_000

_ACCEPT_PX, _ACCEPT_SHARE = 0.75, 0.005
"""Largest misfit of a labeling: px, plus a share of the marker's extent in the image for an imperfect calibration."""

_UNIQUE_RATIO, _UNIQUE_PX = 2.0, 0.5
"""The second-best labeling must be worse by this factor, and by so many px."""


@dataclass(frozen=True, eq=False)
class Labeling:
    """For each control point the index of its blob, or the reason why there is none.

    Attributes
    ----------
    blobs : array (n,) of int, or None
    pixels : array (n, 2), px, or None
        Corrected centers in the order of the control points.
    reason : str
        Empty when labeled.
    """

    blobs: Indices | None
    pixels: Array | None
    reason: str = ""


def label_dots(blobs: Blobs, marker: Marker, camera: Camera) -> Labeling:
    """Find the one assignment of blobs to control points that the camera could have seen.

    Every assignment of blobs to four well-spread control points, the key dot first, that keeps the orientation of
    all triples (a view from the front does) is a homography; those that take all control points near blobs of
    the right kind are verified: centers and ellipses must be those of the nearest calibrated pose, and no other
    assignment may be nearly as good.

    Raises
    ------
    InputError
        If the marker's control points are fewer than four, on one line, or not in one plane z = const.
    """
    points, radii, rings = _layout(marker)
    if len(blobs) < len(points):
        return Labeling(None, None, f"found {len(blobs)} dots, the marker has {len(points)}")
    if blobs.ring.sum() < rings.sum():
        return Labeling(None, None, "found no key ring")
    basis = _basis(points, rings)
    hypotheses = _four_blobs(blobs, rings[basis])
    if hypotheses is None:
        return Labeling(None, None, f"found {len(blobs)} dots: too many to tell the marker's from the others")
    assignments = _assignments(blobs, points, rings, basis, hypotheses)
    if not len(assignments):
        return Labeling(None, None, f"found {len(blobs)} dots, but not in the marker's layout")
    misfit, corrected = _misfit(blobs, assignments, points, radii, camera)
    order = np.argsort(misfit)
    best = order[0]
    pixels = corrected[best]
    if not misfit[best] <= _ACCEPT_PX + _ACCEPT_SHARE * np.ptp(pixels, axis=0).max():
        return Labeling(None, None, f"no labeling fits the camera: the best is off by {misfit[best]:.2g} px")
    if len(order) > 1 and misfit[order[1]] < _UNIQUE_RATIO * misfit[best] + _UNIQUE_PX:
        return Labeling(
            None, None, f"labels are ambiguous: two labelings fit, to {misfit[best]:.2g} and {misfit[order[1]]:.2g} px"
        )
    return Labeling(assignments[best], pixels)


def _layout(marker: Marker) -> tuple[Array, Array, NDArray[np.bool_]]:
    xyz = marker.xyz
    if len(xyz) < 4:
        raise InputError("4 or more control points", f"n={len(xyz)}", "a homography needs four")
    if np.ptp(xyz[:, 2]) > 0:
        raise InputError(
            "a flat marker", f"a relief of {np.ptp(xyz[:, 2]) * 1e3:g} mm", "detect markers whose dots are in one plane"
        )
    features = [point.feature for point in marker.control_points]
    return (
        xyz[:, :2],
        np.array([feature.diameter / 2 for feature in features]),
        np.array([feature.kind == "ring" for feature in features]),
    )


def _basis(points: Array, rings: NDArray[np.bool_]) -> Indices:
    """Four control points, a ring among them if possible, of which the smallest triangle is largest."""
    key = int(np.argmax(rings))
    candidates = _far_apart(points, key, MAX_CANDIDATES)
    with_key = ((key, *rest) for rest in combinations(candidates[1:], 3))
    # A key dot where the diagonals of a square meet is on a line with two of any three others.
    for choices in (with_key, combinations(candidates, 4)):
        quads = list(choices)
        smallest = np.abs(_triangles(points[np.array(quads)])).min(axis=-1)
        best = int(np.argmax(smallest))
        if smallest[best] > 1e-6 * np.ptp(points, axis=0).max() ** 2:
            return np.array(quads[best], dtype=np.intp)
    raise InputError("four control points of which no three are on a line", "none", "use a layout that spans the plane")


def _far_apart(points: Array, first: int, count: int) -> list[int]:
    """Indices of up to `count` points (n, 2), each the farthest from those before it, beginning with `first`."""
    chosen = [first]
    distance = np.linalg.norm(points - points[first], axis=-1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=-1))
    return chosen


def _triangles(quads: Array) -> Array:
    """Twice the signed areas (..., 4) of the triangles that leave out one of four points (..., 4, 2)."""
    first, second, third = (quads[..., [1, 0, 0, 0], :], quads[..., [2, 2, 1, 1], :], quads[..., [3, 3, 3, 2], :])
    u, v = second - first, third - first
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _four_blobs(blobs: Blobs, rings: NDArray[np.bool_]) -> Indices | None:
    """All ordered choices (k, 4) of distinct blobs of the given kinds; None if they are more than can be tried."""
    # Ring or not is trusted: a ring that reads as a disk gives no labeling rather than a wrong one.
    choices = [np.flatnonzero(blobs.ring == ring) for ring in rings]
    if np.prod([float(len(choice)) for choice in choices]) > MAX_HYPOTHESES:
        return None
    grid = np.stack(np.meshgrid(*choices, indexing="ij"), axis=-1).reshape(-1, 4)
    return grid[(np.diff(np.sort(grid, axis=-1), axis=-1) > 0).all(axis=-1)]


def _assignments(blobs: Blobs, points: Array, rings: NDArray[np.bool_], basis: Indices, hypotheses: Indices) -> Indices:
    """Distinct assignments (m, n) of blobs to control points that hypotheses (k, 4) for the basis lead to."""
    # The image's y points down, so every triangle changes its sign; equal signs also keep all four before the camera.
    turn = -np.sign(_triangles(points[basis]))
    hypotheses = hypotheses[(np.sign(_triangles(blobs.center[hypotheses])) == turn).all(axis=-1)]
    gate = 0.5 * blobs.semi[:, 1] + 1
    found = []
    for start in range(0, len(hypotheses), _CHUNK):
        chunk = hypotheses[start : start + _CHUNK]
        homography = _projective_frame(blobs.center[chunk]) @ np.linalg.inv(_projective_frame(points[basis]))
        with np.errstate(divide="ignore", invalid="ignore"):
            predicted = apply_homography(homography, points)
            distance = np.linalg.norm(predicted[:, :, None] - blobs.center, axis=-1)
        distance = np.where(blobs.ring == rings[:, None], np.nan_to_num(distance, nan=np.inf), np.inf)
        nearest = distance.argmin(axis=-1)
        close = (distance.min(axis=-1) < gate[nearest]).all(axis=-1)
        distinct = (np.diff(np.sort(nearest, axis=-1), axis=-1) > 0).all(axis=-1)
        found.append(nearest[close & distinct])
    merged = np.concatenate(found) if found else np.zeros((0, len(points)), dtype=np.intp)
    return np.unique(merged, axis=0)


def _projective_frame(quads: Array) -> Array:
    """Matrix (..., 3, 3) that takes (1,0,0), (0,1,0), (0,0,1) and (1,1,1) to four points (..., 4, 2)."""
    homogeneous = np.concatenate([quads, np.ones((*quads.shape[:-1], 1))], axis=-1).swapaxes(-1, -2)
    columns = homogeneous[..., :3]
    return np.asarray(columns * np.linalg.solve(columns, homogeneous[..., 3:]).swapaxes(-1, -2))


def _misfit(blobs: Blobs, assignments: Indices, points: Array, radii: Array, camera: Camera) -> tuple[Array, Array]:
    """RMS (m,) in px by which centers and semi-axes miss those of the nearest calibrated pose; corrected centers.

    With four dots any assignment is a homography; that H = K [r1 r2 t] with a rotation, and the size and shape of the
    dots, is what tells a right one.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        corrected, homography = correct_centers(blobs.center[assignments], points, radii)
        usable = np.isfinite(corrected).all(axis=(-1, -2)) & np.isfinite(homography).all(axis=(-1, -2))
        misfit = np.full(len(assignments), np.inf)
        if usable.any():
            rotation, translation = decompose_homography(homography[usable], camera.matrix)
            nearest = plane_homography(rotation, translation, camera.matrix)
            offset = apply_homography(nearest, points) - corrected[usable]
            semi = circle_image(points, radii, nearest[:, None])[1]
            error = np.concatenate([offset, semi - blobs.semi[assignments[usable]]], axis=-1)
            misfit[usable] = np.nan_to_num(np.sqrt(np.mean(np.sum(error**2, axis=-1), axis=-1)), nan=np.inf)
    return misfit, corrected
