"""Tests of single observations of an adjustment, and what they notice (Baarda 1968)."""
# tests: tests/bounds/test_reliability.py

import numpy as np

from markergen.arrays import Array

RISK, POWER = 0.001, 0.8
"""Probabilities that the test suspects a right dot, and that it suspects a wrong one; geodesists' usual values."""


def noncentrality() -> float:
    """Square lambda of a dot's displacement, in its standard deviations, that the test notices: about 20.

    The test statistic of a dot, v' Q^-1 v of its residual v with covariance Q, has a chi-square distribution with two
    degrees of freedom, noncentral by lambda if the dot is displaced.
    """
    from scipy.special import chndtrinc

    return float(chndtrinc(-2 * np.log(RISK), 2, 1 - POWER))


def detectability(shares: Array, covariance: Array, plane: Array) -> Array:
    """K (..., n, 2, 2): a displacement g in m of a dot in the plane has the noncentrality g' K g.

    With F = J' W J the information of the dot, C = (sum F)^-1, and S = J T the derivative of its image by its place,
    the residual of the displaced dot has the noncentrality (S g)' (W - W J C J' W) (S g), so

        K = T' (F - F C F) T.

    Parameters
    ----------
    shares : array (..., n, 6, 6)
        F.
    covariance : array (..., 1, 6, 6)
        C.
    plane : array (..., 1, 6, 2)
        T, see `TraceObjective`.
    """
    # Also for arrays of autograd.
    return np.swapaxes(plane, -1, -2) @ (shares - shares @ covariance @ shares) @ plane
