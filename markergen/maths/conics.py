"""Projection of dots as ellipses, and pose refinement from ellipse centers: batched, in normalized coordinates.

Normalized coordinates are (X/z, Y/z), without lens distortion and camera matrix, so this module is independent of
pixels but for the lens in `fitted_centers`. The center of an image ellipse is not the image of the dot's center; the
exact offset follows from the conic. Nor is the center of what a lens makes of an ellipse the image of its center.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.maths.batched import Batched
from markergen.maths.information import mirrored_rotation
from markergen.maths.levenberg_marquardt import Arrays, Attempt, Damping, LeastSquares, levenberg_marquardt

DAMPING = Damping(start=1e-4, least=1e-12, slack=1e-12, ridge=1e-14)
"""Damping; the ridge holds the direction that collinear dots leave free."""


@dataclass(frozen=True, eq=False)
class Outlines(Batched):
    """Image ellipses of k times n disks, in normalized coordinates.

    Attributes
    ----------
    center : array (k, n, 2)
        Centers of the ellipses.
    point : array (k, n, 2)
        Images of the disks' own centers.
    shape : array (k, n, 2, 2)
        E with (x - c)' E^-1 (x - c) = 1 on the outline: semi-axes squared along the axes.
    front, seen : arrays (k, n) of bool
        True if the disk is wholly in front of the camera, and if it also faces it.
    """

    center: Array
    point: Array
    shape: Array
    front: NDArray[np.bool_]
    seen: NDArray[np.bool_]


def outlines(points: Array, radii: Array, rotation: Array, translation: Array) -> Outlines:
    """Return the exact image ellipses of disks parallel to the marker plane, each at its own height.

    The dual conic of a disk of radius r about P with normal n is r^2 (I - n n') - P P', in the camera frame and in the
    normalized image alike; center and shape of the ellipse are ratios of its entries.

    Parameters
    ----------
    points : array (n, 3), m
    radii : array (n,), m
        0 for bare points.
    rotation, translation : arrays (k, 3, 3) and (k, 3)
    """
    place = points @ rotation.swapaxes(-1, -2) + translation[:, None]
    normal = rotation[:, None, :, 2]
    disk = np.eye(3) - normal[..., :, None] * normal[..., None, :]
    facing = np.sum(place * normal, axis=-1) < 0
    disk = disk * (radii**2)[:, None, None]
    depth = place[..., 2]
    # Below zero the rim reaches the plane of the camera's center.
    level = depth**2 - disk[..., 2, 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        center = (place[..., :2] * depth[..., None] - disk[..., :2, 2]) / level[..., None]
        mixed = place[..., :2, None] * place[..., None, :2] - disk[..., :2, :2]
        shape = center[..., :, None] * center[..., None, :] - mixed / level[..., None, None]
        point = place[..., :2] / depth[..., None]
    front = (depth > 0) & (level > 0)
    return Outlines(center, point, shape, front, front & facing)


_AROUND = np.arange(32) * (np.pi / 16)
"""Parameters of an outline's points, as many as in detector/src/lens.c. With 16, centers of ellipses 100 px long and
three times as long as wide are off by 0.002 px behind strong lenses."""
_HARMONICS = np.stack([np.ones(32), np.cos(_AROUND), np.sin(_AROUND)])
_TO_HARMONICS = np.linalg.pinv(_HARMONICS)
_LEAST_SQUARE = 1e-16
"""Added to the squares of semi-axes, so that points have an outline."""


def fitted_centers(center: Array, shape: Array, lens: Callable[[Array], Array]) -> Array:
    """Centers (..., 2) in px of the ellipses that fit the images of ellipses through a lens best, as a detector's do.

    A lens bends an ellipse, and what it makes of it has no center. A fit to the grey levels minimizes the integral of
    d^2 over the outline, d being the distance along the normal. With q(u) = c0 + B (cos u, sin u) + h(u), the image of
    the point of parameter u, and h without harmonics 0 and 1, the ellipse of c0 and B moves by

        (sum m m' / |m|)^-1 sum m m'h / |m|,    m the normal as long as the derivative of B (cos u, sin u),

    up to products of h's even and odd parts; for a small circle and a weak radial lens, it ends
    3/8 tr(B B' d^2 q) from the image of the center. `detector/src/lens.c` is the inverse.

    Parameters
    ----------
    center, shape : arrays (..., 2) and (..., 2, 2), normalized
        See `Outlines`.
    lens : callable
        From normalized coordinates (..., 2) to px; nan where there is no image.
    """
    c, s = _HARMONICS[1:]
    wide = np.sqrt(shape[..., 0, 0] + _LEAST_SQUARE)[..., None]
    lean = shape[..., 0, 1, None] / wide
    high = np.sqrt(shape[..., 1, 1, None] + _LEAST_SQUARE - lean**2)
    outline = lens(np.stack([center[..., :1] + wide * c, center[..., 1:] + lean * c + high * s], axis=-1))
    x, y = (np.ascontiguousarray(outline[..., k]) for k in (0, 1))
    (x0, xc, xs), (y0, yc, ys) = (np.moveaxis((values @ _TO_HARMONICS)[..., None], -2, 0) for values in (x, y))
    nx, ny = ys * c - yc * s, xc * s - xs * c
    across = (nx * (x - x0 - xc * c - xs * s) + ny * (y - y0 - yc * c - ys * s)) / (length := np.hypot(nx, ny))
    xx, xy, yy = ((a * b / length).sum(axis=-1) for a, b in ((nx, nx), (nx, ny), (ny, ny)))
    along, down = (nx * across).sum(axis=-1), (ny * across).sum(axis=-1)
    area = xx * yy - xy * xy
    moved = (yy * along - xy * down) / area, (xx * down - xy * along) / area
    return np.stack([x0[..., 0] + moved[0], y0[..., 0] + moved[1]], axis=-1)


def pose_rows(points: Array, rotation: Array, translation: Array) -> Array:
    """Return the Jacobian (k, n, 2, 6) of the normalized images of points (n, 3) with respect to the pose (w, dt).

    See `maths.information`.
    """
    rotated = points @ rotation.swapaxes(-1, -2)
    scale = 1 / (rotated[..., 2] + translation[:, None, 2])
    x, y = (scale * (rotated[..., i] + translation[:, None, i]) for i in (0, 1))
    a, b, c = (scale * rotated[..., i] for i in range(3))
    rows = np.zeros((*x.shape, 2, 6))
    # A row g of d x / d X_camera, here (1, 0, -x)/z and (0, 1, -y)/z, gives (R X) x g for w.
    rows[..., 0, 0], rows[..., 0, 1], rows[..., 0, 2] = -x * b, c + x * a, -b
    rows[..., 1, 0], rows[..., 1, 1], rows[..., 1, 2] = -y * b - c, y * a, a
    rows[..., 0, 3] = rows[..., 1, 4] = scale
    rows[..., 0, 5], rows[..., 1, 5] = -x * scale, -y * scale
    return rows


def refine_poses(
    points: Array,
    radii: Array,
    seen: Array,
    weight: Array,
    rotation: Array,
    translation: Array,
    steps: int = 20,
    tolerance: float = 1e-10,
) -> tuple[Array, Array, Array]:
    """Refine k poses by Levenberg-Marquardt on the weighted distance between measured and predicted ellipse centers.

    The derivative of an ellipse's center is approximated by that of the disk's center: they differ by a thousandth,
    which costs a step and shifts the minimum by only that thousandth of the residuals.

    Parameters
    ----------
    points, radii : arrays (n, 3) and (n,), m
    seen : array (k, n, 2)
        Measured centers of ellipses, normalized coordinates; anything finite where the weight is 0.
    weight : array (k, n, 2, 2)
        Inverse covariances of `seen`; 0 for missing dots.
    rotation, translation : arrays (k, 3, 3) and (k, 3)
        Initial poses.
    steps : int
        Maximum number of steps.
    tolerance : float
        Stops when no step rotates by more than this, in rad, or moves by more than this share of the distance, or
        lowers chi2 by more than this share of it.

    Returns
    -------
    rotation (k, 3, 3), translation (k, 3), chi2 (k,)
        chi2 is inf for a pose that does not see all weighted dots from the front.
    """
    used = np.asarray(weight.any(axis=(-2, -1)))
    problems = EllipseCenters(points, radii, seen, weight, used, tolerance, together=len(seen) <= FEW)
    (rotation, translation), chi2 = levenberg_marquardt(problems, (rotation, translation), DAMPING, steps)
    return rotation, translation, chi2


def mirrored_poses(points: Array, rotation: Array, translation: Array) -> tuple[Array, Array]:
    """Mirror poses (k, 3, 3), (k, 3) about the middle of the points, which leaves a flat marker's image similar."""
    middle = points.mean(axis=0)
    place = rotation @ middle + translation
    mirrored = mirrored_rotation(rotation, place)
    return mirrored, place - mirrored @ middle


FEW = 64
"""Number of poses up to which removing them one by one costs more than their steps: if removed, 50 poses of five dots
take 1.3 times as long, 100 take 0.8 times, 4,000 half as long."""

_GENERATORS = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=float
)
"""skew(w) = w @ _GENERATORS, as rows of nine."""


def _rotation(vectors: Array) -> Array:
    """Compute `maths.rotation.exponential` for a few vectors (k, 3), in a quarter of the time."""
    cross = (vectors @ _GENERATORS).reshape(-1, 3, 3)
    angle = np.sqrt(np.sum(vectors**2, axis=-1))[:, None, None] + 1e-150
    half = np.sin(angle / 2) / angle
    return np.eye(3) + np.sin(angle) / angle * cross + 2 * half**2 * (cross @ cross)


@dataclass(frozen=True, eq=False)
class EllipseCenters(LeastSquares):
    """Weighted distances between measured and predicted ellipse centers; see `refine_poses`.

    `used` (k, n) marks the dots that have a weight; `together`: all take steps until each has converged or diverged.
    """

    points: Array
    radii: Array
    seen: Array
    weight: Array
    used: Mask
    tolerance: float
    together: bool

    def residuals(self, unknowns: Arrays) -> Arrays:
        """Return chi2 (k,), inf if a used dot is not seen, and measured minus predicted centers (k, n, 2).

        Centers of unused dots are 0.
        """
        rotation, translation = unknowns
        # The centers of `outlines`, without the shapes.
        place = self.points @ rotation.swapaxes(-1, -2) + translation[:, None]
        normal = rotation[:, None, :, 2]
        depth = place[..., 2:]
        square = self.radii[:, None] ** 2
        level = depth**2 - square * (1 - normal[..., 2:] ** 2)
        front = (depth[..., 0] > 0) & (level[..., 0] > 0) & (np.sum(place * normal, axis=-1) < 0)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            center = (place[..., :2] * depth + square * normal[..., 2:] * normal[..., :2]) / level
            residual = np.where(self.used[..., None], self.seen - center, 0.0)
            chi2 = np.sum((self.weight @ residual[..., None])[..., 0] * residual, axis=(-2, -1))
        visible = (front | ~self.used).all(axis=-1)
        return np.where(visible & (chi2 < np.inf), chi2, np.inf), residual

    def jacobian(self, unknowns: Arrays, results: Arrays) -> Array:
        """See `LeastSquares.jacobian`; here (k, n, 2, 6)."""
        del results
        return pose_rows(self.points, *unknowns)

    def normal_equations(self, jacobian: Array, residual: Array) -> tuple[Array, Array]:
        """See `LeastSquares.normal_equations`."""
        k = len(self.seen)
        weighted = (self.weight @ jacobian).reshape(k, -1, 6).swapaxes(-1, -2)
        return weighted @ jacobian.reshape(k, -1, 6), (weighted @ residual.reshape(k, -1, 1))[..., 0]

    def moved(self, unknowns: Arrays, step: Array) -> Arrays:
        """See `LeastSquares.moved`."""
        return _rotation(step[:, :3]) @ unknowns[0], unknowns[1] + step[:, 3:]

    def converged(self, attempt: Attempt) -> Mask:
        """See `LeastSquares.converged`."""
        _, translation = attempt.kept
        settled = attempt.good & (attempt.after >= attempt.before * (1 - self.tolerance))
        moved = np.abs(attempt.step)
        moved[:, 3:] /= np.sqrt(np.sum(translation**2, axis=-1, keepdims=True))
        going = (moved.max(axis=-1) > self.tolerance) & ~settled & (attempt.cost < np.inf)
        return np.full(len(going), not going.any()) if self.together else ~going

    def take(self, chosen: Mask) -> "EllipseCenters":
        """See `LeastSquares.take`."""
        return replace(self, seen=self.seen[chosen], weight=self.weight[chosen], used=self.used[chosen])
