"""Fit of dots' ellipses to the grey levels around their outlines, batched."""

from copy import copy
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Blobs
from markergen.detect.candidates import grey_noise
from markergen.detect.edge_psf import blurred_ellipse
from markergen.detect.outline_pixels import (
    QUANTIZATION,
    SECTORS,
    OutlinePixels,
    outline_pixels,
    sector_of,
    strangeness,
    white_noise,
)

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

# Columns of the unknowns.
CENTER, SHAPE, LIGHT, DARK, BLUR, SLOPE = slice(0, 2), slice(2, 5), 5, 6, 7, slice(8, 10)
HOLE, SCALE = slice(10, 12), 12
COUNT = 13

MIN_SEMI_PX = 0.6
"""Minimum semi-axis: with less than half a pixel's blur, a dot cannot be told from a line."""

_CONVERGED_PX, _SETTLED_PX = 1e-3, 0.02
"""The iteration ends when every center moves by less than the first: the next step would be under 4e-4 px, a tenth of
the best standard deviation. Blobs that still take steps above the second at the end are not dots."""

_LONGEST_STEP_PX, _LONGEST_SCALE_STEP = 2.0, 0.1
_MIN_BLUR, _MAX_BLUR = 0.28, 6.0
"""Range of the blur in px, including the pixel's own area, which alone is 0.29."""

_OUTLIER_SHARE, _OUTLIER_SIGMA, _OUTLIER_SPREAD = 0.12, 5.0, 4.0
"""Pixels that are off by more than this share of the contrast, this multiple of the noise, and this multiple of the
standard deviation of the residual belong to something else."""

_MAX_LEFT_OUT = 5
"""Maximum number of sectors left out, counting neighbors of strange ones: half an ellipse also fits other ellipses."""
_MAX_TRIMMED = 0.15

NOISE_SLACK, _MOST_NOISE = 1.5, 2.0
"""Ratio to the noise of the plainest image areas, accepted and maximum: noise grows with the light."""

_SCALE_SIGMA, _SCALE_NOISE = 0.05, 0.02
"""Standard deviation of a hole's size about half of the ring's, as if measured at this noise per contrast."""

_OF_DOTS = "ring", "index", "origin", "size", "unknowns", "left_out", "step", "normal"
_OF_PIXELS = "weight", "residual", "slope", "direction", "silent"
"""Names of the state arrays (B, ...) and (..., N)."""

_SATURATION = tuple(2**bits - 1 for bits in range(8, 17))


class EllipseDescent:
    """Unknowns (B, 13) of the dots still being fitted, and their pixels with weights 0 or 1.

    The columns: center (2) and M (m11, m12, m22) of the ellipse |M (x - c)| = 1; grey levels of light and dark; blur;
    relative slope (2) of the light, 1/px; center (2) and size of a ring's hole, relative to the outline's.

    Parameters
    ----------
    pixels : OutlinePixels
    center, shape : arrays (B, 2) and (B, 2, 2), px and 1/px
        Initial ellipses; `shape` is M.
    light, dark, blur : arrays (B,), grey levels and px
    ring : array (B,) of bool
    noise : float, grey levels
        Noise of plain image areas.
    top : int
        The image's highest grey level, to detect saturation.
    """

    def __init__(
        self,
        pixels: OutlinePixels,
        center: Array,
        shape: Array,
        light: Array,
        dark: Array,
        blur: Array,
        ring: Bools,
        noise: float,
        top: int,
    ) -> None:
        count = len(center)
        self.pixels, self.ring, self.image_noise = pixels, ring, noise
        self.saturation = top if top in _SATURATION else None
        self.index = np.arange(count)
        self.origin, self.size = center, np.sort(1 / np.linalg.eigvalsh(shape), axis=-1)
        self.unknowns = np.zeros((count, COUNT))
        self.unknowns[:, CENTER] = self.unknowns[:, HOLE] = center
        self.unknowns[:, SHAPE] = shape[:, [0, 0, 1], [0, 1, 1]]
        self.unknowns[:, LIGHT], self.unknowns[:, DARK] = light, dark
        self.unknowns[:, BLUR] = np.clip(blur, 0.5, _MAX_BLUR)
        self.unknowns[:, SCALE] = 0.5
        self.left_out = np.zeros((count, SECTORS), dtype=bool)
        self.step = np.full(count, np.inf)
        # From the last evaluation of the model:
        self.normal = np.zeros((count, COUNT, COUNT))
        self.weight = np.ones(len(pixels.x))
        self.residual = np.zeros(len(pixels.x))
        self.direction, self.slope = np.zeros((2, len(pixels.x))), np.zeros(len(pixels.x))
        self.silent = np.zeros(len(pixels.x), dtype=bool)

    @property
    def contrast(self) -> Array:
        """Light minus dark (B,)."""
        return np.asarray(self.unknowns[:, LIGHT] - self.unknowns[:, DARK])

    def keep(self, chosen: Bools) -> None:
        """Drop all but the chosen (B,)."""
        if chosen.all():
            return
        of_chosen = chosen[self.pixels.owner]
        for name in _OF_PIXELS:
            setattr(self, name, getattr(self, name)[..., of_chosen])
        for name in _OF_DOTS:
            setattr(self, name, getattr(self, name)[chosen])
        self.pixels = self.pixels.of(chosen)

    def run(self, steps: int, chosen: Bools | None = None) -> None:
        """Iterate until the centers, or those of the chosen, converge; diverging fits are dropped."""
        if chosen is not None and not chosen.all():
            self._run_part(steps, chosen)
            return
        for done in range(1, steps + 1):
            if not len(self.index):
                return
            gradient = self._evaluate()
            scale = np.maximum(np.einsum("bii->bi", self.normal), 1e-12) ** -0.5
            scaled = self.normal * scale[:, :, None] * scale[:, None, :]
            # A ridge of rounding's size keeps the matrices of regions that are not ellipses from being singular.
            step = scale * np.linalg.solve(scaled + 1e-9 * np.eye(COUNT), (scale * gradient)[..., None])[..., 0]
            self._move(step)
            moving = self.step > _CONVERGED_PX
            if 2 * moving.sum() <= len(moving):
                # Most have converged, and each costs as much as one that still moves.
                self._run_part(steps - done, moving)
                return

    def _run_part(self, steps: int, chosen: Bools) -> None:
        if steps == 0 or not chosen.any():
            return
        part = copy(self)
        part.keep(chosen)
        part.run(steps)
        place = np.searchsorted(self.index, part.index)
        for name in _OF_DOTS:
            getattr(self, name)[place] = getattr(part, name)
        of_place = np.isin(self.pixels.owner, place)
        for name in _OF_PIXELS:
            getattr(self, name)[..., of_place] = getattr(part, name)
        alive = ~chosen
        alive[place] = True
        self.keep(alive)

    def _evaluate(self) -> Array:
        """Evaluate the residual and normal matrices J'J of the pixels that count; return J'r (B, 13)."""
        model, jacobian = self._model()
        if self.saturation is not None:
            self.silent = model > self.saturation
            model = np.minimum(model, self.saturation)
            jacobian[:, self.silent] = 0
        self.residual = self.pixels.grey - model
        # A neighbor's edge in the band, or a speck, is no information about this dot.
        weight = self.weight * (np.abs(self.residual) < 0.5 * self.contrast[self.pixels.owner])
        weighted = jacobian * weight
        spans = list(zip(self.pixels.start[:-1], self.pixels.start[1:], strict=True))
        self.normal = np.stack([weighted[:, a:b] @ jacobian[:, a:b].T for a, b in spans])
        gradient = np.stack([weighted[:, a:b] @ self.residual[a:b] for a, b in spans])
        # A disk has no hole to move. If the blur is as wide as a ring's ink, a darker and thinner ring looks the same:
        # a half is the usual size.
        self.normal[:, range(10, COUNT), range(10, COUNT)] += ~self.ring[:, None]
        prior = self.ring * (_SCALE_NOISE * self.contrast / _SCALE_SIGMA) ** 2
        self.normal[:, SCALE, SCALE] += prior
        gradient[:, SCALE] += prior * (0.5 - self.unknowns[:, SCALE])
        return gradient

    def _move(self, step: Array) -> None:
        """Take the step (B, 13), within limits."""
        now = self.unknowns
        moved = now + step
        moved[:, CENTER] = now[:, CENTER] + np.clip(step[:, CENTER], -_LONGEST_STEP_PX, _LONGEST_STEP_PX)
        moved[:, BLUR] = np.clip(moved[:, BLUR], now[:, BLUR] / 2, now[:, BLUR] * 2)
        moved[:, BLUR] = np.clip(moved[:, BLUR], _MIN_BLUR, _MAX_BLUR)
        moved[:, SCALE] = now[:, SCALE] + np.clip(step[:, SCALE], -_LONGEST_SCALE_STEP, _LONGEST_SCALE_STEP)
        moved[:, SCALE] = np.clip(moved[:, SCALE], 0.1, 0.9)
        self.unknowns = moved
        self.step = np.abs(step[:, CENTER]).max(axis=-1)
        trace = moved[:, 2] + moved[:, 4]
        determinant = moved[:, 2] * moved[:, 4] - moved[:, 3] ** 2
        sane = np.isfinite(moved).all(axis=-1) & (determinant > 0) & (trace > 0) & (self.contrast > 0)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            # The smaller eigenvalue of M lies between det/trace and twice that, the larger one below the trace.
            sane &= determinant / trace > 0.3 / self.size[:, 1]
            sane &= trace < 2 / MIN_SEMI_PX
            sane &= np.linalg.norm(moved[:, CENTER] - self.origin, axis=-1) < self.size[:, 0] + 1
        self.keep(sane)

    def _model(self) -> tuple[Array, Array]:
        """Return grey levels (N,) and their derivatives (13, N)."""
        counts = np.diff(self.pixels.start)
        p = np.repeat(self.unknowns.T, counts, axis=1)
        origin = np.repeat(self.origin.T, counts, axis=1)
        x, y = self.pixels.x - p[0], self.pixels.y - p[1]
        across, down = self.pixels.x - origin[0], self.pixels.y - origin[1]
        lit = 1 + p[8] * across + p[9] * down
        contrast = (p[LIGHT] - p[DARK]) * lit
        jacobian = np.zeros((COUNT, len(x)))

        ink, by_rho, by_blur, (u, v) = blurred_ellipse(x, y, (p[2], p[3], p[4]), p[BLUR])
        slope = -contrast * by_rho
        normal_x, normal_y = slope * (p[2] * u + p[3] * v), slope * (p[3] * u + p[4] * v)
        self.direction, self.slope = np.stack([u, v]), np.hypot(normal_x, normal_y)
        jacobian[0], jacobian[1] = -normal_x, -normal_y
        jacobian[2], jacobian[3], jacobian[4] = slope * u * x, slope * (u * y + v * x), slope * v * y
        jacobian[BLUR] = -contrast * by_blur
        ring = np.flatnonzero(np.repeat(self.ring, counts))
        if len(ring):
            q = p[:, ring]
            m11, m12, m22 = q[2:5] / q[SCALE]
            x, y = self.pixels.x[ring] - q[10], self.pixels.y[ring] - q[11]
            hole, by_rho, by_blur, (u, v) = blurred_ellipse(x, y, (m11, m12, m22), q[BLUR])
            ink[ring] -= hole
            slope = contrast[ring] * by_rho
            gradient_x, gradient_y = m11 * u + m12 * v, m12 * u + m22 * v
            jacobian[10, ring], jacobian[11, ring] = -slope * gradient_x, -slope * gradient_y
            jacobian[2:5, ring] += slope / q[SCALE] * np.stack([u * x, u * y + v * x, v * y])
            # d rho/d scale = -rho/scale, and rho = x'grad rho.
            jacobian[SCALE, ring] = -slope * (x * gradient_x + y * gradient_y) / q[SCALE]
            jacobian[BLUR, ring] += contrast[ring] * by_blur
        jacobian[LIGHT], jacobian[DARK] = (1 - ink) * lit, ink * lit
        level = p[LIGHT] - (p[LIGHT] - p[DARK]) * ink
        jacobian[8], jacobian[9] = level * across, level * down
        return level * lit, jacobian

    def misfit(self) -> Array:
        """Return the mean square (B,) of the residual, grey levels squared, each pixel clipped at half the contrast."""
        half = 0.5 * self.contrast[self.pixels.owner]
        squares = np.clip(self.residual, -half, half) ** 2
        count = np.diff(self.pixels.start)
        return np.asarray(np.bincount(self.pixels.owner, squares, len(count)) / np.maximum(count, 1))

    def drop_hopeless(self, misfit: float) -> None:
        """Drop dots whose residual beyond the noise exceeds this share of the contrast."""
        self.keep(self.misfit() < (misfit * self.contrast) ** 2 + (NOISE_SLACK * self.image_noise) ** 2)

    def leave_out(self) -> Bools:
        """Give zero weight to foreign pixels and sectors; return for which dots (B,) this changed anything."""
        strange = self.strangeness()
        # Foreign edges distort the fit, and so make other sectors look strange: the worst go first.
        worst = np.where(self.left_out, 0, strange).max(axis=-1, keepdims=True)
        bad = strange > np.maximum(1, worst / 2)
        # An occluder's edge rarely ends at a sector's limit.
        self.left_out = self.left_out | bad | np.roll(bad, 1, axis=-1) | np.roll(bad, -1, axis=-1)
        self.keep(self.left_out.sum(axis=-1) <= _MAX_LEFT_OUT)
        limit = np.maximum(_OUTLIER_SHARE * self.contrast, _OUTLIER_SIGMA * self.noise())
        # If the blur differs from the model's, many pixels are off by a little, which is harmless.
        limit = np.maximum(limit, _OUTLIER_SPREAD * np.sqrt(self.variance()))
        kept = (np.abs(self.residual) < limit[self.pixels.owner]) & ~self.left_out.ravel()[self._sector()]
        changed = np.bincount(self.pixels.owner, kept != self.weight, len(self.index)) > 0
        self.weight = kept.astype(float)
        return np.asarray(changed)

    def complete(self) -> Bools:
        """Return whether (B,) the fit has converged and every edge that was not left out belongs to the dot."""
        trimmed = (self.weight == 0) & ~self.left_out.ravel()[self._sector()]
        count = np.diff(self.pixels.start)
        few = np.bincount(self.pixels.owner, trimmed, len(count)) <= _MAX_TRIMMED * count
        return np.asarray((self.step < _SETTLED_PX) & few & ((self.strangeness() <= 1) | self.left_out).all(axis=-1))

    def strangeness(self) -> Array:
        """Return the deviation (B, SECTORS) of the edge from its expected place; 1 is the maximum allowed."""
        model = self.pixels.grey - self.residual
        blur, size = self.unknowns[:, BLUR], self.size[:, 1]
        return strangeness(self._sector(), self.slope, model, self.residual, self.contrast, blur, size, self.noise())

    def noise(self) -> Array:
        """Return the standard deviation (B,) of the grey noise in the band, limited by the image's noise.

        In a small dot, all pixels are near an edge, and a misfit looks like noise.
        """
        most = max(_MOST_NOISE * self.image_noise + 0.5, np.sqrt(QUANTIZATION))
        return np.minimum(white_noise(self.pixels, self.residual), most)

    def variance(self) -> Array:
        """Return the variance (B,) of the pixels that count, grey levels squared, at least that of rounding."""
        owner, count = self.pixels.owner, len(self.index)
        # Saturated pixels show no noise.
        weight = self.weight * ~self.silent
        squares = np.bincount(owner, weight * self.residual**2, count)
        freedom = np.bincount(owner, weight, count) - np.where(self.ring, COUNT, COUNT - 3)
        return np.asarray(np.maximum(squares / np.maximum(freedom, 1), QUANTIZATION))

    def _sector(self) -> Indices:
        return sector_of(self.pixels, self.direction)


Image = NDArray[np.uint8] | NDArray[np.uint16]

_CHECKPOINTS = (1, 0.3), (2, 0.17), (5, 0.12)
"""Step counts, and the maximum RMS residual after them, beyond the noise and as a share of the contrast."""
_STEPS, _ROUNDS = 5, 4

_BAND_BLURS, _MIN_BAND_PX, _MAX_BAND_PX = 3.0, 2.5, 9.0
"""Half-width of the band of fitted pixels around the outline: beyond it the levels are flat and carry no information,
and the next dot may begin."""

_MAX_MISFIT, _MAX_NOISE = 0.06, 0.2
"""Maximum RMS residual beyond the noise, and maximum noise, at the end, as shares of the contrast."""
_MIN_MAJOR_PX, _MAX_ELONGATION, _MAX_SIGMA_PX = 2.4, 10.0, 0.5
_HOLE_SCALES = 0.15, 0.85

_DISK_BELOW, _RING_ABOVE, _RING_GAIN = 0.15, 0.7, 20.0
"""Levels in the middle of certain disks and certain rings; minimum gain of a doubtful ring in twice the
log-likelihood."""


@dataclass(frozen=True, eq=False)
class FittedDots:
    """B fitted dots.

    Attributes
    ----------
    index : array (B,) of int
        Index of the region that each dot was fitted to.
    center : array (B, 2), px
    covariance : array (B, 2, 2), px^2, of the center
    semi : array (B, 2), px, longest first
    angle : array (B,), rad, of the longest axis from x
    ring : array (B,) of bool
    blur : array (B,), px
    misfit : array (B,)
        Twice the negative log-likelihood, up to a constant that all fits of one outline share.
    """

    index: Indices
    center: Array
    covariance: Array
    semi: Array
    angle: Array
    ring: Bools
    blur: Array
    misfit: Array

    def __len__(self) -> int:
        return len(self.center)

    def take(self, index: Bools | Indices) -> "FittedDots":
        """Return a subset."""
        return FittedDots(*(getattr(self, field.name)[index] for field in fields(self)))


_ROUGH_SIGMA_PX = 0.3
"""Standard deviation along each axis of the center of a dot that the fit refuses, px."""


def fit_blobs(image: Image, blobs: Blobs) -> Blobs:
    """Fit blobs to the grey levels; those that the fit refuses keep their rough ellipse, with a wide covariance.

    Same length and order as `blobs`. See `fit_dots`.
    """
    dots = fit_dots(image, blobs, grey_noise(image))
    result = blobs.take(np.arange(len(blobs)))
    result.covariance[:] = _ROUGH_SIGMA_PX**2 * np.eye(2)
    result.fitted[:] = False
    for name in ("center", "covariance", "semi", "angle", "ring", "blur"):
        getattr(result, name)[dots.index] = getattr(dots, name)
    result.fitted[dots.index] = True
    return result


def fit_dots(image: Image, regions: Blobs, noise: float) -> FittedDots:
    """Fit blurred dark ellipses or elliptic rings to grey levels by least squares; drop regions that are not dots.

    Model: (1 + g'x) (light - (light - dark) (D - D_hole)), with D the share of ink (`blurred_ellipse`) and g the
    slope of the light over the dot; saturated where the image is. Ellipse, levels, slope and blur are unknown, and for
    a ring the hole's center and scale too: under perspective hole and outline are not concentric. Every pixel counts
    by its information, so the center's error is near the lower bound set by the image's noise.

    Parts of the outline without an edge, or with one elsewhere (an occluder, a touching neighbor), are found sector by
    sector and left out. A fifth of the outline may be missing; with more the dot is dropped, since half an ellipse also
    fits other ellipses, with other centers.

    Parameters
    ----------
    image : array (h, w)
    regions : Blobs
    noise : float, grey levels
        Noise of plain image areas, to distinguish noise from misfit.

    Returns
    -------
    FittedDots
        Dots with the covariance of each center from the fit's normal matrix and residual noise, which is at least that
        of rounding to whole grey levels.
    """
    # A region that is neither dark nor light in the middle is fitted both as a disk and as a ring.
    doubtful = (regions.middle > _DISK_BELOW) & (regions.middle < _RING_ABOVE)
    index = np.concatenate([np.arange(len(regions)), np.flatnonzero(doubtful)])
    ring = np.concatenate([regions.middle >= _RING_ABOVE, np.ones(int(doubtful.sum()), dtype=bool)])
    descent = _descent(image, regions.take(index), ring, ring | doubtful[index], noise)
    for steps, misfit in _CHECKPOINTS:
        descent.run(steps)
        descent.drop_hopeless(misfit)
    for _ in range(_ROUNDS):
        descent.run(_STEPS, descent.leave_out())
    dots = _dots(descent, index)
    return dots.take(_better(dots))


def _descent(image: Image, regions: Blobs, ring: Bools, filled: Bools, noise: float) -> EllipseDescent:
    axes = regions.axes
    spread = axes @ axes.swapaxes(-1, -2)
    values, vectors = np.linalg.eigh(spread)
    shape = np.einsum("bik,bk,bjk->bij", vectors, values**-0.5, vectors)
    band = np.clip(_BAND_BLURS * regions.blur, _MIN_BAND_PX, _MAX_BAND_PX)
    pixels = outline_pixels(image, regions.center, spread, band, filled)
    top = int(image.max(initial=0))
    return EllipseDescent(pixels, regions.center, shape, regions.light, regions.dark, regions.blur, ring, noise, top)


def _dots(descent: EllipseDescent, index: Indices) -> FittedDots:
    """Return the regions with the outline of a dot nearly all around, with the center's covariance."""
    if len(descent.index):
        noise, variance = descent.noise(), descent.variance()
        good = variance < (NOISE_SLACK * noise) ** 2 + (_MAX_MISFIT * descent.contrast) ** 2
        descent.keep(good & (noise < _MAX_NOISE * descent.contrast) & descent.complete())
    variance, unknowns = descent.variance(), descent.unknowns
    step, covariance = _shrink_slope(descent.normal, variance, unknowns[:, SLOPE])
    # M's smaller eigenvalue belongs to the longer semi-axis.
    values, vectors = np.linalg.eigh((unknowns + step)[:, SHAPE][:, [0, 1, 1, 2]].reshape(-1, 2, 2))
    scale = unknowns[:, SCALE]
    good = np.einsum("bii->b", covariance[:, CENTER, CENTER]) < _MAX_SIGMA_PX**2
    good &= (1 / values[:, 0] > _MIN_MAJOR_PX) & (1 / values[:, 1] > MIN_SEMI_PX)
    good &= values[:, 1] < _MAX_ELONGATION * values[:, 0]
    good &= ~descent.ring | ((scale > _HOLE_SCALES[0]) & (scale < _HOLE_SCALES[1]))
    return FittedDots(
        index[descent.index],
        unknowns[:, CENTER] + step[:, CENTER],
        covariance[:, CENTER, CENTER],
        1 / values,
        np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0]),
        descent.ring,
        unknowns[:, BLUR],
        np.diff(descent.pixels.start) * np.log(np.maximum(descent.misfit(), 1e-12)),
    ).take(good)


def _shrink_slope(normal: Array, variance: Array, slope: Array) -> tuple[Array, Array]:
    """Return the last step (B, 13) and covariance (B, 13, 13) with the light's slope shrunk toward that of other dots.

    A free slope costs a third of the center's information; without a slope, uneven light displaces the center. So the
    slope has a normal prior about zero with the variance of all slopes of the image beyond their own errors
    (DerSimonian and Laird's estimate): none in even light, as much as needed in other light.
    """
    if not len(slope):
        return np.zeros((0, normal.shape[-1])), normal
    free = variance[:, None, None] * np.linalg.pinv(normal, hermitian=True)
    own = np.einsum("bii->b", free[:, SLOPE, SLOPE]) / 2
    weight = np.maximum(own, 1e-15) ** -2
    between = np.sum(weight * (np.sum(slope**2, axis=-1) / 2 - own)) / np.sum(weight)
    prior = variance / max(float(between), 1e-12)
    stiff = normal.copy()
    stiff[:, [8, 9], [8, 9]] += prior[:, None]
    inverse = np.linalg.pinv(stiff, hermitian=True)
    # On some processors its product is symmetric only up to rounding.
    inverse = (inverse + inverse.swapaxes(-1, -2)) / 2
    step = -np.einsum("bij,bj->bi", inverse[:, :, SLOPE], prior[:, None] * slope)
    return step, variance[:, None, None] * inverse


def _better(dots: FittedDots) -> Bools:
    """For dots fitted both as a disk and as a ring, choose the better fit: the ring only if it is clearly better."""
    chosen = np.ones(len(dots), dtype=bool)
    for ring in np.flatnonzero(dots.ring):
        for disk in np.flatnonzero((dots.index == dots.index[ring]) & ~dots.ring):
            chosen[disk if dots.misfit[disk] - dots.misfit[ring] > _RING_GAIN else ring] = False
    return chosen
