"""Identification of dots among blobs: the best labeling that fits, provided that it is unique.

Labels are sought among rough ellipses (`search`); when the dots of the best labeling are fitted to the grey levels, the
labelings are fitted again, with others of the same dots and with what tags tell (`confirm`); what is still acceptable
then and the only one (`ambiguity`) is reported.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect import kernel, kernel_pose
from markergen.detect.blobs import Ellipses
from markergen.detect.conic_projection import Outlines
from markergen.detect.fiducials import CONFIRMS, NO_TAGS, REFUTES, Sightings, TagReader, verdicts
from markergen.detect.labeling_hypotheses import (
    LEAST_DOTS,
    NEAR_PX,
    NEAR_REACH,
    Labelings,
    assign,
    distinct,
    find_labelings,
    fit_labelings,
    joined,
    misfits,
    none,
)
from markergen.detect.pose_hypotheses import DotLayout
from markergen.detect.rival_labelings import FEW_DOTS, rival_labelings
from markergen.detect.seen_models import Model, Poses
from markergen.model.camera import Camera
from markergen.model.feature import DOT_PIXELS
from markergen.model.tag import Tag

ACCEPT_PX, ACCEPT_SHARE = 0.6, 0.005
"""Maximum misfit of a labeling without missing dots: px, plus a share of the marker's extent in the image for an
imperfect calibration. With dots missing it is lower, in proportion to the remaining checks (see `Search.bound`)."""

ROUGH_PX, REFUSED_PX = 1.0, 0.4
"""Additional misfit of ellipses that are not fitted to the grey levels yet, and of those that the fit refuses: these
are good to 0.1 to 0.3 px, along each of five axes."""

LEAST_ROUND = 3
"""Minimum number of dots that the fit to the grey levels does not refuse, beside half of a labeling."""

ALIKE_SHARE = 0.6
"""Share of a labeling's dots that another one has in common if it differs in single dots only."""

WHOLE_SHARE = 0.75
"""Share of a marker's dots that a labeling must have to end the search, in which case rivals are sought among them."""

PRINT_SIGMAS = 4.0
"""Multiple of the print's standard deviation, added in quadrature. The misfit of four dots in sigma follows a chi
distribution with two degrees of freedom: 1 in 3000 exceeds four."""

CROWD = 20
"""Number of blobs above which the bound for four dots, which leave but two numbers to check, falls in proportion:
among 80 dots of strangers there are four that fit to a pixel in 1 of 40 images."""

OUTLINE_PX, OUTLINE_SHARE = 0.1, 0.02
"""Maximum misfit of the outlines alone of four dots without a camera: px, plus a share of a dot's radius in the image.
A mirrored marker that is nearly symmetric misses by as little as 0.027 of the radius; noise is a tenth of a pixel."""

UNIQUE_RATIO, UNIQUE_PX = 2.0, 0.5
"""Margin to any other labeling of the same blobs: it must be worse by this factor, and by this many px for the marker
and for each dot that it misses, of many dots for each such share of them: see `_margin`."""

MISSING_PX, WRONG_KIND_PX = 1.0, 3.0
"""Penalties added to the misfit when labelings are compared: for a dot that should be visible and is missing, and for a
ring in place of a disk or vice versa."""

EDGE_PX = 3.0
"""Margin in px: a dot is expected if it is predicted inside the image, by more than this plus its size."""

SMALL = f"dots less than {DOT_PIXELS:g} px across are hardly found"

_KEPT = 24
"""Maximum number of labelings that are compared in the end, the best ones."""


@dataclass(frozen=True, eq=False)
class View:
    """A layout and the camera that it is sought with.

    Attributes
    ----------
    camera : Camera
        Defines pixels; its calibration is used only if `calibrated`.
    print_sigma : float, m
        Standard deviation of a dot's place in the print along each axis; used only with a calibration.
    """

    layout: DotLayout
    camera: Camera
    calibrated: bool = True
    print_sigma: float = 0.0

    @property
    def px(self) -> float:
        """Pixels per unit of the normalized coordinates."""
        return float(np.sqrt(self.camera.fx * self.camera.fy))


@dataclass(frozen=True, eq=False)
class Search:
    """Labelings of one marker.

    Attributes
    ----------
    candidates : Labelings
        Best first.
    bound : array (A,), px
        Maximum accepted misfit of each.
    missing : array (A,) of int
        Number of dots that should be visible and have no blob.
    strange : array (A,)
        Evidence against the kinds of its dots: for each disk with a ring in its place, or a ring with a disk in its
        place, from 0 to 1.
    tags, sighting : arrays (A,) of int
        Verdict of the tags in the image on each labeling, and the tag that it is based on: see `verdicts`.
    seen : Sightings
        Tags that were read.
    ringed : bool
        False if the marker has a ring and none is seen, so that kinds tell nothing.
    reason : str
        Reason why there is no labeling; empty if the first candidate is one, unless another contends.
    """

    view: View
    candidates: Labelings
    bound: Array
    missing: Indices
    strange: Array
    tags: Indices
    sighting: Indices
    seen: Sightings = NO_TAGS
    ringed: bool = True
    reason: str = ""

    @property
    def layout(self) -> DotLayout:
        """Layout of the marker."""
        return self.view.layout

    @property
    def rank(self) -> tuple[int, int, float]:
        """Sort key, lower is better: a visible tag, most dots, least misfit including penalties for missing dots."""
        misfit = float(self.candidates.misfit[0] + MISSING_PX * self.missing[0])
        return -int(self.tags[0]), -int(self.candidates.count[0]), misfit

    def __len__(self) -> int:
        return len(self.candidates)

    def take(self, chosen: Indices) -> "Search":
        """Return a subset of the labelings."""
        per_labeling = ("bound", "missing", "strange", "tags", "sighting")
        parts = {name: getattr(self, name)[chosen] for name in per_labeling}
        return replace(self, candidates=self.candidates.take(chosen), **parts)

    def without(self, claimed: NDArray[np.bool_]) -> "Search | None":
        """Return the labelings that use no claimed blobs (B,), numbered without these; None if the best one does."""
        taken = np.asarray((claimed[self.candidates.blobs] & (self.candidates.blobs >= 0)).any(axis=-1))
        if taken[:1].any():
            return None
        rest, number = self.take(np.flatnonzero(~taken)), np.append(np.cumsum(~claimed) - 1, -1)
        return replace(rest, candidates=replace(rest.candidates, blobs=number[rest.candidates.blobs]))

    @property
    def blobs(self) -> Indices:
        """Blobs (n,) of the best labeling, -1 for none."""
        return self.candidates.blobs[0]

    @property
    def corners(self) -> Array | None:
        """Corners (4, 2) in px of the tag that confirms the best labeling, or None."""
        return self.seen.pixels[self.sighting[0]] if self.tags[0] == CONFIRMS else None


CUT = "there are too many alike for a full search"


def search(ellipses: Ellipses, view: View, rough: Array | None = None, thorough: bool = True) -> Search:
    """Find the labelings of blobs that are consistent with the camera, best first.

    Guessed poses (`guess_poses`) take blobs near the dots they predict; labelings of four or more dots are fitted, and
    verified by the distances of centers and outlines from those of the fitted pose, which leaves 5 m - 6 numbers of m
    dots to check. The search ends with a labeling of the whole marker, which may be wrong, or ambiguous: see `confirm`.

    Parameters
    ----------
    rough : array (B,) in px, or None
        Additional misfit of ellipses that are not fitted: `ROUGH_PX` or `REFUSED_PX`.
    thorough : bool
        False for a further copy of a marker: found if most of it is in plain sight, with its ring if it has one.
    """
    if len(ellipses) < LEAST_DOTS:
        needed = f"at least {LEAST_DOTS} of the marker's {len(view.layout)} are needed"
        return _failed(view, f"found {_dots(len(ellipses))}, {needed}; {SMALL}")

    def judge(candidates: Labelings) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        enough = candidates.take(np.flatnonzero(candidates.misfit < np.inf))
        if not len(enough):
            return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
        judged = _judged(enough, ellipses, view, rough, kinds=False)
        misfit, count = judged.candidates.misfit, judged.candidates.count
        whole = (judged.missing == 0) & (count >= WHOLE_SHARE * len(view.layout)) & (misfit <= 0.5 * judged.bound)
        return misfit <= judged.bound, whole

    candidates = find_labelings(ellipses, view.layout, view.px, view.calibrated, judge=judge, thorough=thorough)
    if not len(candidates) or candidates.count[0] < LEAST_DOTS:
        found = _failed(view, _how_far(ellipses, candidates, view))
    else:
        found = _answered(_judged(candidates, ellipses, view, rough), ellipses)
    return replace(found, reason=f"{found.reason}; {CUT}") if found.reason and candidates.cut else found


def given(blobs: Indices, model: Model, view: View) -> Search:
    """Return a labeling (n,), with a model near the right one, in the form that `confirm` takes."""
    silent = np.zeros(1, dtype=np.intp)
    candidates = Labelings(blobs[None], np.full(1, np.inf), model, view.layout)
    return Search(view, candidates, np.zeros(1), silent, np.zeros(1), silent, silent - 1)


def confirm(
    found: Search,
    ellipses: Ellipses,
    rough: Array | None = None,
    tag: Tag | None = None,
    tags: Sightings | TagReader = NO_TAGS,
) -> Search:
    """Return the labelings of a search fitted again to ellipses that are better known, with rivals of the best one.

    Parameters
    ----------
    ellipses : Ellipses
        Those of the search, of which some are now fitted to the grey levels.
    tag, tags : Tag or None, Sightings or TagReader
        The marker's tag, and the tags in the image: labelings that put another tag in its place are left out.
    """
    view = found.view
    layout, px, pool = view.layout, view.px, found.candidates
    pool = fit_labelings(pool.blobs, pool.model, ellipses, layout, px, rings_tell=True)
    judged = _judged(pool.take(distinct(pool.blobs, pool.misfit)), ellipses, view, rough)
    best = judged.take(np.arange(1))
    misfit = min(best.candidates.misfit[0], judged.bound[0])
    # Clutter around the marker may have spoiled the search for other labelings of the same dots. Without a ring,
    # nothing is sure about kinds: one of the dots may be a ring that was read as a disk.
    key = best.blobs[layout.rings]
    ringed = not len(key) or bool(ellipses.ring[key[key >= 0]].any())
    lack = int(_margin(best, max(misfit, 0.0)))
    rivals = rival_labelings(best.candidates, lack, ellipses, layout, px, ringed)
    if len(rivals):
        pool = joined(judged.candidates, rivals)
        judged = _judged(pool.take(distinct(pool.blobs, pool.misfit)), ellipses, view, rough, ringed)
    answered = _answered(_told(judged, tag, tags), ellipses, tag)
    return answered if answered.reason else _settled(answered)


def _judged(
    candidates: Labelings, ellipses: Ellipses, view: View, rough: Array | None, ringed: bool = True, kinds: bool = True
) -> Search:
    """Rank labelings with the evidence against them, by misfit and missing dots; rejected ones come last."""
    layout, px = view.layout, view.px
    printing = _printing(candidates, px, view.print_sigma)
    if kernel.library() is not None and isinstance(candidates.model, Poses):
        drawn, camera = candidates.predicted, view.camera
        predicted = camera.to_pixels(drawn.center), drawn.shape, drawn.seen
        size = camera.width, camera.height, camera.fx, camera.fy, EDGE_PX
        settings = *size, px, ACCEPT_PX, ACCEPT_SHARE, REFUSED_PX, LEAST_ROUND, _crowded(ellipses)
        missing, bound = kernel_pose.judge_poses(
            candidates.blobs, (ellipses.center, rough), predicted, printing, settings
        )
    else:
        missing = (expected(candidates.predicted, view.camera) & (candidates.blobs < 0)).sum(axis=-1)
        bound = _bound(candidates, missing, ellipses, px, printing, rough)
    # In a coarse print, leaving out any dot may improve the fit: if all dots are acceptable, keep them all.
    lack = np.hypot(MISSING_PX, printing) * (len(layout) - candidates.count)
    order = np.lexsort((candidates.misfit + lack, candidates.misfit > bound))[:_KEPT]
    candidates, bound, missing = candidates.take(order), bound[order], missing[order]
    there = candidates.blobs if ringed else np.full(candidates.blobs.shape, -1)
    if kinds and (candidates.blobs < 0).any():
        near, _ = assign(candidates.predicted, ellipses, layout, NEAR_REACH, NEAR_PX / px, rings_tell=False)
        there = np.where(candidates.blobs < 0, near, there)
    strange = np.sum(np.abs(ellipses.hole[there] - layout.rings) * (there >= 0), axis=-1)
    silent = np.zeros(len(candidates), dtype=np.intp)
    return Search(view, candidates, bound, missing, strange, silent, silent - 1, ringed=ringed)


def _told(judged: Search, tag: Tag | None, tags: Sightings | TagReader) -> Search:
    """Add what the tags tell; labelings with their tag come first."""
    # A homography maps only the dots' plane.
    if tag is None or not (judged.view.calibrated or not judged.layout.points[0, 2]):
        return judged
    camera = judged.view.camera
    corners = judged.candidates.model.project(np.column_stack([tag.corners, np.zeros(4)]))
    fits = judged.candidates.misfit <= judged.bound
    with np.errstate(invalid="ignore"):
        seen = tags.near(camera.to_pixels(corners[fits]))
    told, sighting = verdicts(corners, tag, camera, seen)
    order = np.lexsort((told != CONFIRMS, ~fits))
    return replace(judged, tags=told, sighting=sighting, seen=seen).take(order)


def _answered(judged: Search, ellipses: Ellipses, tag: Tag | None = None) -> Search:
    """Return the labelings that no tag refutes, with the reason if the best one is not acceptable."""
    view = judged.view
    layout, fits = view.layout, judged.candidates.misfit <= judged.bound
    found = judged.take(np.flatnonzero(judged.tags != REFUTES))
    if fits[0] and (not len(found) or not found.candidates.misfit[0] <= found.bound[0]):
        return replace(judged, reason=_other_tag(judged, tag))
    if len(found) and found.candidates.misfit[0] <= found.bound[0]:
        return found
    # The labeling of the most dots tells why.
    count = judged.candidates.count - judged.missing
    best = judged.take(np.lexsort((judged.candidates.misfit, -count))[:1])
    seen, misfit = int(best.candidates.count[0]), best.candidates.misfit[0]
    if seen < best.missing[0]:
        why = f"at most {seen} of {seen + best.missing[0]} dots that should be seen are where they should be"
    elif best.bound[0] < 0 and view.calibrated:
        why = f"most of the {seen} that are where dots should be are not round"
    elif best.bound[0] < 0:
        why = f"without a camera, {seen} of {len(layout)} dots fit too loosely to tell their labels"
    else:
        why = f"the best labeling fits {seen} of {len(layout)} dots to {misfit:.2g} px, {best.bound[0]:.2g} px allowed"
    return replace(judged, reason=f"found {_dots(len(ellipses))}, but not in the marker's layout: {why}")


def ambiguity(chosen: Search) -> str:
    """Return the reason why the best labeling of a search is not unique; empty if it is."""
    rival = contender(chosen, chosen, same_marker=True)
    if rival is None:
        return ""
    pair = f"{chosen.candidates.misfit[0]:.2g} and {chosen.candidates.misfit[rival]:.2g} px"
    return f"labels are ambiguous{'' if chosen.ringed else ' without the key ring'}: two labelings fit, to {pair}"


def contender(chosen: Search, others: Search, same_marker: bool) -> int | None:
    """Return the index of a labeling that explains the best one's blobs differently, and nearly as well, or None.

    Labelings that share no blob are other copies; those that agree on their common blobs are parts of one labeling.
    """
    best, labelings = chosen.blobs, others.candidates.blobs
    taken = np.zeros(max(best.max(), labelings.max(initial=-1)) + 2, dtype=bool)
    # The last is that of -1, no blob.
    taken[best[best >= 0]] = True
    shared = taken[labelings].any(axis=-1)
    if same_marker:
        same = labelings == best
        shared &= ~(same | (labelings < 0)).all(axis=-1) & ~(same | (best < 0)).all(axis=-1)
        # With most dots in common, the pose is the same, and only the others are in doubt: see `_settled`.
        shared &= ~_alike(chosen.candidates.count[0], best, labelings)
    # Fewer dots explained, or more expected dots missing, count against a labeling.
    fewer = chosen.candidates.count[0] - others.candidates.count
    more = MISSING_PX * np.maximum(fewer, others.missing - chosen.missing[0])
    strange = WRONG_KIND_PX * (others.strange - chosen.strange[0])
    excess = others.candidates.misfit + more + strange
    allowed = _margin(chosen, chosen.candidates.misfit[0])
    # A tag in the right place weighs more than any dot.
    told = others.tags >= chosen.tags[0]
    rivals = np.flatnonzero(shared & told & (excess < allowed))
    return int(rivals[np.argmin(excess[rivals])]) if len(rivals) else None


def _margin(chosen: Search, misfit: float) -> float:
    """Return the misfit in px, penalties included, below which another labeling contends with the best one.

    A missing dot is one of `FEW_DOTS` checks at most: of 150 dots, it hardly weakens what the others tell.
    """
    missing = chosen.missing[0] * min(1.0, FEW_DOTS / chosen.candidates.count[0])
    return float(UNIQUE_RATIO * misfit + UNIQUE_PX * (1 + missing))


def _alike(count: int, best: Indices, labelings: Indices) -> NDArray[np.bool_]:
    """Return which labelings (A, n) have the same blobs as the best one for most of its dots."""
    agreed = ((labelings == best) & (best >= 0)).sum(axis=-1)
    return np.asarray(agreed >= max(LEAST_DOTS, ALIKE_SHARE * count))


def _settled(found: Search) -> Search:
    """Return labelings without the best one's dots that others like it, which fit as well, give to other blobs."""
    candidates = found.candidates
    best, count = found.blobs, int(candidates.count[0])
    close = candidates.misfit < UNIQUE_RATIO * candidates.misfit[0] + UNIQUE_PX
    others = candidates.blobs[close & _alike(count, best, candidates.blobs) & (found.tags >= found.tags[0])]
    if len(others) < 2:
        return found
    doubtful = ((others != best) & (others >= 0) & (best >= 0)).any(axis=0)
    # A blob that is another dot's in another labeling is in doubt, too.
    doubtful |= (best >= 0) & ((others[:, :, None] == best) & (np.eye(len(best)) == 0)).any(axis=(0, 1))
    if not doubtful.any() or count - np.count_nonzero(doubtful) < LEAST_DOTS:
        return found
    blobs = candidates.blobs.copy()
    blobs[0, doubtful] = -1
    return replace(found, candidates=replace(candidates, blobs=blobs))


def _printing(candidates: Labelings, px: float, print_sigma: float) -> Array:
    """Return the error (A,) of the print in px, at `PRINT_SIGMAS`, at each pose's distance; 0 without a camera."""
    if not isinstance(candidates.model, Poses):
        return np.zeros(len(candidates))
    depth = np.abs(candidates.model.translation[:, 2])
    return np.divide(PRINT_SIGMAS * print_sigma * px, depth, out=np.zeros(len(depth)), where=depth > 0)


def _bound(
    candidates: Labelings, missing: Indices, ellipses: Ellipses, px: float, printing: Array, rough: Array | None
) -> Array:
    """Return the maximum misfit (A,) in px: lower with missing dots, by the share of dots beyond those fixing the pose.

    Less than half of the expected dots are never enough. Negative where no misfit is acceptable.
    """
    used = candidates.blobs >= 0
    center = ellipses.center[candidates.blobs]
    low, high = (np.where(used[..., None], center, fill) for fill in (np.inf, -np.inf))
    extent = px * np.max(high.max(axis=1) - low.min(axis=1), axis=-1)
    count = candidates.count
    bound = (ACCEPT_PX + ACCEPT_SHARE * extent) * (count - 3) / np.maximum(count + missing - 3, 1)
    unsure, refused = np.zeros((2, len(count)))
    if rough is not None:
        own = rough[candidates.blobs] * used
        unsure, refused = np.sqrt((own * own).sum(axis=-1) / count), (own == REFUSED_PX).sum(axis=-1)
    # What is no dot may be where one should be, but does not carry a labeling.
    round_ = count - refused >= np.maximum(LEAST_ROUND, count / 2)
    if isinstance(candidates.model, Poses):
        # Four corners of a square are a third of a regular 12-gon, wherever equal dots are on a grid.
        sure = np.hypot(bound, printing) * np.where(count == LEAST_DOTS, _crowded(ellipses), 1.0)
        return np.where(round_ & (count >= missing), np.hypot(sure, unsure), -1.0)
    told = _plane_is_told(candidates, missing, ellipses, px, unsure)
    return np.where(round_ & told, np.hypot(bound, unsure), -1.0)


def _crowded(ellipses: Ellipses) -> float:
    """Share of the bound that is left to four dots."""
    return min(1.0, CROWD / max(len(ellipses), 1))


def _plane_is_told(
    candidates: Labelings, missing: Indices, ellipses: Ellipses, px: float, unsure: Array
) -> NDArray[np.bool_]:
    """Return which homographies (A,) are supported by more than four centers, which any homography fits.

    Their outlines must fit, the more closely the fewer dots there are and the more are missing; four dots of a larger
    marker, or half of the expected ones, are not enough.
    """
    used, count = candidates.blobs >= 0, candidates.count
    in_place = replace(candidates.predicted, center=ellipses.center[candidates.blobs])
    radius = px * np.linalg.det(ellipses.shape)[candidates.blobs] ** 0.25
    allowed = OUTLINE_PX + OUTLINE_SHARE * np.sum(radius * used, axis=-1) / np.maximum(count, 1)
    enough = (count == used.shape[1]) | ((count > LEAST_DOTS) & (count > missing))
    allowed = np.hypot(allowed * (count - 3) / (1 + missing), unsure)
    return enough & (misfits(in_place, ellipses, candidates.blobs, px) <= allowed)


def expected(drawn: Outlines, camera: Camera) -> NDArray[np.bool_]:
    """Return which dots (A, n) are predicted wholly inside the image, with a margin."""
    with np.errstate(invalid="ignore", divide="ignore"):
        pixels = camera.to_pixels(drawn.center)
        half = np.sqrt(drawn.shape.diagonal(axis1=-2, axis2=-1)) * camera.focal + EDGE_PX
        middle = np.array([camera.width - 1, camera.height - 1]) / 2
        inside = np.abs(pixels - middle) + half <= middle
    return drawn.seen & inside[..., 0] & inside[..., 1]


def _how_far(ellipses: Ellipses, candidates: Labelings, view: View) -> str:
    """Return the reason why there are no four dots in the marker's layout."""
    layout, found = view.layout, f"found {_dots(len(ellipses))}"
    if layout.rings.any() and not ellipses.ring.any():
        found += ", no key ring"
    if not len(candidates) or candidates.count[0] < 2:
        return f"{found}, but not in the marker's layout"
    fit = f"{found}, of which at most {candidates.count[0]} fit the marker's layout of {len(layout)}"
    beyond = candidates.predicted.seen & ~expected(candidates.predicted, view.camera)
    cut_off = (beyond | (candidates.blobs >= 0)).all(axis=-1).any()
    return f"{fit}; the others may be cut off by the image's edge" if cut_off else fit


def _dots(count: int) -> str:
    return f"{count} dot{'' if count == 1 else 's'}"


def _other_tag(judged: Search, tag: Tag | None) -> str:
    """Return the reason why a tag refutes the best labeling, which fits."""
    family, number = judged.seen.names[judged.sighting[0]]
    if tag is not None and (family, number) == (tag.family, tag.id):
        return f"found its dots and its tag {tag}, which do not lie as in the marker: the print may be a mirrored one"
    return f"found a marker of this layout with the tag {family}:{number}, not {tag}"


def _failed(view: View, reason: str) -> Search:
    silent = np.zeros(0, dtype=np.intp)
    nothing = none(view.layout, calibrated=view.calibrated)
    return Search(view, nothing, np.zeros(0), silent, np.zeros(0), silent, silent, reason=reason)
