"""Ellipses of blobs with the lens undone."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Blobs
from markergen.model.camera import Camera

Array = NDArray[np.float64]

_SAMPLES = 32
_STEPS = 3
"""Samples of an outline and Gauss-Newton steps of its fit: with more, centers change by less than 1e-5 px."""


@dataclass(frozen=True, eq=False)
class Ellipses:
    """B ellipses in normalized coordinates.

    Attributes
    ----------
    center : array (B, 2)
    shape : array (B, 2, 2)
        E with (x - c)' E^-1 (x - c) = 1 on the outline.
    ring : array (B,) of bool
    index : array (B,) of int
        Of the blobs that they are.
    """

    center: Array
    shape: Array
    ring: NDArray[np.bool_]
    index: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.center)

    def take(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> "Ellipses":
        """Return the chosen ones."""
        return Ellipses(*(getattr(self, each.name)[chosen] for each in fields(self)))


def undo_lens(blobs: Blobs, camera: Camera) -> Ellipses:
    """Ellipses of the blobs as a camera without distortion, of focal length 1, would have taken them.

    A lens with distortion makes of an ellipse something else, which the blob's ellipse fits best; so points of the
    blob's outline are sent back through the lens, and an ellipse fitted to where they come from. Blobs where no ray
    comes to the image are left out.
    """
    turn = np.stack([np.cos(blobs.angle), np.sin(blobs.angle)], axis=-1)
    across = np.stack([-turn[:, 1], turn[:, 0]], axis=-1)
    # Columns: the semi-axes.
    axes = np.stack([turn * blobs.semi[:, :1], across * blobs.semi[:, 1:]], axis=-1)
    if camera == camera.ideal:
        center = camera.from_pixels(blobs.center)
        axes = axes / camera.focal[:, None]
        return Ellipses(center, axes @ axes.swapaxes(-1, -2), blobs.ring, np.arange(len(blobs)))
    angle = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    circle = np.stack([np.cos(angle), np.sin(angle)])
    pixels = blobs.center[:, None] + (axes @ circle).swapaxes(-1, -2)
    # The fit of the grey levels spends its freedom evenly along the outline: points count by the arc they stand for.
    speed = np.linalg.norm(axes @ np.stack([-circle[1], circle[0]]), axis=-2)
    outline = camera.from_pixels(pixels)
    usable = np.flatnonzero(np.isfinite(outline).all(axis=(-2, -1)))
    center, shape = _fit_ellipse(outline[usable], circle, speed[usable])
    return Ellipses(center, shape, blobs.ring[usable], usable)


def _fit_ellipse(points: Array, circle: Array, weight: Array) -> tuple[Array, Array]:
    """Ellipses that minimize the weighted squared distance from points (B, s, 2) near their outline.

    Center c and symmetric M, which takes the ellipse to the unit circle: the distance is (rho - 1)/|grad rho| with
    rho = |M (x - c)|, to first order, as in the fit of the grey levels.
    """
    center = points.mean(axis=1)
    # Points at equal steps of an ellipse's parameter have its axes as their first harmonic.
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
        # Residual rho - 1; its derivatives by center and matrix.
        rows = np.stack([-gradient[..., 0], -gradient[..., 1], *by_matrix], axis=-1)
        weighted = (rows * scale[..., None]).swapaxes(-1, -2)
        step = np.linalg.solve(weighted @ rows, weighted @ (1 - rho)[..., None])[..., 0]
        center = center + step[:, :2]
        matrix = matrix + step[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    inverse = np.linalg.inv(matrix)
    return center, inverse @ inverse.swapaxes(-1, -2)
