"""Synthetic views of a marker, detected as a photo would be and held against the truth they were made from."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.detect import Detection, detect
from markergen.errors import InputError
from markergen.maths.projection import project
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.render import DEFAULT_OPTICS, Optics, render_view
from markergen.validate.metrics import statistics

Array = NDArray[np.float64]

WRONG_PX = 5.0
"""A detection with any dot farther than this from its true place carries a wrong label."""


@dataclass(frozen=True, eq=False)
class View:
    """One synthetic image, what was found in it, and what is true.

    Attributes
    ----------
    pose : int
        Index into the pose distribution.
    image : array (height, width) of uint8
    detection : Detection
    truth : array (n, 2), px
        Projected control points.
    """

    pose: int
    image: NDArray[np.uint8]
    detection: Detection
    truth: Array

    @property
    def error_px(self) -> Array:
        """Distances (n,) in px of the detected control points from the true ones; empty when not found."""
        return _distance(self.detection.pixels, self.truth)

    @property
    def uncorrected_px(self) -> Array:
        """The same (n,) for the centers of the image ellipses, before the correction."""
        return _distance(self.detection.ellipse_centers, self.truth)

    @property
    def wrong(self) -> bool:
        """Found, but with a wrong label."""
        return bool(np.any(self.error_px > WRONG_PX))

    @property
    def detected(self) -> bool:
        """Found, and right."""
        return self.detection.found and not self.wrong

    def png(self) -> bytes:
        """The image as PNG bytes with the detected control points and their ids drawn in."""
        from markergen.render.png import png

        return png(self.image, self.detection.pixels, [int(i) for i in self.detection.ids])


def take_views(
    marker: Marker,
    camera: Camera,
    poses: PoseDistribution,
    count: int = 20,
    seed: int = 0,
    optics: Optics = DEFAULT_OPTICS,
) -> Iterator[View]:
    """Render and detect `count` views, one pose drawn from each of `count` equal stretches of the distribution.

    Poses come again, with other noise, where the distribution has fewer than `count`.

    Raises
    ------
    InputError
        If count is below 1, a dot has no size, or the marker cannot be detected (see `label_dots`).
    """
    if count < 1:
        raise InputError("one view or more", f"views={count}", "ask for a positive number of views")
    if min(point.feature.diameter for point in marker.control_points) == 0:
        raise InputError("dots that can be seen", "a dot of diameter 0", "design the marker with --dot above 0")
    jitter = np.random.default_rng([seed, count]).random(count)
    for k, pose in enumerate(((np.arange(count) + jitter) * len(poses) / count).astype(int)):
        rotation, translation = poses.rotation[pose], poses.translation[pose]
        image = render_view(marker, camera, rotation, translation, optics, np.random.default_rng([seed, count, k]))
        truth = project(marker.xyz, rotation[None], translation[None], camera.matrix)[0]
        yield View(int(pose), image, detect(image, marker, camera), truth)


def validate_views(
    marker: Marker,
    camera: Camera,
    poses: PoseDistribution,
    count: int = 20,
    seed: int = 0,
    optics: Optics = DEFAULT_OPTICS,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Detect the marker in synthetic views (see `take_views`) and tell how often and how accurately it is found.

    Returns
    -------
    dict
        Plain JSON values: ``count``; ``detected``, found with right labels; ``wrong``, found with a wrong one;
        ``point_px`` and ``uncorrected_px``, statistics of the dots' errors in px with and without the correction of
        the ellipse centers, over the detected views; ``by_polar_angle`` with the same per angle and the ``rate`` of
        detection; ``failures``, the pose, its polar angle in degrees, its distance in m and the reason, of each other.
    """
    groups = {angle: _Tally() for angle in poses.by_polar_angle()}
    angle_of = {int(i): angle for angle, mask in poses.by_polar_angle().items() for i in np.flatnonzero(mask)}
    total, failures = _Tally(), []
    if progress:
        progress(0, count)
    for done, view in enumerate(take_views(marker, camera, poses, count, seed, optics), start=1):
        total.add(view)
        groups[angle_of[view.pose]].add(view)
        if not view.detected:
            failures.append(
                {
                    "pose": view.pose,
                    "polar_angle_deg": round(float(poses.polar_angle_deg[view.pose]), 2),
                    "distance": float(np.linalg.norm(poses.translation[view.pose])),
                    "reason": view.detection.reason or f"wrong label: a dot is {view.error_px.max():.1f} px off",
                }
            )
        if progress:
            progress(done, count)
    by_polar_angle = {
        angle: {**tally.as_dict(), "rate": tally.detected / tally.count}
        for angle, tally in groups.items()
        if tally.count
    }
    return {**total.as_dict(), "by_polar_angle": by_polar_angle, "failures": failures}


class _Tally:
    """Counts and errors of some views."""

    def __init__(self) -> None:
        self.count = self.detected = self.wrong = 0
        self._errors: list[Array] = []
        self._uncorrected: list[Array] = []

    def add(self, view: View) -> None:
        self.count += 1
        self.wrong += view.wrong
        if view.detected:
            self.detected += 1
            self._errors.append(view.error_px)
            self._uncorrected.append(view.uncorrected_px)

    def as_dict(self) -> dict[str, Any]:
        return {
            "count": self.count,
            "detected": self.detected,
            "wrong": self.wrong,
            "point_px": statistics(np.concatenate([np.zeros(0), *self._errors])),
            "uncorrected_px": statistics(np.concatenate([np.zeros(0), *self._uncorrected])),
        }


def _distance(pixels: Array, truth: Array) -> Array:
    return np.linalg.norm(pixels - truth, axis=-1) if len(pixels) else np.zeros(0)
