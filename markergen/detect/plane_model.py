"""Image model of dots in known planes: the pixels around their outlines, and their grey levels."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.edge_psf import BOXED, pixel_edge
from markergen.model.camera import Camera

Grey = NDArray[np.uint8] | NDArray[np.uint16]

_EDGE = 3.5
"""Half-width of an edge, in standard deviations of its blur: the width of ink that is used, and the minimum distance of
a pixel from other dots."""

_GROUND_PX, _INK_PX = 2.5, 1.0
"""Width of the strip used beyond an edge, on ground and ink. Both show the noise; the ground also shows how the light
changes across the dot, which otherwise would be mistaken for a shift."""

_BENT = 0.15
"""Maximum deviation of a dot's image from an ellipse, as a share of its half-width."""

_LEAST_HOLE = 0.1
"""Minimum share of a hole that remains, however far the ink has spread."""

_TINY = 1e-12

UNKNOWNS = 10
"""Unknowns of each dot: place (2), spread of the ink (1), S (3), light, dark, gradient of the light (2); see
`grey_levels`."""
PLACE, SPREAD, BLUR, LIGHT, DARK, SLOPE = slice(0, 2), 2, slice(3, 6), 6, 7, slice(8, 10)


@dataclass(frozen=True, eq=False)
class PredictedDot:
    """A predicted dot; places are in its plane, relative to its predicted center, in units of its radius.

    Attributes
    ----------
    plane : array (3, 3)
        Homogeneous mapping from places to normalized image coordinates.
    start : array (2,)
        Place where it was detected.
    hole : float
        Radius of the hole; 0 for disks.
    neighbors : array (k, 3)
        Places and radii of the marker's other dots.
    """

    plane: Array
    start: Array
    hole: float
    neighbors: Array

    def image(self, camera: Camera, place: Array) -> tuple[Array, Array]:
        """Return the image (2,) of a place (2,) in px as taken, and its derivative (2, 2) with respect to the place."""
        mapped = self.plane @ np.append(place, 1)
        normalized = mapped[:2] / mapped[2]
        derivative = (self.plane[:2, :2] - normalized[:, None] * self.plane[2, :2]) / mapped[2]
        return camera.to_pixels(normalized), camera.pixel_jacobian(normalized) @ derivative

    def rays(self, normalized: Array, from_pixel: Array) -> tuple[Array, Array, Array]:
        """Intersect rays (2, N) with the plane, and return `place`, `jacobian` and `fade` of `Surroundings`.

        from_pixel (2, 2, N) is the derivative of the normalized coordinates with respect to the pixel.
        """
        inverse = np.linalg.inv(self.plane)
        mapped = inverse[:, :2] @ normalized + inverse[:, 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            place, from_pixel = mapped[:2] / mapped[2], from_pixel / mapped[2]
        fade = np.einsum("j,jkN->kN", inverse[2, :2], from_pixel)
        return place, np.einsum("ij,jkN->ikN", inverse[:2, :2], from_pixel) - place[:, None] * fade, fade


@dataclass(frozen=True, eq=False)
class Surroundings:
    """N pixels around the outlines of dots, ordered by dot.

    Attributes
    ----------
    parts : list of slice
        The pixels of each dot.
    dot : array (N,) of int
    pixel : array (2, N) of int
        Column and row.
    place : array (2, N)
        Intersection of each pixel's ray with the dot's plane.
    jacobian : array (2, 2, N), 1/px
        Derivative of `place` with respect to the pixel in the image as taken.
    fade : array (2, N), 1/px
        Derivative of the logarithm of the plane's homogeneous coordinate with respect to the pixel.
    offset : array (2, N)
        Offset from the dot's center in the image, in half-widths of the dot.
    grey : array (N,)
        Relative to the level of places without light.
    hole : array (N,)
    """

    parts: list[slice]
    dot: NDArray[np.intp]
    pixel: NDArray[np.intp]
    place: Array
    jacobian: Array
    fade: Array
    offset: Array
    grey: Array
    hole: Array


def surroundings(
    image: Grey, camera: Camera, dots: Sequence[PredictedDot], blur: Array, unlit: float = 0.0
) -> Surroundings:
    """Gather the pixels near the outlines of one or more dots, except those near other dots' outlines.

    Parameters
    ----------
    blur : array (m,), px
        Standard deviation of each dot's edge.
    unlit : float
        Grey level of places without light.
    """
    edges = _EDGE * blur
    seen = [dot.image(camera, dot.start) for dot in dots]
    center = np.array([each[0] for each in seen])
    half_width = np.array([np.hypot(*each[1].T).max() for each in seen])
    candidates = [_candidates(image, dot, *each, edge) for dot, each, edge in zip(dots, seen, edges, strict=True)]
    # All at once: undoing the lens distortion takes about as long for one dot as for many.
    normalized = camera.from_pixels(np.concatenate(candidates).astype(float))
    from_pixel = _inverse(camera.pixel_jacobian(normalized).transpose(1, 2, 0))
    found, start = [], 0
    for dot, edge, pixels in zip(dots, edges, candidates, strict=True):
        part = slice(start, start + len(pixels))
        place, jacobian, fade = dot.rays(normalized[part].T, from_pixel[..., part])
        near = _near(dot, edge, place, jacobian)
        found.append((place[:, near], jacobian[..., near], fade[:, near], pixels[near].T))
        start = part.stop
    place, jacobian, fade, pixels = (np.concatenate(columns, axis=-1) for columns in zip(*found, strict=True))
    counts = [each[0].shape[1] for each in found]
    which = np.repeat(np.arange(len(dots)), counts)
    return Surroundings(
        parts=[slice(start, stop) for start, stop in pairwise(np.cumsum([0, *counts]).tolist())],
        dot=which,
        pixel=pixels,
        place=place,
        jacobian=jacobian,
        fade=fade,
        offset=(pixels - center[which].T) / half_width[which],
        grey=image[pixels[1], pixels[0]] - unlit,
        hole=np.array([dot.hole for dot in dots])[which],
    )


def _candidates(image: Grey, dot: PredictedDot, center: Array, derivative: Array, edge: float) -> NDArray[np.intp]:
    """Return columns and rows (k, 2) of all pixels in the band around the outline, and of some outside it."""
    half = np.hypot(derivative[:, 0], derivative[:, 1])
    # Lens and perspective bend the ellipse that the derivative at the center makes of the circle.
    margin = edge + _GROUND_PX + 1 + _BENT * half.max()
    size = np.array(image.shape[::-1])
    low = np.clip(np.floor(center - half - margin), 0, size).astype(int)
    high = np.clip(np.ceil(center + half + margin) + 1, 0, size).astype(int)
    x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    pixels = np.stack([x.ravel(), y.ravel()])
    back = np.asarray(np.linalg.inv(derivative), dtype=float)
    rho, steepness = _radial(back @ (pixels - center[:, None]), back[:, :, None])
    near = (rho - 1 < margin * steepness) & (rho - (dot.hole or 1) > -margin * steepness)
    return pixels[:, near].T


def _near(dot: PredictedDot, edge: float, place: Array, jacobian: Array) -> NDArray[np.bool_]:
    """Return which places (2, N) are near this outline alone, with edges `edge` px wide to either side."""
    with np.errstate(invalid="ignore"):
        rho, steepness = _radial(place - dot.start[:, None], jacobian)
        near = (rho - 1 > -(edge + _INK_PX) * steepness) & (rho - 1 < (edge + _GROUND_PX) * steepness)
        if dot.hole:
            near |= np.abs(rho - dot.hole) < edge * steepness
        for x, y, radius in dot.neighbors[np.hypot(*dot.neighbors[:, :2].T) < 2 * (1 + dot.neighbors[:, 2])]:
            rho, steepness = _radial(place - [[x], [y]], jacobian)
            near &= rho - radius > edge * steepness
    return near


def _radial(offset: Array, jacobian: Array) -> tuple[Array, Array]:
    """Return the distance rho (N,) of places (2, N) from a center, and |grad rho| (N,) with respect to the pixel."""
    rho = np.maximum(np.hypot(offset[0], offset[1]), _TINY)
    gradient = (offset[:, None] * jacobian).sum(axis=0) / rho
    return rho, np.hypot(gradient[0], gradient[1])


def _inverse(matrices: Array) -> Array:
    """Invert matrices (2, 2, N), in a tenth of the time that the general routine takes."""
    (a, b), (c, d) = matrices
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.array([[d, -b], [-c, a]]) / (a * d - b * c)


def grey_levels(state: Array, pixels: Surroundings) -> tuple[Array, Array, Array]:
    """Evaluate the model of the grey levels, with F the normal distribution and e the outward distance in px.

        grey = (1 + g'x) [light - (light - dark) (F(-e/s) - F(-e_hole/s))],    e = (rho - 1 - w) / |grad rho|

    rho is the distance from the dot's center in radii, its gradient is with respect to the pixel in the image as taken.
    Two terms are added to e: second-order perspective, without which the near and the far edge are both off toward the
    same side, by 0.002 px; and s^2/2 times the curvature, the retreat of a blurred edge. s^2 = n'Sn along the edge's
    normal n, since a moving camera blurs only along its motion. w is the spread of the ink, by which disks grow and
    holes shrink, g the gradient of the light. All unknowns but place and g are even about the center, so neither
    estimating them nor errors of the modeled point spread degrade the center.

    Parameters
    ----------
    state : array (m, 10)
        place (2), w, S (11, 12, 22) in px^2, light, dark, g (2)

    Returns
    -------
    grey : array (N,)
    jacobian : array (10, N)
        Derivatives by the unknowns of the pixel's dot.
    edge : array (N,)
        Slope of the edge's profile, as a share of its maximum.
    """
    from scipy.special import ndtr

    place_x, place_y, spread, s11, s12, s22, light, dark, slope_x, slope_y = state.T[:, pixels.dot]
    x, y = pixels.place[0] - place_x, pixels.place[1] - place_y
    rho = np.maximum(np.hypot(x, y), _TINY)
    x, y = x / rho, y / rho
    (j11, j12), (j21, j22) = pixels.jacobian
    u, v = x * j11 + y * j21, x * j12 + y * j22
    steepness = np.hypot(u, v)
    u, v = u / steepness, v / steepness
    blur_square = s11 * u * u + 2 * s12 * u * v + s22 * v * v
    blur = np.sqrt(blur_square)
    fade = pixels.fade[0] * u + pixels.fade[1] * v
    # The pixel's square has a fourth cumulant along the normal, -(u^4 + v^4)/120 = -(1 - 2 u^2 v^2)/120, and a Gaussian
    # none; Edgeworth's series has it over 24. That suffices unless the pixel is most of the blur.
    peak = (1 - 2 * (u * v) ** 2) / (2880 * np.sqrt(2 * np.pi) * blur_square**2)
    # Curvature of the image of the circle through the pixel, times its rho.
    bend = (j11 * j22 - j12 * j21) ** 2 / (steepness**2 * steepness)

    boxed = blur < BOXED
    ink, edge = np.zeros_like(rho), np.zeros_like(rho)
    by_distance, by_spread, by_blur = np.zeros_like(rho), np.zeros_like(rho), np.zeros_like(rho)
    for sign, where in ((1.0, slice(None)), (-1.0, np.flatnonzero(pixels.hole))):
        hole = pixels.hole[where]
        radius = 1 + spread[where] if sign > 0 else np.maximum(hole - spread[where], _LEAST_HOLE * hole)
        distance = (rho[where] - radius) / steepness[where]
        distance -= fade[where] * distance**2
        # Where the curve is no wider than the blur, the law of small retreats exaggerates.
        retreat = 0.5 * blur[where] * bend[where] / radius
        distance += blur[where] * retreat / (1 + retreat)
        depth = -distance / blur[where]
        profile = np.exp(-0.5 * depth**2)
        density = sign * profile / (np.sqrt(2 * np.pi) * blur[where])
        share = ndtr(depth) + peak[where] * depth * (depth**2 - 3) * profile
        change = -density * depth
        sharp = np.flatnonzero(boxed[where])
        if len(sharp):
            normal, own = (u[where][sharp], v[where][sharp]), blur[where][sharp]
            share[sharp], slope, by_square = pixel_edge(-distance[sharp], normal, own)
            density[sharp], change[sharp] = sign * slope, 2 * sign * own * by_square
        ink[where] += sign * share
        edge[where] = np.maximum(edge[where], profile)
        by_distance[where] -= density
        by_spread[where] += sign * density / steepness[where]
        by_blur[where] += change
    contrast = light - dark
    shade = 1 + slope_x * pixels.offset[0] + slope_y * pixels.offset[1]
    flat = light - contrast * ink
    # The change of gradient and retreat with the unknowns affects only the path to the solution, and is neglected.
    by_place = shade * contrast * by_distance / steepness
    by_square = -0.5 * shade * contrast * by_blur / blur
    jacobian = np.stack(
        [
            by_place * x,
            by_place * y,
            -shade * contrast * by_spread,
            by_square * u * u,
            2 * by_square * u * v,
            by_square * v * v,
            shade * (1 - ink),
            shade * ink,
            pixels.offset[0] * flat,
            pixels.offset[1] * flat,
        ]
    )
    return shade * flat, jacobian, edge
