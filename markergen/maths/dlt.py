"""The direct linear transform: its matrix, its condition number with gradient, and the normalized estimate.

For a correspondence X = (X, Y), x = (x, y) and p = (X, Y, 1) the two rows of A (Acuna & Willert 2018, Eq. 4) are

    [ 0   -p   y p ]
    [ p    0  -x p ]

so A h = 0 for h = (row 1, row 2, row 3) of the homography. Every entry of A'A is a moment of the points, which
makes A'A cheap to form without A: with q = (XX, XY, X, YY, Y, 1) the nine 3x3 blocks are sums of q, x q, y q and
(xx + yy) q.
"""

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array

_QUADRATIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Position in q of the product p_i p_j."""

_ROUNDING = 9 * np.finfo(float).eps
"""Share of the largest eigenvalue of A'A up to which another one is rounding noise."""


def dlt_matrix(object_points: Array, image_points: Array) -> Array:
    """DLT matrix A, shape (..., 2n, 9), of object points and image points, both (..., n, 2), any units."""
    shape = np.broadcast_shapes(object_points.shape, image_points.shape)
    p = np.broadcast_to(_homogeneous(object_points), (*shape[:-1], 3))
    rows = np.zeros((*shape[:-1], 2, 9))
    rows[..., 0, 3:6] = -p
    rows[..., 0, 6:] = image_points[..., 1:] * p
    rows[..., 1, :3] = p
    rows[..., 1, 6:] = -image_points[..., :1] * p
    return rows.reshape(*shape[:-2], -1, 9)


def condition(object_points: Array, image_points: Array, softness: float = 0.0) -> Array:
    """Condition number c(A) = s1/s8 of the DLT matrix (Eq. 11).

    Parameters
    ----------
    object_points, image_points : array (..., n, 2)
        Correspondences; leading shapes broadcast. c depends on their coordinate systems.
    softness : float
        0 gives c itself. Above 0 the smallest singular value is replaced by the smooth lower bound
        (sum over k = 2..8 of s_k^(-2/softness))^(-softness/2), which is differentiable where s7 = s8.

    Returns
    -------
    array (...)
        At least 1; inf where the rank of A is below 8 (n < 4, three of four points on a line).
    """
    return _spectrum(object_points, image_points, softness)[0]


def condition_and_gradient(
    object_points: Array, image_points: Array, softness: float = 0.0
) -> tuple[Array, Array, Array]:
    """Return `condition` and the gradient of its logarithm with respect to both sets of points.

    d log c = (u1' dA v1)/s1 - (u8' dA v8)/s8 in terms of singular vectors, equal to tr(G d(A'A)) with
    G = (v1 v1'/s1^2 - v8 v8'/s8^2)/2; the latter is computed. Where s7 = s8 the eigenvectors that LAPACK
    returns select one subgradient of the kink; with softness > 0 there is no kink.

    Returns
    -------
    value (...), object_gradient (..., n, 2), image_gradient (..., n, 2)
        Gradients of log(value), finite wherever the value is.
    """
    value, vectors, weights = _spectrum(object_points, image_points, softness)
    kept = vectors[..., :, 1:] if softness else vectors[..., :, [1, 8]]
    scale = weights if softness else weights[..., [0, 7]]
    g = (kept * scale[..., None, :]) @ kept.swapaxes(-1, -2)

    p = _homogeneous(object_points)
    x, y = image_points[..., 0], image_points[..., 1]
    cross_x, cross_y, last = g[..., :3, 6:], g[..., 3:6, 6:], g[..., 6:, 6:]
    cross_x = cross_x + cross_x.swapaxes(-1, -2)
    cross_y = cross_y + cross_y.swapaxes(-1, -2)
    # tr(G A'A) = sum over points of p'(Q0 - x Qx - y Qy + (xx + yy) Qw)p, a quadratic form in p for each point.
    along = [p @ matrix for matrix in (g[..., :3, :3] + g[..., 3:6, 3:6], cross_x, cross_y, last)]
    form_x, form_y, form_w = (np.einsum("...i,...i->...", p, part) for part in along[1:])
    image_gradient = np.stack([2 * x * form_w - form_x, 2 * y * form_w - form_y], axis=-1)
    object_gradient = 2 * (
        along[0] - x[..., None] * along[1] - y[..., None] * along[2] + (x * x + y * y)[..., None] * along[3]
    )
    return value, object_gradient[..., :2], image_gradient


def relative_error_bounds(object_points: Array, exact: Array, noisy: Array) -> tuple[Array, Array, Array]:
    """Relative error of the DLT's h, and the lower and upper bound of Acuna & Willert 2018, section III, for it.

    |h - h'| / |h'| with the singular vectors h and h' of A and A' for the smallest singular value, of one sign; at
    least |A' (h - h')| / (|A'| |h'|), and to first order at most c(A) |A - A'| / |A| = |A - A'| / s8, with spectral
    norms.

    Parameters
    ----------
    object_points, exact, noisy : arrays (..., n, 2)
        The last two are images, both in the same coordinates.

    Returns
    -------
    error, lower, upper : arrays (...)
    """
    matrix, disturbed = dlt_matrix(object_points, exact), dlt_matrix(object_points, noisy)
    h, h_hat = (np.linalg.svd(a)[2][..., 8, :] for a in (matrix, disturbed))
    h_hat = h_hat * np.where(np.sum(h * h_hat, axis=-1) < 0, -1.0, 1.0)[..., None]
    # With n = 4 the eighth singular value is the last one.
    eighth = np.linalg.svd(matrix, compute_uv=False)[..., 7]
    moved = np.linalg.norm(np.einsum("...ij,...j->...i", disturbed, h - h_hat), axis=-1)
    lower = moved / np.linalg.norm(disturbed, 2, axis=(-2, -1))
    return np.linalg.norm(h - h_hat, axis=-1), lower, np.linalg.norm(matrix - disturbed, 2, axis=(-2, -1)) / eighth


def normal_matrix(object_points: Array, image_points: Array) -> Array:
    """A'A, shape (..., 9, 9), from moments of the points; only the lower triangle of blocks is filled.

    LAPACK's symmetric eigensolvers read only that triangle.
    """
    p = _homogeneous(object_points)
    q = np.stack([p[..., 0] ** 2, p[..., 0] * p[..., 1], p[..., 0], p[..., 1] ** 2, p[..., 1], p[..., 2]], axis=-1)
    x, y = image_points[..., 0], image_points[..., 1]
    weights = np.stack([x, y, x * x + y * y], axis=-2)
    moments = weights @ q
    result = np.zeros((*moments.shape[:-2], 9, 9))
    result[..., :3, :3] = result[..., 3:6, 3:6] = q.sum(axis=-2)[..., _QUADRATIC]
    result[..., 6:, :3] = -moments[..., 0, _QUADRATIC]
    result[..., 6:, 3:6] = -moments[..., 1, _QUADRATIC]
    result[..., 6:, 6:] = moments[..., 2, _QUADRATIC]
    return result


def normalization(points: Array) -> tuple[Array, Array]:
    """Hartley's center (..., 1, 2) and scale (..., 1, 1): (points - center) * scale has an RMS of sqrt(2)."""
    center = points.mean(axis=-2, keepdims=True)
    mean_square = np.mean(np.sum((points - center) ** 2, axis=-1), axis=-1)[..., None, None]
    return center, np.sqrt(2 / mean_square)


def four_in_general_position(points: Array) -> NDArray[np.bool_]:
    """Return true (...) if some four of the points (..., n, 2), not all collinear, have no three on a line."""
    center, scale = normalization(points)
    normalized = (points - center) * scale
    # This holds exactly if the DLT matrix of the identity has rank 8; eigenvalues alone take a third of the time.
    values = np.linalg.eigvalsh(normal_matrix(normalized, normalized))
    return np.asarray(values[..., 1] >= _ROUNDING * values[..., 8])


def estimate_homography(object_points: Array, image_points: Array) -> Array:
    """Normalized DLT estimate of H (..., 3, 3), scaled to H[2, 2] = 1, from n >= 4 points (Hartley 1997).

    Uses the eigenvector of the smallest eigenvalue of the 9x9 A'A instead of the last right singular vector of A: after
    normalization A is so well conditioned that squaring costs no more than 1e-12 px, and it is four times as fast.
    nan where points are not finite, or all in one place.
    """
    object_center, object_scale = normalization(object_points)
    image_center, image_scale = normalization(image_points)
    normal = normal_matrix((object_points - object_center) * object_scale, (image_points - image_center) * image_scale)
    if not np.isfinite(normal).all():
        # LAPACK raises an error; what is nan in the similarities makes the result nan as well.
        normal = np.nan_to_num(normal, nan=0.0, posinf=0.0, neginf=0.0)
    # eigh reads the lower triangle alone, which is what `normal_matrix` fills.
    h = np.linalg.eigh(normal)[1][..., :, 0].reshape(*normal.shape[:-2], 3, 3)
    h = np.linalg.inv(_similarity(image_center, image_scale)) @ h @ _similarity(object_center, object_scale)
    return h / h[..., 2:, 2:]


def _similarity(center: Array, scale: Array) -> Array:
    matrix = np.zeros((*center.shape[:-2], 3, 3))
    matrix[..., 0, 0] = matrix[..., 1, 1] = scale[..., 0, 0]
    matrix[..., :2, 2] = -scale[..., 0] * center[..., 0, :]
    matrix[..., 2, 2] = 1
    return matrix


def _homogeneous(points: Array) -> Array:
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def _spectrum(object_points: Array, image_points: Array, softness: float) -> tuple[Array, Array, Array]:
    """Value, eigenvectors of A'A, and the weights of eigenvectors 2..9 in the gradient of log c."""
    values, vectors = np.linalg.eigh(normal_matrix(object_points, image_points))
    largest = values[..., 8]
    # An eigenvalue below this is rounding noise, and the layout is degenerate.
    # The value stays finite until `degenerate` makes it infinite, and the gradient never divides by 0.
    usable = np.maximum(values[..., 1:], _ROUNDING * largest[..., None])
    degenerate = values[..., 1] < usable[..., 0]
    least = usable[..., 0]
    weights = np.zeros_like(usable)
    if softness:
        shares = (usable[..., :-1] / least[..., None]) ** (-1 / softness)
        total = shares.sum(axis=-1)
        least = least * total**-softness
        weights[..., :-1] = -0.5 * shares / total[..., None] / usable[..., :-1]
    else:
        weights[..., 0] = -0.5 / least
    weights[..., -1] = 0.5 / largest
    value = np.where(degenerate, np.inf, np.sqrt(largest / least))
    return value, vectors, weights
