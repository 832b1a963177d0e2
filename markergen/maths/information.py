"""Fisher information of pose and homography from noisy image points, and the resulting bounds.

For isotropic Gaussian noise of sigma px on every image coordinate the information is J'J/sigma^2, with J the Jacobian
of the image points; its inverse bounds the covariance of every unbiased estimator (CRLB).

A pose has six parameters (w, dt): R <- exp([w]x) R, t <- t + dt, both in the camera frame, rad and m. A homography
has eight: M <- M (I + D), D33 = 0, where M = [r1 r2 t] acts on (X/r, Y/r, 1), so that no gauge depends on the unit.
"""

import numpy as np

from markergen.arrays import Array
from markergen.maths.projection import rotate
from markergen.maths.rotation import angle_between, exponential, skew


def apply_pose_step(rotation: Array, translation: Array, step: Array) -> tuple[Array, Array]:
    """Apply steps (w, dt) (k, 6) to poses (k, 3, 3), (k, 3): exp([w]x) R and t + dt."""
    return exponential(step[:, :3]) @ rotation, translation + step[:, 3:]


def pose_jacobian(points: Array, rotation: Array, translation: Array, focal: Array) -> Array:
    """Jacobian (..., P, 2n, 6) of the image points (px) with respect to the pose.

    Parameters
    ----------
    points : array (..., n, 2 or 3), m, marker frame
    rotation, translation : arrays (P, 3, 3) and (P, 3)
    focal : array (2,), px
    """
    return rotated_jacobian(rotate(points, rotation), translation, focal)


def rotated_jacobian(rotated: Array, translation: Array, focal: Array) -> Array:
    """`pose_jacobian` (..., P, 2n, 6) from rotated points R X (..., P, n, 3) in m."""
    # By component: np.cross, and products along a last axis of 3, take three to ten times as long.
    (x, y, z), u, v, p, q = _projected(rotated, translation, focal)
    jacobian = np.empty((*rotated.shape[:-1], 2, 6))
    # A row g of d x / d X_camera, (u, 0, p) or (0, v, q), multiplies dX = w x (R X) + dt; its part for w is (R X) x g.
    across, along = jacobian[..., 0, :], jacobian[..., 1, :]
    across[..., 0], across[..., 1], across[..., 2] = y * p, z * u - x * p, -y * u
    across[..., 3], across[..., 4], across[..., 5] = u, 0.0, p
    along[..., 0], along[..., 1], along[..., 2] = y * q - z * v, -x * q, x * v
    along[..., 3], along[..., 4], along[..., 5] = 0.0, v, q
    return jacobian.reshape(*rotated.shape[:-2], -1, 6)


def homography_jacobian(points: Array, rotation: Array, translation: Array, focal: Array, radius: float) -> Array:
    """Jacobian (..., P, 2n, 8) of the image points (px) with respect to the homography; points (..., n, 2) in m."""
    rows = _image_rows(rotate(points, rotation) + translation[:, None, :], focal)
    along = rows @ _unit_plane(rotation, translation, radius)[:, None]
    unit = np.concatenate([points / radius, np.ones((*points.shape[:-1], 1))], axis=-1)[..., None, :, None, None, :]
    jacobian = (along[..., :, None] * unit).reshape(*rows.shape[:-1], 9)[..., :8]
    return jacobian.reshape(*jacobian.shape[:-3], -1, 8)


def information(jacobian: Array) -> Array:
    """J'J, shape (..., k, k): the Fisher information for noise of 1 px."""
    return np.matmul(jacobian.swapaxes(-1, -2), jacobian)


def covariance(matrix: Array) -> Array:
    """Inverse of an information matrix (..., k, k); inf throughout where it is singular, by rounding as well."""
    try:
        inverse = np.asarray(np.linalg.inv(matrix), dtype=float)
    except np.linalg.LinAlgError:
        # Where a point is outside the lens model's domain, all entries are nan.
        singular = np.asarray(~np.isfinite(matrix).all(axis=(-2, -1)))
        singular[~singular] = np.linalg.matrix_rank(matrix[~singular], hermitian=True) < matrix.shape[-1]
        inverse = np.full_like(matrix, np.inf)
        inverse[~singular] = np.linalg.inv(matrix[~singular])
    failed = ~np.all(np.diagonal(inverse, axis1=-2, axis2=-1) > 0, axis=-1)
    if failed.any():
        inverse[failed] = np.inf
    return inverse


def moved_information(matrix: Array, offset: Array) -> Array:
    """Information (..., 6, 6) on the pose of another frame of the same body.

    For origins o' = o + offset, offset (..., 3) in m in the camera frame, dt' = dt + w x offset, so that (w, dt) =
    A (w, dt') and the information is A' M A.
    """
    change = np.broadcast_to(np.eye(6), matrix.shape).copy()
    change[..., 3:, :3] = skew(offset)
    return change.swapaxes(-1, -2) @ matrix @ change


def displacement_weight(rim: Array, rotation: Array) -> Array:
    """W (P, 6, 6), m^2: trace(W C) is the expected squared 3-D displacement of rim points (m, 2) or (m, 3)."""
    rotated = rotate(rim, rotation)
    second = rotated.swapaxes(-1, -2) @ rotated / rim.shape[-2]
    mean = rotated.mean(axis=-2)
    weight = np.zeros((len(rotation), 6, 6))
    weight[:, :3, :3] = np.trace(second, axis1=-2, axis2=-1)[:, None, None] * np.eye(3) - second
    # d(R b + t) = w x (R b) + dt; the cross term vanishes for a rim centered on the origin.
    weight[:, :3, 3:] = skew(mean)
    weight[:, 3:, :3] = -skew(mean)
    weight[:, 3:, 3:] = np.eye(3)
    return weight


def pose_jacobian_pullback(cotangent: Array, points: Array, rotation: Array, translation: Array, focal: Array) -> Array:
    """Gradient (..., P, n, 2 or 3) with respect to the points of sum(cotangent * pose_jacobian(points, ...)).

    Closed form from the second derivatives of the projection. A cotangent row (c, d) of an image coordinate with the
    gradient g contributes g.w, w = c x (R X) + d, whose derivative is dg.w + dX.(g x c).
    """
    rotated = rotate(points, rotation)
    (x, y, z), u, v, p, q = _projected(rotated, translation, focal)
    rows = np.moveaxis(cotangent.reshape(*rotated.shape[:-1], 2, 6), (-2, -1), (0, 1))
    (c0, c1, c2, d0, _, d2), (e0, e1, e2, _, f1, f2) = np.ascontiguousarray(rows)
    depth = z + translation[:, None, 2]
    across, along = (c0 * y - c1 * x + d2) / depth, (e0 * y - e1 * x + f2) / depth
    gradient = np.empty_like(rotated)
    gradient[..., 0] = v * e2 - p * c1 - q * e1 - u * across
    gradient[..., 1] = p * c0 - u * c2 + q * e0 - v * along
    toward = u * (c1 - (c1 * z - c2 * y + d0) / depth) - v * (e0 + (e2 * x - e0 * z + f1) / depth)
    gradient[..., 2] = toward - 2 * (p * across + q * along)
    return gradient @ rotation[:, :, : points.shape[-1]]


def homography_jacobian_pullback(
    cotangent: Array, points: Array, rotation: Array, translation: Array, focal: Array, radius: float
) -> Array:
    """Gradient (..., P, n, 2) with respect to the points of sum(cotangent * homography_jacobian(points, ...))."""
    camera_points = rotate(points, rotation) + translation[:, None, :]
    rows = _image_rows(camera_points, focal)
    plane = _unit_plane(rotation, translation, radius)[:, None]
    parts = cotangent.reshape(*rows.shape[:-1], 8)
    parts = np.concatenate([parts, np.zeros((*parts.shape[:-1], 1))], axis=-1).reshape(*rows.shape[:-1], 3, 3)
    unit = np.concatenate([points / radius, np.ones((*points.shape[:-1], 1))], axis=-1)[..., None, :, None, :]
    weights = np.einsum("...ij,...j->...i", parts, unit) @ plane.swapaxes(-1, -2)
    gradient = _row_gradient(weights, camera_points, focal) @ rotation[:, :, :2]
    direct = np.einsum("...ri,...rij->...j", rows @ plane, parts)[..., :2] / radius
    return gradient + direct


def rotation_bound(pose_covariance: Array) -> Array:
    """RMS rotation angle in rad for a pose covariance (..., 6, 6), to first order."""
    return np.sqrt(np.trace(pose_covariance[..., :3, :3], axis1=-2, axis2=-1))


def translation_bound(pose_covariance: Array, translation: Array) -> Array:
    """RMS of |t_hat - t|/|t| (a fraction) for a pose covariance (..., P, 6, 6); translation (P, 3)."""
    return np.sqrt(np.trace(pose_covariance[..., 3:, 3:], axis1=-2, axis2=-1)) / np.linalg.norm(translation, axis=-1)


def mirrored_rotation(rotation: Array, translation: Array) -> Array:
    """Rotation (..., 3, 3) of the flipped pose: the marker's normal reflected about the line of sight.

    The rest of the frame follows by the smallest rotation from the normal to its mirror image. For a normal along the
    line of sight the two poses coincide.
    """
    sight = translation / np.linalg.norm(translation, axis=-1, keepdims=True)
    normal = rotation[..., :, 2]
    # Reflection about the line of sight l is the half turn 2 l l' - I; n -> -n as well leaves it facing away again.
    mirror = 2 * np.sum(sight * normal, axis=-1, keepdims=True) * sight - normal
    return smallest_rotation(normal, mirror) @ rotation


def smallest_rotation(source: Array, target: Array) -> Array:
    """Rotation (..., 3, 3) by the smallest angle from unit vectors source (..., 3) to target (..., 3).

    Opposite vectors have no unique smallest rotation; the result is then not a rotation.
    """
    cosine = np.sum(source * target, axis=-1)[..., None, None]
    # The matrix of the cross product with source x target.
    cross = target[..., :, None] * source[..., None, :]
    cross = cross - cross.swapaxes(-1, -2)
    return np.eye(3) + cross + cross @ cross / (1 + cosine)


def flip_separation(rotation: Array, translation: Array, pose_covariance: Array) -> Array:
    """Angle between a pose and its mirrored pose, in units of the rotation bound (rad / rad, shape (P,))."""
    separation = angle_between(rotation, mirrored_rotation(rotation, translation))
    return separation / rotation_bound(pose_covariance)


def _projected(rotated: Array, translation: Array, focal: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Rotated points (3, ..., P, n), and entries (..., P, n) of the rows (u, 0, p), (0, v, q) of `_image_rows`."""
    x, y, depth = np.moveaxis(rotated + translation[:, None], -1, 0)
    u, v = focal[0] / depth, focal[1] / depth
    return np.moveaxis(rotated, -1, 0), u, v, -u * x / depth, -v * y / depth


def _image_rows(camera_points: Array, focal: Array) -> Array:
    """Image-point Jacobian (..., 2, 3): rows f_x/z (1, 0, -a) and f_y/z (0, 1, -b), with (a, b) = (X/z, Y/z)."""
    scale = focal / camera_points[..., 2:]
    rows = np.zeros((*camera_points.shape[:-1], 2, 3))
    rows[..., 0, 0], rows[..., 1, 1] = scale[..., 0], scale[..., 1]
    rows[..., :, 2] = -scale * camera_points[..., :2] / camera_points[..., 2:]
    return rows


def _row_gradient(weights: Array, camera_points: Array, focal: Array) -> Array:
    """Gradient (..., 3) with respect to the camera point of the sum of row . weight over the two image rows."""
    depth = camera_points[..., 2:]
    scale = focal / depth**2
    slope = camera_points[..., :2] / depth
    last = weights[..., :, 2]
    lateral = -scale * last
    diagonal = np.stack([weights[..., 0, 0], weights[..., 1, 1]], axis=-1)
    axial = np.sum(scale * (2 * slope * last - diagonal), axis=-1, keepdims=True)
    return np.concatenate([lateral, axial], axis=-1)


def _unit_plane(rotation: Array, translation: Array, radius: float) -> Array:
    """M = [r r1, r r2, t], shape (P, 3, 3), from (X/r, Y/r, 1) to the camera frame."""
    return np.concatenate([rotation[..., :2] * radius, translation[..., None]], axis=-1)
