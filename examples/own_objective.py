"""Define an objective in ten lines, with autograd: the error along the line of sight, not in all directions.

python examples/own_objective.py 6
"""

import sys

import autograd.numpy as np

import markergen as mg
from markergen.objectives import OBJECTIVES, Criterion
from markergen.objectives.autograd import Array, AutogradObjective


@OBJECTIVES.register("depth")
class Depth(AutogradObjective):
    """Standard deviation in m of the distance to the camera, RMS over the poses."""

    unit = "m"
    criterion = Criterion("depth_m", "depth mm", factor=1e3)

    def values(self, points: Array) -> Array:
        """Return the sixth standard deviation (B, P) of the pose: translation along the optical axis."""
        return np.sqrt(self.covariance(points)[..., 5, 5])


def main(n: int) -> None:
    """Design n dots with it and with the default objective, for a camera off to one side."""
    for objective in ("depth", "pose"):
        design = mg.design(n=n, dot="20mm", poses="cone:tilt=40..70,azimuth=-30..30,count=100", objective=objective)
        print(f"{objective:>6}: depth to {1e3 * design.criteria['design']['depth_m']:.2f} mm for 1 px of noise")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
