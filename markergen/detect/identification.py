"""Identification of dots among blobs: the best labeling that fits, provided that it is unique."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Ellipses
from markergen.detect.fiducials import CONFIRMS, NO_TAGS, REFUTES, Sightings, verdicts
from markergen.detect.labeling_hypotheses import (
    LEAST_DOTS,
    NEAR_PX,
    NEAR_REACH,
    Labelings,
    Planes,
    Poses,
    assign,
    find_labelings,
    misfits,
)
from markergen.detect.pose_hypotheses import DotLayout
from markergen.detect.rival_labelings import rival_labelings
from markergen.model.camera import Camera
from markergen.model.tag import Tag

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_BLOBS = 2256
"""Maximum number of blobs among which labels are sought."""

ACCEPT_PX, ACCEPT_SHARE = 0.6, 0.005
"""Maximum misfit of a labeling without missing dots: px, plus a share of the marker's extent in the image for an
imperfect calibration. With dots missing it is lower, in proportion to the remaining checks (see `Search.bound`)."""

PRINT_SIGMAS = 4.0
"""Multiple of the print's standard deviation, added in quadrature. The misfit of four dots in sigma follows a chi
distribution with two degrees of freedom: 1 in 3000 exceeds four."""

OUTLINE_PX, OUTLINE_SHARE = 0.1, 0.02
"""Maximum misfit of the outlines alone of four dots without a camera: px, plus a share of a dot's radius in the image.
A mirrored marker that is nearly symmetric misses by as little as 0.027 of the radius; noise is a tenth of a pixel."""

UNIQUE_RATIO, UNIQUE_PX = 2.0, 0.5
"""Margin to any other labeling of the same blobs: it must be worse by this factor, and by this many px for the marker
and for each dot that it misses."""

MISSING_PX, WRONG_KIND_PX = 1.0, 3.0
"""Penalties added to the misfit when labelings are compared: for a dot that should be visible and is missing, and for a
ring in place of a disk or vice versa."""

ROUGH_PX = 1.0
"""Additional misfit accepted of ellipses that are not fitted yet."""

EDGE_PX = 3.0
"""Margin in px: a dot is expected if it is predicted inside the image, by more than this plus its size."""


@dataclass(frozen=True, eq=False)
class Search:
    """Result of a search for one marker.

    Attributes
    ----------
    layout : DotLayout
    candidates : Labelings
        Best first.
    bound : array (A,), px
        Maximum accepted misfit of each.
    missing : array (A,) of int
        Number of dots that should be visible and have no blob.
    rings, disks : arrays (A,) of int
        Number of disks with a ring in their place, and of rings with a disk in their place.
    tags, sighting : arrays (A,) of int
        Verdict of the tags in the image on each labeling, and the tag that it is based on: see `verdicts`.
    alone : Search or None
        Search on only the blobs of the best labeling; if it has no ring, as though rings looked like disks.
    reason : str
        Reason why there is no labeling; empty if the first candidate is one, unless another contends.
    """

    layout: DotLayout
    candidates: Labelings
    bound: Array
    missing: Indices
    rings: Indices
    disks: Indices
    tags: Indices
    sighting: Indices
    alone: "Search | None" = None
    reason: str = ""

    @property
    def rank(self) -> tuple[int, int, float]:
        """Sort key, lower is better: a visible tag, most dots, least misfit including penalties for missing dots."""
        misfit = float(self.candidates.misfit[0] + MISSING_PX * self.missing[0])
        return -int(self.tags[0]), -int(self.candidates.count[0]), misfit

    def __len__(self) -> int:
        return len(self.candidates)

    def take(self, chosen: Indices) -> "Search":
        """Return a subset of the labelings."""
        per_labeling = ("bound", "missing", "rings", "disks", "tags", "sighting")
        parts = {name: getattr(self, name)[chosen] for name in per_labeling}
        return replace(self, candidates=self.candidates.take(chosen), **parts)

    @property
    def blobs(self) -> Indices:
        """Blobs (n,) of the best labeling, -1 for none."""
        return self.candidates.blobs[0]


def search(
    ellipses: Ellipses,
    layout: DotLayout,
    camera: Camera,
    calibrated: bool = True,
    print_sigma: float = 0.0,
    tag: Tag | None = None,
    sightings: Sightings = NO_TAGS,
    find: Callable[..., Labelings] = find_labelings,
    rough: bool = False,
) -> Search:
    """Find the labelings of blobs that are consistent with the camera, best first.

    Guessed poses (`guess_poses`) take blobs near the dots they predict; labelings of four or more dots are fitted, and
    verified by the distances of centers and outlines from those of the fitted pose, which leaves 5 m - 6 numbers of m
    dots to check. An accepted labeling may still be ambiguous: see `ambiguity`.

    Parameters
    ----------
    camera : Camera
        Defines pixels; its calibration is used only if `calibrated`.
    print_sigma : float, m
        Standard deviation of a dot's place in the print along each axis; used only with a calibration.
    tag, sightings : Tag or None, Sightings
        The marker's tag, and the tags in the image: labelings that put another tag in its place are left out.
    find : callable
        `find_labelings`, or a version that caches its results.
    rough : bool
        True for ellipses that are not fitted yet: a labeling found may be wrong, and its rivals are not sought.
    """
    px = float(np.sqrt(camera.fx * camera.fy))
    if len(ellipses) < LEAST_DOTS:
        return _failed(
            layout, f"found {len(ellipses)} dots, and labels take {LEAST_DOTS} of the marker's {len(layout)}"
        )
    if len(ellipses) > MAX_BLOBS:
        return _failed(layout, f"found {len(ellipses)} dots: too many to tell the marker's from the others")
    candidates = find(ellipses, layout, px, calibrated, judge=_judge(ellipses, layout, camera, px, print_sigma))
    if not len(candidates) or candidates.count[0] < LEAST_DOTS:
        return _failed(layout, _how_far(ellipses, layout, candidates, camera))

    def ranked(candidates: Labelings, own: Ellipses) -> Search:
        return _ranked(candidates, own, layout, camera, px, print_sigma, tag, sightings, rough)

    everything = ranked(candidates, ellipses)
    found = everything.take(np.flatnonzero(everything.tags != REFUTES))
    if everything.tags[0] == REFUTES and everything.candidates.misfit[0] <= everything.bound[0]:
        # The remaining blobs may be another copy, or clutter.
        if not len(found) or not found.candidates.misfit[0] <= found.bound[0]:
            return _failed(layout, _other_tag(everything, tag, sightings))
    elif not len(found):
        return _failed(layout, _how_far(ellipses, layout, candidates, camera))
    misfit, said = found.candidates.misfit[0], f"found {len(ellipses)} dots, but not in the marker's layout"
    if found.candidates.count[0] < found.missing[0]:
        seen, expected = found.candidates.count[0], found.candidates.count[0] + found.missing[0]
        return _failed(layout, f"{said}: only {seen} of {expected} dots that should be seen are where they should be")
    if found.bound[0] < 0:
        seen = f"{found.candidates.count[0]} of {len(layout)} dots"
        return _failed(layout, f"{said}: without a camera, {seen} fit too loosely to tell their labels")
    if not misfit <= found.bound[0]:
        fits = f"{found.candidates.count[0]} of {len(layout)} dots to {misfit:.2g} px, {found.bound[0]:.2g} px allowed"
        return _failed(layout, f"{said}: the best labeling fits {fits}")
    if found.rings[0]:
        return _failed(layout, f"{said}: there is a ring in the place of a dot")
    if rough:
        return found
    # Other labelings of the same dots.
    ringed = not layout.rings.any() or bool((found.blobs[layout.rings] >= 0).any())
    lack = int(UNIQUE_RATIO * misfit + UNIQUE_PX * (1 + found.missing[0]))
    rivals = rival_labelings(found.candidates, lack, ellipses, layout, px, ringed)
    if not len(rivals):
        return found
    lone = ranked(rivals, ellipses)
    return replace(found, alone=lone.take(np.flatnonzero(lone.tags != REFUTES)))


def _judge(ellipses, layout, camera, px, print_sigma):
    def judge(candidates):
        if not len(candidates):
            return np.zeros((2, 0), dtype=bool)
        absent = candidates.blobs < 0
        missing = np.sum(_expected(candidates, camera) & absent, axis=-1)
        bound = _bound(candidates, missing, ellipses, px, _printing(candidates, px, print_sigma))
        whole = (missing == 0) & (4 * candidates.count > 3 * len(layout)) & (candidates.misfit <= 0.5 * bound)
        return candidates.misfit <= bound, whole

    return judge


def _ranked(
    candidates: Labelings,
    ellipses: Ellipses,
    layout: DotLayout,
    camera: Camera,
    px: float,
    print_sigma: float,
    tag: Tag | None,
    seen: Sightings,
    rough: bool = False,
) -> Search:
    """Rank labelings with the evidence against them: first those with their tag, then by misfit and missing dots.

    Rejected ones come last.
    """
    absent = candidates.blobs < 0
    missing = np.sum(_expected(candidates, camera) & absent, axis=-1)
    printing = _printing(candidates, px, print_sigma)
    bound = _bound(candidates, missing, ellipses, px, printing)
    if rough:
        bound = np.where(candidates.count > missing, np.hypot(bound, ROUGH_PX), -1.0)
    # In a coarse print, leaving out any dot may improve the fit: if all dots are acceptable, keep them all.
    lack = np.hypot(MISSING_PX, printing) * (len(layout) - candidates.count)
    tags, sighting = np.zeros((2, len(candidates)), dtype=np.intp)
    # A homography maps only the dots' plane.
    if tag is not None and (isinstance(candidates.model, Poses) or not layout.points[0, 2]):
        corners = candidates.model.project(np.column_stack([tag.corners, np.zeros(4)]))
        tags, sighting = verdicts(corners, tag, camera, seen)
    order = np.lexsort((candidates.misfit + lack, tags != CONFIRMS, candidates.misfit > bound))
    there, _ = assign(candidates.predicted, ellipses, layout, NEAR_REACH, NEAR_PX / px, rings_tell=False)
    strange = absent & (there >= 0) & (ellipses.ring[there] != layout.rings)
    rings, disks = (np.sum(strange & (layout.rings == kind), axis=-1) for kind in (False, True))
    return Search(layout, candidates, bound, missing, rings, disks, tags, sighting).take(order)


def ambiguity(chosen: Search) -> str:
    """Return the reason why the best labeling of a search is not unique; empty if it is."""
    for others in (chosen, chosen.alone):
        rival = None if others is None else contender(chosen, others, same_marker=True)
        if others is not None and rival is not None:
            pair = f"{chosen.candidates.misfit[0]:.2g} and {others.candidates.misfit[rival]:.2g} px"
            lost = chosen.layout.rings.any() and not (chosen.blobs[chosen.layout.rings] >= 0).any()
            return f"labels are ambiguous{' without the key ring' if lost else ''}: two labelings fit, to {pair}"
    return ""


def contender(chosen: Search, others: Search, same_marker: bool) -> int | None:
    """Return the index of a labeling that explains the best one's blobs differently, and nearly as well, or None.

    Labelings that share no blob are other copies; those that agree on their common blobs are parts of one labeling.
    """
    best, labelings = chosen.blobs, others.candidates.blobs
    shared = np.isin(labelings, best[best >= 0]).any(axis=-1)
    if same_marker:
        same = labelings == best
        shared &= ~(same | (labelings < 0)).all(axis=-1) & ~(same | (best < 0)).all(axis=-1)
    # Fewer dots explained, or more expected dots missing, count against a labeling.
    fewer = chosen.candidates.count[0] - others.candidates.count
    more = MISSING_PX * np.maximum(fewer, others.missing - chosen.missing[0])
    strange = WRONG_KIND_PX * (others.rings + others.disks - chosen.rings[0] - chosen.disks[0])
    excess = others.candidates.misfit + more + strange
    allowed = UNIQUE_RATIO * chosen.candidates.misfit[0] + UNIQUE_PX * (1 + chosen.missing[0])
    # A tag in the right place weighs more than any dot.
    told = others.tags >= chosen.tags[0]
    rivals = np.flatnonzero(shared & told & (excess < allowed))
    return int(rivals[np.argmin(excess[rivals])]) if len(rivals) else None


def _printing(candidates: Labelings, px: float, print_sigma: float) -> Array:
    """Return the error (A,) of the print in px, at `PRINT_SIGMAS`, at each pose's distance; 0 without a camera."""
    if not isinstance(candidates.model, Poses):
        return np.zeros(len(candidates))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(PRINT_SIGMAS * print_sigma * px / np.abs(candidates.model.translation[:, 2]), posinf=0.0)


def _bound(candidates: Labelings, missing: Indices, ellipses: Ellipses, px: float, printing: Array) -> Array:
    """Return the maximum misfit (A,) in px: lower with missing dots, by the share of dots beyond those fixing the pose.

    Less than half of the expected dots are never enough. Negative where no misfit is acceptable.
    """
    used = (candidates.blobs >= 0)[..., None]
    center = ellipses.center[candidates.blobs]
    low, high = (np.where(used, center, fill) for fill in (np.inf, -np.inf))
    extent = px * np.max(high.max(axis=1) - low.min(axis=1), axis=-1)
    count = candidates.count
    bound = (ACCEPT_PX + ACCEPT_SHARE * extent) * (count - 3) / (count + missing - 3)
    if isinstance(candidates.model, Poses):
        bound = np.hypot(bound, printing)
        # Four corners of a square are a third of a regular 12-gon, wherever equal dots are on a grid.
        return np.where(count >= missing, bound, -1.0)
    return np.where(_plane_is_told(candidates, missing, ellipses, px), bound, -1.0)


def _plane_is_told(candidates: Labelings, missing: Indices, ellipses: Ellipses, px: float) -> NDArray[np.bool_]:
    """Return which homographies (A,) are supported by more than four centers, which any homography fits.

    Their outlines must fit, the more closely the fewer dots there are and the more are missing; four dots of a larger
    marker, or half of the expected ones, are not enough.
    """
    used, count = candidates.blobs >= 0, candidates.count
    in_place = replace(candidates.predicted, center=ellipses.center[candidates.blobs])
    radius = px * np.linalg.det(ellipses.shape)[candidates.blobs] ** 0.25
    allowed = OUTLINE_PX + OUTLINE_SHARE * np.sum(radius * used, axis=-1) / np.maximum(count, 1)
    enough = (count == used.shape[1]) | ((count > LEAST_DOTS) & (count > missing))
    return enough & (misfits(in_place, ellipses, candidates.blobs, px) <= allowed * (count - 3) / (1 + missing))


def _expected(candidates: Labelings, camera: Camera) -> NDArray[np.bool_]:
    """Return which dots (A, n) are predicted wholly inside the image, with a margin."""
    drawn = candidates.predicted
    with np.errstate(invalid="ignore", divide="ignore"):
        pixels = camera.to_pixels(drawn.center)
        half = np.sqrt(drawn.shape[..., [0, 1], [0, 1]]) * camera.focal + EDGE_PX
        size = np.array([camera.width, camera.height])
        inside = ((pixels - half >= 0) & (pixels + half <= size - 1)).all(axis=-1)
    return drawn.seen & inside


def _how_far(ellipses: Ellipses, layout: DotLayout, candidates: Labelings, camera: Camera) -> str:
    """Return the reason why there are no four dots in the marker's layout."""
    found = f"found {len(ellipses)} dots"
    if layout.rings.any() and not ellipses.ring.any():
        found += ", no key ring"
    if not len(candidates) or candidates.count[0] < 2:
        return f"{found}, but not in the marker's layout"
    fit = f"{found}, of which at most {candidates.count[0]} fit the marker's layout of {len(layout)}"
    absent = candidates.blobs[0] < 0
    cut_off = (candidates.predicted.seen[0] & ~_expected(candidates, camera)[0])[absent].all()
    return f"{fit}; the others may be cut off by the image's edge" if cut_off else fit


def _other_tag(search: Search, tag: Tag | None, seen: Sightings) -> str:
    """Return the reason why a tag refutes the best labeling, which fits."""
    family, number = seen.names[search.sighting[0]]
    if tag is not None and (family, number) == (tag.family, tag.id):
        return f"found its dots and its tag {tag}, which do not lie as in the marker: the print may be a mirrored one"
    return f"found a marker of this layout with the tag {family}:{number}, not {tag}"


def _failed(layout: DotLayout, reason: str) -> Search:
    nothing = Planes(np.zeros((0, 3, 3)))
    none = np.zeros((0, len(layout)), dtype=np.intp)
    candidates = Labelings(none, np.zeros(0), nothing, nothing.outlines(layout))
    count = np.zeros(0, dtype=np.intp)
    return Search(layout, candidates, np.zeros(0), count, count, count, count, count, reason=reason)
