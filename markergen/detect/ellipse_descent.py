"""Descent to the ellipses that fit grey levels best, batched: the twin of kernel_fit.c."""
# tests: tests/detect/test_ellipse_fit.py

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect import edge_psf, outline_pixels
from markergen.detect.edge_psf import blurred_ellipse
from markergen.detect.outline_pixels import (
    QUANTIZATION,
    SECTORS,
    OutlinePixels,
    sector_of,
    sector_sums,
    strangeness,
    white_noise,
)

Bools = NDArray[np.bool_]

# Columns of the unknowns.
CENTER, SHAPE, LIGHT, DARK, BLUR, SLOPES = slice(0, 2), slice(2, 5), 5, 6, 7, slice(8, 12)
HOLE, SCALE = slice(12, 14), 14
COUNT = 15

MIN_SEMI_PX = 0.6
"""Minimum semi-axis: with less than half a pixel's blur, a dot cannot be told from a line."""

_CONVERGED_PX, _SETTLED_PX, _JUDGED_PX = 2e-3, 0.02, 0.1
"""A fit ends when a step moves its center by less than the first: the next would be under a third of it, a tenth of the
best standard deviation. Outlines that still take steps above the second at the end are not dots. Pixels and sectors are
left out once the steps of center and blur are below the third, but not at the first step."""

_UNJUDGED = 1

_STEPS, _ROUNDS = 16, 4
"""Maximum number of steps, and of times that a dot's pixels are chosen anew."""

_LONGEST_STEP_PX, _LONGEST_SCALE_STEP = 2.0, 0.1
_MIN_BLUR, MAX_BLUR = 0.28, 6.0
"""Range of the blur in px, including the pixel's own area, which alone is 0.29."""

_OUTLIER_SHARE, _OUTLIER_SIGMA, _OUTLIER_SPREAD = 0.12, 5.0, 4.0
"""Pixels that are off by more than this share of the contrast, this multiple of the noise, and this multiple of the
standard deviation of the residual belong to something else."""

_MAX_LEFT_OUT = 5
"""Maximum number of sectors left out, counting neighbors of strange ones: half an ellipse also fits other ellipses."""
_MAX_TRIMMED = 0.15

_SCALE_SIGMA, _SHINE_SIGMA, _PRIOR_NOISE = 0.05, 0.003, 0.02
"""Standard deviations of a hole's size about half of the ring's, and of a reflection's slope, relative to the light and
in 1/px, about none; as if measured at this noise per contrast."""

CONSTANTS = [
    *(_CONVERGED_PX, _SETTLED_PX, _JUDGED_PX, _UNJUDGED, _STEPS, _ROUNDS, _LONGEST_STEP_PX, _LONGEST_SCALE_STEP),
    *(_MIN_BLUR, MAX_BLUR, MIN_SEMI_PX, _OUTLIER_SHARE, _OUTLIER_SIGMA, _OUTLIER_SPREAD, _MAX_LEFT_OUT, _MAX_TRIMMED),
    *(_PRIOR_NOISE / _SCALE_SIGMA, _PRIOR_NOISE / _SHINE_SIGMA),
    *(*edge_psf.CONSTANTS, *outline_pixels.CONSTANTS, *edge_psf.QUADRATURE),
]
"""What the compiled fit takes from here, in the order of kernel_fit.c."""


class EllipseDescent:
    """Unknowns (B, 15) of dots that are being fitted, and their pixels with weights 0 or 1.

    The columns: center (2) and M (m11, m12, m22) of the ellipse |M (x - c)| = 1; grey levels of light and dark; blur;
    slopes of light and of dark (2 each), per px; center (2) of a ring's hole, and its size relative to the outline's.

    Parameters
    ----------
    unknowns : array (B, 15)
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
        trace, root = eigenvalues(unknowns)
        self.size = 2 / (trace[:, None] + root[:, None] * [-1, 1])
        self.alive = np.ones(count, dtype=bool)
        self.left_out = np.zeros((count, SECTORS), dtype=bool)
        self.step, self.blur_step = np.full(count, np.inf), np.full(count, np.inf)
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
            calm = active & (self.step < _JUDGED_PX) & (self.blur_step < _JUDGED_PX) & (step >= _UNJUDGED)
            # The shape of the tips is computed anew at steps 0, 2, 5...: it is expensive, and changes little between.
            self.evaluate(active, step == 0 or step % 3 == 2)
            changed = self.leave_out(calm & (rounds < _ROUNDS))
            rounds += changed
            # The equations of those whose pixels changed are not of these pixels.
            self.move(active & ~changed)
            active &= self.alive & (changed | ~calm | (self.step > _CONVERGED_PX))

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
        """Return grey levels (N,), their derivatives (15, N), the edge's slope, sectors' directions and the tips."""
        p = np.repeat(self.unknowns[dots].T, counts, axis=1)
        origin = np.repeat(self.origin[dots].T, counts, axis=1)
        across, down = x - origin[0], y - origin[1]
        dx, dy = x - p[0], y - p[1]
        light, dark = p[LIGHT] + p[8] * across + p[9] * down, p[DARK] + p[10] * across + p[11] * down
        contrast = light - dark
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
            dx, dy = x[at] - q[12], y[at] - q[13]
            old = None if held[1] is None else held[1][at]
            hole, by_rho, by_blur, (u, v), made[1, at] = blurred_ellipse(dx, dy, (m11, m12, m22), q[BLUR], old)
            ink[at] -= hole
            slope = contrast[at] * by_rho
            gradient_x, gradient_y = m11 * u + m12 * v, m12 * u + m22 * v
            jacobian[12, at], jacobian[13, at] = -slope * gradient_x, -slope * gradient_y
            jacobian[2:5, at] += slope / q[SCALE] * np.stack([u * dx, u * dy + v * dx, v * dy])
            # d rho/d scale = -rho/scale, and rho = x'grad rho.
            jacobian[SCALE, at] = -slope * (dx * gradient_x + dy * gradient_y) / q[SCALE]
            jacobian[BLUR, at] += contrast[at] * by_blur
        jacobian[LIGHT], jacobian[DARK] = 1 - ink, ink
        jacobian[8:10] = (1 - ink) * across, (1 - ink) * down
        jacobian[10:12] = ink * across, ink * down
        return light - contrast * ink, jacobian, steep, direction, made

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
        moved[:, BLUR] = np.clip(moved[:, BLUR], _MIN_BLUR, MAX_BLUR)
        moved[:, SCALE] = now[:, SCALE] + np.clip(step[:, SCALE], -_LONGEST_SCALE_STEP, _LONGEST_SCALE_STEP)
        moved[:, SCALE] = np.clip(moved[:, SCALE], 0.1, 0.9)
        trace, root = eigenvalues(moved)
        size = self.size[at]
        with np.errstate(invalid="ignore"):
            sane = np.isfinite(moved).all(axis=-1) & (trace - root > 0.6 / size[:, 0]) & (trace < 2 / MIN_SEMI_PX)
            sane &= (moved[:, LIGHT] > moved[:, DARK]) & (
                np.abs(moved[:, CENTER] - self.origin[at]).max(axis=-1) < size[:, 1] + 1
            )
        self.unknowns[at[sane]] = moved[sane]
        self.step[at], self.blur_step[at] = np.abs(step[:, CENTER]).max(axis=-1), np.abs(moved - now)[:, BLUR]
        self.alive[at[~sane]] = False

    def inverse(self) -> Array:
        """Return the inverses (B, 15, 15) of the normal matrices with their priors."""
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

    def uneven(self) -> tuple[Array, Array, Array]:
        """Return `uneven`, `odd` and `pairs` of `Fits`; sectors left out do not count."""
        variance, half, kept = self.variance(), SECTORS // 2, ~self.left_out
        information = np.maximum(self.sums[:, :, 1], 1e-12)
        shift = self.sums[:, :, 2] / information
        # An ellipse takes five of the shifts.
        even = np.sum(information * shift**2 * kept, axis=-1) / variance / np.maximum(kept.sum(axis=-1) - 5, 1)
        both = kept[:, :half] & kept[:, half:]
        spread = 1 / information[:, :half] + 1 / information[:, half:]
        odd = np.sum((shift[:, :half] - shift[:, half:]) ** 2 / spread * both, axis=-1) / variance
        return even, odd, both.sum(axis=-1).astype(float)

    def misfit(self) -> Array:
        """Return twice the negative log-likelihood (B,) of all pixels, each clipped at half the contrast."""
        squares, count = self.sums[:, :, 7].sum(axis=-1), np.diff(self.pixels.start)
        return np.asarray(count * np.log(np.maximum(squares / np.maximum(count, 1), 1e-12)))


def eigenvalues(unknowns: Array) -> tuple[Array, Array]:
    """Return the sum and the difference of M's eigenvalues."""
    m11, m12, m22 = unknowns[:, SHAPE].T
    return m11 + m22, np.sqrt((m11 - m22) ** 2 + 4 * m12 * m12)


def _equations(normal: Array, gradient: Array, unknowns: Array, ring: Bools) -> tuple[Array, Array]:
    """Add the priors to normal matrices (B, 15, 15) and gradients (B, 15)."""
    normal, gradient = normal.copy(), gradient.copy()
    # A disk has no hole to move. If the blur is as wide as a ring's ink, a darker and thinner ring looks the same:
    # a half is the usual size.
    normal[:, range(12, COUNT), range(12, COUNT)] += ~ring[:, None]
    weight = (_PRIOR_NOISE * (unknowns[:, LIGHT] - unknowns[:, DARK])) ** 2
    prior = ring * weight / _SCALE_SIGMA**2
    normal[:, SCALE, SCALE] += prior
    gradient[:, SCALE] += prior * (0.5 - unknowns[:, SCALE])
    # In small dots hardly anything is all dark.
    row = shine_rows(unknowns)
    shine = (row @ unknowns[:, SLOPES, None])[..., 0]
    prior = weight / _SHINE_SIGMA**2
    normal[:, SLOPES, SLOPES] += prior[:, None, None] * row.swapaxes(-1, -2) @ row
    gradient[:, SLOPES] -= prior[:, None] * (row.swapaxes(-1, -2) @ shine[..., None])[..., 0]
    return normal, gradient


def shine_rows(unknowns: Array) -> Array:
    """Return the matrices (B, 2, 4) from the slopes to those that illumination does not explain, 1/px.

    Illumination changes light and dark by the same factor, a reflection by the same amount: (light x slope of dark -
    dark x slope of light)/norm, relative to the greater level.
    """
    light, dark = unknowns[:, LIGHT], unknowns[:, DARK]
    norm = np.sqrt(light * light + dark * dark) * np.maximum(np.abs(light), np.abs(dark))
    row = np.zeros((len(unknowns), 2, 4))
    row[:, 0, 0] = row[:, 1, 1] = -dark / norm
    row[:, 0, 2] = row[:, 1, 3] = light / norm
    return row
