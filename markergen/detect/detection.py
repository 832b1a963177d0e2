"""Complete detection, from an image to labeled centers and a pose, with a reason if it fails."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.blobs import Blobs, Ellipses, Image, as_dark, undo_lens
from markergen.detect.candidates import find_blobs
from markergen.detect.conic_projection import correct_centers, outlines
from markergen.detect.ellipse_fit import fit_blobs
from markergen.detect.fiducials import NO_TAGS, REFUTES, Sightings, TagReader
from markergen.detect.identification import (
    CUT,
    REFUSED_PX,
    ROUGH_PX,
    Search,
    View,
    ambiguity,
    confirm,
    contender,
    search,
)
from markergen.detect.joining import Spare, joined
from markergen.detect.labeling_hypotheses import LEAST_DOTS
from markergen.detect.pose import DEFAULT_ERRORS, PoseEstimate, fit_pose, homography_of, outlier
from markergen.detect.pose_hypotheses import DotLayout, layout_of
from markergen.detect.results import Detection, Unlabeled
from markergen.detect.seen_models import Poses
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker, check_supported
from markergen.model.rig import Target
from markergen.read.images import LARGEST_FRAME

MAX_COPIES = 32
"""Maximum number of copies of one marker in one image."""

MAX_RESTARTED = 4
"""Number of labelings in a row that do not hold once their dots are fitted, at which the search ends. Markers that are
found had one at most, in 800 views; regular patterns have thousands."""

NOT_HELD = f"found labelings, but none that holds once its dots are fitted; {CUT}"

COPY_CONTRAST = 0.3
"""Least contrast of the dots of a further copy of a marker, as a share of the least contrast of those found."""

CLAIMED = "labels are ambiguous between two markers that fit the same dots"
UNREAD = "the tag could not be read, and two markers fit the same dots"


@dataclass(frozen=True, eq=False)
class Sought:
    """Markers to look for, with everything that depends only on them; prepared once for many images.

    Attributes
    ----------
    layouts : tuple of DotLayout
        One layout for each marker; the markers of a family share a layout and its search results.
    bodies : tuple of Marker or Rig
        What the caller looks for, whose constellations `markers` are, in the same order.
    """

    markers: tuple[Marker, ...]
    layouts: tuple[DotLayout, ...]
    bodies: tuple[Target, ...]

    @cached_property
    def body_of(self) -> tuple[int, ...]:
        """Index of the body that each marker is a constellation of."""
        return tuple(k for k, body in enumerate(self.bodies) for _ in body.constellations)

    @property
    def families(self) -> frozenset[str]:
        """Families of the markers' tags."""
        return frozenset(marker.tag.family for marker in self.markers if marker.tag)

    @cached_property
    def by_polarity(self) -> "dict[bool, tuple[Sought, list[int]]]":
        """The bodies with dark dots (False) and those with light ones (True), with their indices among all."""
        parts = {}
        for light in sorted({marker.light for marker in self.markers}):
            chosen = [k for k, body in enumerate(self.bodies) if body.constellations[0].marker.light == light]
            rows = [k for k, body in enumerate(self.body_of) if body in chosen]
            markers, layouts = tuple(self.markers[k] for k in rows), tuple(self.layouts[k] for k in rows)
            parts[light] = Sought(markers, layouts, tuple(self.bodies[k] for k in chosen)), chosen
        return parts


def prepare(targets: Sequence[Target], calibrated: bool) -> Sought:
    """Check markers and rigs and precompute what the search needs; raises as `detect` does.

    Parameters
    ----------
    calibrated : bool
        True if the images have a camera.
    """
    if not targets:
        raise InputError("one marker or more", "none", "say what to look for")
    markers = tuple(constellation.marker for body in targets for constellation in body.constellations)
    for marker in markers:
        check_supported(marker, "to detect")
    layout_by_points = {marker.control_points: _layout(marker) for marker in markers}
    layouts = tuple(layout_by_points[marker.control_points] for marker in markers)
    if not calibrated and not all(layout.flat for layout in layouts):
        raise InputError("a camera for a marker with relief", "none", "give the camera's calibration")
    if not calibrated and any(body.frame == "rig" for body in targets):
        raise InputError("a camera for a rig", "none", "give the camera's calibration")
    return Sought(markers, layouts, tuple(targets))


# Calls of `detect`, one for each image, prepare a marker once.
_layout = lru_cache(maxsize=64)(layout_of)


def detect(
    image: Image, marker: Target, camera: Camera | None = None, errors: ErrorSources = DEFAULT_ERRORS
) -> Detection:
    """Find one marker or rig in a grey image; if there are several copies, the one with the most dots.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    camera : Camera or None
        Without one, labels follow from the homography alone, and there is no pose.
    errors : ErrorSources
        Errors of print and calibration, for the weights of the dots and the pose's covariance.

    Raises
    ------
    InputError
        If the image is not grey of uint8 or uint16, or the marker has fewer than four dots, collinear dots, dots
        without size, or relief and there is no camera; also as `check_supported` does. An image without the marker is
        not an error.
    """
    return detect_all(image, [marker], camera, errors, copies=1)[0]


def detect_all(
    image: Image,
    markers: Sequence[Target],
    camera: Camera | None = None,
    errors: ErrorSources = DEFAULT_ERRORS,
    copies: int = MAX_COPIES,
) -> list[Detection]:
    """Find all copies of all markers and rigs in a grey image.

    The best labeling of all markers is taken, its blobs are removed, and so on. A blob that two markers claim with
    labelings that fit nearly equally well is assigned to neither. A tag that is read decides between markers that
    differ by their tags, and between labelings; otherwise, dots and key ring do.

    Parameters
    ----------
    copies : int
        Maximum number of copies of each marker.

    Returns
    -------
    list of Detection
        Detections, best first, then one with the reason for each marker that was not found at all.

    Raises
    ------
    InputError
        As `detect` does.
    """
    if camera is not None and image.ndim == 2 and image.shape != (camera.height, camera.width):
        sizes = f"{image.shape[1]}x{image.shape[0]} px, the camera {camera.width}x{camera.height} px"
        return [Detection(False, reason=f"the image is {sizes}", marker=k) for k in range(len(markers))]
    return find_all(image, prepare(markers, camera is not None), camera, errors, copies)


def find_all(
    image: Image,
    sought: Sought,
    camera: Camera | None,
    errors: ErrorSources = DEFAULT_ERRORS,
    copies: int = MAX_COPIES,
) -> list[Detection]:
    """Run `detect_all` for prepared markers, in an image of the camera's size; light dots as dark ones, inverted."""
    _check(image)
    found = []
    for light, (own, indices) in sought.by_polarity.items():
        for each in _find_alike(image, own, light, camera, errors, copies):
            rival = None if each.rival is None else indices[each.rival]
            found.append(replace(each, marker=indices[each.marker], rival=rival))
    return sorted(found, key=lambda each: -len(each.ids)) if len(sought.by_polarity) > 1 else found


def _find_alike(
    image: Image, sought: Sought, light: bool, camera: Camera | None, errors: ErrorSources, copies: int
) -> list[Detection]:
    """Run `find_all` for markers with dots of one polarity."""
    image = as_dark(image, light)
    tags = TagReader(image, sought.families) if sought.families else NO_TAGS
    eye, fit = camera or made_up_camera(*image.shape[::-1]), partial(fit_blobs, image, inverted=light)
    blobs = find_blobs(image)
    found = identify(blobs, sought, eye, camera is not None, errors, copies, tags, fit)
    if all(body.is_single for body in sought.bodies):
        return found
    return joined(found, sought.bodies, camera, errors, copies, Spare(blobs, lambda chosen: fit(blobs.take(chosen))))


def detect_dots(image: Image, light: bool = False) -> Blobs:
    """Find all dark elliptic dots on a lighter ground, of a marker or not, and fit them to the grey levels.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    light : bool
        True for light dots on a darker ground, whose levels are then those of the inverted image.

    Returns
    -------
    Blobs
        Empty for images without contrast. Dots cut off by the image's edge are left out.

    Raises
    ------
    InputError
        If the image is not a grey image of uint8 or uint16, or has more than LARGEST_FRAME pixels.
    """
    _check(image)
    image = as_dark(image, light)
    return fit_blobs(image, find_blobs(image), light)


def _check(image: Image) -> None:
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise InputError(
            "a grey image (h, w) of uint8 or uint16", f"{image.shape} of {image.dtype}", "convert the image to grey"
        )
    if image.size > LARGEST_FRAME:
        raise InputError(
            f"an image of at most {LARGEST_FRAME // 10**6} megapixels",
            f"{image.shape[1]}x{image.shape[0]} px",
            "reduce its size, or cut out the part with the marker",
        )


def identify(
    blobs: Blobs,
    markers: Sequence[Marker] | Sought,
    camera: Camera,
    calibrated: bool = True,
    errors: ErrorSources = DEFAULT_ERRORS,
    copies: int = MAX_COPIES,
    tags: Sightings | TagReader = NO_TAGS,
    fit: Callable[[Blobs], Blobs] | None = None,
) -> list[Detection]:
    """Run `detect_all` on the dots and tags of an image.

    Labels are sought among rough blobs. The grey levels at those of the best labeling must confirm it.

    Parameters
    ----------
    fit : callable or None
        Fits a labeling's blobs, such as `fit_blobs`; None if all are fitted already.
    calibrated : bool
        False if the camera is made up from the image's size.
    """
    sought = markers if isinstance(markers, Sought) else prepare(markers, calibrated)
    markers = sought.markers
    views = {each: View(each, camera, calibrated, errors.print_sigma) for each in sought.layouts}
    ellipses = undo_lens(blobs, camera)
    rough = np.full(len(ellipses), 0.0 if fit is None else ROUGH_PX)
    left, reasons, found = dict.fromkeys(range(len(markers)), copies), dict[int, str](), list[Detection]()
    rivals, unlabeled = dict[int, int](), dict[int, Unlabeled]()
    searches, plain, restarted = dict[DotLayout, Search](), np.inf, 0
    while left:
        first_of = {sought.layouts[k] for k, more in left.items() if more == copies}
        own = dict.fromkeys(sought.layouts[k] for k in left)
        searches = {
            each: searches.get(each)
            or (
                search(ellipses, views[each], rough)
                if each in first_of
                else _copy(blobs, ellipses, views[each], rough, plain)
            )
            for each in own
        }
        for k in list(left):
            if searches[sought.layouts[k]].reason:
                reasons.setdefault(k, searches[sought.layouts[k]].reason)
                del left[k]
        if not left:
            break
        first = min((searches[sought.layouts[k]] for k in left), key=lambda each: each.rank)
        claimed = _among(ellipses, first)
        fresh = claimed & (rough == ROUGH_PX)
        blobs, ellipses, rough = _fitted(blobs, ellipses, rough, fresh, fit, camera)
        sharing = (k for k in left if (claimed & _among(ellipses, searches[sought.layouts[k]])).any())
        confirmed = {k: confirm(searches[sought.layouts[k]], ellipses, rough, markers[k].tag, tags) for k in sharing}
        answers = {k: each for k, each in confirmed.items() if not each.reason}
        best = min(answers, key=lambda k: answers[k].rank, default=-1)
        others = _among(ellipses, answers.get(best, first)) & (rough == ROUGH_PX)
        reasons = {k: each.reason for k, each in confirmed.items() if each.reason} | reasons
        better = bool(answers) and bool(others.any())
        if better:
            blobs, ellipses, rough = _fitted(blobs, ellipses, rough, others, fit, camera)
        untold = all(each.tags[0] != REFUTES for each in confirmed.values())
        if better or (not answers and fresh.any() and untold):
            # Another labeling is better than the one that was fitted, or it does not hold now that its dots are known
            # better: others may.
            searches, restarted = {}, restarted + 1
            if restarted < MAX_RESTARTED:
                continue
            reasons |= {k: f"{reasons[k]}; {CUT}" if k in reasons else NOT_HELD for k in left}
            break
        if answers:
            restarted = 0
            chosen = answers[best]
            claimed |= _among(ellipses, chosen)
            doubt = ambiguity(chosen)
            claims = {} if doubt else _claims(best, answers)
            if doubt or claims:
                dots = _unlabeled(chosen, blobs, ellipses, markers[best], camera)
                for k, rival in ({best: best} if doubt else claims).items():
                    if k not in unlabeled:
                        unlabeled[k] = dots
                        reasons[k] = doubt or (UNREAD if markers[k].tag and markers[rival].tag else CLAIMED)
                        if not doubt:
                            rivals[k] = rival
            elif left[best] == copies or _is_told(chosen):
                detection = finish(chosen, blobs, ellipses, markers[best], camera, calibrated, errors)
                found.append(replace(detection, marker=best, tag=chosen.corners if detection.found else None))
                plain = min(plain, _contrast(blobs, ellipses)[_among(ellipses, chosen)].min())
                left[best] -= 1
                if not left[best]:
                    del left[best]
        # An ambiguous detection also claims its blobs, exclusively.
        kept = {layout: each.without(claimed) for layout, each in searches.items()}
        searches = {layout: each for layout, each in kept.items() if each and not each.reason}
        ellipses, rough = ellipses.take(~claimed), rough[~claimed]
    seen = {each.marker for each in found}
    return found + [
        Detection(False, reason=reasons[k], marker=k, rival=rivals.get(k), unlabeled=unlabeled.get(k))
        for k in range(len(markers))
        if k not in seen
    ]


def _copy(blobs: Blobs, ellipses: Ellipses, view: View, rough: Array, contrast: float) -> Search:
    """Search for a further copy of a marker in plain sight: likely ones alone, and not in much less contrast."""
    part = np.flatnonzero(_contrast(blobs, ellipses) >= COPY_CONTRAST * contrast)
    found = search(ellipses.take(part), view, rough[part], thorough=False)
    labels = found.candidates.blobs
    return replace(
        found, candidates=replace(found.candidates, blobs=np.where(labels >= 0, np.append(part, -1)[labels], -1))
    )


def _is_told(chosen: Search) -> bool:
    """Return whether a further copy has all its dots or more than four: any four may be those of another marker."""
    count = chosen.candidates.count[0]
    return bool(count > LEAST_DOTS or count == len(chosen.layout))


def _contrast(blobs: Blobs, ellipses: Ellipses) -> Array:
    return (blobs.light - blobs.dark)[ellipses.index]


def _among(ellipses: Ellipses, chosen: Search) -> NDArray[np.bool_]:
    """Return which ellipses (B,) belong to a search's best labeling."""
    among = np.zeros(len(ellipses) + 1, dtype=bool)
    # The last is that of -1, no blob.
    among[chosen.blobs] = True
    return among[:-1]


def _fitted(
    blobs: Blobs,
    ellipses: Ellipses,
    rough: Array,
    chosen: NDArray[np.bool_],
    fit: Callable[[Blobs], Blobs] | None,
    camera: Camera,
) -> tuple[Blobs, Ellipses, Array]:
    """Return blobs, ellipses and additional misfits, of which some, the ellipses `chosen`, are of fitted blobs."""
    if fit is None or not chosen.any():
        return blobs, ellipses, rough
    index, place = ellipses.index[chosen], np.flatnonzero(chosen)
    better = fit(blobs.take(index))
    alone = undo_lens(better, camera)
    rough = rough.copy()
    rough[place] = np.where(better.fitted, 0.0, REFUSED_PX)
    ellipses = ellipses.put(place[alone.index], replace(alone, index=index[alone.index]))
    return blobs.put(index, better), ellipses, rough


def made_up_camera(width: int, height: int) -> Camera:
    """Return a camera for images without one: its focal length only initializes the search."""
    focal = float(max(width, height, 1))
    return Camera(max(width, 1), max(height, 1), focal, focal, (width - 1) / 2, (height - 1) / 2)


def _claims(best: int, searches: dict[int, Search]) -> dict[int, int]:
    """Return markers that claim the same blobs with labelings nearly as good as the best one's, with their rivals."""
    rivals = [
        k
        for k, each in searches.items()
        if k != best and contender(searches[best], each, same_marker=False) is not None
    ]
    return {best: rivals[0], **dict.fromkeys(rivals, best)} if rivals else {}


def _unlabeled(chosen: Search, blobs: Blobs, ellipses: Ellipses, marker: Marker, camera: Camera) -> Unlabeled:
    """Return the dots of the best labeling, whose labels are a guess."""
    used = np.flatnonzero(chosen.blobs >= 0)
    own, drawn = chosen.blobs[used], chosen.candidates.predicted
    corrected = ellipses.center[own] - (drawn.center - drawn.point)[0, used]
    index = ellipses.index[own]
    guess = np.array([marker.control_points[k].id for k in used], dtype=np.intp)
    return Unlabeled(camera.to_pixels(corrected), blobs.covariance[index], blobs.center[index], guess)


def finish(
    chosen: Search,
    blobs: Blobs,
    ellipses: Ellipses,
    marker: Marker,
    camera: Camera,
    calibrated: bool,
    errors: ErrorSources,
) -> Detection:
    """Return a labeling's detection: the pose, outliers dropped, and the dots' centers corrected from the pose."""
    layout = chosen.layout
    ids = np.array([point.id for point in marker.control_points], dtype=np.intp)
    used = np.flatnonzero(chosen.blobs >= 0)
    labeled, pose = used, None
    if calibrated:
        used, pose = _pose(chosen, used, blobs, ellipses, marker, camera, errors)
        if pose is None:
            return Detection(False, reason="no pose sees the dots from the front")
    own = chosen.blobs[used]
    points, radii, seen = layout.places[used], layout.radii[used], ellipses.center[own]
    homography = None
    if pose is None:
        corrected, planes = correct_centers(seen[None], points[:, :2], radii)
        corrected, homography = corrected[0], camera.matrix @ planes[0]
    else:
        drawn = outlines(points, radii, pose.rotation[None], pose.translation[None])
        corrected = seen - (drawn.center - drawn.point)[0]
        if layout.flat:
            homography = homography_of(layout.points[used], corrected, camera, pose)
    index = ellipses.index[own]
    return Detection(
        True,
        ids[used],
        camera.to_pixels(corrected),
        blobs.covariance[index],
        blobs.center[index],
        None if homography is None else homography / homography[2, 2],
        pose,
        dropped=np.delete(ids[labeled], np.searchsorted(labeled, used)),
        misfit=float(chosen.candidates.misfit[0]),
    )


def _pose(
    chosen: Search,
    used: NDArray[np.intp],
    blobs: Blobs,
    ellipses: Ellipses,
    marker: Marker,
    camera: Camera,
    errors: ErrorSources,
) -> tuple[NDArray[np.intp], PoseEstimate | None]:
    """Return the indices of the dots kept, and the pose from them."""
    model = chosen.candidates.model
    assert isinstance(model, Poses)
    start = model.rotation[0], model.translation[0]
    while True:
        own = chosen.blobs[used]
        measured = (
            chosen.layout.places[used],
            chosen.layout.radii[used],
            ellipses.center[own],
            blobs.covariance[ellipses.index[own]],
            camera,
            errors.of(marker, used),
        )
        pose = fit_pose(*measured, start)
        worst = None if pose is None else outlier(*measured, pose)
        if worst is None:
            return used, pose
        used = np.delete(used, worst)
