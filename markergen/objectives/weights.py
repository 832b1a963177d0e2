"""The image noise model: every dot weighs, in every pose, as much as its image tells about where it is."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.maths.dot_noise import directions, linearize
from markergen.model.image_noise import ImageNoise
from markergen.objectives.blocks import row_products, times_rows
from markergen.units import format_length

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DotNoise:
    """Dots of one diameter in m, and the image that shows them."""

    diameter: float
    image: ImageNoise = ImageNoise()  # noqa: RUF009  (frozen, so it can be shared)

    def __str__(self) -> str:
        return f"the image noise of {format_length(self.diameter)} dots ({self.image})"


class DotWeights:
    """Weights of the rows of a Jacobian J (..., P, 2n, k) of image points: the Fisher information of the dots' centers.

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
        self._nodes = directions(center @ self._affine)

    def __call__(self, jacobian: Array) -> tuple[Array, Callable[[Array], Array]]:
        """W J, and how half of <S, d(J' W J)> is pulled back to J: from J S, S symmetric, to a cotangent of J."""
        image = self._noise.image
        affine = jacobian @ self._affine
        blocks = affine.reshape(*affine.shape[:-2], -1, 2, 2)
        weight, weight_pullback = linearize(blocks, image.edge_px, image.contrast_to_noise, self._nodes)

        def pullback(turned: Array) -> Array:
            by_weight = 0.5 * row_products(turned, jacobian)
            by_affine = weight_pullback(by_weight).reshape(affine.shape)
            return times_rows(weight, turned) + by_affine @ self._affine.swapaxes(-1, -2)

        return times_rows(weight, jacobian), pullback
