"""Results of detection: labeled dots with their pose, or dots without labels."""
# tests: tests/detect/test_photometric.py

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.pose import PoseEstimate


def _empty(*shape: int) -> Array:
    return np.zeros((0, *shape))


@dataclass(frozen=True, eq=False)
class Unlabeled:
    """Dots of a marker whose labels are ambiguous.

    Attributes
    ----------
    pixels : array (k, 2), px
        Images of the dots' centers in the image as taken, corrected with the pose or homography of the best-fitting
        labeling. Labelings that fit equally well predict the same outlines, so the correction is nearly the same; it
        may differ, by up to its own size, only between the two planar poses of a marker seen from afar.
    covariance, ellipse_centers : arrays (k, 2, 2), px^2, and (k, 2), px
        As in `Detection`.
    guess : array (k,) of int
        Ids of the control points by one of the labelings that fit: only what knows more, such as other photographs of
        the same print, can tell which of them is right.
    """

    pixels: Array
    covariance: Array
    ellipse_centers: Array
    guess: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Detection:
    """Detection of one marker in one image.

    Attributes
    ----------
    found : bool
        True if there are four or more control points with unique labels.
    ids : array (m,) of int
        Ids of the control points found, in the marker's order, or, for a rig, their numbers through its markers; empty
        if not found, like the other arrays.
    pixels : array (m, 2), px
        Images of the control points, in the image as taken: lens distortion included.
    covariance : array (m, 2, 2), px^2
        Covariance of `pixels`, from the image's noise.
    ellipse_centers : array (m, 2), px
        Centers of the dots' image ellipses, in the image as taken, from which `pixels` were corrected.
    homography : array (3, 3) or None
        Homography from the marker plane (m) to ideal px, those of `camera.ideal`; None for a marker with relief.
    pose : PoseEstimate or None
        Pose; None without a camera.
    reason : str
        Reason why the marker was not found; empty otherwise.
    marker : int
        Index among the markers that were looked for.
    rival : int or None
        Index of another marker that fits the same dots, if that is the reason.
    dropped : array (k,) of int
        Control points that were labeled, but lie farther from their predicted place than any error explains.
    tag : array (4, 2) in px, or None
        Corners of the marker's tag in the image as taken, in the order of `Tag.corners`; None if it was not read.
    unlabeled : Unlabeled or None
        The dots, if ambiguous labels are the reason; None otherwise.
    misfit : float, px
        RMS by which the dots miss the labeling's prediction: see `misfits`; inf if not found.
    checked : Detection or None
        If the marker was tracked: the detection in an earlier frame in which other labelings were last looked for. None
        if they were in this one.
    parts : tuple of Detection
        Those of the constellations that it was joined from, in their own frames, each with the number of its
        constellation as `marker`; empty for a marker that is one constellation.
    """

    found: bool
    ids: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    pixels: Array = field(default_factory=lambda: _empty(2))
    covariance: Array = field(default_factory=lambda: _empty(2, 2))
    ellipse_centers: Array = field(default_factory=lambda: _empty(2))
    homography: Array | None = None
    pose: PoseEstimate | None = None
    reason: str = ""
    marker: int = 0
    rival: int | None = None
    dropped: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    tag: Array | None = None
    unlabeled: Unlabeled | None = None
    misfit: float = float("inf")
    checked: "Detection | None" = None
    parts: "tuple[Detection, ...]" = ()
