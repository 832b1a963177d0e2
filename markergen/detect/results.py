"""Results of detection: labeled dots with their pose, or dots without labels."""
# tests: tests/detect/test_detection.py

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markergen_detect import Verdict
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.estimators.weighted_pose import PoseEstimate


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
    """Detection of one marker or rig in one image.

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
    state, reason : str
        ``found``, or the kind of reason why not, and the reason in words.
    marker : int
        Index among the markers that were looked for.
    rival : int or None
        Index of another marker that fits the same dots, if that is the reason.
    dropped : array (k,) of int
        Control points that were labeled, but lie farther from their predicted place than any error explains.
    tag : array (4, 2) in px, or None
        Corners of the marker's tag in the image as taken, in the order of `Tag.corners`; None if it was not read.
    tag_state : str
        ``read``; ``none`` for a marker without one; or why it was not read.
    turns : array (k,), rad
        By which other labelings that are about as likely are turned about the marker's normal.
    unlabeled : Unlabeled or None
        The dots, if ambiguous labels are the reason; None otherwise.
    misfit : float, px
        RMS by which the dots miss their places; inf if not found.
    evidence : float
        Logarithm of the likelihood ratio of the labeling to clutter.
    verdict : Verdict or None
        Whether image, print and camera agree; None without a pose.
    track : object
        Where the detector looks for it in the next frame; None if it was not found.
    tracked : bool
        True if only the surroundings of where it was in the frame before were looked at.
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
    state: str = "found"
    tag_state: str = "none"
    turns: Array = field(default_factory=_empty)
    evidence: float = float("-inf")
    verdict: Verdict | None = None
    track: Any = None
    tracked: bool = False
