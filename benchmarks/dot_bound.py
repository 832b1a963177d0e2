"""Least standard deviation of a dot's center per axis in px, by the noise of its grey levels.

    python -m benchmarks.dot_bound

For disks seen from the front, of a contrast of 195 grey levels, a blur of 0.7 px and noise of 2 grey levels.
"""

import numpy as np

from markergen.maths.dot_crlb import center_covariance

CONTRAST, NOISE, BLUR_PX = 195, 2, 0.7

if __name__ == "__main__":
    for radius in (1.5, 4, 10):
        covariance = center_covariance(radius * np.eye(2), BLUR_PX, CONTRAST / NOISE)
        print(f"radius {radius:g} px: {np.sqrt(covariance[0, 0]):.4f} px")
