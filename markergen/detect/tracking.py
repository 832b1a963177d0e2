"""Tracking: markers are sought where they were in the frame before; doubt is left to a search of the whole frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Blobs, Image, as_dark, undo_lens
from markergen.detect.candidates import find_blobs
from markergen.detect.conic_projection import Outlines
from markergen.detect.detection import Detection, Sought, finish, made_up_camera
from markergen.detect.ellipse_fit import fit_blobs
from markergen.detect.fiducials import CONFIRMS, NO_TAGS, Sightings, look_for_tags
from markergen.detect.identification import EDGE_PX, Search, View, ambiguity, confirm, search
from markergen.detect.labeling_hypotheses import LEAST_DOTS, Planes, Poses
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.read.images import grey_frame

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_LEAST_MARGIN = 12.0
"""Minimum distance in px that a dot may have moved since the frame before; a large dot, by its own diameter."""

_COARSE_PX, _FINE_PX = 14.0, 48.0
"""Diameter in px of dots in the coarse windows, at least, and in the fine ones, at most: the pixels between are left
out to find a large dot, and averaged to measure it. Its blur then is that of the averages, but its outline is long."""

_LEAST_SIDE, _BAND = 32, 12.0
"""Minimum side of a window, px: the noise is estimated from pieces of this length. Margin around a dot for its fit."""

_SIZE_RATIO = 1.6
"""Maximum ratio of a dot's semi-axes to those predicted."""

_GATE, _GATE_PX = 0.5, 2.0
_NEAR, _NEAR_PX = 0.3, 1.0
"""Maximum distance of a dot from its predicted place, moved as another one: a share of its diameter, plus px; and from
its place by the affine map that fits all of them."""

_TAG_QUIET, _TAG_MARGIN, _TAG_PX = 0.6, 0.25, 160.0
"""Of a tag's window, in its sides: quiet zones, at most, and the margin for motion; maximum side of the tag, px."""


def track(
    frame: NDArray[Any],
    near: Sequence[Detection],
    sought: Sought,
    camera: Camera | None,
    errors: ErrorSources,
) -> list[Detection] | None:
    """Find markers again, near where they were in the frame before; None if not every one of them is there for certain.

    Only the windows of `frame` in which dots may be are looked at, and converted to grey. The dots that moved together
    are fitted to the grey levels, and these alone are searched for the marker, as in a whole frame: the labels do not
    follow from those of the frame before. Of each marker, all labelings of these dots are compared without regard to
    dots that would be missing, since nothing is known about other places.

    Parameters
    ----------
    frame : array (h, w) or (h, w, c), as for `grey_frame`
    near : sequence of Detection
        Those of the frame before, all of them found.
    sought, camera, errors
        As for `find_all`.
    """
    height, width = frame.shape[:2]
    eye = camera or made_up_camera(width, height)
    found = list[Detection]()
    for each in near:
        again = _again(frame, each, sought, eye, camera is not None, errors)
        if again is None or any(_same_place(again, other) for other in found):
            return None
        found.append(again)
    return sorted(found, key=lambda each: -len(each.ids))


def _again(
    frame: NDArray[Any], before: Detection, sought: Sought, camera: Camera, calibrated: bool, errors: ErrorSources
) -> Detection | None:
    """Find one marker again."""
    marker, layout = sought.markers[before.marker], sought.layouts[before.marker]
    model = _model(before, camera, calibrated)
    predicted = None if model is None else _predicted(model.outlines(layout), camera)
    if model is None or predicted is None:
        return None
    blobs, _ = _dots(frame, predicted, marker.light)
    ellipses = undo_lens(blobs, camera)
    if len(ellipses) < LEAST_DOTS:
        return None
    tags = _tags(frame, model, marker, sought, camera)
    result = search(ellipses, View(layout, camera, calibrated, errors.print_sigma))
    if not result.reason:
        result = confirm(result, ellipses, tag=marker.tag, tags=tags)
    if result.reason or _doubtful(result, before.marker, sought):
        return None
    detection = finish(result, blobs, ellipses, marker, camera, calibrated, errors)
    if not detection.found:
        return None
    return replace(detection, marker=before.marker, tag=result.corners)


def _doubtful(result: Search, index: int, sought: Sought) -> bool:
    """Return whether the labels may be others, or the marker another one of those sought."""
    # Dots of another labeling may be outside of the windows.
    if ambiguity(replace(result, missing=np.zeros_like(result.missing))):
        return True
    marker, layout = sought.markers[index], sought.layouts[index]
    pairs = zip(sought.markers, sought.layouts, strict=True)
    alike = sum(other is layout and each.light == marker.light for each, other in pairs) > 1
    return alike and result.tags[0] != CONFIRMS


def _same_place(one: Detection, other: Detection) -> bool:
    """Return whether two detections share dots."""
    apart = np.linalg.norm(one.ellipse_centers[:, None] - other.ellipse_centers, axis=-1)
    return bool(apart.min() < 1)


@dataclass(frozen=True, eq=False)
class _Predicted:
    """The outlines of a marker's n dots where they were in the frame before.

    Attributes
    ----------
    dots : array (n,) of int
        Which of the marker's dots they are.
    center : array (n, 2), px of the image as taken
    semi : array (n, 2), px, longest first
    """

    dots: Indices
    center: Array
    semi: Array


def _model(before: Detection, camera: Camera, calibrated: bool) -> Poses | Planes | None:
    """Return the pose of the frame before, or without a camera the homography, to normalized coordinates."""
    if calibrated:
        return None if before.pose is None else Poses(before.pose.rotation[None], before.pose.translation[None])
    if before.homography is None:
        return None
    return Planes(np.asarray(np.linalg.solve(camera.matrix, before.homography)[None], dtype=float))


def _predicted(drawn: Outlines, camera: Camera) -> _Predicted | None:
    """Predict the dots that lie inside the image; None if fewer than four do."""
    with np.errstate(invalid="ignore"):
        usable = drawn.seen[0] & np.isfinite(drawn.shape[0]).all(axis=(-2, -1))
        center = camera.to_pixels(np.where(usable[:, None], drawn.center[0], np.nan))
    size = np.array([camera.width, camera.height])
    with np.errstate(invalid="ignore"):
        usable &= ((center >= 0) & (center <= size - 1)).all(axis=-1)
    if usable.sum() < LEAST_DOTS:
        return None
    stretch = camera.pixel_jacobian(drawn.center[0, usable])
    values = np.linalg.eigvalsh(stretch @ drawn.shape[0, usable] @ stretch.swapaxes(-1, -2))
    if not np.isfinite(values).all() or not (values > 0).all():
        return None
    return _Predicted(np.flatnonzero(usable), center[usable], np.sqrt(values[:, ::-1]))


def _dots(frame: NDArray[Any], predicted: _Predicted, light: bool) -> tuple[Blobs, Indices]:
    """Return blobs, fitted, that moved together from where dots are predicted, and which of the marker's each is."""
    diameter = 2 * predicted.semi[:, 0]
    margin = np.maximum(_LEAST_MARGIN, diameter)
    factor = np.maximum(diameter // _COARSE_PX, 1).astype(int)
    windows = _look(frame, predicted.center, diameter + 2 * margin, factor, light)
    blobs, owner = windows.find()
    size = np.log(np.sqrt(blobs.semi.prod(axis=-1)) / np.sqrt(predicted.semi.prod(axis=-1))[owner])
    alike = np.abs(size) < np.log(_SIZE_RATIO)
    blobs, owner = blobs.take(alike), owner[alike]
    chosen = _moved_together(blobs.center, owner, predicted.center, diameter)
    blobs, owner = blobs.take(chosen), owner[chosen]
    dots = predicted.dots[owner]
    if len(blobs) < LEAST_DOTS:
        return blobs, dots
    if (factor > 1).any():
        diameter = 2 * blobs.semi[:, 0]
        factor = np.ceil(diameter / _FINE_PX).astype(int)
        windows = _look(frame, blobs.center, diameter + 2 * _BAND * factor, factor, light, average=True)
        fine, owner = windows.find()
        away = np.linalg.norm(fine.center - blobs.center[owner], axis=-1) / (0.2 * diameter[owner] + 1)
        # The nearest to the middle of each window.
        order = np.lexsort((away, owner))
        order = order[away[order] < 1]
        _, first = np.unique(owner[order], return_index=True)
        blobs, owner = fine.take(order[first]), owner[order[first]]
        dots = dots[owner]
    return windows.fit(blobs, owner), dots


def _moved_together(center: Array, owner: Indices, predicted: Array, diameter: Array) -> Indices:
    """Return the indices of blobs that moved alike from the predicted places, at most one for each place.

    Every blob proposes its own offset; the one that most others are near is taken, and an affine map is fitted to the
    pairs, which describes the motion between two frames to a fraction of a pixel.

    Parameters
    ----------
    center : array (k, 2), px
    owner : array (k,) of int
        Index of the predicted dot in whose window the blob is.
    predicted, diameter : arrays (n, 2) and (n,), px
    """
    none = np.zeros(0, dtype=np.intp)
    if len(center) < LEAST_DOTS:
        return none
    order = np.argsort(owner, kind="stable")
    start = np.unique(owner[order], return_index=True)[1]
    offset = (center - predicted[owner])[order]

    def nearest(away: Array) -> tuple[Array, Indices]:
        """Return the least distance (places,) in each window, and its index among the sorted."""
        least = np.minimum.reduceat(away, start)
        at = np.flatnonzero(away == np.repeat(least, np.diff(np.append(start, len(away)))))
        _, first = np.unique(owner[order][at], return_index=True)
        return least, at[first]

    gate = (_GATE * diameter + _GATE_PX)[owner[order]]
    away = np.sum((offset[:, None] - offset) ** 2, axis=-1) / gate**2
    score = np.sum(np.maximum(1 - np.minimum.reduceat(away, start, axis=1), 0), axis=1)
    least, at = nearest(away[int(np.argmax(score))])
    chosen = at[least < 1]
    gate = (_NEAR * diameter + _NEAR_PX)[owner[order]]
    middle = predicted.mean(axis=0)
    reach = np.abs(predicted - middle).max() + 1
    rows = np.column_stack([(predicted[owner[order]] - middle) / reach, np.ones(len(order))])
    for _ in range(2):
        if len(chosen) < LEAST_DOTS:
            return none
        affine = np.linalg.lstsq(rows[chosen], offset[chosen], rcond=None)[0]
        least, at = nearest(np.sum((offset - rows @ affine) ** 2, axis=-1) / gate**2)
        chosen = at[least < 1]
    return np.asarray(order[chosen])


@dataclass(frozen=True, eq=False)
class _Windows:
    """Square windows of a frame, one below the other in one image.

    Attributes
    ----------
    image : array (n * side, side)
    origin : array (n, 2), px
        Place in the frame of each window's first pixel.
    factor : array (n,) of int
        Side of a window's pixel in px of the frame.
    size : array (2,), px
        Width and height of the frame.
    inverted : bool
        True if light dots have become dark.
    """

    image: Image
    origin: Array
    factor: Indices
    size: Array
    inverted: bool

    def find(self) -> tuple[Blobs, Indices]:
        """Return rough blobs in px of the frame, whole inside of it and of a window, and each one's window."""
        blobs = find_blobs(self.image)
        side = self.image.shape[1]
        owner = np.clip(np.floor((blobs.center[:, 1] + 0.5) / side), 0, len(self.factor) - 1).astype(np.intp)
        half = np.linalg.norm(blobs.axes, axis=-1)
        within = blobs.center - np.stack([np.zeros(len(owner)), owner * side], axis=-1)
        whole = ((within - half >= 0) & (within + half <= side - 1)).all(axis=-1)
        moved = self._moved(blobs, owner, 1)
        half = half * self.factor[owner, None]
        whole &= ((moved.center - half >= EDGE_PX) & (moved.center + half <= self.size - 1 - EDGE_PX)).all(axis=-1)
        return moved.take(whole), owner[whole]

    def fit(self, blobs: Blobs, owner: Indices) -> Blobs:
        """Fit blobs, in px of the frame, to the grey levels of their windows."""
        return self._moved(fit_blobs(self.image, self._moved(blobs, owner, -1), self.inverted), owner, 1)

    def _moved(self, blobs: Blobs, owner: Indices, sign: int) -> Blobs:
        """Return blobs in px of the frame (1) instead of px of the windows' image, or the other way around (-1)."""
        factor = self.factor[owner].astype(float)
        shift = np.stack([np.zeros(len(owner)), owner * self.image.shape[1]], axis=-1)
        if sign > 0:
            center = (blobs.center - shift) * factor[:, None] + self.origin[owner]
        else:
            center = (blobs.center - self.origin[owner]) / factor[:, None] + shift
        scale = factor**sign
        return replace(
            blobs,
            center=center,
            semi=blobs.semi * scale[:, None],
            covariance=blobs.covariance * scale[:, None, None] ** 2,
            blur=blobs.blur * scale,
        )


def _look(
    frame: NDArray[Any], center: Array, width: Array, factor: Indices, light: bool, average: bool = False
) -> _Windows:
    """Cut windows out of a frame and convert them to grey; beyond its edge, its last pixels are repeated.

    Parameters
    ----------
    center, width : arrays (n, 2) and (n,), px
        Middle and minimum side.
    factor : array (n,) of int
        Every how many pixels are taken, or averaged.
    light : bool
        True for light dots, which become dark.
    """
    import cv2

    side = max(_LEAST_SIDE, int(np.ceil((width / factor).max())) + 1)
    height, breadth = frame.shape[:2]
    first = np.rint(center - factor[:, None] * (side - 1) / 2).astype(int)
    tiles = list[Any]()
    for (x, y), step in zip(first.tolist(), factor.tolist(), strict=True):
        reach, stride = side * step, 1 if average else step
        if x >= 0 and y >= 0 and x + reach <= breadth and y + reach <= height:
            tile = frame[y : y + reach : stride, x : x + reach : stride]
        else:
            rows, columns = (np.arange(start, start + reach, stride) for start in (y, x))
            tile = frame[np.clip(rows, 0, height - 1)[:, None], np.clip(columns, 0, breadth - 1)]
        grey = as_dark(grey_frame(tile), light)
        if average and step > 1:
            grey = np.asarray(cv2.resize(grey, (side, side), interpolation=cv2.INTER_AREA))
        tiles.append(grey)
    origin = first + (factor[:, None] - 1) / 2 * average
    return _Windows(np.concatenate(tiles), origin, factor, np.array([breadth, height]), light)


def _tags(frame: NDArray[Any], model: Poses | Planes, marker: Marker, sought: Sought, camera: Camera) -> Sightings:
    """Read the tags near where the marker's own is predicted."""
    if marker.tag is None:
        return NO_TAGS
    with np.errstate(invalid="ignore"):
        pixels = camera.to_pixels(model.project(np.column_stack([marker.tag.corners, np.zeros(4)]))[0])
    if not (np.isfinite(pixels) & (np.abs(pixels) < 1e6)).all():
        return NO_TAGS
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    side = float((high - low).max())
    factor = np.array([int(np.ceil(side / _TAG_PX))])
    width = side * (1 + _TAG_QUIET) + 2 * max(_LEAST_MARGIN, _TAG_MARGIN * side)
    window = _look(frame, ((low + high) / 2)[None], np.array([width]), factor, marker.light, average=True)
    own, _ = sought.by_polarity[marker.light]
    tags = look_for_tags(window.image, own.families)
    return Sightings(tags.names, tags.pixels * factor[0] + window.origin)
