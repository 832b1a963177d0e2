"""The result of a calibration: the print as measured, the camera, and how well both are known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.calibrate.adjustment import Adjustment
from markergen.calibrate.sightings import Sightings
from markergen.model.camera import Camera
from markergen.model.marker import Marker

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """Expected pose error over the working volume, RMS over its poses, to first order.

    Attributes
    ----------
    rotation_deg, translation : float, deg and m
    image, print, camera : (rotation_deg, translation)
        Contributions of each source.
    """

    rotation_deg: float
    translation: float
    image: tuple[float, float]
    print: tuple[float, float]
    camera: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Calibration:
    """A print measured by photographs, and the camera.

    Attributes
    ----------
    designs : tuple of Marker
        Markers as given.
    markers : tuple of Marker
        Measured markers: dots at their places with the joint covariance, in the frame of the design.
    camera : Camera
        Camera as given, or as calibrated.
    camera_covariance : array (k, k) or None
        Covariance of its parameters; None if it was taken as exact.
    estimated : tuple of str
        Names of the camera parameters that the photographs determined; empty if it was given.
    sightings : Sightings
    adjustment : Adjustment
    dropped : array (v, n) of bool
        Dots rejected as outliers, in the views of `sightings`.
    before, after : ExpectedError
        Expected pose error with the print as designed and as measured.
    scale_source : str
        What the scale of the print comes from, as a sentence.
    notes : tuple of str
        Warnings, as sentences.
    """

    designs: tuple[Marker, ...]
    markers: tuple[Marker, ...]
    camera: Camera
    camera_covariance: Array | None
    estimated: tuple[str, ...]
    sightings: Sightings
    adjustment: Adjustment
    dropped: NDArray[np.bool_]
    before: ExpectedError
    after: ExpectedError
    scale_source: str
    notes: tuple[str, ...]
