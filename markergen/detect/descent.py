"""Gauss-Newton descent of many dots at once: grey levels of blurred ellipses and elliptic rings against the image."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from markergen.detect.edge_model import blurred_ellipse
from markergen.detect.outline_check import QUANTIZATION, SECTORS, sector_of, strangeness, white_noise
from markergen.detect.outline_pixels import OutlinePixels

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

# Columns of the unknowns.
CENTER, SHAPE, LIGHT, DARK, BLUR, SLOPE = slice(0, 2), slice(2, 5), 5, 6, 7, slice(8, 10)
HOLE, SCALE = slice(10, 12), 12
COUNT = 13

MIN_SEMI_PX = 0.6
"""Thinner than half a pixel's blur nothing is told from a line."""

_CONVERGED_PX, _SETTLED_PX = 1e-3, 0.02
"""A step of every center below the first ends the iteration: the next would be under 4e-4 px, a tenth of the best
standard deviation. What still takes steps above the second at the end is no dot."""

_LONGEST_STEP_PX, _LONGEST_SCALE_STEP = 2.0, 0.1
_MIN_BLUR, _MAX_BLUR = 0.28, 6.0
"""In px, with the pixel's own area, which alone is 0.29."""

_OUTLIER_SHARE, _OUTLIER_SIGMA, _OUTLIER_SPREAD = 0.12, 5.0, 4.0
"""Pixels off by more than this share of the contrast, so many times the noise, and so many times the standard deviation
of the residual, show something else."""

_MAX_LEFT_OUT = 5
"""Of the sectors, with the neighbors of those that are strange: half an ellipse is much of another ellipse too."""
_MAX_TRIMMED = 0.15

NOISE_SLACK, _MOST_NOISE = 1.5, 2.0
"""Noise is accepted, and expected, so many times that of the plainest parts of the image: it grows with the light."""

_SCALE_SIGMA, _SCALE_NOISE = 0.05, 0.02
"""What is expected of a hole's size beside half of the ring's, as if it were measured at this noise per contrast."""

_OF_DOTS = "ring", "index", "origin", "size", "unknowns", "left_out", "step", "normal"
_OF_PIXELS = "weight", "residual", "slope", "direction", "silent"
"""The state's arrays (B, ...) and (..., N)."""

_SATURATION = tuple(2**bits - 1 for bits in range(8, 17))


class Descent:
    """Unknowns (B, 13) of the dots still in the race, and their pixels with weights 0 or 1.

    The columns: center (2) and M (m11, m12, m22) of the ellipse |M (x - c)| = 1; grey levels of light and dark; blur;
    the light's slope (2), relative, 1/px; center (2) and size, relative to the outline's, of a ring's hole.

    Parameters
    ----------
    pixels : OutlinePixels
    center, shape : arrays (B, 2) and (B, 2, 2), px and 1/px
        The ellipses at the start; `shape` is M.
    light, dark, blur : arrays (B,), grey levels and px
    ring : array (B,) of bool
    noise : float, grey levels
        Of plain parts of the image.
    top : int
        The image's highest grey level, which tells whether it is saturated.
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
        # Of the last evaluation of the model:
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
        """Take steps until the centers, or those of the chosen, stand still; what runs away is dropped."""
        if chosen is not None and not chosen.all():
            self._run_part(steps, chosen)
            return
        for done in range(1, steps + 1):
            if not len(self.index):
                return
            gradient = self._evaluate()
            scale = np.maximum(np.einsum("bii->bi", self.normal), 1e-12) ** -0.5
            scaled = self.normal * scale[:, :, None] * scale[:, None, :]
            # A ridge of rounding's size keeps the matrices of what is no ellipse from being singular.
            step = scale * np.linalg.solve(scaled + 1e-9 * np.eye(COUNT), (scale * gradient)[..., None])[..., 0]
            self._move(step)
            moving = self.step > _CONVERGED_PX
            if 2 * moving.sum() <= len(moving):
                # Most stand still, and each costs as much as one that moves.
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
        """Residual, and normal matrices J'J, of the pixels that count; J'r (B, 13)."""
        model, jacobian = self._model()
        if self.saturation is not None:
            self.silent = model > self.saturation
            model = np.minimum(model, self.saturation)
            jacobian[:, self.silent] = 0
        self.residual = self.pixels.grey - model
        # A neighbor's edge in the band, or a speck, says nothing about this dot.
        weight = self.weight * (np.abs(self.residual) < 0.5 * self.contrast[self.pixels.owner])
        weighted = jacobian * weight
        spans = list(zip(self.pixels.start[:-1], self.pixels.start[1:], strict=True))
        self.normal = np.stack([weighted[:, a:b] @ jacobian[:, a:b].T for a, b in spans])
        gradient = np.stack([weighted[:, a:b] @ self.residual[a:b] for a, b in spans])
        # A disk has no hole to move. Where the blur is as wide as a ring's ink, a darker and thinner ring looks the
        # same: half is usual.
        self.normal[:, range(10, COUNT), range(10, COUNT)] += ~self.ring[:, None]
        prior = self.ring * (_SCALE_NOISE * self.contrast / _SCALE_SIGMA) ** 2
        self.normal[:, SCALE, SCALE] += prior
        gradient[:, SCALE] += prior * (0.5 - self.unknowns[:, SCALE])
        return gradient

    def _move(self, step: Array) -> None:
        """Take the step (B, 13), within reason."""
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
        """Grey levels (N,) and their derivatives (13, N)."""
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
        """Mean square (B,) of the residual, grey levels squared, no pixel counting for more than half the contrast."""
        half = 0.5 * self.contrast[self.pixels.owner]
        squares = np.clip(self.residual, -half, half) ** 2
        count = np.diff(self.pixels.start)
        return np.asarray(np.bincount(self.pixels.owner, squares, len(count)) / np.maximum(count, 1))

    def drop_hopeless(self, misfit: float) -> None:
        """Drop what is farther from explained than by a share of the contrast and the noise."""
        self.keep(self.misfit() < (misfit * self.contrast) ** 2 + (NOISE_SLACK * self.image_noise) ** 2)

    def leave_out(self) -> Bools:
        """Give no weight to pixels and sectors that show something else; for which dots (B,) this is news."""
        strange = self.strangeness()
        # What is strange here pulls the fit, and so makes other sectors strange: the worst go first.
        worst = np.where(self.left_out, 0, strange).max(axis=-1, keepdims=True)
        bad = strange > np.maximum(1, worst / 2)
        # An occluder's edge rarely ends where a sector does.
        self.left_out = self.left_out | bad | np.roll(bad, 1, axis=-1) | np.roll(bad, -1, axis=-1)
        self.keep(self.left_out.sum(axis=-1) <= _MAX_LEFT_OUT)
        limit = np.maximum(_OUTLIER_SHARE * self.contrast, _OUTLIER_SIGMA * self.noise())
        # Where the blur is another than the model's, much is off by some, and means no harm.
        limit = np.maximum(limit, _OUTLIER_SPREAD * np.sqrt(self.variance()))
        kept = (np.abs(self.residual) < limit[self.pixels.owner]) & ~self.left_out.ravel()[self._sector()]
        changed = np.bincount(self.pixels.owner, kept != self.weight, len(self.index)) > 0
        self.weight = kept.astype(float)
        return np.asarray(changed)

    def complete(self) -> Bools:
        """Whether (B,) the fit stands still and every edge, but for what was left out, is that of the dot."""
        trimmed = (self.weight == 0) & ~self.left_out.ravel()[self._sector()]
        count = np.diff(self.pixels.start)
        few = np.bincount(self.pixels.owner, trimmed, len(count)) <= _MAX_TRIMMED * count
        return np.asarray((self.step < _SETTLED_PX) & few & ((self.strangeness() <= 1) | self.left_out).all(axis=-1))

    def strangeness(self) -> Array:
        """How far (B, SECTORS) the edge is from where it should be; 1 is the most allowed."""
        model = self.pixels.grey - self.residual
        blur, size = self.unknowns[:, BLUR], self.size[:, 1]
        return strangeness(self._sector(), self.slope, model, self.residual, self.contrast, blur, size, self.noise())

    def noise(self) -> Array:
        """Standard deviation (B,) of the grey noise in the band, no more than the image's noise allows.

        Of a small dot no pixel is far from an edge, and a misfit looks like noise.
        """
        most = max(_MOST_NOISE * self.image_noise + 0.5, np.sqrt(QUANTIZATION))
        return np.minimum(white_noise(self.pixels, self.residual), most)

    def variance(self) -> Array:
        """Variance (B,) of the pixels that count, grey levels squared, no less than that of rounding."""
        owner, count = self.pixels.owner, len(self.index)
        # Saturated pixels show no noise.
        weight = self.weight * ~self.silent
        squares = np.bincount(owner, weight * self.residual**2, count)
        freedom = np.bincount(owner, weight, count) - np.where(self.ring, COUNT, COUNT - 3)
        return np.asarray(np.maximum(squares / np.maximum(freedom, 1), QUANTIZATION))

    def _sector(self) -> Indices:
        return sector_of(self.pixels, self.direction)
