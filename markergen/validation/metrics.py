"""Errors of estimates, criteria for failures and flips, and statistics with their counts."""

from typing import Any

import numpy as np

from markergen.arrays import Array, Mask
from markergen.maths.information import mirrored_rotation
from markergen.maths.projection import apply_homography, to_camera
from markergen.maths.rotation import angle_between, logarithm

Statistics = dict[str, float | int | None]

FLIP_SEPARATION = 6.0
"""Minimum separation of pose and mirrored pose, in units of the rotation bound, for calling an estimate a flip."""
EFFICIENCY_LIMIT_DEG = 2.5
"""Rotation bound above which the first-order bound does not hold, and an efficiency would be meaningless."""
POSE_PARAMETERS = 6
"""Degrees of freedom of a pose, the mean NEES if its covariance is right."""
STATISTICS = ("mean", "std", "rms", "median", "p95", "max")
"""Keys of `statistics` other than the count, in column order."""


def rotation_error_deg(estimate: Array, rotation: Array) -> Array:
    """RE (...): angle of R_hat^T R in degrees, for estimates (..., 3, 3); nan where the estimate is not finite."""
    return np.rad2deg(angle_between(estimate, rotation))


def translation_error_pct(estimate: Array, translation: Array) -> Array:
    """TE (...): |t_hat - t|/|t| in percent, for estimates (..., 3)."""
    return np.asarray(100 * np.linalg.norm(estimate - translation, axis=-1) / np.linalg.norm(translation, axis=-1))


def homography_error_px2(estimate: Array, grid: Array, pixels: Array) -> Array:
    """HE (T,): mean over the validation grid of the squared distance |x_j - pi(H_hat X_j)|^2 in px^2 (not its root).

    Parameters
    ----------
    estimate : array (T, 3, 3)
    grid : array (m, 2), m, marker frame
    pixels : array (m, 2)
        Noise-free image of the grid.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.asarray(np.mean(np.sum((pixels - apply_homography(estimate, grid)) ** 2, axis=-1), axis=-1))


def pose_failed(points: Array, rotation: Array, translation: Array, te_pct: Array) -> Mask:
    """Failure (T,) of estimates (T, 3, 3), (T, 3): not finite, a point (n, 3) behind the camera, or TE over 100 %."""
    in_front = np.all(to_camera(points, rotation, translation)[..., 2] > 0, axis=-1)
    # A comparison with nan is false, so that non-finite estimates fail as well.
    return np.asarray(~(in_front & (te_pct <= 100) & np.isfinite(rotation).all(axis=(-2, -1))))


def homography_failed(points: Array, estimate: Array, he_px2: Array) -> Mask:
    """Failure (T,) of estimates (T, 3, 3) with H[2, 2] = 1: not finite, or a point (n, 2) beyond the horizon."""
    depth = points @ estimate[:, 2, :2].T + 1
    return np.asarray(~(np.isfinite(he_px2) & np.all(depth > 0, axis=0)))


def flipped(estimate: Array, rotation: Array, translation: Array) -> Mask:
    """Tell which rotations (T, 3, 3) are nearer to the mirrored pose than to the true one (3, 3), (3,)."""
    mirrored = mirrored_rotation(rotation, translation)
    return np.asarray(angle_between(estimate, mirrored) < angle_between(estimate, rotation))


def pose_nees(
    rotation_estimate: Array, translation_estimate: Array, rotation: Array, translation: Array, information: Array
) -> Array:
    """NEES (T,): e' C^-1 e with e = (log(R_hat R^T), t_hat - t), and C^-1 the information (6, 6) at the true pose.

    Its mean is 6 for an unbiased estimator that reaches the bound. The estimates must be finite.
    """
    error = np.concatenate([logarithm(rotation_estimate @ rotation.T), translation_estimate - translation], axis=-1)
    return np.einsum("ti,ij,tj->t", error, information, error)


def statistics(values: Array) -> Statistics:
    """Count, mean, std, rms, median, 95th percentile and maximum of values of any shape; None if there are none."""
    if not values.size:
        return {"count": 0, **dict.fromkeys(STATISTICS)}
    median, p95 = np.quantile(values, [0.5, 0.95])
    return {
        "count": values.size,
        "mean": float(np.mean(values)),
        "std": float(np.std(values)),
        "rms": rms(values),
        "median": float(median),
        "p95": float(p95),
        "max": float(np.max(values)),
    }


def rms(values: Array) -> float:
    """Root mean square of values of any shape; inf if any of them is."""
    return float(np.sqrt(np.mean(np.square(values))))


def efficiency(rotation_deg: Array, kept: Mask, bound_deg: Array) -> float | None:
    """Mean square of the rotation bound over that of the measured RE; 1 is optimal.

    Parameters
    ----------
    rotation_deg, kept : arrays (P, T)
        RE, and a mask of the trials that neither failed nor flipped.
    bound_deg : array (P,)
        Rotation bound for each pose.

    Returns
    -------
    float or None
        None if the RMS bound is above 2.5 degrees (where the first-order bound does not hold), if it or the errors are
        0, or if no trial is left.
    """
    if not kept.any() or not np.sqrt(np.mean(bound_deg**2)) <= EFFICIENCY_LIMIT_DEG:
        return None
    measured = np.mean(rotation_deg[kept] ** 2)
    # Each pose's bound is weighted by its number of trials.
    bound = np.average(bound_deg**2, weights=kept.sum(axis=1))
    return float(bound / measured) if bound > 0 and measured > 0 else None


RESAMPLES = 2000
"""Bootstrap resamples, enough to determine the ends of the 95 % interval to a fiftieth of its length.

scipy.stats.bootstrap has the same intervals but for its draws, by which the ends of stored results would move by 0.3 %.
"""


def rms_interval(values: Array, seed: int) -> list[float] | None:
    """95 % interval of the RMS of values (n,): a bootstrap over views; None for fewer than two values."""
    if len(values) < 2:
        return None
    low, high = np.quantile(np.sqrt(resampled_means(values[:, None] ** 2, seed))[:, 0], [0.025, 0.975])
    return [float(low), float(high)]


def resampled_means(values: Array, seed: int) -> Array:
    """Means (RESAMPLES, k) of rows (n, k) drawn with replacement."""
    count = len(values)
    weights = np.random.default_rng([seed, count]).multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    return np.asarray(weights @ values / count)


CONFIDENCE = 0.99
"""Probability that an interval holds what it is for; one right covariance in a hundred is outside."""


def mean_nees_interval(count: int) -> tuple[float, float]:
    """Interval that contains the mean NEES of `count` trials with probability `CONFIDENCE` if the covariance is right.

    The sum of the trials' NEES is chi-square with 6 * count degrees of freedom.
    """
    from scipy.special import gammaincinv

    tail = (1 - CONFIDENCE) / 2
    low, high = gammaincinv(POSE_PARAMETERS * count / 2, [tail, 1 - tail]) * 2 / count
    return float(low), float(high)


def nees_statistics(values: Array) -> dict[str, Any]:
    """Mean of the finite NEES of any shape, and its interval around 6 if the covariance is right."""
    values = values[np.isfinite(values)]
    if not values.size:
        return {"count": 0, "mean": None, "interval": None}
    return {"count": values.size, "mean": np.mean(values), "interval": mean_nees_interval(values.size)}


def share_interval(successes: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Clopper-Pearson interval of a probability from the number of successes among `count` independent trials."""
    from scipy.special import betaincinv

    tail = (1 - confidence) / 2
    low = betaincinv(successes, count - successes + 1, tail) if successes else 0.0
    high = betaincinv(successes + 1, count - successes, 1 - tail) if successes < count else 1.0
    return float(low), float(high)
