"""Statistics of a comparison: errors with intervals, bounds, flips, and ratios to the first contestant."""
# tests: tests/comparison/test_compare.py

from collections.abc import Sequence
from typing import Any

import numpy as np

from markergen.arrays import Array, Mask
from markergen.comparison.contestants import Contestant
from markergen.comparison.series import Observation, Series
from markergen.objectives import Setting
from markergen.validation.bounds import pose_bounds
from markergen.validation.metrics import FLIP_SEPARATION, rms, statistics

ERRORS = ("rotation_deg", "translation_pct")
RESAMPLES = 2000
"""Bootstrap resamples, enough to determine the ends of the 95 % interval to a fiftieth of its length."""
MOST = 0.9
"""Minimum share of the views that a contestant must find for its misses to count in choosing the common views."""


def comparison_results(
    series: Series, setting: Setting, observations: Sequence[Sequence[Observation]], bounds: Array
) -> dict[str, Any]:
    """Return the results of `compare`, without settings, from one observation per contestant and view.

    Parameters
    ----------
    bounds : array (contestants, views, 2), deg and %
    """
    pose = series.pose
    counts = np.array([[observation.counts for observation in row] for row in observations])
    # Those that miss many views would leave the others few to be compared in, and the easy ones.
    taking_part = counts.mean(axis=1) >= MOST
    common: Mask = np.asarray(counts[taking_part if taking_part.any() else counts.any(axis=1)].all(axis=0))
    common &= counts.any()
    everywhere = np.ones(series.count, dtype=bool)
    groups = {"by_polar_angle": series.poses.by_polar_angle(), "by_distance": series.poses.by_distance()}
    radius = setting.boundary.radius
    entries: list[dict[str, Any]] = []
    for contestant, row, bound in zip(series.contestants, observations, bounds, strict=True):
        ink = contestant.ink(radius)
        entries.append(
            {
                "name": contestant.name,
                "size": contestant.size,
                "absent": contestant.absent,
                "ink": {"cm2": 1e4 * ink, "share": ink / contestant.area(radius)},
                "setting": "",
                "tuning": [],
                **_summary(row, bound, everywhere, series.seed),
                "pattern_bound": {key: _finite(rms(bound[:, k])) for k, key in enumerate(ERRORS)},
                "flips": _flips(series, contestant, row),
                "common": _summary(row, bound, common, series.seed),
                "ratio": {key: _ratio(key, row, observations[0], series.seed) for key in ERRORS},
                **{
                    by: {
                        name: {
                            **_summary(row, bound, mask[pose]),
                            "common": _summary(row, bound, mask[pose] & common),
                        }
                        for name, mask in masks.items()
                        if mask[pose].any()
                    }
                    for by, masks in groups.items()
                },
                "failures": [
                    {
                        "view": k,
                        "distance": float(series.poses.distance[pose[k]]),
                        "polar_angle_deg": round(float(series.poses.polar_angle_deg[pose[k]]), 2),
                        "reason": observation.reason or "the pose has failed",
                    }
                    for k, observation in enumerate(row)
                    if not observation.counts
                ],
            }
        )
    camera = series.camera
    return {
        "camera": camera.as_dict(),
        "poses": {"name": series.poses.name, "count": len(series.poses), "dropped": series.poses.dropped},
        "radius": radius,
        "room": str(setting.boundary),
        "optics": dict(vars(series.optics)),
        "print_sigma_mm": 1e3 * series.print_sigma,
        "seed": series.seed,
        "views": {"count": series.count, "common": int(common.sum())},
        "contestants": entries,
    }


def _summary(row: Sequence[Observation], bound: Array, chosen: Mask, seed: int | None = None) -> dict[str, Any]:
    """Statistics over the chosen views, with intervals of the RMS if there is a seed for the bootstrap."""
    seen = [observation for observation, inside in zip(row, chosen, strict=True) if inside]
    counted = np.array([observation.counts for observation in row]) & chosen
    kept = [observation for observation in seen if observation.counts]
    detected = sum(observation.detected for observation in seen)
    errors = {key: np.array([getattr(observation, key) for observation in kept]) for key in ERRORS}
    intervals = {} if seed is None else {"interval": {key: rms_interval(errors[key], seed) for key in ERRORS}}
    return {
        "count": len(seen),
        "detected": detected,
        "wrong": sum(observation.wrong for observation in seen),
        "failed": sum(observation.failed for observation in seen),
        "rate": detected / len(seen) if seen else None,
        **{key: statistics(errors[key]) for key in ERRORS},
        "point_px": statistics(np.concatenate([np.zeros(0), *(observation.point_px for observation in kept)])),
        "bound": {key: _finite(rms(bound[counted, k])) if kept else None for k, key in enumerate(ERRORS)},
        **intervals,
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def rms_interval(values: Array, seed: int) -> list[float] | None:
    """95 % interval of the RMS of values (n,): a bootstrap over views; None for fewer than two values."""
    if len(values) < 2:
        return None
    low, high = np.quantile(np.sqrt(_resampled(values[:, None] ** 2, seed))[:, 0], [0.025, 0.975])
    return [float(low), float(high)]


def _resampled(values: Array, seed: int) -> Array:
    """Means (RESAMPLES, k) of rows (n, k) drawn with replacement."""
    count = len(values)
    weights = np.random.default_rng([seed, count]).multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    return np.asarray(weights @ values / count)


def _flips(series: Series, contestant: Contestant, row: Sequence[Observation]) -> int:
    """Number of poses nearer to the mirrored one, among those where the contestant's point errors separate the two."""
    errors = np.concatenate([np.zeros(0), *(observation.point_px for observation in row if observation.counts)])
    if not len(errors):
        return 0
    sigma = float(np.sqrt(np.mean(errors**2) / 2))
    apart = pose_bounds(contestant.points, series.camera, series.poses, sigma).separation > FLIP_SEPARATION
    return sum(
        observation.counts and observation.mirrored and bool(apart[p])
        for observation, p in zip(row, series.pose, strict=True)
    )


def _ratio(key: str, row: Sequence[Observation], first: Sequence[Observation], seed: int) -> dict[str, Any] | None:
    """RMS relative to the first contestant's, over the views in which both count, with a 95 % interval.

    The interval is a bootstrap over views: pairs of errors are resampled with replacement.
    """
    pairs = [(getattr(a, key), getattr(b, key)) for a, b in zip(row, first, strict=True) if a.counts and b.counts]
    if not pairs:
        return None
    squares = np.array(pairs) ** 2
    if not squares[:, 1].any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.sqrt(np.divide(*_resampled(squares, seed).T))
    low, high = np.nanquantile(ratios, [0.025, 0.975])
    square, reference = squares.mean(axis=0)
    return {"count": len(pairs), "rms": float(np.sqrt(square / reference)), "interval": [float(low), float(high)]}
