"""Fit of dots' ellipses to the grey levels around their outlines, batched."""

from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from markergen.detect import edge_psf, kernel
from markergen.detect import outline_pixels as outline_pixels_
from markergen.detect.blobs import Blobs
from markergen.detect.components import grey_noise
from markergen.detect.edge_psf import blurred_ellipse
from markergen.detect.outline_pixels import (
    QUANTIZATION,
    SECTORS,
    OutlinePixels,
    outline_pixels,
    sector_of,
    sector_sums,
    strangeness,
    white_noise,
)

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]
Image = NDArray[np.uint8] | NDArray[np.uint16]

# Columns of the unknowns.
CENTER, SHAPE, LIGHT, DARK, BLUR, SLOPE = slice(0, 2), slice(2, 5), 5, 6, 7, slice(8, 10)
HOLE, SCALE = slice(10, 12), 12
COUNT = 13

MIN_SEMI_PX = 0.6
"""Minimum semi-axis: with less than half a pixel's blur, a dot cannot be told from a line."""

_CONVERGED_PX, _SETTLED_PX, _JUDGED_PX = 2e-3, 0.02, 0.1
"""A fit ends when a step moves its center by less than the first: the next would be under a third of it, a tenth of the
best standard deviation. Outlines that still take steps above the second at the end are not dots. Pixels and sectors are
left out from the first step below the third on."""

_STEPS, _ROUNDS = 16, 4
"""Maximum number of steps, and of times that a dot's pixels are chosen anew."""

_LONGEST_STEP_PX, _LONGEST_SCALE_STEP = 2.0, 0.1
_MIN_BLUR, _MAX_BLUR = 0.28, 6.0
"""Range of the blur in px, including the pixel's own area, which alone is 0.29."""

_OUTLIER_SHARE, _OUTLIER_SIGMA, _OUTLIER_SPREAD = 0.12, 5.0, 4.0
"""Pixels that are off by more than this share of the contrast, this multiple of the noise, and this multiple of the
standard deviation of the residual belong to something else."""

_MAX_LEFT_OUT = 5
"""Maximum number of sectors left out, counting neighbors of strange ones: half an ellipse also fits other ellipses."""
_MAX_TRIMMED = 0.15

_NOISE_SLACK, _MOST_NOISE = 1.5, 2.0
"""Ratio to the noise of the plainest image areas, accepted and maximum: noise grows with the light."""

_SCALE_SIGMA, _SCALE_NOISE = 0.05, 0.02
"""Standard deviation of a hole's size about half of the ring's, as if measured at this noise per contrast."""

_BAND_BLURS, _MIN_BAND_PX, _MAX_BAND_PX = 3.0, 2.5, 9.0
"""Half-width of the band of fitted pixels around the outline: beyond it the levels are flat and carry no information,
and the next dot may begin."""

_MAX_MISFIT, _MAX_NOISE = 0.12, 0.2
"""Maximum RMS residual beyond the noise, and maximum noise, at the end, as shares of the contrast. Cameras that sharpen
edges leave 0.08."""
_MIN_MAJOR_PX, _MAX_ELONGATION, _MAX_SIGMA_PX = 1.0, 10.0, 0.5
_HOLE_SCALES = 0.15, 0.85
_MAX_MOVE_PX, _MAX_MOVE = 0.7, 0.03
"""Maximum distance from the rough center, px plus a share of the longer semi-axis: what covers a dot can pull the fit
off by more."""

_DISK_BELOW, _RING_ABOVE, _RING_GAIN = 0.3, 0.7, 20.0
"""Levels in the middle of certain disks, glossy ones included, and certain rings; minimum gain of a doubtful ring in
twice the log-likelihood."""

_ROUGH_PX = 0.2
"""Standard deviation along each axis of the center of a dot whose fit is refused."""

_PER_UNIT = 64
"""Places of the compiled fit's table of the normal distribution per standard deviation."""

_SATURATION = tuple(2**bits - 1 for bits in range(8, 17))


class EllipseDescent:
    """Unknowns (B, 13) of dots that are being fitted, and their pixels with weights 0 or 1.

    The columns: center (2) and M (m11, m12, m22) of the ellipse |M (x - c)| = 1; grey levels of light and dark; blur;
    relative slope (2) of the light, 1/px; center (2) and size of a ring's hole, relative to the outline's.

    Parameters
    ----------
    pixels : OutlinePixels
    unknowns : array (B, 13)
        Initial values.
    ring : array (B,) of bool
    noise : float, grey levels
        Maximum noise: in a small dot, all pixels are near an edge, and a misfit looks like noise.
    saturation : float
        Grey level above which the image shows none.
    """

    def __init__(self, pixels: OutlinePixels, unknowns: Array, ring: Bools, noise: float, saturation: float) -> None:
        count = len(unknowns)
        self.pixels, self.ring, self.most_noise, self.saturation = pixels, ring, noise, saturation
        self.unknowns, self.origin = unknowns.copy(), unknowns[:, CENTER].copy()
        trace, root = _eigenvalues(unknowns)
        self.size = 2 / (trace[:, None] + root[:, None] * [-1, 1])
        self.alive = np.ones(count, dtype=bool)
        self.left_out = np.zeros((count, SECTORS), dtype=bool)
        self.step = np.full(count, np.inf)
        # From the last evaluation of the model:
        self.normal, self.gradient = np.zeros((count, COUNT, COUNT)), np.zeros((count, COUNT))
        self.sums, self.white = np.zeros((count, SECTORS, 8)), np.zeros(count)
        self.tips = np.zeros((2, len(pixels.x)))
        self.weight, self.residual = np.ones(len(pixels.x)), np.zeros(len(pixels.x))
        self.sector = np.zeros(len(pixels.x), dtype=np.intp)
        self.silent = np.zeros(len(pixels.x), dtype=bool)

    @property
    def contrast(self) -> Array:
        """Light minus dark (B,)."""
        return np.asarray(self.unknowns[:, LIGHT] - self.unknowns[:, DARK])

    def run(self) -> None:
        """Iterate until all centers converge; dots whose fit diverges are no longer alive."""
        active, rounds = self.alive.copy(), np.zeros(len(self.unknowns), dtype=int)
        for step in range(_STEPS):
            if not active.any():
                return
            calm = active & (self.step < _JUDGED_PX)
            # The shape of the tips is computed anew at steps 0, 2, 5...: it is expensive, and changes little between.
            self.evaluate(active, step == 0 or step % 3 == 2)
            changed = self.leave_out(calm & (rounds < _ROUNDS))
            rounds += changed
            # The equations of those whose pixels changed are not of these pixels.
            self.move(active & ~changed)
            active &= self.alive & (changed | (self.step > _CONVERGED_PX))

    def evaluate(self, active: Bools, fresh: bool) -> None:
        """Evaluate residuals, normal matrices J'J and gradients J'r of the pixels that count, of the active dots."""
        at = slice(None) if active.all() else np.flatnonzero(active[self.pixels.owner])
        dots = np.flatnonzero(active)
        counts = np.diff(self.pixels.start)[dots]
        x, y, grey, weight = self.pixels.x[at], self.pixels.y[at], self.pixels.grey[at], self.weight[at]
        tips = None if fresh else self.tips[:, at]
        model, jacobian, slope, direction, tips = self.model(dots, counts, x, y, tips)
        silent = model > self.saturation
        if silent.any():
            model = np.minimum(model, self.saturation)
            jacobian[:, silent] = 0
        residual = grey - model
        owner = np.repeat(np.arange(len(dots)), counts)
        # A neighbor's edge in the band, or a speck, is no information about this dot.
        half = 0.5 * self.contrast[dots]
        weighted = jacobian * (weight * (np.abs(residual) < half[owner]))
        ends = np.cumsum(counts)
        for dot, a, b in zip(dots, ends - counts, ends, strict=True):
            self.normal[dot] = weighted[:, a:b] @ jacobian[:, a:b].T
            self.gradient[dot] = weighted[:, a:b] @ residual[a:b]
        sector = sector_of(direction)
        self.sums[dots] = sector_sums(owner * SECTORS + sector, slope, model, residual, half).reshape(-1, SECTORS, 8)
        self.residual[at], self.silent[at], self.sector[at], self.tips[:, at] = residual, silent, sector, tips

    def model(self, dots: Indices, counts: Indices, x: Array, y: Array, tips: Array | None) -> tuple[Array, ...]:
        """Return grey levels (N,), their derivatives (13, N), the edge's slope, sectors' directions and the tips."""
        p = np.repeat(self.unknowns[dots].T, counts, axis=1)
        origin = np.repeat(self.origin[dots].T, counts, axis=1)
        across, down = x - origin[0], y - origin[1]
        dx, dy = x - p[0], y - p[1]
        lit = 1 + p[8] * across + p[9] * down
        full = p[LIGHT] - p[DARK]
        contrast = full * lit
        jacobian = np.zeros((COUNT, len(x)))
        held = (None, None) if tips is None else tips
        ink, by_rho, by_blur, direction, tip = blurred_ellipse(dx, dy, (p[2], p[3], p[4]), p[BLUR], held[0])
        u, v = direction
        slope = -contrast * by_rho
        normal_x, normal_y = slope * (p[2] * u + p[3] * v), slope * (p[3] * u + p[4] * v)
        jacobian[0], jacobian[1] = -normal_x, -normal_y
        jacobian[2], jacobian[3], jacobian[4] = slope * u * dx, slope * (u * dy + v * dx), slope * v * dy
        jacobian[BLUR] = -contrast * by_blur
        steep = np.sqrt(normal_x * normal_x + normal_y * normal_y)
        made = np.stack([tip, np.zeros_like(tip)])
        at = np.flatnonzero(np.repeat(self.ring[dots], counts))
        if len(at):
            q = p[:, at]
            m11, m12, m22 = q[2:5] / q[SCALE]
            dx, dy = x[at] - q[10], y[at] - q[11]
            old = None if held[1] is None else held[1][at]
            hole, by_rho, by_blur, (u, v), made[1, at] = blurred_ellipse(dx, dy, (m11, m12, m22), q[BLUR], old)
            ink[at] -= hole
            slope = contrast[at] * by_rho
            gradient_x, gradient_y = m11 * u + m12 * v, m12 * u + m22 * v
            jacobian[10, at], jacobian[11, at] = -slope * gradient_x, -slope * gradient_y
            jacobian[2:5, at] += slope / q[SCALE] * np.stack([u * dx, u * dy + v * dx, v * dy])
            # d rho/d scale = -rho/scale, and rho = x'grad rho.
            jacobian[SCALE, at] = -slope * (dx * gradient_x + dy * gradient_y) / q[SCALE]
            jacobian[BLUR, at] += contrast[at] * by_blur
        jacobian[LIGHT], jacobian[DARK] = (1 - ink) * lit, ink * lit
        level = p[LIGHT] - full * ink
        jacobian[8], jacobian[9] = level * across, level * down
        return level * lit, jacobian, steep, direction, made

    def move(self, chosen: Bools) -> None:
        """Take the step of the chosen dots, within limits."""
        at = np.flatnonzero(chosen)
        if not len(at):
            return
        normal, gradient = _equations(self.normal[at], self.gradient[at], self.unknowns[at], self.ring[at])
        scale = np.maximum(np.einsum("bii->bi", normal), 1e-12) ** -0.5
        scaled = normal * scale[:, :, None] * scale[:, None, :]
        # A ridge of rounding's size keeps the matrices of outlines that are not ellipses from being singular.
        step = scale * np.linalg.solve(scaled + 1e-9 * np.eye(COUNT), (scale * gradient)[..., None])[..., 0]
        now = self.unknowns[at]
        moved = now + step
        moved[:, CENTER] = now[:, CENTER] + np.clip(step[:, CENTER], -_LONGEST_STEP_PX, _LONGEST_STEP_PX)
        moved[:, BLUR] = np.clip(moved[:, BLUR], now[:, BLUR] / 2, now[:, BLUR] * 2)
        moved[:, BLUR] = np.clip(moved[:, BLUR], _MIN_BLUR, _MAX_BLUR)
        moved[:, SCALE] = now[:, SCALE] + np.clip(step[:, SCALE], -_LONGEST_SCALE_STEP, _LONGEST_SCALE_STEP)
        moved[:, SCALE] = np.clip(moved[:, SCALE], 0.1, 0.9)
        trace, root = _eigenvalues(moved)
        size = self.size[at]
        with np.errstate(invalid="ignore"):
            sane = np.isfinite(moved).all(axis=-1) & (trace - root > 0.6 / size[:, 0]) & (trace < 2 / MIN_SEMI_PX)
            sane &= (moved[:, LIGHT] > moved[:, DARK]) & (
                np.abs(moved[:, CENTER] - self.origin[at]).max(axis=-1) < size[:, 1] + 1
            )
        self.unknowns[at[sane]] = moved[sane]
        self.step[at] = np.abs(step[:, CENTER]).max(axis=-1)
        self.alive[at[~sane]] = False

    def inverse(self) -> Array:
        """Return the inverses (B, 13, 13) of the normal matrices with their priors."""
        normal, _ = _equations(self.normal, self.gradient, self.unknowns, self.ring)
        scale = np.maximum(np.einsum("bii->bi", normal), 1e-12) ** -0.5
        scaled = normal * scale[:, :, None] * scale[:, None, :] + 1e-12 * np.eye(COUNT)
        return np.asarray(np.linalg.inv(scaled) * scale[:, :, None] * scale[:, None, :])

    def leave_out(self, chosen: Bools) -> Bools:
        """Give zero weight to foreign pixels and sectors; return for which dots (B,) this changed anything."""
        if not chosen.any():
            return chosen
        noise = self.noise()
        strange = self.strangeness(noise)
        # Foreign edges distort the fit, and so make other sectors look strange: the worst go first.
        worst = np.where(self.left_out, 0, strange).max(axis=-1, keepdims=True)
        bad = (strange > np.maximum(1, worst / 2)) & chosen[:, None]
        # An occluder's edge rarely ends at a sector's limit.
        self.left_out = self.left_out | bad | np.roll(bad, 1, axis=-1) | np.roll(bad, -1, axis=-1)
        limit = np.maximum(_OUTLIER_SHARE * self.contrast, _OUTLIER_SIGMA * noise)
        # If the blur differs from the model's, many pixels are off by a little, which is harmless.
        limit = np.maximum(limit, _OUTLIER_SPREAD * np.sqrt(self.variance()))
        owner = self.pixels.owner
        kept = (np.abs(self.residual) < limit[owner]) & ~self.left_out.ravel()[owner * SECTORS + self.sector]
        kept = np.where(chosen[owner], kept, self.weight > 0)
        changed = np.bincount(owner[kept != self.weight], minlength=len(chosen)) > 0
        self.weight = kept.astype(float)
        self.alive &= self.left_out.sum(axis=-1) <= _MAX_LEFT_OUT
        return np.asarray(changed & self.alive)

    def complete(self, noise: Array) -> Bools:
        """Return whether (B,) the fit has converged and every edge that was not left out belongs to the dot."""
        owner = self.pixels.owner
        trimmed = (self.weight == 0) & ~self.left_out.ravel()[owner * SECTORS + self.sector]
        count = np.diff(self.pixels.start)
        few = np.bincount(owner, trimmed, len(count)) <= _MAX_TRIMMED * count
        strange = self.strangeness(noise)
        return np.asarray(self.alive & (self.step < _SETTLED_PX) & few & ((strange <= 1) | self.left_out).all(axis=-1))

    def strangeness(self, noise: Array) -> Array:
        """Return the deviation (B, SECTORS) of the edge from its expected place; 1 is the maximum allowed."""
        return strangeness(self.sums, self.contrast, self.unknowns[:, BLUR], self.size[:, 0], noise)

    def noise(self) -> Array:
        """Return the standard deviation (B,) of the grey noise in the band."""
        return np.minimum(white_noise(self.pixels, self.residual), self.most_noise)

    def variance(self) -> Array:
        """Return the variance (B,) of the pixels that count, grey levels squared, at least that of rounding."""
        owner, count = self.pixels.owner, len(self.unknowns)
        # Saturated pixels show no noise.
        weight = self.weight * ~self.silent
        squares = np.bincount(owner, weight * self.residual**2, count)
        freedom = np.bincount(owner, weight, count) - np.where(self.ring, COUNT, COUNT - 3)
        return np.asarray(np.maximum(squares / np.maximum(freedom, 1), QUANTIZATION))

    def misfit(self) -> Array:
        """Return twice the negative log-likelihood (B,) of all pixels, each clipped at half the contrast."""
        squares, count = self.sums[:, :, 7].sum(axis=-1), np.diff(self.pixels.start)
        return np.asarray(count * np.log(np.maximum(squares / np.maximum(count, 1), 1e-12)))


def _eigenvalues(unknowns: Array) -> tuple[Array, Array]:
    """Return the sum and the difference of M's eigenvalues."""
    m11, m12, m22 = unknowns[:, SHAPE].T
    return m11 + m22, np.sqrt((m11 - m22) ** 2 + 4 * m12 * m12)


def _equations(normal: Array, gradient: Array, unknowns: Array, ring: Bools) -> tuple[Array, Array]:
    """Add the priors to normal matrices (B, 13, 13) and gradients (B, 13)."""
    normal, gradient = normal.copy(), gradient.copy()
    # A disk has no hole to move. If the blur is as wide as a ring's ink, a darker and thinner ring looks the same:
    # a half is the usual size.
    normal[:, range(10, COUNT), range(10, COUNT)] += ~ring[:, None]
    prior = ring * (_SCALE_NOISE / _SCALE_SIGMA * (unknowns[:, LIGHT] - unknowns[:, DARK])) ** 2
    normal[:, SCALE, SCALE] += prior
    gradient[:, SCALE] += prior * (0.5 - unknowns[:, SCALE])
    return normal, gradient


@dataclass(frozen=True, eq=False)
class Fits:
    """Result of B fits: unknowns (B, 13), the inverses of their normal matrices, variance and noise of the grey levels.

    `complete` (B,) tells whether the fit has converged, and every edge that was not left out belongs to the dot;
    `misfit` (B,) is twice the negative log-likelihood, up to a constant that all fits to the same pixels share.
    """

    unknowns: Array
    inverse: Array
    variance: Array
    noise: Array
    complete: Bools
    misfit: Array

    def take(self, index: Indices) -> "Fits":
        """Return a subset."""
        return Fits(*(getattr(self, each.name)[index] for each in fields(self)))


def fit_blobs(image: Image, blobs: Blobs, inverted: bool = False) -> Blobs:
    """Fit blurred dark ellipses or elliptic rings to grey levels by least squares, from rough ellipses.

    Model: (1 + g'x) (light - (light - dark) (D - D_hole)), with D the share of ink (`blurred_ellipse`) and g the
    slope of the light over the dot; saturated where the image is. Ellipse, levels, slope and blur are unknown, and for
    a ring the hole's center and scale too: under perspective hole and outline are not concentric. Every pixel counts
    by its information, so the center's error is near the lower bound set by the image's noise.

    Parts of the outline without an edge, or with one elsewhere (an occluder, a touching neighbor), are found sector by
    sector and left out. A fifth of the outline may be missing; with more the fit is refused, since half an ellipse also
    fits other ellipses, with other centers. What is neither dark nor light in the middle is fitted as a disk and as a
    ring, and is a ring only if that is clearly better.

    Parameters
    ----------
    image : array (h, w)
    blobs : Blobs
        Rough ellipses, a fraction of a px off.
    inverted : bool
        True for light dots in an inverted image, whose highest grey level is where there is no light.

    Returns
    -------
    Blobs
        The same blobs in the same order, with the covariance of each center from the fit's normal matrix and residual
        noise, which is at least that of rounding to whole grey levels. Where the fit is refused, the rough ellipse
        stays, with a wide covariance, and `fitted` is False.
    """
    if not len(blobs):
        return blobs
    count = len(blobs)
    doubtful = (blobs.middle > _DISK_BELOW) & (blobs.middle < _RING_ABOVE)
    index = np.concatenate([np.arange(count), np.flatnonzero(doubtful)])
    kinds = blobs.take(index)
    kinds.ring[count:] ^= True
    # Both kinds are fitted to the same pixels.
    fits = fit_unknowns(image, kinds, kinds.ring | doubtful[index], inverted)
    good = _accepted(fits, kinds)
    chosen = np.arange(count)
    for other in range(count, len(index)):
        own = int(index[other])
        ring, disk = (own, other) if kinds.ring[own] else (other, own)
        if good[own] and good[other]:
            chosen[own] = ring if fits.misfit[disk] - fits.misfit[ring] > _RING_GAIN else disk
        elif good[other]:
            chosen[own] = other
    return _fitted(kinds.take(chosen), fits.take(chosen), good[chosen])


def _fitted(blobs: Blobs, fits: Fits, good: Bools) -> Blobs:
    """Return blobs with the results of the good fits."""
    step, covariance = _shrink_slope(fits, good)
    unknowns = fits.unknowns + step
    good = good & (covariance[:, 0, 0] + covariance[:, 1, 1] < _MAX_SIGMA_PX**2)
    trace, root = _eigenvalues(unknowns)
    # M's smaller eigenvalue belongs to the longer axis.
    semi = 2 / (trace[:, None] + root[:, None] * [-1, 1])
    angle = 0.5 * np.arctan2(-2 * unknowns[:, 3], unknowns[:, 4] - unknowns[:, 2])
    rough = np.maximum((blobs.covariance[:, 0, 0] + blobs.covariance[:, 1, 1]) / 2, _ROUGH_PX**2)
    return replace(
        blobs,
        center=np.where(good[:, None], unknowns[:, CENTER], blobs.center),
        semi=np.where(good[:, None], semi, blobs.semi),
        angle=np.where(good, angle, blobs.angle),
        covariance=np.where(good[:, None, None], covariance, rough[:, None, None] * np.eye(2)),
        light=np.where(good, unknowns[:, LIGHT], blobs.light),
        dark=np.where(good, unknowns[:, DARK], blobs.dark),
        blur=np.where(good, unknowns[:, BLUR], blobs.blur),
        fitted=good,
    )


def fit_unknowns(image: Image, blobs: Blobs, filled: Bools, inverted: bool = False) -> Fits:
    """Run the fits of `fit_blobs`, compiled or in NumPy; `filled` (B,) is true where the inside counts as well."""
    unknowns = np.zeros((len(blobs), COUNT))
    unknowns[:, CENTER] = unknowns[:, HOLE] = blobs.center
    cosine, sine = np.cos(blobs.angle), np.sin(blobs.angle)
    a, b = 1 / blobs.semi.T
    unknowns[:, 2], unknowns[:, 4] = a * cosine**2 + b * sine**2, a * sine**2 + b * cosine**2
    unknowns[:, 3] = (a - b) * cosine * sine
    # The light scales what is reflected: a slope of the light tilts an inverted image about its highest level.
    unlit = float(np.iinfo(image.dtype).max) if inverted else 0.0
    unknowns[:, LIGHT], unknowns[:, DARK] = blobs.light - unlit, blobs.dark - unlit
    unknowns[:, BLUR] = np.clip(blobs.blur, 0.5, _MAX_BLUR)
    unknowns[:, SCALE] = 0.5
    band = np.clip(_BAND_BLURS * blobs.blur, _MIN_BAND_PX, _MAX_BAND_PX)
    # Rows enough to see the noise, and no more in larger images.
    plain = grey_noise(image[:: max(1, len(image) // 240)])
    noise = max(_MOST_NOISE * plain + 0.5, np.sqrt(QUANTIZATION))
    top = 255 if image.dtype == np.uint8 else int(image.max(initial=0))
    saturation = top - unlit if top in _SATURATION else np.inf
    if kernel.library() is not None:
        limits = noise, saturation, unlit, *_constants()
        found = Fits(*kernel.fit_dots(image, blobs.semi, blobs.angle, band, blobs.ring, filled, *limits, unknowns))
    else:
        pixels = outline_pixels(image, blobs.center, blobs.semi, blobs.angle, band, filled)
        pixels = replace(pixels, grey=pixels.grey - unlit)
        descent = EllipseDescent(pixels, unknowns, blobs.ring, noise, saturation)
        descent.run()
        white = descent.noise()
        facts = descent.variance(), white, descent.complete(white), descent.misfit()
        found = Fits(descent.unknowns, descent.inverse(), *facts)
    found.unknowns[:, [LIGHT, DARK]] += unlit
    return found


@cache
def _constants() -> tuple[Array, Array]:
    """Return what the compiled fit takes from here: the constants, in the order of kernel_fit.c, and F and f."""
    from scipy.special import ndtr

    settings = np.concatenate(
        [
            [_CONVERGED_PX, _SETTLED_PX, _JUDGED_PX, _STEPS, _ROUNDS, _LONGEST_STEP_PX, _LONGEST_SCALE_STEP],
            [_MIN_BLUR, _MAX_BLUR, MIN_SEMI_PX, _OUTLIER_SHARE, _OUTLIER_SIGMA, _OUTLIER_SPREAD],
            [_MAX_LEFT_OUT, _MAX_TRIMMED, _SCALE_NOISE / _SCALE_SIGMA],
            edge_psf.CONSTANTS,
            outline_pixels_.CONSTANTS,
            edge_psf.QUADRATURE,
        ]
    )
    place = np.arange(-8 * _PER_UNIT, 8 * _PER_UNIT + 1) / _PER_UNIT
    table = np.stack([ndtr(place), np.exp(-0.5 * place * place) / np.sqrt(2 * np.pi)], axis=-1)
    return np.concatenate([settings, [place[0], _PER_UNIT, len(place)]]), table


def _accepted(fits: Fits, blobs: Blobs) -> Bools:
    """Return which dots (B,) have the outline of a dot nearly all around, near the rough one."""
    contrast = fits.unknowns[:, LIGHT] - fits.unknowns[:, DARK]
    trace, root = _eigenvalues(fits.unknowns)
    good = fits.complete & (fits.noise < _MAX_NOISE * contrast)
    good &= fits.variance < (_NOISE_SLACK * fits.noise) ** 2 + (_MAX_MISFIT * contrast) ** 2
    good &= (trace - root < 2 / _MIN_MAJOR_PX) & (trace + root < 2 / MIN_SEMI_PX)
    good &= trace + root < _MAX_ELONGATION * (trace - root)
    moved = np.linalg.norm(fits.unknowns[:, CENTER] - blobs.center, axis=-1)
    good &= moved < _MAX_MOVE_PX + _MAX_MOVE * blobs.semi[:, 0]
    scale = fits.unknowns[:, SCALE]
    return np.asarray(good & (~blobs.ring | ((scale > _HOLE_SCALES[0]) & (scale < _HOLE_SCALES[1]))))


def _shrink_slope(fits: Fits, good: Bools) -> tuple[Array, Array]:
    """Return the last step (B, 13) and the centers' covariance (B, 2, 2), with slopes of the light shrunk to zero.

    A free slope costs a third of the center's information; without a slope, uneven light displaces the center. So the
    slope has a normal prior about zero with the variance of all slopes of the image beyond their own errors
    (DerSimonian and Laird's estimate): none in even light, as much as needed in other light.
    """
    step, covariance = np.zeros(fits.unknowns.shape), np.full((len(good), 2, 2), np.nan)
    if not good.any():
        return step, covariance
    free = fits.variance[good, None, None] * fits.inverse[good]
    slope, errors = fits.unknowns[good, SLOPE], free[:, SLOPE, SLOPE]
    own = np.einsum("bii->b", errors) / 2
    weight = np.maximum(own, 1e-15) ** -2
    between = float(np.sum(weight * (np.sum(slope**2, axis=-1) / 2 - own)) / np.sum(weight))
    # The gain of a measurement of both slopes as zero, with this variance.
    gain = free[:, :, SLOPE] @ np.linalg.inv(errors + max(between, 1e-12) * np.eye(2))
    step[good] = -(gain @ slope[..., None])[..., 0]
    centers = free[:, CENTER, CENTER] - gain[:, CENTER] @ free[:, SLOPE, CENTER]
    # On some processors its product is symmetric only up to rounding.
    covariance[good] = (centers + centers.swapaxes(-1, -2)) / 2
    return step, covariance
