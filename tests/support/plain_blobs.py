"""Blobs of which only places, sizes and kinds matter."""

import numpy as np

from markergen.detect.blobs import Blobs


def plain_blobs(center, semi, angle, ring, covariance):
    """Return blobs fitted to black on white, slightly blurred."""
    count = len(center)
    levels = (np.full(count, each) for each in (225.0, 30.0, 0.8))
    return Blobs(center, semi, angle, ring, covariance, *levels, np.where(ring, 1.0, 0.0), np.ones(count, dtype=bool))
