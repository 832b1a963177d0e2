"""Which blob is which dot: the best of the labelings that fit, if it is the only one."""

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
from markergen.model.camera import Camera
from markergen.model.tag import Tag

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_BLOBS = 256
"""Blobs among which labels are sought."""

ACCEPT_PX, ACCEPT_SHARE = 0.6, 0.005
"""Largest misfit of a labeling without missing dots: px, plus a share of the marker's extent in the image for an
imperfect calibration. With dots missing it is less, in the ratio of what is left to check (see `Search.bound`)."""

PRINT_SIGMAS = 4.0
"""Of the print, added in quadrature. The misfit of four dots in sigma is chi with two degrees of freedom: 1 in 3000 has
more than four."""

OUTLINE_PX, OUTLINE_SHARE = 0.1, 0.02
"""Largest misfit of the outlines alone of four dots without a camera: px, plus a share of a dot's radius in the image.
A mirrored marker that is nearly symmetric misses by as little as 0.027 of the radius, a tenth of a pixel is noise."""

UNIQUE_RATIO, UNIQUE_PX = 2.0, 0.5
"""Any other labeling of the same blobs must be worse by this factor, and by so many px for the marker and each dot that
it misses."""

MISSING_PX, WRONG_KIND_PX = 1.0, 3.0
"""What is added to the misfit when labelings are compared: for a dot that should be seen and is not, and for one in
whose place there is a ring instead of a disk, or the other way around."""

EDGE_PX = 3.0
"""A dot is expected if it is predicted inside the image, and farther than this, plus its size, from the edge."""


@dataclass(frozen=True, eq=False)
class Search:
    """What a search for one marker came to.

    Attributes
    ----------
    layout : DotLayout
    candidates : Labelings
        Best first.
    bound : array (A,), px
        Misfit up to which each is accepted.
    missing : array (A,) of int
        Dots that should be seen and have no blob.
    rings, disks : arrays (A,) of int
        Disks in whose place there is a ring, and rings in whose place there is a disk.
    tags, sighting : arrays (A,) of int
        What the tag in the image says of each labeling, and which one it is: see `verdicts`.
    alone : Search or None
        The same for the blobs of the best labeling alone; if it has no ring, as though rings looked like disks.
    reason : str
        Why there is no labeling; empty if the first candidate is one, unless another contends.
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
        """The less, the better: its tag seen, most dots, least misfit, to which dots that should be seen add."""
        misfit = float(self.candidates.misfit[0] + MISSING_PX * self.missing[0])
        return -int(self.tags[0]), -int(self.candidates.count[0]), misfit

    def __len__(self) -> int:
        return len(self.candidates)

    def take(self, chosen: Indices) -> "Search":
        """Return the chosen labelings."""
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
) -> Search:
    """Find the labelings of blobs that the camera could have seen, the best one first.

    Guessed poses (`guess_poses`) take blobs near the dots they predict; labelings of four dots or more are fitted, and
    verified by how far centers and outlines are from those of the fitted pose, which leaves 5 m - 6 numbers of m dots
    to check. A labeling that is accepted may still not be the only one: see `ambiguity`.

    Parameters
    ----------
    camera : Camera
        For pixels; its calibration counts only if `calibrated`.
    print_sigma : float, m
        Of a dot's place in the print along each axis; counts with a calibration alone.
    tag, sightings : Tag or None, Sightings
        The marker's tag, and those in the image: labelings that put another tag in its place are left out.
    find : callable
        `find_labelings`, or what remembers its results.
    """
    px = float(np.sqrt(camera.fx * camera.fy))
    if len(ellipses) < LEAST_DOTS:
        return _failed(
            layout, f"found {len(ellipses)} dots, and labels take {LEAST_DOTS} of the marker's {len(layout)}"
        )
    if len(ellipses) > MAX_BLOBS:
        return _failed(layout, f"found {len(ellipses)} dots: too many to tell the marker's from the others")
    candidates = find(ellipses, layout, px, calibrated)
    if not len(candidates) or candidates.count[0] < LEAST_DOTS:
        return _failed(layout, _how_far(ellipses, layout, candidates, camera))

    def ranked(candidates: Labelings, own: Ellipses) -> Search:
        return _ranked(candidates, own, layout, camera, px, print_sigma, tag, sightings)

    everything = ranked(candidates, ellipses)
    found = everything.take(np.flatnonzero(everything.tags != REFUTES))
    if everything.tags[0] == REFUTES and everything.candidates.misfit[0] <= everything.bound[0]:
        # What else there is may be another copy, or just strangers.
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
    # What is around the marker may have spoiled the search for other labelings of the same dots.
    ringed = not layout.rings.any() or bool((found.blobs[layout.rings] >= 0).any())
    own = ellipses.take(found.blobs[found.blobs >= 0])
    if ringed and len(own) == len(ellipses):
        return found
    lone = ranked(find_labelings(own, layout, px, calibrated, rings_tell=ringed), own)
    return replace(found, alone=lone.take(np.flatnonzero(lone.tags != REFUTES)))


def _ranked(
    candidates: Labelings,
    ellipses: Ellipses,
    layout: DotLayout,
    camera: Camera,
    px: float,
    print_sigma: float,
    tag: Tag | None,
    seen: Sightings,
) -> Search:
    """Labelings with what speaks against them, those with their tag first, best first by misfit and lack of dots.

    Those out of bounds come last.
    """
    absent = candidates.blobs < 0
    missing = np.sum(_expected(candidates, camera) & absent, axis=-1)
    printing = _printing(candidates, px, print_sigma)
    bound = _bound(candidates, missing, ellipses, px, printing)
    # Of a coarse print any dot may be left out for a better fit: all of them, if accepted, are the one to take.
    lack = np.hypot(MISSING_PX, printing) * (len(layout) - candidates.count)
    tags, sighting = np.zeros((2, len(candidates)), dtype=np.intp)
    # A homography is that of the dots' plane alone.
    if tag is not None and (isinstance(candidates.model, Poses) or not layout.points[0, 2]):
        corners = candidates.model.project(np.column_stack([tag.corners, np.zeros(4)]))
        tags, sighting = verdicts(corners, tag, camera, seen)
    order = np.lexsort((candidates.misfit + lack, tags != CONFIRMS, candidates.misfit > bound))
    there, _ = assign(candidates.predicted, ellipses, layout, NEAR_REACH, NEAR_PX / px, rings_tell=False)
    strange = absent & (there >= 0) & (ellipses.ring[there] != layout.rings)
    rings, disks = (np.sum(strange & (layout.rings == kind), axis=-1) for kind in (False, True))
    return Search(layout, candidates, bound, missing, rings, disks, tags, sighting).take(order)


def ambiguity(chosen: Search) -> str:
    """Reason why the best labeling of a search is not the only one; empty if it is."""
    for others in (chosen, chosen.alone):
        rival = None if others is None else contender(chosen, others, same_marker=True)
        if others is not None and rival is not None:
            pair = f"{chosen.candidates.misfit[0]:.2g} and {others.candidates.misfit[rival]:.2g} px"
            lost = chosen.layout.rings.any() and not (chosen.blobs[chosen.layout.rings] >= 0).any()
            return f"labels are ambiguous{' without the key ring' if lost else ''}: two labelings fit, to {pair}"
    return ""


def contender(chosen: Search, others: Search, same_marker: bool) -> int | None:
    """Index of a labeling that explains blobs of the best labeling differently, and nearly as well; None without any.

    Labelings that share no blob are other copies; those that agree in what they have are parts of the same labeling.
    """
    best, labelings = chosen.blobs, others.candidates.blobs
    if others is chosen.alone:
        # There the blobs are numbered by themselves.
        best = np.where(best >= 0, np.cumsum(best >= 0) - 1, -1)
    shared = np.isin(labelings, best[best >= 0]).any(axis=-1)
    if same_marker:
        same = labelings == best
        shared &= ~(same | (labelings < 0)).all(axis=-1) & ~(same | (best < 0)).all(axis=-1)
    # Fewer dots explained, or more that should be seen and are not, speak against a labeling.
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
    """Error (A,) of the print in px, at `PRINT_SIGMAS`, at the distance of each pose; 0 without a camera."""
    if not isinstance(candidates.model, Poses):
        return np.zeros(len(candidates))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(PRINT_SIGMAS * print_sigma * px / np.abs(candidates.model.translation[:, 2]), posinf=0.0)


def _bound(candidates: Labelings, missing: Indices, ellipses: Ellipses, px: float, printing: Array) -> Array:
    """Accepted misfit (A,) in px: less where dots are missing, by the share of dots beyond those that fix the pose.

    Less than half of the dots that should be seen are never enough. Negative for what is not accepted at any misfit.
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
    """Whether (A,) homographies are backed by more than the four centers that any homography fits.

    Their outlines must be right, the more so the fewer dots there are and the more are missing; and four dots of more,
    or half of those that should be seen, are not enough.
    """
    used, count = candidates.blobs >= 0, candidates.count
    in_place = replace(candidates.predicted, center=ellipses.center[candidates.blobs])
    radius = px * np.linalg.det(ellipses.shape)[candidates.blobs] ** 0.25
    allowed = OUTLINE_PX + OUTLINE_SHARE * np.sum(radius * used, axis=-1) / np.maximum(count, 1)
    enough = (count == used.shape[1]) | ((count > LEAST_DOTS) & (count > missing))
    return enough & (misfits(in_place, ellipses, candidates.blobs, px) <= allowed * (count - 3) / (1 + missing))


def _expected(candidates: Labelings, camera: Camera) -> NDArray[np.bool_]:
    """Dots (A, n) that are predicted wholly inside the image, by a margin."""
    drawn = candidates.predicted
    with np.errstate(invalid="ignore", divide="ignore"):
        pixels = camera.to_pixels(drawn.center)
        half = np.sqrt(drawn.shape[..., [0, 1], [0, 1]]) * camera.focal + EDGE_PX
        size = np.array([camera.width, camera.height])
        inside = ((pixels - half >= 0) & (pixels + half <= size - 1)).all(axis=-1)
    return drawn.seen & inside


def _how_far(ellipses: Ellipses, layout: DotLayout, candidates: Labelings, camera: Camera) -> str:
    """Why there are no four dots in the marker's layout."""
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
    """Why the best labeling, which fits, is refuted by a tag."""
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
