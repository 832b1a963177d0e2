"""Dot candidates: dark ellipses in the image, as seen and with the lens distortion removed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.maths.batched import Batched
from markergen.model.camera import NO_DISTORTION, Camera

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Blobs(Batched):
    """B candidate dots of one image, rough or fitted to grey levels.

    Attributes
    ----------
    center : array (B, 2), px
        Center of the image ellipse, which is not yet the image of the dot's center.
    semi : array (B, 2), px, longest first
    angle : array (B,), rad, of the longest axis from x
    ring : array (B,) of bool
        True if the middle is bright.
    covariance : array (B, 2, 2), px^2
        Covariance of the center.
    light, dark : arrays (B,), grey levels outside and inside
    blur : array (B,), px
        Width of the edge as the standard deviation of a normal distribution.
    middle : array (B,)
        Level in the middle relative to what a disk, 0, and a key ring, 1, of this outline and blur would show; 0.5
        where both would show the same.
    fitted : array (B,) of bool
        True if fitted to grey levels, false if from a few points of the edge alone.
    """

    center: Array
    semi: Array
    angle: Array
    ring: NDArray[np.bool_]
    covariance: Array
    light: Array
    dark: Array
    blur: Array
    middle: Array
    fitted: NDArray[np.bool_]

    @property
    def hole(self) -> Array:
        """Evidence of a ring (B,), from 0 for a disk to 1."""
        return np.clip(self.middle, 0, 1)

    @property
    def axes(self) -> Array:
        """Semi-axes (B, 2, 2) as columns, px, longest first."""
        cosine, sine, axes = np.cos(self.angle), np.sin(self.angle), np.empty((len(self), 2, 2))
        axes[:, 0, 0], axes[:, 1, 0] = cosine, sine
        axes[:, 0, 1], axes[:, 1, 1] = -sine, cosine
        axes *= self.semi[:, None]
        return axes


DOUBTFUL = 0.25
"""Evidence of a ring below which a blob is surely a disk, and beyond one minus which it is surely a ring."""


def as_dark(image: Image, light: bool) -> Image:
    """Return an image with dark dots: unchanged, or, if they are light, the highest grey level of its type minus it."""
    return ~image if light else image


_SAMPLES = 32
_STEPS = 3
"""Samples of an outline and Gauss-Newton steps of its fit: with more, centers change by less than 1e-5 px."""


@dataclass(frozen=True, eq=False)
class Ellipses(Batched):
    """B ellipses in normalized coordinates.

    Attributes
    ----------
    center : array (B, 2)
    shape : array (B, 2, 2)
        E with (x - c)' E^-1 (x - c) = 1 on the outline.
    hole : array (B,)
        Evidence of a ring, from 0 for a disk to 1.
    index : array (B,) of int
        Index of each ellipse's blob.
    """

    center: Array
    shape: Array
    hole: Array
    index: NDArray[np.intp]

    @property
    def ring(self) -> NDArray[np.bool_]:
        """True (B,) for rings, as far as can be told."""
        return self.hole > 0.5

    def strange(self, rings: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which ellipses (n, B) are surely of another kind than the rings, or disks, of `rings` (n,)."""
        return np.where(rings[:, None], self.hole < DOUBTFUL, self.hole > 1 - DOUBTFUL)


def undo_lens(blobs: Blobs, camera: Camera) -> Ellipses:
    """Return the blobs' ellipses as seen by a camera of focal length 1 without distortion.

    A distorted ellipse is no longer an ellipse, and the blob's ellipse is only its best fit; so points of the blob's
    outline are undistorted, and an ellipse is fitted to the results. Blobs with points that no ray reaches are left
    out.
    """
    axes = blobs.axes
    if camera.distortion == NO_DISTORTION:
        center = (blobs.center - [camera.cx, camera.cy]) / camera.focal
        axes = axes / camera.focal[:, None]
        return Ellipses(center, axes @ axes.swapaxes(-1, -2), blobs.hole, np.arange(len(blobs)))
    angle = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    circle = np.stack([np.cos(angle), np.sin(angle)])
    pixels = blobs.center[:, None] + (axes @ circle).swapaxes(-1, -2)
    # The fit of the grey levels weights the outline evenly along its length: points are weighted by their arc length.
    speed = np.linalg.norm(axes @ np.stack([-circle[1], circle[0]]), axis=-2)
    outline = camera.from_pixels(pixels)
    usable = np.flatnonzero(np.isfinite(outline).all(axis=(-2, -1)))
    center, shape = _fit_ellipse(outline[usable], circle, speed[usable])
    return Ellipses(center, shape, blobs.hole[usable], usable)


def _fit_ellipse(points: Array, circle: Array, weight: Array) -> tuple[Array, Array]:
    """Fit ellipses that minimize the weighted squared distance from points (B, s, 2) near their outline.

    With center c and symmetric M, which maps the ellipse to the unit circle, the distance is (rho - 1)/|grad rho| to
    first order, with rho = |M (x - c)|, as in the fit of the grey levels.
    """
    center = points.mean(axis=1)
    # The first harmonic of points at equal steps of an ellipse's parameter gives its axes.
    axes = 2 * (points - center[:, None]).swapaxes(-1, -2) @ circle.T / circle.shape[1]
    values, vectors = np.linalg.eigh(axes @ axes.swapaxes(-1, -2))
    matrix = (vectors / np.sqrt(values)[:, None, :]) @ vectors.swapaxes(-1, -2)
    for _ in range(_STEPS):
        offset = points - center[:, None]
        mapped = offset @ matrix
        rho = np.linalg.norm(mapped, axis=-1)
        unit = mapped / rho[..., None]
        gradient = unit @ matrix
        by_matrix = [
            unit[..., 0] * offset[..., 0],
            unit[..., 0] * offset[..., 1] + unit[..., 1] * offset[..., 0],
            unit[..., 1] * offset[..., 1],
        ]
        scale = weight / np.sum(gradient**2, axis=-1)
        # Residual rho - 1, and its derivatives with respect to center and matrix.
        rows = np.stack([-gradient[..., 0], -gradient[..., 1], *by_matrix], axis=-1)
        weighted = (rows * scale[..., None]).swapaxes(-1, -2)
        step = np.linalg.solve(weighted @ rows, weighted @ (1 - rho)[..., None])[..., 0]
        center = center + step[:, :2]
        matrix = matrix + step[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    inverse = np.linalg.inv(matrix)
    return center, inverse @ inverse.swapaxes(-1, -2)
