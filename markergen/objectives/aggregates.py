"""Aggregates: reductions of an objective's values over the poses to one number, with derivative.

Each takes values (..., P), all positive, a softness, and how much each pose counts: weights (P,) of mean 1, or 1. It
returns the aggregate (...) and its derivative (..., P).
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.registry import Registry

Aggregate = Callable[..., tuple[Array, Array]]
Weight = Array | float

AGGREGATES: Registry[Aggregate] = Registry("aggregate", __name__)
"""Aggregates by name."""

NONSMOOTH = ("max", "cvar")
"""Aggregates whose derivative is discontinuous where poses swap ranks, unless the softness is above 0."""

DEFAULT_LEVEL = 0.9
"""Default level of ``cvar``."""

_HALVINGS = 60
"""Number of bisections for the softened quantile, enough for full precision."""


def aggregate_of(text: str, weight: Array | None = None) -> Aggregate:
    """Look up an aggregate by name, for poses that count by weights (P,); ``cvar:0.95`` includes its level.

    Raises
    ------
    InputError
        If the name is unknown, or the level is not a number from 0 to below 1.
    """
    name, colon, argument = text.partition(":")
    aggregate = partial(AGGREGATES[name], weight=1.0 if weight is None else weight / weight.mean())
    if not colon:
        return aggregate
    if name != "cvar":
        raise InputError(f"no number behind {name!r}", repr(text), f"write {name}; only cvar has a level: cvar:0.9")
    try:
        level = float(argument)
    except ValueError:
        level = np.nan
    if not 0 <= level < 1:
        raise InputError(
            "a level of cvar from 0 to below 1", repr(text), "write cvar:0.9 for the mean of the worst tenth of poses"
        )
    return partial(mean_of_worst, level=level, weight=aggregate.keywords["weight"])


@AGGREGATES.register("rms")
def root_mean_square(values: Array, softness: float = 0.0, weight: Weight = 1.0) -> tuple[Array, Array]:
    """Root of the mean square."""
    del softness
    total = np.sqrt(np.mean(weight * values**2, axis=-1))
    return total, weight * values / (values.shape[-1] * total[..., None])


@AGGREGATES.register("mean")
def mean(values: Array, softness: float = 0.0, weight: Weight = 1.0) -> tuple[Array, Array]:
    """Arithmetic mean."""
    del softness
    return np.mean(weight * values, axis=-1), weight * np.full_like(values, 1 / values.shape[-1])


@AGGREGATES.register("logmean")
def logmean(values: Array, softness: float = 0.0, weight: Weight = 1.0) -> tuple[Array, Array]:
    """Geometric mean, exp(mean(log v)), which no single bad pose dominates."""
    del softness
    total = np.exp(np.mean(weight * np.log(values), axis=-1))
    return total, weight * total[..., None] / (values.shape[-1] * values)


@AGGREGATES.register("max")
def maximum(values: Array, softness: float = 0.0, weight: Weight = 1.0) -> tuple[Array, Array]:
    """Maximum; with softness s > 0 the norm (sum v^(1/s))^s, smooth and larger by a factor of at most P^s.

    Weights do not matter to it.
    """
    del weight
    worst = np.max(values, axis=-1)
    if not softness:
        derivative = np.zeros_like(values)
        np.put_along_axis(derivative, np.argmax(values, axis=-1)[..., None], 1.0, axis=-1)
        return worst, derivative
    with np.errstate(invalid="ignore"):
        shares = (values / worst[..., None]) ** (1 / softness)
    total = shares.sum(axis=-1, keepdims=True)
    value = np.where(np.isfinite(worst), worst * total[..., 0] ** softness, np.inf)
    return value, total ** (softness - 1) * shares * worst[..., None] / values


@AGGREGATES.register("cvar")
def cvar(values: Array, softness: float = 0.0, weight: Weight = 1.0) -> tuple[Array, Array]:
    """Mean of the worst tenth of the poses, see `mean_of_worst`."""
    return mean_of_worst(values, softness, DEFAULT_LEVEL, weight)


def mean_of_worst(values: Array, softness: float, level: float, weight: Weight = 1.0) -> tuple[Array, Array]:
    """Mean of the worst k = (1 - level) P poses, the last of them counted fractionally; the worst pose if k < 1.

    It is the minimum over t of t + sum (v - t)+ / k (Rockafellar & Uryasev 2000). With softness s > 0, (v - t)+ becomes
    (v^(1/s) + t^(1/s))^s - t: the smooth maximum of v and t, which is too large by a factor of at most 2^s, minus t. At
    level 0 it is the mean.
    """
    count = values.shape[-1]
    worst = max((1 - level) * count, 1.0)
    if not softness or worst >= count:
        order = np.argsort(-values, axis=-1, kind="stable")
        mass = np.broadcast_to(weight, values.shape)
        falling = np.take_along_axis(mass, order, axis=-1)
        worse = np.take_along_axis(np.cumsum(falling, axis=-1) - falling, np.argsort(order, axis=-1), axis=-1)
        derivative = np.clip(worst - worse, 0.0, mass) / worst
        # Infinite values times zero weights would be nan.
        return np.sum(np.where(derivative > 0, values, 0.0) * derivative, axis=-1), derivative
    top = values.max(axis=-1, keepdims=True)
    finite = np.isfinite(top)
    scaled = np.where(finite, values / np.where(finite, top, 1.0), 1.0)
    # At the upper end the sum of all shares is less than one pose below their number.
    low, high = np.zeros_like(top), np.full_like(top, 2 * count**softness)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        # The derivative with respect to t grows with t and is 0 at the minimum.
        rising = np.sum(weight * _soft_share(middle, scaled, softness), axis=-1, keepdims=True) > count - worst
        low, high = np.where(rising, low, middle), np.where(rising, middle, high)
    larger, smaller = np.maximum(scaled, high), np.minimum(scaled, high)
    excess = larger * (1 + (smaller / larger) ** (1 / softness)) ** softness
    value = high[..., 0] + np.sum(weight * (excess - high), axis=-1) / worst
    return np.where(finite, top, np.inf)[..., 0] * value, weight * _soft_share(scaled, high, softness) / worst


def _soft_share(one: Array, other: Array, softness: float) -> Array:
    """Derivative of (one^(1/s) + other^(1/s))^s with respect to `one`: 1 where one >> other, 0 where one << other."""
    with np.errstate(over="ignore"):
        return (1 + (other / one) ** (1 / softness)) ** (softness - 1)
