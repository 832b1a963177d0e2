"""Aggregates: one number from the values of an objective over the poses, and its derivative.

Each takes values (B, P), all positive, and a softness; it returns the aggregate (B,) and its derivative (B, P).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from markergen.registry import Registry

Array = NDArray[np.float64]
Aggregate = Callable[[Array, float], tuple[Array, Array]]

AGGREGATES: Registry[Aggregate] = Registry("aggregate", __name__)


@AGGREGATES.register("rms")
def rms(values: Array, softness: float = 0.0) -> tuple[Array, Array]:
    """Root of the mean square."""
    del softness
    total = np.sqrt(np.mean(values**2, axis=-1))
    return total, values / (values.shape[-1] * total[..., None])


@AGGREGATES.register("mean")
def mean(values: Array, softness: float = 0.0) -> tuple[Array, Array]:
    """Arithmetic mean."""
    del softness
    return np.mean(values, axis=-1), np.full_like(values, 1 / values.shape[-1])


@AGGREGATES.register("logmean")
def logmean(values: Array, softness: float = 0.0) -> tuple[Array, Array]:
    """Geometric mean, exp(mean(log v)): no single bad pose decides."""
    del softness
    total = np.exp(np.mean(np.log(values), axis=-1))
    return total, total[..., None] / (values.shape[-1] * values)


@AGGREGATES.register("max")
def maximum(values: Array, softness: float = 0.0) -> tuple[Array, Array]:
    """Worst pose; with softness s > 0 the norm (sum v^(1/s))^s, smooth and above it by at most P^s."""
    worst = np.max(values, axis=-1)
    if not softness:
        derivative = np.zeros_like(values)
        np.put_along_axis(derivative, np.argmax(values, axis=-1)[..., None], 1.0, axis=-1)
        return worst, derivative
    shares = (values / worst[..., None]) ** (1 / softness)
    total = shares.sum(axis=-1, keepdims=True)
    return worst * total[..., 0] ** softness, total ** (softness - 1) * shares * worst[..., None] / values
