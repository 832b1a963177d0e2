"""What residuals beyond the noise of the photographs most likely come from."""

# tests: tests/calibration/test_noise.py

from dataclasses import replace

from scipy.stats import chi2 as chi2_distribution

from markergen.calibration.adjustment import Adjustment, attempt
from markergen.calibration.camera_choice import wider_lenses
from markergen.calibration.flexing import Flex
from markergen.calibration.judging import NotJudged

FACTOR, CHANCE = 2.0, 1e-3
"""chi2 per degree of freedom, and its probability by the noise alone, at which a model counts as wrong: photographs of
which camera and print are right have 0.9 to 1.4, those with a lens model that lacks a coefficient 7 and more."""

EXPLAINS = 0.5
"""Share of the excess of chi2 that a cause has to explain."""


def likely_cause(adjustment: Adjustment, flex: Flex | NotJudged) -> str:
    """Return what most likely is not as modeled; empty where residuals are as the noise explains, or dots were held.

    Larger lens models are tried in turn, the smallest one that explains the residuals is named.
    """
    factor, freedom = adjustment.variance_factor, adjustment.degrees_of_freedom
    network = adjustment.network
    if not network.free or freedom <= 0 or factor < FACTOR or chi2_distribution.sf(adjustment.chi2, freedom) > CHANCE:
        return ""
    for name, larger in wider_lenses(replace(network, cameras=adjustment.cameras)):
        fitted = attempt(larger, adjustment.views, adjustment.weights, adjustment.places)
        if fitted and factor - fitted.variance_factor > EXPLAINS * (factor - 1):
            camera = "the lens model is too small" if len(network.freedom) else "the camera is not quite the given one"
            return f"{camera}: with f, c, {name} free, chi2 falls to {fitted.variance_factor:.2g}"
    if isinstance(flex, Flex) and flex.bends:
        return "the print bends between the photographs"
    return "the photographs were processed (stabilized, rectified, sharpened) or taken in motion: no lens explains them"
