"""``fov``: the field-of-view model of Devernay & Faugeras (2001), as in Kalibr and ROS."""

import numpy as np

from markergen.maths.lenses import Array, Coefficients, RadialModel


class FieldOfView(RadialModel):
    """s = atan(2 r tan(w/2)) / (w r)."""

    coefficients = (("w",),)
    aliases = ("field_of_view",)

    def scale(self, square: Array, coefficients: Coefficients) -> Array:
        """See `RadialModel.scale`."""
        (w,) = coefficients
        steep, radius = 2 * np.tan(w / 2), np.sqrt(square)
        nearby = square < 1e-12
        grown = np.where(nearby, steep - steep**3 * square / 3, np.arctan(steep * radius) / np.where(nearby, 1, radius))
        return grown / w


FOV = FieldOfView()
