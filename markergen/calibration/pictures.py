"""What the pixels of photographs tell beside their dots: which are copies of another, and how wide dots are.

Two photographs from one place have the same dots, but noise of their own. A copy has that of its original, also if it
was encoded again, which may remove some of it: over plain areas, the covariance of the two images' differences of
neighbors is then about the smaller one of their variances, and 0 for two photographs.
"""

from collections.abc import Callable, Sequence
from typing import Any

import markergen_detect
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from markergen.arrays import Array, Indices, Mask
from markergen.calibration.network import Views
from markergen.maths.conics import outlines
from markergen.model.camera import Camera
from markergen.model.marker import Marker

ALIKE_PX, SAME_PLACE_PX = 0.5, 2.0
"""Distance up to which the dots of copies are apart, and of photographs from one place, such as a tripod: lens and
print err in them alike, so that one tells nothing of the other."""

COPY, PLAIN = 0.5, 4.0
"""Share of the smaller variance from which noise is the same; multiple of the usual difference of neighbors from which
on there is an edge."""

WIDER, ALL = 0.15, 3
"""Share by which a dot's diameter has to be off, relative to the others, in all of so many photographs."""


def same_noise(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Return whether two grey images (h, w) of one scene have the same noise."""
    rows = [np.diff(image.astype(float), axis=1) for image in (first, second)]
    plain = np.logical_and.reduce([np.abs(row) <= PLAIN * np.median(np.abs(row)) + 1 for row in rows])
    a, b = (row[plain] for row in rows)
    least = min(float(a.var()), float(b.var()))
    return bool(np.array_equal(first, second) or (least > 0 and float(np.mean(a * b)) > COPY * least))


def stations(views: Views, photo: Indices, within: float = SAME_PLACE_PX) -> dict[int, int]:
    """Return the first photograph with dots as near as this, px, to those of each that is not the first itself."""
    first_of: dict[int, int] = {}
    numbers = np.unique(photo).tolist()
    sides = {number: views.take(photo == number) for number in numbers}
    for k, second in enumerate(numbers):
        for first in numbers[:k]:
            if first in first_of or len(sides[first]) != len(sides[second]):
                continue
            seen = sides[first].seen & sides[second].seen
            apart = np.abs(sides[first].pixels - sides[second].pixels).max(axis=-1)
            if seen.any() and apart[seen].max() < within:
                first_of[second] = first
                break
    return first_of


def copies(views: Views, photo: Indices, grey: Callable[[int], NDArray[Any]]) -> dict[int, int]:
    """Return which photographs are copies, each with the one that it is a copy of.

    Parameters
    ----------
    photo : array (v,) of int
        Photograph of each view.
    grey : callable
        From the number of a photograph to its grey levels.
    """
    station_of = stations(views, photo, ALIKE_PX)
    originals: dict[int, int] = {}
    for second in sorted(station_of):
        others = [
            station_of[second],
            *(k for k in station_of if k < second and station_of[k] == station_of[second] and k not in originals),
        ]
        for first in others:
            if same_noise(grey(first), grey(second)):
                originals[second] = first
                break
    return originals


def contradicted_diameters(
    markers: Sequence[Marker], views: Views, photo: Indices, camera: Camera, grey: Callable[[int], NDArray[Any]]
) -> tuple[str, ...]:
    """Return dots whose diameters differ from those designed, relative to the others', as sentences."""
    points, radii = (np.concatenate([getattr(marker, name) for marker in markers]) for name in ("xyz", "radii"))
    owner = np.repeat(np.arange(len(markers)), [len(marker) for marker in markers])
    most = np.argsort(-views.seen.sum(axis=1), kind="stable")
    sentences = list[str]()
    for number, marker in enumerate(markers):
        largest = [view for view in most if views.seen[view, owner == number].any()][:ALL]
        ratios = np.array(
            [_widths(views, view, points, radii, camera, grey(int(photo[view])), marker) for view in largest]
        )
        if len(ratios) < ALL or not np.isfinite(ratios).any(axis=1).all():
            continue
        ratios = ratios[:, owner == number] / np.nanmedian(ratios[:, owner == number], axis=1, keepdims=True)
        off: Mask = (np.abs(np.log(ratios)) > np.log(1 + WIDER)).all(axis=0)
        if not off.any() or off.mean() > 0.5:
            continue
        usual = float(np.median(marker.radii))
        for k in np.flatnonzero(off)[:3]:
            designed = float(marker.radii[k]) / usual
            width = designed * float(np.median(ratios[:, k]))
            sentences.append(
                f"dot {marker.control_points[k].id} is {width:.2g} times as wide as "
                f"others in the photographs, {designed:.3g} times by marker.json: correct its diameter there"
            )
    return tuple(sentences)


def _widths(
    views: Views, view: int, points: Array, radii: Array, camera: Camera, grey: NDArray[Any], marker: Marker
) -> Array:
    """Diameters (n,) of the dots in a view over those that marker and pose predict; nan where a dot is not found."""
    blobs, dots, ratio = markergen_detect.find_dots(grey, marker.light), views.seen[view], np.full(len(points), np.nan)
    drawn = outlines(points[dots], radii[dots], views.rotation[view : view + 1], views.translation[view : view + 1])
    if len(blobs.center):
        apart, nearest = cKDTree(blobs.center).query(views.pixels[view, dots])
        stretched = np.linalg.det(camera.pixel_jacobian(drawn.center[0])) * np.sqrt(np.linalg.det(drawn.shape[0]))
        area = blobs.semi[nearest].prod(axis=1)
        ratio[dots] = np.where(apart < 1, np.sqrt(area / np.abs(stretched)), np.nan)
    return ratio
