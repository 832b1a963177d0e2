"""``none``: a pinhole camera."""
# tests: tests/contracts/test_lenses.py

from markergen.arrays import Array
from markergen.maths.lenses import LARGEST_RADIUS, LENSES, Coefficients, LensModel


class NoDistortion(LensModel):
    """s = 1: no distortion."""

    coefficients = ((),)
    opencv = True

    def map(self, x: Array, y: Array, coefficients: Coefficients) -> tuple[Array, Array]:
        """See `LensModel.map`."""
        del coefficients
        return x, y

    def domain_radius(self, coefficients: Coefficients) -> float:
        """See `LensModel.domain_radius`."""
        del coefficients
        return LARGEST_RADIUS


LENSES.register("none")(NoDistortion())
