"""Joining what was found of a body's constellations to one pose.

Constellations that agree on a pose of the body are joined, the body's other dots are taken where that pose predicts
them, and one pose is estimated from all dots. So a flip of one plate is settled by the others, and a dot counts
wherever it is seen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect.blobs import Blobs, Ellipses, undo_lens
from markergen.detect.conic_projection import Outlines, body_outlines, outlines, pose_rows
from markergen.detect.identification import expected
from markergen.detect.pose import PoseEstimate, fit_pose, homography_of, normalized_covariance, outlier
from markergen.detect.results import Detection
from markergen.estimators.budget import ErrorSources, PoseBudget
from markergen.maths.rotation import skew
from markergen.model.body import Body, Constellation, Plate
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.occlusion import hidden
from markergen.model.poses import PoseDistribution
from markergen.model.sight import LEAST_FACING

GATE_SIGMA, GATE_PX = 4.0, 1.0
"""Maximum distance of a dot from where a pose of the body predicts it: a multiple of that place's standard deviation,
and px."""

SIZE_LOG = 0.35
"""Maximum difference of the logarithm of a dot's size, the root of the product of its semi-axes, from the predicted."""

AGREED = 0.75
"""Minimum share of a constellation's dots that are where the pose of another one predicts them, for joining the two."""

SURE_FACING = 0.4
"""Cosine of the tilt from which on a dot is expected to be seen; from `LEAST_FACING` on it may be."""

SHORT_PX = 3.5
"""Length of the short axis of a dot's image at which its center is off by 1.4 times as much as the grey levels tell: by
1.0 to 1.1 times at 5 px and more, 1.2 at 4 px, 1.7 at 3 px, where it is narrower than the blur of its edges."""

ROUNDS = 3
"""Maximum number of times that further dots are taken and the pose is estimated again."""

_CORRECTIONS = 2
"""Times that centers of dots on several plates are corrected with the pose and the pose is estimated again: the
corrections hardly depend on it."""


@dataclass(frozen=True, eq=False)
class Spare:
    """What else is in an image: its rough blobs, and what fits those of some indices to the grey levels."""

    blobs: Blobs
    fit: Callable[[Indices], Blobs]


def join(
    body: Body,
    found: Sequence[tuple[Constellation, Detection]],
    camera: Camera,
    errors: ErrorSources,
    spare: Spare | None = None,
) -> list[Detection]:
    """Join the constellations found in one image to copies of their body, the one with the most dots first.

    Parameters
    ----------
    found : sequence of (Constellation, Detection)
        Of this body, found with poses, in their own frames.
    spare : Spare or None
        The image's blobs, among which further dots of the body are looked for; None to take none.

    Returns
    -------
    list of Detection
        Each with the detections of its constellations as its `parts`. Left out are those that share dots with one
        before, bodies most of whose dots should be seen and are not, and those in whose place there is another one of
        as many constellations or more: then one of the two is wrong, or the body is not as it is said to be.
    """
    waiting = [_Sighting(part, each, camera) for part, each in found]
    bodies, refuted = list[Detection](), list[Detection]()
    while waiting:
        agreed = max((_agreeing(body, guess, waiting, camera) for guess in _guesses(waiting)), key=_dots)
        detection = _estimated(body, agreed, camera, errors, spare)
        waiting = [each for each in waiting if not any(each is other for other in agreed)]
        if detection is None:
            continue
        waiting = [each for each in waiting if not share_dots(each.detection, detection)]
        plain = spare is None or _missing(body, detection, camera) <= len(detection.ids)
        (bodies if plain else refuted).append(detection)
    sure = [each for each in bodies if not any(_contradicts(body, other, each) for other in [*bodies, *refuted])]
    return sorted(sure, key=lambda each: -len(each.ids))


def _contradicts(body: Body, other: Detection, own: Detection) -> bool:
    """Return whether another detection of a body, with as many constellations or more, is where this one is."""
    if other is own or len(other.parts) < len(own.parts):
        return False
    assert other.pose is not None
    assert own.pose is not None
    middle = body.xyz.mean(axis=0)
    places = [pose.rotation @ middle + pose.translation for pose in (other.pose, own.pose)]
    reach = np.linalg.norm(body.xyz - middle, axis=-1).max()
    return bool(np.linalg.norm(places[0] - places[1]) < reach)


class _Sighting:
    """A constellation found in an image, as dots of its body."""

    def __init__(self, part: Constellation, detection: Detection, camera: Camera) -> None:
        assert detection.pose is not None
        self.part, self.detection = part, detection
        ids = np.array([point.id for point in part.marker.control_points])
        rows = np.array([int(np.flatnonzero(ids == number)[0]) for number in detection.ids], dtype=np.intp)
        self.dots = part.dots[rows]
        # The detection has the images of the dots' centers; those of the ellipses depend on no pose.
        radii, pose = part.marker.radii[rows], detection.pose
        drawn = outlines(part.marker.xyz[rows], radii, pose.rotation[None], pose.translation[None])
        self.seen = camera.from_pixels(detection.pixels) + (drawn.center - drawn.point)[0]
        self.covariance = _widened(detection.covariance, drawn.shape[0], camera)

    @cached_property
    def poses(self) -> list[PoseEstimate]:
        """Poses T_camera_body that the constellation allows: its pose, and the mirrored one if that fits as well."""
        assert self.detection.pose is not None
        return [of_body(each, self.part.plate) for each in _both(self.detection.pose)]


def _both(pose: PoseEstimate) -> list[PoseEstimate]:
    """Return an estimate, and the other pose that fits as well, if there is one."""
    if pose.alternative is None:
        return [pose]
    rotation, translation = pose.alternative
    return [pose, replace(pose, rotation=rotation, translation=translation, alternative=None)]


def _guesses(waiting: Sequence[_Sighting]) -> list[tuple[_Sighting, PoseEstimate]]:
    return [(each, pose) for each in waiting for pose in each.poses]


def _dots(agreed: Sequence[_Sighting]) -> int:
    return sum(len(each.dots) for each in agreed)


def _agreeing(
    body: Body, guess: tuple[_Sighting, PoseEstimate], waiting: Sequence[_Sighting], camera: Camera
) -> list[_Sighting]:
    """Return the sightings, one for each constellation, whose dots are where a guess at the body's pose has them."""
    own, pose = guess
    drawn = body_outlines(body, pose.rotation[None], pose.translation[None])
    agreed, taken = [own], {id(own.part)}
    for each in sorted(waiting, key=lambda other: -len(other.dots)):
        if id(each.part) in taken:
            continue
        away = _away(body, pose, drawn, each.dots, each.seen, each.covariance, camera)
        if np.mean(drawn.seen[0, each.dots] & (away < 1)) >= AGREED:
            agreed.append(each)
            taken.add(id(each.part))
    return agreed


def _away(
    body: Body, pose: PoseEstimate, drawn: Outlines, dots: Indices, seen: Array, covariance: Array, camera: Camera
) -> Array:
    """Distance (m,) of ellipse centers from where a pose predicts them, in units of what is allowed."""
    spread = GATE_SIGMA**2 * _spread(body, pose, dots, seen, covariance, camera)
    spread = spread + (GATE_PX**2 / (camera.fx * camera.fy)) * np.eye(2)
    offset = seen - drawn.center[0, dots]
    with np.errstate(invalid="ignore"):
        square = np.einsum("mi,mij,mj->m", offset, np.linalg.inv(spread), offset)
    return np.sqrt(np.where(np.isfinite(square), square, np.inf))


def _spread(body: Body, pose: PoseEstimate, dots: Indices, seen: Array, covariance: Array, camera: Camera) -> Array:
    """Covariance (m, 2, 2) of dots about the places that a pose predicts, in normalized coordinates."""
    rows = pose_rows(body.xyz[dots], pose.rotation[None], pose.translation[None])[0]
    return rows @ pose.budget.total @ rows.swapaxes(-1, -2) + normalized_covariance(seen, covariance, camera)


def share_dots(one: Detection, other: Detection) -> bool:
    """Return whether two detections have dots in common."""
    apart = np.linalg.norm(one.ellipse_centers[:, None] - other.ellipse_centers, axis=-1)
    return bool(apart.min(initial=np.inf) < 1)


def _estimated(
    body: Body, agreed: Sequence[_Sighting], camera: Camera, errors: ErrorSources, spare: Spare | None
) -> Detection | None:
    """Return the body's detection from sightings that agree, and from what other dots are seen; None if it fails."""
    dots = np.concatenate([each.dots for each in agreed])
    seen = np.concatenate([each.seen for each in agreed])
    covariance = np.concatenate([each.covariance for each in agreed])
    centers = np.concatenate([each.detection.ellipse_centers for each in agreed])
    start = max(agreed[0].poses, key=lambda pose: _dots(_agreeing(body, (agreed[0], pose), agreed, camera)))
    pose, dropped = start, np.zeros(0, dtype=np.intp)
    for _ in range(ROUNDS if spare else 1):
        fitted = _pose(body, dots, seen, covariance, camera, errors, pose)
        if fitted is None:
            return None
        pose, kept = fitted
        dropped = np.concatenate([dropped, dots[~kept]])
        dots, seen, covariance, centers = dots[kept], seen[kept], covariance[kept], centers[kept]
        if spare is None:
            break
        known = np.concatenate([dots, dropped])
        # Of two poses that fit one plate, the one that predicts more of the other dots.
        guesses = [(each, _further(body, each, known, centers, camera, spare)) for each in _both(pose)]
        guess, more = max(guesses, key=lambda pair: len(pair[1].dots))
        if not len(more.dots):
            break
        pose = guess
        dots, seen = np.concatenate([dots, more.dots]), np.concatenate([seen, more.seen])
        covariance, centers = np.concatenate([covariance, more.covariance]), np.concatenate([centers, more.centers])
    order = np.argsort(dots, kind="stable")
    dots, seen, covariance, centers = dots[order], seen[order], covariance[order], centers[order]
    drawn = body_outlines(body, pose.rotation[None], pose.translation[None])
    corrected = seen - (drawn.center - drawn.point)[0, dots]
    residual = seen - drawn.center[0, dots]
    misfit = np.sqrt(camera.fx * camera.fy * np.sum(residual**2) / (len(dots) - 3))
    homography = None
    if isinstance(body, Marker) and not np.ptp(body.search_xyz[:, 2]):
        homography = homography_of(body.search_xyz[dots], corrected, camera, pose)
        homography = homography / homography[2, 2]
    return Detection(
        True,
        body.ids[dots],
        camera.to_pixels(corrected),
        covariance,
        centers,
        homography,
        pose,
        dropped=body.ids[np.sort(dropped)],
        misfit=float(misfit),
        tag=agreed[0].detection.tag if isinstance(body, Marker) else None,
        parts=tuple(replace(each.detection, marker=body.constellations.index(each.part)) for each in agreed),
    )


@dataclass(frozen=True, eq=False)
class _Further:
    """Dots (m,) of a body among an image's blobs, with centers (m, 2) and covariances (m, 2, 2) as in `Detection`."""

    dots: Indices
    seen: Array
    covariance: Array
    centers: Array


def _further(body: Body, pose: PoseEstimate, known: Indices, taken: Array, camera: Camera, spare: Spare) -> _Further:
    """Find the dots that are not known yet among the blobs that are not taken, by place, size and kind."""
    drawn = body_outlines(body, pose.rotation[None], pose.translation[None])
    others = np.setdiff1d(
        np.flatnonzero(drawn.seen[0] & (body.facing(pose.rotation, pose.translation) > LEAST_FACING)), known
    )
    apart = np.linalg.norm(spare.blobs.center[:, None] - taken, axis=-1).min(axis=-1, initial=np.inf)
    ellipses = undo_lens(spare.blobs, camera)
    free = np.flatnonzero(apart[ellipses.index] > 2)
    nothing = _Further(others[:0], np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2)))
    if not len(others) or not len(free):
        return nothing
    spread = GATE_SIGMA**2 * _spread(body, pose, others, drawn.center[0, others], np.zeros((2, 2)), camera)
    spread = spread + (GATE_PX**2 / (camera.fx * camera.fy)) * np.eye(2)
    offset = ellipses.center[free] - drawn.center[0, others][:, None]
    away = np.einsum("nbi,nij,nbj->nb", offset, np.linalg.inv(spread), offset)
    size = [0.25 * np.log(np.linalg.det(shape)) for shape in (drawn.shape[0, others], ellipses.shape[free])]
    away[np.abs(size[0][:, None] - size[1]) > SIZE_LOG] = np.inf
    away[ellipses.strange(body.is_ring[others])[:, free]] = np.inf
    nearest = away.argmin(axis=-1)
    least = away[np.arange(len(others)), nearest]
    # A blob within reach of two dots, and a dot with two blobs in reach, are not told.
    sure = (least < 1) & ((away < 1).sum(axis=-1) == 1) & ((away < 1).sum(axis=0)[nearest] == 1)
    chosen = free[nearest[sure]]
    blobs = spare.fit(ellipses.index[chosen])
    alone: Ellipses = undo_lens(blobs, camera)
    good = blobs.fitted[alone.index]
    rows = alone.index[good]
    covariance = _widened(blobs.covariance[rows], alone.shape[good], camera)
    return _Further(others[sure][rows], alone.center[good], covariance, blobs.center[rows])


def _widened(covariance: Array, shape: Array, camera: Camera) -> Array:
    """Return covariances (m, 2, 2) of centers, px^2, that allow for narrow images; see `SHORT_PX`."""
    short = 2 * np.sqrt(np.linalg.eigvalsh(shape)[:, 0] * camera.fx * camera.fy)
    return covariance * (1 + (SHORT_PX / short) ** 4)[:, None, None]


def _missing(body: Body, found: Detection, camera: Camera) -> int:
    """Return the number of dots that should be seen, large enough and wholly inside the image, and are not."""
    pose = found.pose
    assert pose is not None
    drawn = body_outlines(body, pose.rotation[None], pose.translation[None])
    with np.errstate(invalid="ignore"):
        across = 2 * np.linalg.det(drawn.shape[0]) ** 0.25 * np.sqrt(camera.fx * camera.fy)
        plain = (
            (across > 1.5 * body.least_px)
            & (body.facing(pose.rotation, pose.translation) > SURE_FACING)
            & expected(drawn, camera)[0]
        )
    if not body.is_convex:
        plain &= ~hidden(body, PoseDistribution("", pose.rotation[None], pose.translation[None]))[0]
    plain[np.isin(body.ids, found.ids)] = False
    return int(plain.sum())


def _pose(
    body: Body,
    dots: Indices,
    seen: Array,
    covariance: Array,
    camera: Camera,
    errors: ErrorSources,
    start: PoseEstimate,
) -> tuple[PoseEstimate, NDArray[np.bool_]] | None:
    """Estimate the body's pose from the ellipse centers of dots (m,), and tell which dots are no outliers; or None.

    In the frame of the plate with the most dots: on one plate alone, a pose has a mirrored one that may fit as well.
    """
    most = int(np.bincount(body.owner[dots]).argmax())
    plate, first = body.plates[most], body.first[most]
    kept = np.ones(len(dots), dtype=bool)
    relation = body.relation_covariance is not None
    alone = not relation and bool((body.owner[dots] == body.owner[dots[0]]).all())
    points = plate.to_marker(body.xyz[dots])
    if alone:
        points = plate.marker.xyz[dots - first]
    radii = plate.marker.radii[dots - first] if alone else np.zeros(len(dots))
    pose = start
    while True:
        used = dots[kept]
        if alone:
            sources = errors.of(plate.marker, used - first)
        else:
            sources = spatial_errors(body, used, plate.rotation_matrix, errors)
        found = None
        for _ in range(1 if alone else _CORRECTIONS):
            centers = seen[kept]
            if not alone:
                drawn = body_outlines(body, pose.rotation[None], pose.translation[None])
                centers = centers - (drawn.center - drawn.point)[0, used]
            measured = points[kept], radii[kept], centers, covariance[kept], camera, sources
            found = fit_pose(*measured, plate.camera_pose(pose.rotation, pose.translation))
            if found is None:
                return None
            pose = of_body(found, plate)
        assert found is not None
        worst = outlier(*measured, found)
        if worst is None:
            return pose, kept
        kept[np.flatnonzero(kept)[worst]] = False


def spatial_errors(body: Body, dots: Indices, turn: Array, errors: ErrorSources) -> ErrorSources:
    """Sources for dots (m,) of several plates: errors in each plate, and of the plates' relation.

    They are in a frame whose axes in the body's are the columns of `turn` (3, 3), such as a plate's.

    A dot at R x + t in the body, on a plate whose pose is off by (w, dt), is off by w x R x + dt.
    """
    whole, scaled = np.zeros((len(dots), 3, len(dots), 3)), np.zeros((len(dots), 3, 2))
    for k, each in enumerate(body.plates):
        own = np.flatnonzero(body.owner[dots] == k)
        if not len(own):
            continue
        rows = dots[own] - body.first[k]
        sources, spatial = errors.of(each.marker, rows), each.marker.joint_places is not None
        axes = 3 if spatial or np.ptp(each.marker.xyz[:, 2]) else 2
        out = each.rotation_matrix[:, :axes]
        block = sources.whole(len(own), axes).reshape(len(own), axes, len(own), axes)
        whole[own[:, None, None, None], np.arange(3)[:, None, None], own[:, None], np.arange(3)] = np.einsum(
            "ia,manb,jb->minj", out, block, out
        )
        scaled[own] = each.rotation_matrix[:, :2] @ sources.scaled(each.marker.xyz[rows])
    # Printed on one printer, all plates have its scale.
    whole += np.einsum("mik,njk->minj", scaled, scaled)
    relation = body.relation_covariance
    if relation is not None:
        moved = np.zeros((len(dots), 3, len(relation)))
        for m, dot in enumerate(dots):
            plate, first = body.plates[body.owner[dot]], 6 * int(body.owner[dot])
            moved[m, :, first : first + 3] = -skew(body.xyz[dot] - plate.translation_vector)
            moved[m, :, first + 3 : first + 6] = np.eye(3)
        through = moved.reshape(-1, len(relation))
        whole += (through @ relation @ through.T).reshape(whole.shape)
    places = np.einsum("ai,manb,bj->minj", turn, whole, turn)
    return replace(errors, place_covariance=None, joint_places=places, scale_sigma=0.0)


def of_body(pose: PoseEstimate, plate: Plate) -> PoseEstimate:
    """Convert the estimate of a pose T_camera_marker to that of T_camera_body, with its covariances.

    R <- exp([w]x) R and t <- t + dt of the marker move the body's origin by dt + [R_body s]x w, s its place from the
    body's origin.
    """

    def moved(rotation: Array, translation: Array) -> tuple[Array, Array]:
        turned = rotation @ plate.rotation_matrix.T
        return turned, translation - turned @ plate.translation_vector

    rotation, translation = moved(pose.rotation, pose.translation)
    change = np.eye(6)
    change[3:, :3] = skew(rotation @ plate.translation_vector)
    budget = pose.budget
    parts = (change @ part @ change.T for part in (budget.image, budget.print, budget.camera, budget.total))
    alternative = None if pose.alternative is None else moved(*pose.alternative)
    return replace(pose, rotation=rotation, translation=translation, budget=PoseBudget(*parts), alternative=alternative)


def joined(
    found: Sequence[Detection],
    bodies: Sequence[Body],
    camera: Camera | None,
    errors: ErrorSources,
    copies: int,
    spare: Spare | None = None,
) -> list[Detection]:
    """Return detections of bodies, best first, from those of their constellations, numbered through the bodies.

    Parameters
    ----------
    camera : Camera or None
        Without one, constellations are not joined, and the one with the most dots stands for its body.
    copies : int
        Maximum number of copies of a body of several constellations.
    """
    parts = [(k, part) for k, body in enumerate(bodies) for part in body.constellations]
    every, seen = list[Detection](), dict[int, list[tuple[Constellation, Detection]]]()
    failed = dict[int, list[tuple[Constellation, Detection]]]()
    for each in found:
        own, part = parts[each.marker]
        if not bodies[own].is_single:
            (seen if each.found else failed).setdefault(own, []).append((part, each))
        else:
            every.append(replace(each, marker=own, rival=None if each.rival is None else parts[each.rival][0]))
    for k, body in enumerate(bodies):
        if body.is_single:
            continue
        if k in seen and camera is not None:
            whole = join(body, seen[k], camera, errors, spare)[:copies]
        else:
            whole = [each for _, each in sorted(seen.get(k, []), key=lambda pair: -len(pair[1].ids))[:1]]
        every += [replace(each, marker=k) for each in whole]
        if not whole:
            every.append(Detection(False, reason=_reason(body, bool(seen.get(k)), failed.get(k, [])), marker=k))
    return sorted(every, key=lambda each: -len(each.ids))


def _reason(body: Body, refuted: bool, failed: Sequence[tuple[Constellation, Detection]]) -> str:
    if refuted:
        return "found some of its dots, but the others are not where they should be: does it look as its file says?"
    part, told = max(failed, key=lambda pair: (pair[1].unlabeled is not None, -failed.index(pair)))
    which = part.plate.name if body.frame == "rig" else f"its {len(part.dots)} largest dots"
    several = f"none of its {len(body.constellations)} {'markers' if body.frame == 'rig' else 'constellations'}"
    return f"found {several}; {which}: {told.reason}"
