"""Tracking: markers are sought where they were in the frame before; doubt is left to a search of the whole frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect.blobs import Blobs, Ellipses, Image, as_dark, undo_lens
from markergen.detect.candidates import find_blobs
from markergen.detect.conic_projection import Outlines, body_outlines
from markergen.detect.detection import Sought, finish, made_up_camera
from markergen.detect.ellipse_fit import fit_blobs
from markergen.detect.fiducials import CONFIRMS, NO_TAGS, Sightings, look_for_tags
from markergen.detect.identification import EDGE_PX, REFUSED_PX, UNIQUE_PX, Search, View, ambiguity, confirm, given
from markergen.detect.joining import Spare, join, share_dots
from markergen.detect.labeling_hypotheses import LEAST_DOTS, find_labelings, misfits
from markergen.detect.pose_hypotheses import DotLayout
from markergen.detect.results import Detection
from markergen.detect.seen_models import Planes, Poses
from markergen.estimators.budget import ErrorSources
from markergen.model.body import Constellation
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.read.images import grey_frame

_LEAST_MARGIN = 12.0
"""Minimum distance in px that a dot may have moved since the frame before; a large dot, by its own diameter."""

_COARSE_PX, _FINE_PX = 14.0, 32.0
"""Diameter in px of dots in the coarse windows, at least, and in the fine ones, at most: the pixels between are left
out to find a large dot, and averaged to measure it. Its blur then is that of the averages, but its outline is long."""

_LEAST_SIDE, _BAND, _SHARP = 32, 8.0, 0.8
"""Minimum side of a window, px: the noise is estimated from pieces of this length. Margin around a dot for its fit, and
the blur from which that starts, px."""

_SIZE_RATIO = 1.6
"""Maximum ratio of a dot's semi-axes to those predicted."""

_GATE, _GATE_PX = 0.5, 2.0
_NEAR, _NEAR_PX = 0.3, 1.0
"""Maximum distance of a dot from its predicted place, moved as another one: a share of its diameter, plus px; and from
its place by the affine map that fits all of them."""

_ALIKE_RATIO, _ALIKE_PX = 1.5, UNIQUE_PX / 2
_ALIKE_STRETCH = 0.7, 1.5
"""Labels that were compared in an earlier frame need not be again while the marker is seen much as it was then: maximum
misfit, relative to the one then plus px, halfway to the least that another labeling had; limits for the squared stretch
of the marker's image since then, in any direction."""

_DOUBLE_EXTENT, _DOUBLE_SHARE = 200.0, 0.03
"""Extent in px at which layouts are compared, and misfit up to which one may be taken for another, as a share of it."""

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
    are fitted to the grey levels, and what they were in the frame before must pass the tests of a whole frame: all
    labelings of these dots are compared, without regard to dots that would be missing, since nothing is known about
    other places. As long as all dots are found again and the marker is seen much as when they were compared last, they
    need not be compared again (`_still_certain`).

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
        body, first = sought.bodies[each.marker], sought.body_of.index(each.marker)
        if not body.is_single:
            again = _body_again(frame, each, first, sought, camera, errors)
        else:
            again = _settled(frame, replace(each, marker=first), sought, eye, camera is not None, errors)
        if again is None or any(share_dots(again, other) for other in found):
            return None
        found.append(replace(again, marker=each.marker))
    return sorted(found, key=lambda each: -len(each.ids))


def _settled(
    frame: NDArray[Any], before: Detection, sought: Sought, camera: Camera, calibrated: bool, errors: ErrorSources
) -> Detection | None:
    """Find one marker again, a second time if dots may have been missed by the first."""
    again, hurried = _again(frame, before, sought, camera, calibrated, errors)
    if again is None or not hurried:
        return again
    more, _ = _again(frame, again, sought, camera, calibrated, errors)
    return again if more is None or len(more.ids) < len(again.ids) else more


def _body_again(
    frame: NDArray[Any], before: Detection, first: int, sought: Sought, camera: Camera | None, errors: ErrorSources
) -> Detection | None:
    """Find all constellations of a body again, the first of which has the number `first`, and further dots of it."""
    body = sought.bodies[before.marker]
    if camera is None or not before.parts:
        return None
    parts = list[tuple[Constellation, Detection]]()
    for each in before.parts:
        number = first + each.marker
        again = _settled(frame, replace(each, marker=number), sought, camera, True, errors)
        if again is None:
            return None
        parts.append((body.constellations[each.marker], again))
    together = join(body, parts, camera, errors)
    if not together or len(together[0].parts) < len(parts):
        return None
    pose, light = together[0].pose, body.constellations[0].marker.light
    predicted = (
        None if pose is None else _predicted(body_outlines(body, pose.rotation[None], pose.translation[None]), camera)
    )
    if predicted is None:
        return None
    others = ~np.isin(body.ids[predicted.dots], together[0].ids)
    if not others.any():
        return together[0]
    diameter = 2 * predicted.semi[others, 0]
    factor = np.maximum(diameter // _COARSE_PX, 1).astype(int)
    windows = _look(frame, predicted.center[others], diameter + 2 * _LEAST_MARGIN, factor, light)
    blobs, owner = windows.find()
    spare = Spare(blobs, lambda index: windows.fit(blobs.take(index), owner[index]))
    again = next(iter(join(body, parts, camera, errors, spare)), None)
    return again if again is not None and len(again.parts) == len(parts) else None


def _again(
    frame: NDArray[Any], before: Detection, sought: Sought, camera: Camera, calibrated: bool, errors: ErrorSources
) -> tuple[Detection | None, bool]:
    """Find one marker again; also return whether some of its dots may have left their windows, or entered the image."""
    lost = None, False
    marker, layout = sought.markers[before.marker], sought.layouts[before.marker]
    model = _model(before, camera, calibrated)
    predicted = None if model is None else _predicted(model.outlines(layout), camera)
    alone = not _has_double(before.marker, sought, calibrated)
    if model is None or predicted is None or not (alone or marker.tag):
        return lost
    blobs, dots = _dots(frame, predicted, marker.light)
    ellipses = undo_lens(blobs, camera)
    if len(ellipses) < LEAST_DOTS:
        return lost
    labels = np.full(len(layout), -1)
    labels[dots[ellipses.index]] = np.arange(len(ellipses))
    rough = np.where(blobs.fitted[ellipses.index], 0.0, REFUSED_PX)
    view = View(layout, camera, calibrated, errors.print_sigma)
    guess = given(labels, model, view)
    if marker.tag is None and not rough.any() and _was_certain(before, predicted, labels):
        detection = finish(guess, blobs, ellipses, marker, camera, calibrated, errors)
        certain = _still_certain(detection, before, labels, ellipses, view)
        if certain is not None:
            return replace(certain, marker=before.marker), False
    result = confirm(guess, ellipses, rough, marker.tag, _tags(frame, model, marker, sought, camera))
    if result.reason or _doubtful(result, labels) or not (alone or result.tags[0] == CONFIRMS):
        return lost
    detection = finish(result, blobs, ellipses, marker, camera, calibrated, errors)
    if not detection.found:
        return lost
    hurried = False
    if (result.blobs < 0).any():
        now = _predicted(result.candidates.predicted.take(np.arange(1)), camera)
        hurried = now is not None and _hurried(np.flatnonzero(result.blobs < 0), predicted, now)
    return replace(detection, marker=before.marker, tag=result.corners), hurried


def _was_certain(before: Detection, predicted: "_Predicted", labels: Indices) -> bool:
    """Return whether all dots were labeled, also when labels were compared last, and are where the pose has them."""
    known = before.checked or before
    everything = len(known.ids) == len(before.ids) == len(predicted.dots) == len(labels)
    if not everything or (labels < 0).any() or not np.isfinite(known.misfit):
        return False
    return bool(np.abs(predicted.center - before.ellipse_centers).max() < 1 + 3 * before.misfit)


def _still_certain(
    now: Detection, before: Detection, labels: Indices, ellipses: Ellipses, view: View
) -> Detection | None:
    """Return a detection if no other labeling of its dots can fit, since none did when the marker was seen alike.

    Then, another labeling was worse by `UNIQUE_PX` and more, and it is now by nearly as much if the marker's image is
    no smaller, and seen from nearly the same side. So if the given labels fit well, no other ones do.
    """
    known, layout = before.checked or before, view.layout
    model, first = (_model(each, view.camera, view.calibrated) for each in (now, known))
    if len(now.ids) < len(layout) or model is None or first is None:
        return None
    if (ellipses.ring[labels] != layout.rings).any():
        return None
    misfit = float(misfits(model.outlines(layout), ellipses, labels[None], view.px)[0])
    if not misfit < _ALIKE_RATIO * known.misfit + _ALIKE_PX:
        return None
    # Squared stretch (2, 2) from m to normalized coordinates, at the middle of the marker.
    middle, step = layout.points.mean(axis=0), 0.1 * np.ptp(layout.points[:, :2])
    spots = middle + step * np.eye(3)[[2, 0, 1]] * [1, 1, 0]
    sides = [np.diff(each.project(spots)[0], axis=0) for each in (model, first)]
    new, old = (each @ each.T for each in sides)
    # The eigenvalues of old^-1 new.
    area = old[0, 0] * old[1, 1] - old[0, 1] ** 2
    mean = (old[1, 1] * new[0, 0] - 2 * old[0, 1] * new[0, 1] + old[0, 0] * new[1, 1]) / (2 * area)
    apart = max(mean**2 - (new[0, 0] * new[1, 1] - new[0, 1] ** 2) / area, 0.0) ** 0.5
    if not (mean - apart > _ALIKE_STRETCH[0] and mean + apart < _ALIKE_STRETCH[1]):
        return None
    return replace(now, misfit=misfit, checked=known)


def _hurried(missing: Indices, before: "_Predicted", now: "_Predicted") -> bool:
    """Return whether missing dots are now where their windows may not have shown them."""
    looked = np.full((max(before.dots.max(), now.dots.max()) + 1, 2), np.inf)
    looked[before.dots] = before.center
    with np.errstate(invalid="ignore"):
        away = np.linalg.norm(now.center - looked[now.dots], axis=-1) > 0.5 * now.margin
    return bool((away & np.isin(now.dots, missing)).any())


def _doubtful(result: Search, labels: Indices) -> bool:
    """Return whether the labels may be others than given."""
    # Other labelings are not refuted by the lack of dots where there are no windows.
    blind = replace(result, missing=np.full_like(result.missing, result.missing[0]))
    return bool(ambiguity(blind)) or bool(((result.blobs >= 0) & (result.blobs != labels)).any())


def _has_double(index: int, sought: Sought, calibrated: bool) -> bool:
    """Return whether a marker's dots may be those of another one that is sought, or a part of them."""
    marker, layout = sought.markers[index], sought.layouts[index]
    others = (k for k, each in enumerate(sought.markers) if k != index and each.light == marker.light)
    return any(_is_part(layout, sought.layouts[k], calibrated) for k in others)


@lru_cache(maxsize=256)
def _is_part(layout: DotLayout, other: DotLayout, calibrated: bool) -> bool:
    """Return whether a layout, seen from the front, looks much like some of the dots of another one."""
    if layout is other:
        return True
    if len(other) < len(layout):
        return False
    extent = float(np.ptp(layout.points[:, :2], axis=0).max())
    pose = Poses(np.diag([1.0, -1.0, -1.0])[None], np.array([[0.0, 0.0, 5 * extent]]))
    drawn = pose.outlines(layout)
    ellipses = Ellipses(drawn.center[0], drawn.shape[0], layout.rings.astype(float), np.arange(len(layout)))
    found = find_labelings(ellipses, other, 5 * _DOUBLE_EXTENT, calibrated)
    return bool(((found.count == len(layout)) & (found.misfit < _DOUBLE_SHARE * _DOUBLE_EXTENT)).any())


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

    @property
    def margin(self) -> Array:
        """How far (n,) dots may have moved to be seen, px."""
        return np.maximum(_LEAST_MARGIN, 2 * self.semi[:, 0])


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
    factor = np.maximum(diameter // _COARSE_PX, 1).astype(int)
    windows = _look(frame, predicted.center, diameter + 2 * predicted.margin, factor, light)
    blobs, owner = windows.find()
    size = np.log(np.sqrt(blobs.semi.prod(axis=-1)) / np.sqrt(predicted.semi.prod(axis=-1))[owner])
    alike = np.abs(size) < np.log(_SIZE_RATIO)
    blobs, owner = blobs.take(alike), owner[alike]
    chosen = _moved_together(blobs.center, owner, predicted.center, diameter)
    blobs, owner = blobs.take(chosen), owner[chosen]
    dots = predicted.dots[owner]
    if len(blobs) < LEAST_DOTS:
        return blobs, dots
    if (factor == 1).all():
        return windows.fit(blobs, owner), dots
    size, owner = 2 * blobs.semi[:, 0], np.arange(len(blobs))
    factor = np.ceil(size / _FINE_PX).astype(int)
    windows = _look(frame, blobs.center, size + 2 * _BAND * factor, factor, light, average=True)
    # Pixels left out tell nothing about the blur.
    blobs = windows.fit(replace(blobs, blur=np.minimum(blobs.blur, _SHARP * factor)), owner)
    if blobs.fitted.all():
        return blobs, dots
    # Where the fit refuses a dot, its rough ellipse counts, which all pixels tell better.
    fine, window = windows.find()
    near = np.linalg.norm(fine.center - blobs.center[window], axis=-1) < 0.1 * size[window] + 1
    own = np.flatnonzero(near & ~blobs.fitted[window])
    kept = np.flatnonzero(blobs.fitted)
    return blobs.take(kept).joined(fine.take(own)), np.concatenate([dots[kept], dots[window[own]]])


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
    own = owner[order]
    start = np.flatnonzero(np.append(True, own[1:] != own[:-1]))
    offset = (center - predicted[owner])[order]

    def nearest(away: Array) -> tuple[Array, Indices]:
        """Return the least distance (places,) in each window, and its index among the sorted."""
        at = np.lexsort((away, own))[start]
        return away[at], at

    gate = (_GATE * diameter + _GATE_PX)[own]
    away = np.sum((offset[:, None] - offset) ** 2, axis=-1) / gate**2
    score = np.sum(np.maximum(1 - np.minimum.reduceat(away, start, axis=1), 0), axis=1)
    least, at = nearest(away[int(np.argmax(score))])
    chosen = at[least < 1]
    gate = (_NEAR * diameter + _NEAR_PX)[own]
    middle = predicted.mean(axis=0)
    reach = np.abs(predicted - middle).max() + 1
    rows = np.column_stack([(predicted[own] - middle) / reach, np.ones(len(order))])
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
