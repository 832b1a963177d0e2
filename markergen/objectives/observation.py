"""Observation model of dots: converts Jacobians from undistorted to distorted image points, and weights them.

A Jacobian has two rows per image point, on which 2x2 blocks act.

**Lens.** With x the normalized coordinates of a point and x' = d(x) the distorted ones, the two rows of an image point
are multiplied by D(x) = diag(f) d'(x) diag(1/f).

**Image noise.** Every dot is weighted, in every pose, by the information that its image gives about its center. Print
errors count as well: a dot's covariance is the sum of those of image and print.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array
from markergen.maths.distortion import distortion_hessian
from markergen.maths.dot_crlb import directions, displaced_center, linearize, product
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import NO_DISTORTION, Camera
from markergen.model.poses import PoseDistribution
from markergen.model.spec import ImageNoise
from markergen.units import format_length

Pullback = Callable[[Array], Array]
LensPullback = Callable[[Array], tuple[Array, Array]]


def in_pairs(rows: Array) -> Array:
    """Reshape rows (..., 2n, k) to (..., n, 2, k)."""
    return rows.reshape(*rows.shape[:-2], -1, 2, rows.shape[-1])


def times_rows(blocks: Array, rows: Array) -> Array:
    """Multiply rows (..., 2n, k) by blocks (..., n, 2, 2) from the left."""
    return product(blocks, rows.reshape(*blocks.shape[:-1], rows.shape[-1])).reshape(rows.shape)


def row_products(left: Array, right: Array) -> Array:
    """Diagonal blocks (..., n, 2, 2) of left right', for rows (..., 2n, k)."""
    return np.einsum("...ik,...jk->...ij", in_pairs(left), in_pairs(right))


def lens_blocks(camera: Camera, normalized: Array) -> Array:
    """D (..., 2, 2) at normalized coordinates (..., 2); nan outside the domain of the lens model."""
    return camera.pixel_jacobian(normalized) / camera.focal


def through_lens(jacobian: Array, points: Array, camera: Camera, poses: PoseDistribution) -> Array:
    """Convert rows (..., P, 2n, k) from undistorted to distorted px, for points (..., n, 2 or 3) in m."""
    if camera.distortion == NO_DISTORTION:
        return jacobian
    normalized = perspective(to_camera(points, poses.rotation, poses.translation))
    return times_rows(lens_blocks(camera, normalized), jacobian)


def linearize_lens(
    jacobian: Array, points: Array, camera: Camera, poses: PoseDistribution
) -> tuple[Array, LensPullback]:
    """`through_lens`, and its pullback.

    The pullback maps a cotangent C of the distorted rows to that of the undistorted ones, and to the gradient
    (..., P, n, 2 or 3) with respect to the points through D alone, <C, dD J>.
    """
    seen = to_camera(points, poses.rotation, poses.translation)
    normalized = perspective(seen)
    blocks = lens_blocks(camera, normalized)

    def pullback(cotangent: Array) -> tuple[Array, Array]:
        distortion, focal = camera.distortion, camera.focal
        hessian = distortion_hessian(distortion.model, normalized, distortion.coefficients)
        by_block = row_products(cotangent, jacobian) * (focal[:, None] / focal)
        lateral = np.einsum("...ij,...ijk->...k", by_block, hessian) / seen[..., 2:]
        axial = -np.sum(lateral * normalized, axis=-1, keepdims=True)
        by_points = np.concatenate([lateral, axial], axis=-1) @ poses.rotation[:, :, : points.shape[-1]]
        return times_rows(blocks.swapaxes(-1, -2), cotangent), by_points

    return times_rows(blocks, jacobian), pullback


@dataclass(frozen=True)
class DotNoise:
    """Noise of dots of one diameter in m, from image and print.

    Attributes
    ----------
    print_sigma : float
        Standard deviation in m of a dot's position along each axis of the marker plane.
    """

    diameter: float
    image: ImageNoise = ImageNoise()  # noqa: RUF009  (frozen, so it can be shared)
    print_sigma: float = 0.0

    def __str__(self) -> str:
        printed = f" and a print error of {format_length(self.print_sigma)}" if self.print_sigma else ""
        return f"the image noise of {format_length(self.diameter)} dots ({self.image}){printed}"


class DotWeights:
    """Weights of the rows of a Jacobian J (..., P, 2n, k) of image points: the Fisher information of the dots' centers.

    With a print error, the inverse of image plus print covariance, (F^-1 + sigma^2 A A' / radius^2)^-1.

    The image of a dot is, to first order, the affine image A = radius d(image)/d(X, Y) of the unit circle. J contains
    that derivative as well, J T = d(image)/d(X, Y) with a fixed T for every pose, so no other derivative is needed.

    Parameters
    ----------
    plane : array (P, k, 2)
        T.
    center : array (P, 2, k)
        J of the marker's origin; the image shape of a dot there only determines the nodes of an integral.
    """

    def __init__(self, noise: DotNoise, plane: Array, center: Array) -> None:
        self._noise = noise
        self._affine = plane * (noise.diameter / 2)
        # Print error in dot radii, which A converts to pixels.
        self._out_of_place = noise.print_sigma / (noise.diameter / 2)
        self._nodes = directions(center @ self._affine)

    def __call__(self, jacobian: Array) -> tuple[Array, Pullback]:
        """W J, and the pullback of half of <S, d(J' W J)>, S symmetric: from J S to a cotangent of J."""
        affine = jacobian @ self._affine
        blocks = affine.reshape(*affine.shape[:-2], -1, 2, 2)
        weight, weight_pullback = self._weights(blocks)

        def pullback(cotangent: Array) -> Array:
            by_weight = 0.5 * row_products(cotangent, jacobian)
            by_affine = weight_pullback(by_weight).reshape(affine.shape)
            return times_rows(weight, cotangent) + by_affine @ self._affine.swapaxes(-1, -2)

        return times_rows(weight, jacobian), pullback

    def _weights(self, affine: Array) -> tuple[Array, Pullback]:
        """W (..., n, 2, 2) of dots with affine images A (..., n, 2, 2), and its pullback to A."""
        image = self._noise.image
        information, image_pullback = linearize(affine, image.edge_px, image.contrast_to_noise, self._nodes)
        if not self._out_of_place:
            return information, image_pullback
        weight, print_pullback = displaced_center(information, self._out_of_place * affine)

        def pullback(cotangent: Array) -> Array:
            by_information, by_displacement = print_pullback(cotangent)
            return image_pullback(by_information) + self._out_of_place * by_displacement

        return weight, pullback
