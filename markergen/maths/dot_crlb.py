"""CRLB of a dot's center in an image, from the Fisher information of the grey levels.

A dark ellipse {c + A u, |u| <= 1} on a light background is imaged through a Gaussian point spread function (lens and
pixel together) of standard deviation s, with white noise of sigma grey levels. Moving the center changes the image by
the gradient of the blurred ellipse, so the information about the center is its square, summed over the pixels:

    I = (contrast/sigma)^2 integral of g g', g = grad(ellipse * PSF)

Ellipse and image are symmetric about the center: g is odd, while the derivatives with respect to blur, grey levels,
size and shape are even, so not knowing these costs nothing. In the frequency domain the integral over the radius is
Weber's second exponential integral, which leaves an integral over the direction k of the frequency, |k| = 1:

    I = (contrast/sigma)^2 det(Q)/(4 s^4) integral k k' f(z) dk,  Q = A A',  z = k'Qk / (2 s^2),  f(z) = exp(-z) I1(z)/z

sqrt(k'Qk) is the ellipse's half-width along k. For edges far apart, z >> 1, this is the line integral over the outline
(contrast/sigma)^2 / (2 sqrt(pi) s) closed integral n n' dl known for straight edges. Example: 0.003 px along each axis
for a dot of 10 px radius, 195 grey levels of contrast, 2 of noise and 0.7 px of blur.

Only the outer edge of a ring counts: a fit that gives the hole its own center, as perspective requires, gains no
information from the inner edge.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array

DIRECTIONS = 8
"""Number of directions over half a turn; the integral is then good to 3e-4 for an axis ratio of 1:3 (tilt of 70 deg)
and to 4e-3 for 1:5."""


@dataclass(frozen=True, eq=False)
class Directions:
    """Nodes of the integral over the direction k.

    Attributes
    ----------
    squares : array (..., 3, N)
        (kx^2, 2 kx ky, ky^2); the product with (Qxx, Qxy, Qyy) is k'Qk.
    weights : array (..., N)
    """

    squares: Array
    weights: Array


def directions(affine: Array, count: int = DIRECTIONS) -> Directions:
    """Integration nodes for ellipses shaped roughly like the affine images A (..., 2, 2) of the unit circle.

    Uniform steps of k crowd on the sides of a long ellipse, uniform steps along its outline at its ends. Halfway
    between, with k proportional to Q^(-1/4) v and v in uniform steps, half as many steps suffice.
    """
    shape = _root(_root(affine @ affine.swapaxes(-1, -2)))
    # Midpoints: for a periodic integrand as accurate as any rule with as many nodes.
    angle = np.pi * (np.arange(count) + 0.5) / count
    cosine, sine = np.cos(angle), np.sin(angle)
    # The adjugate replaces the inverse, since k is normalized anyway.
    x = shape[..., 1, 1, None] * cosine - shape[..., 0, 1, None] * sine
    y = shape[..., 0, 0, None] * sine - shape[..., 0, 1, None] * cosine
    square = x**2 + y**2
    determinant = shape[..., 0, 0] * shape[..., 1, 1] - shape[..., 0, 1] ** 2
    squares = np.stack([x**2, 2 * x * y, y**2], axis=-2) / square[..., None, :]
    return Directions(squares, determinant[..., None] / square * (2 * np.pi / count))


def center_information(affine: Array, edge_px: float, contrast_to_noise: float) -> Array:
    """Fisher information (..., 2, 2) in px^-2 of dot centers.

    Parameters
    ----------
    affine : array (..., 2, 2), px
        A, the affine image of the unit circle: its singular values are the semi-axes of the dot's image.
    edge_px : float
        Standard deviation s of the point spread function, px; with the area of the pixel, s^2 = blur^2 + 1/12.
    contrast_to_noise : float
        Contrast between dot and background over the noise, both in grey levels; the noise includes rounding (variance
        1/12).
    """
    return linearize(affine[..., None, :, :], edge_px, contrast_to_noise, directions(affine))[0][..., 0, :, :]


def center_covariance(affine: Array, edge_px: float, contrast_to_noise: float) -> Array:
    """CRLB (..., 2, 2) in px^2 of dot centers, see `center_information`; nan or inf for dots seen edge-on."""
    a, b, _, d = np.moveaxis(
        center_information(affine, edge_px, contrast_to_noise).reshape(*affine.shape[:-2], 4), -1, 0
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([d, -b, -b, a], axis=-1).reshape(affine.shape) / (a * d - b * b)[..., None, None]


def dot_covariance(
    semi: Array, angle: Array, edge_px: float, contrast: float, noise_grey: float, lens: Array | None = None
) -> Array:
    """CRLB (..., 2, 2) in px^2 of dot centers, given their image ellipses.

    Parameters
    ----------
    semi : array (..., 2), px, longest first
    angle : array (...), rad
        Angle of the longest axis from x.
    edge_px, contrast, noise_grey : float
        See `center_information`; contrast and noise in grey levels.
    lens : array (..., 2, 2) or None
        Derivative of the distorted image, to which noise and blur apply, with respect to the image of the ellipses.

    Returns
    -------
    array (..., 2, 2)
        nan where the ellipse is nan (dot not visible).
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(*np.shape(angle), 2, 2)
    affine = rotation * semi[..., None, :]
    return center_covariance(affine if lens is None else lens @ affine, edge_px, contrast / noise_grey)


def linearize(
    affine: Array, edge_px: float, contrast_to_noise: float, nodes: Directions
) -> tuple[Array, Callable[[Array], Array]]:
    """`center_information` (..., m, 2, 2) of m dots that share their nodes (...), and its pullback.

    The pullback maps symmetric cotangents (..., m, 2, 2) to the gradient (..., m, 2, 2) of sum(cotangent * information)
    with respect to A, with the nodes held fixed: it is the exact derivative of the sum over the nodes.
    """
    a, b, c, d = (affine[..., i, j] for i in (0, 1) for j in (0, 1))
    shape = np.stack([a * a + b * b, a * c + b * d, c * c + d * d], axis=-1)
    determinant = a * d - b * c
    z = shape @ nodes.squares / (2 * edge_px**2)
    level, slope = _radial(z)
    # det(Q) is the square of det(A).
    scale = (contrast_to_noise * determinant / (2 * edge_px**2)) ** 2
    transposed = nodes.squares.swapaxes(-1, -2)
    weights = nodes.weights[..., None, :]
    packed = (level * weights) @ transposed * [1.0, 0.5, 1.0] * scale[..., None]
    information = packed[..., [0, 1, 1, 2]].reshape(affine.shape)

    def pullback(cotangent: Array) -> Array:
        along = np.stack(
            [cotangent[..., 0, 0], 0.5 * (cotangent[..., 0, 1] + cotangent[..., 1, 0]), cotangent[..., 1, 1]], axis=-1
        )
        # Derivatives through Q in z, and through the factor det(A)^2.
        by_z = slope * weights * (along @ nodes.squares)
        xx, xy, yy = np.moveaxis(by_z @ transposed * [1.0, 0.5, 1.0] * (scale / edge_px**2)[..., None], -1, 0)
        share = 2 * np.sum(along * packed * [1.0, 2.0, 1.0], axis=-1) / determinant
        gradient = [xx * a + xy * c + share * d, xx * b + xy * d - share * c]
        gradient += [xy * a + yy * c - share * b, xy * b + yy * d + share * a]
        return np.stack(gradient, axis=-1).reshape(affine.shape)

    return information, pullback


def displaced_center(information: Array, displacement: Array) -> tuple[Array, Callable[[Array], tuple[Array, Array]]]:
    """Information W (..., 2, 2) of dots that are themselves displaced, W = (F^-1 + B B')^-1, and its pullback.

    Adjugates, written adj, avoid F^-1: W = (F + det(F) adj(P)) / det(1 + F P), P = B B'.

    Parameters
    ----------
    information : array (..., 2, 2), px^-2
        F, Fisher information from the images of the dots.
    displacement : array (..., 2, 2), px
        B, image of a displacement by one standard deviation along each axis of the plane.

    Returns
    -------
    array, function
        The pullback maps symmetric cotangents (..., 2, 2) of W to those of F and of B.
    """
    spread = product(displacement, displacement.swapaxes(-1, -2))
    share = product(information, spread)
    whole = 1 + share[..., 0, 0] + share[..., 1, 1] + _determinant(information) * _determinant(spread)
    weight = (information + _determinant(information)[..., None, None] * _adjugate(spread)) / whole[..., None, None]

    def pullback(cotangent: Array) -> tuple[Array, Array]:
        # dW = U dF U' - W dP W with U = W F^-1 = (1 + F P)^-1.
        inverse = (np.eye(2) + _adjugate(share)) / whole[..., None, None]
        by_information = product(product(inverse.swapaxes(-1, -2), cotangent), inverse)
        return by_information, -2 * product(product(product(weight, cotangent), weight), displacement)

    return weight, pullback


def product(left: Array, right: Array) -> Array:
    """Product (..., 2, k) of many blocks (..., 2, 2) and (..., 2, k), as explicit sums: a third of matmul's time."""
    out = np.empty(np.broadcast_shapes(left.shape[:-2], right.shape[:-2]) + (2, right.shape[-1]))
    for i in (0, 1):
        np.multiply(left[..., i, :1], right[..., 0, :], out=out[..., i, :])
        out[..., i, :] += left[..., i, 1:] * right[..., 1, :]
    return out


def _determinant(matrix: Array) -> Array:
    return matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]


def _adjugate(matrix: Array) -> Array:
    """Inverse (..., 2, 2) times the determinant."""
    a, b, c, d = (matrix[..., i, j] for i in (0, 1) for j in (0, 1))
    return np.stack([d, -b, -c, a], axis=-1).reshape(matrix.shape)


def _radial(z: Array) -> tuple[Array, Array]:
    """exp(-z) I1(z)/z and its derivative, to 1.6 % (to 0.6 % for half-widths above 2 s, to 0.05 % above 4 s).

    f = (z^4 + z^3 + z^2 + c z + d)^(-3/8) / sqrt(2 pi). The first three terms match the asymptotic series; c and d
    minimize the largest error over z > 0. The Bessel function itself takes twenty times as long as all else here.
    """
    # A quartic to the power of -3/8 has the limits of the function: 1/2 at 0, to 1.6 %, and (2 pi z^3)^-1/2 far out.
    quartic = (((z + 1) * z + 1) * z + 1.9317) * z + 0.5250
    root = np.sqrt(np.sqrt(np.sqrt(quartic)))
    level = 1 / (np.sqrt(2 * np.pi) * root**3)
    return level, -0.375 * level * (((4 * z + 3) * z + 2) * z + 1.9317) / quartic


def _root(matrix: Array) -> Array:
    """Square root of symmetric positive 2x2 matrices (..., 2, 2): (M + sqrt(det M)) / sqrt(tr M + 2 sqrt(det M))."""
    a, b, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    determinant = np.sqrt(np.maximum(a * d - b * b, 0.0))
    return (matrix + determinant[..., None, None] * np.eye(2)) / np.sqrt(a + d + 2 * determinant)[..., None, None]
