"""The image noise model: every dot weighs, in every pose, as much as its image tells about where it is.

A dot that is printed out of place counts as well: its covariance is that of the image plus that of the print.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.maths.dot_noise import directions, displaced, linearize
from markergen.model.spec import ImageNoise
from markergen.objectives.blocks import row_products, times_rows
from markergen.units import format_length

Array = NDArray[np.float64]
Pullback = Callable[[Array], Array]


@dataclass(frozen=True)
class DotNoise:
    """Dots of one diameter in m, the image that shows them, and how well they are printed.

    Attributes
    ----------
    diameter : float
    image : ImageNoise
    print_sigma : float
        Standard deviation in m of a dot's place along each axis of the marker plane.
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

    The image of a dot is, to first order, the affine image A = radius d(image)/d(X, Y) of the unit circle. Image and
    plane point move each other through J, J T = d(image)/d(X, Y) with a fixed T for every pose, so no other derivative
    than J is needed.

    Parameters
    ----------
    noise : DotNoise
    plane : array (P, k, 2)
        T.
    center : array (P, 2, k)
        J of the marker's origin; its dot's shape chooses the nodes of an integral, nothing else.
    """

    def __init__(self, noise: DotNoise, plane: Array, center: Array) -> None:
        self._noise = noise
        self._affine = plane * (noise.diameter / 2)
        # Of the print error, in radii: what A turns into pixels.
        self._out_of_place = noise.print_sigma / (noise.diameter / 2)
        self._nodes = directions(center @ self._affine)

    def __call__(self, jacobian: Array) -> tuple[Array, Pullback]:
        """W J, and how half of <S, d(J' W J)> is pulled back to J: from J S, S symmetric, to a cotangent of J."""
        affine = jacobian @ self._affine
        blocks = affine.reshape(*affine.shape[:-2], -1, 2, 2)
        weight, weight_pullback = self._weights(blocks)

        def pullback(turned: Array) -> Array:
            by_weight = 0.5 * row_products(turned, jacobian)
            by_affine = weight_pullback(by_weight).reshape(affine.shape)
            return times_rows(weight, turned) + by_affine @ self._affine.swapaxes(-1, -2)

        return times_rows(weight, jacobian), pullback

    def _weights(self, affine: Array) -> tuple[Array, Pullback]:
        """W (..., n, 2, 2) of dots with affine images A (..., n, 2, 2), and its pullback to A."""
        image = self._noise.image
        information, image_pullback = linearize(affine, image.edge_px, image.contrast_to_noise, self._nodes)
        if not self._out_of_place:
            return information, image_pullback
        weight, print_pullback = displaced(information, self._out_of_place * affine)

        def pullback(cotangent: Array) -> Array:
            by_information, by_displacement = print_pullback(cotangent)
            return image_pullback(by_information) + self._out_of_place * by_displacement

        return weight, pullback
