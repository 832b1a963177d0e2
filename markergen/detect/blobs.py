"""Dot candidates: dark ellipses in the image, as seen and with the lens distortion removed."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from markergen.detect.candidate_regions import find_regions, grey_noise
from markergen.detect.ellipse_fit import FittedDots, fit_dots
from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.read.images import LARGEST_FRAME

Array = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.uint16]

_SAME_PLACE, _SAME_SIZE = 0.5, 1.5
"""Share of the short semi-axis, and ratio of the semi-axes, within which two fits are of the same dot."""


@dataclass(frozen=True, eq=False)
class Blobs:
    """B candidate dots of one image.

    Attributes
    ----------
    center : array (B, 2), px
        Center of the image ellipse, which is not yet the image of the dot's center.
    semi : array (B, 2), px, longest first
    angle : array (B,), rad, of the longest axis from x
    ring : array (B,) of bool
        True if the middle is bright.
    covariance : array (B, 2, 2), px^2
        Covariance of the center, from the grey noise estimated by the fit.
    """

    center: Array
    semi: Array
    angle: Array
    ring: NDArray[np.bool_]
    covariance: Array

    def __len__(self) -> int:
        return len(self.center)


def as_dark(image: Image, light: bool) -> Image:
    """Return an image with dark dots: unchanged, or, if they are light, the highest grey level of its type minus it."""
    return ~image if light else image


def detect_dots(image: Image) -> Blobs:
    """Find dark elliptic dots on a lighter ground.

    Regions that are darker than their surroundings (`find_regions`) initialize a fit of ellipse, grey levels and blur
    to the image's grey levels (`fit_dots`).

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16

    Returns
    -------
    Blobs
        Empty for images without contrast. Dots cut off by the image's edge are left out.

    Raises
    ------
    InputError
        If the image is not a grey image of uint8 or uint16, or has more than LARGEST_FRAME pixels.
    """
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise InputError(
            "a grey image (h, w) of uint8 or uint16", f"{image.shape} of {image.dtype}", "convert the image to grey"
        )
    if image.size > LARGEST_FRAME:
        raise InputError(
            f"an image of at most {LARGEST_FRAME // 10**6} megapixels",
            f"{image.shape[1]}x{image.shape[0]} px",
            "reduce its size, or cut out the part with the marker",
        )
    dots = fit_dots(image, find_regions(image), grey_noise(image))
    dots = dots.take(_distinct(dots))
    return Blobs(dots.center, dots.semi, dots.angle, dots.ring, dots.covariance)


def _distinct(dots: FittedDots) -> NDArray[np.intp]:
    """Return the indices of distinct dots: fits that began in different regions can end in the same dot.

    Of dots that lie in each other's middle and are of about the same size, the one with the most precise center stays.
    """
    kept: list[int] = []
    for i in np.argsort(np.trace(dots.covariance, axis1=-2, axis2=-1), kind="stable"):
        apart = np.linalg.norm(dots.center[kept] - dots.center[i], axis=-1) > _SAME_PLACE * dots.semi[i, 1]
        other_size = np.abs(np.log(dots.semi[kept] / dots.semi[i])).max(axis=-1) > np.log(_SAME_SIZE)
        if np.all(apart | other_size):
            kept.append(int(i))
    return np.sort(np.array(kept, dtype=np.intp))


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
        Index of each ellipse's blob.
    """

    center: Array
    shape: Array
    ring: NDArray[np.bool_]
    index: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.center)

    def take(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> "Ellipses":
        """Return a subset."""
        return Ellipses(*(getattr(self, each.name)[chosen] for each in fields(self)))


def undo_lens(blobs: Blobs, camera: Camera) -> Ellipses:
    """Return the blobs' ellipses as seen by a camera of focal length 1 without distortion.

    A distorted ellipse is no longer an ellipse, and the blob's ellipse is only its best fit; so points of the blob's
    outline are undistorted, and an ellipse is fitted to the results. Blobs with points that no ray reaches are left
    out.
    """
    turn = np.stack([np.cos(blobs.angle), np.sin(blobs.angle)], axis=-1)
    across = np.stack([-turn[:, 1], turn[:, 0]], axis=-1)
    # The columns are the semi-axes.
    axes = np.stack([turn * blobs.semi[:, :1], across * blobs.semi[:, 1:]], axis=-1)
    if camera == camera.ideal:
        center = camera.from_pixels(blobs.center)
        axes = axes / camera.focal[:, None]
        return Ellipses(center, axes @ axes.swapaxes(-1, -2), blobs.ring, np.arange(len(blobs)))
    angle = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    circle = np.stack([np.cos(angle), np.sin(angle)])
    pixels = blobs.center[:, None] + (axes @ circle).swapaxes(-1, -2)
    # The fit of the grey levels weights the outline evenly along its length: points are weighted by their arc length.
    speed = np.linalg.norm(axes @ np.stack([-circle[1], circle[0]]), axis=-2)
    outline = camera.from_pixels(pixels)
    usable = np.flatnonzero(np.isfinite(outline).all(axis=(-2, -1)))
    center, shape = _fit_ellipse(outline[usable], circle, speed[usable])
    return Ellipses(center, shape, blobs.ring[usable], usable)


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
