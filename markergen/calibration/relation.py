"""What is held together, from photographs that show several parts at once: plates of a body, and cameras of a rig.

The adjustment of each marker in each photograph by itself leaves out that all plates in a photograph move together, and
that cameras which take photographs at one moment stay where they are to each other. Here the poses of the body, those
of its plates and of the cameras, the dots in their markers and the cameras' parameters are adjusted together, from
that adjustment on, as `RigidPoses`. The dots of each marker neither translate nor rotate with respect to its design,
nor do the designed dots of all markers with respect to the designed body. Photographs give the ratios of the markers'
scales and of the cameras' distances; without a measured length the dots of all markers together do not grow.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import numpy as np

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import Adjustment, adjust
from markergen.calibration.network import Pose, RigidPoses
from markergen.calibration.scale import DOUBTED
from markergen.errors import InputError
from markergen.maths.rotation import angle_between, inverse_pose, pose_product, rigid_motion, skew
from markergen.model.body import Body, Plate

LOOSE = 3.0
"""Ratio of residuals with one pose for all that is held together to those with one for each from which on it counts as
moving."""

STRAY, STRAY_DEG, LEAST_PAIRS = 20.0, 3.0, 5
"""Angle beyond which a pair of photographs was not taken at once: times the median of the pairs' angles to the middle
one, and at least; and the fewest pairs. Right ones were up to 5 medians (0.06 deg) off, wrong ones 17 deg or more."""


@dataclass(frozen=True, eq=False)
class Relation:
    """Plates of a body, or cameras, or both, as they are held together in the adjustment of all.

    The rig, None for markers that are no rig's, has the measured markers, their poses and the covariance of these; each
    marker is turned (k,) in degrees and moved (k,) in m from where it was designed. `looseness` is the ratio of
    residuals with one pose for all to those with one for each: the root of the ratio of chi2 per degree of freedom.
    `photographs` counts the moments that show two parts or more; `scale_sigma` is what is unknown of the scale, as a
    share.
    """

    rig: Body | None
    turned_deg: Array
    moved: Array
    looseness: float
    photographs: int
    together: Adjustment
    names: tuple[str, ...]
    scale_sigma: float = 0.0

    @property
    def sigma(self) -> tuple[Array, Array]:
        """Standard deviations (k,) of the markers' rotations in degrees and translations in m, RMS over directions."""
        assert self.rig is not None
        assert self.rig.relation_covariance is not None
        return _sigmas(self.rig.relation_covariance)

    @property
    def is_as_designed(self) -> bool:
        """Whether all markers are where the rig has them, within `DOUBTED` standard deviations."""
        if self.rig is None:
            return True
        deviations = zip((self.turned_deg, self.moved), self.sigma, strict=True)
        return all(bool((off <= DOUBTED * sigma).all()) for off, sigma in deviations)

    @property
    def deviation(self) -> str:
        """How far the markers are from where the rig has them."""
        angle, moved = (np.sqrt(np.mean(np.square(off))) for off in (self.turned_deg, self.moved))
        return f"{angle:.2g} deg and {1e3 * moved:.2g} mm RMS from where the rig has them"

    def plate_rows(self) -> list[tuple[Plate, float, float, float, float]]:
        """Each plate with its rotation in degrees and translation in m from the design, and their sigmas."""
        assert self.rig is not None
        columns = (values.tolist() for values in (self.turned_deg, self.moved, *self.sigma))
        return list(zip(self.rig.plates, *columns, strict=True))

    @property
    def cameras(self) -> Pose:
        """Poses T_camera_first (c, 3, 3) and (c, 3), m."""
        assert self.together.joints is not None
        last = slice(-len(self.names), None)
        return self.together.joints.rotation[last], self.together.joints.translation[last]

    @cached_property
    def camera_covariance(self) -> Array:
        """Covariance (6 c, 6 c) of (w, dt) of the cameras' poses, with what is unknown of the scale."""
        size = 6 * len(self.names)
        grown = np.zeros((len(self.names), 6))
        grown[:, 3:] = self.scale_sigma * self.cameras[1]
        return self.together.rigid_covariance[-size:, -size:] + np.outer(grown, grown)

    def camera_rows(self) -> list[tuple[str, float, Array, float, float]]:
        """Name of each camera but the first, its rotation in degrees, its translation in m, and their sigmas."""
        (rotation, translation), sigmas = self.cameras, zip(*_sigmas(self.camera_covariance), strict=True)
        angles = np.rad2deg(angle_between(rotation, np.eye(3)))
        rows = zip(self.names, angles.tolist(), translation, sigmas, strict=True)
        return [(name, angle, away, *map(float, sigma)) for name, angle, away, sigma in rows][1:]

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found."""
        listed = []
        for name, angle, away, *sigma in self.camera_rows():
            place = " ".join(f"{1e3 * number:.2f}" for number in away)
            listed.append(
                f"T_{name}_{self.names[0]}: turned by {angle:.4g} deg, moved by ({place}) mm, known to "
                f"{sigma[0]:.1g} deg and {1e3 * sigma[1]:.1g} mm from {self.photographs} moments."
            )
        if self.rig is not None:
            sigma = [np.sqrt(np.mean(np.square(values))) for values in self.sigma]
            listed.append(
                f"The markers are {self.deviation}, known to {sigma[0]:.1g} deg and {1e3 * sigma[1]:.1g} mm from "
                f"{self.photographs} photographs that show two or more."
            )
        return tuple(listed)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Whether parts move relative to each other."""
        if self.looseness < LOOSE:
            return ()
        parts = " and the ".join(["markers"] * (self.rig is not None) + ["cameras"] * (len(self.names) > 1))
        taken = ", or photographs of one name were not taken at once" * (len(self.names) > 1)
        return (
            f"the {parts} seem to move relative to each other{taken}: residuals with one pose for all of them are "
            f"{self.looseness:.2g} times those with one for each",
        )


def relate(
    body: Body | None,
    adjustment: Adjustment,
    moment: Indices,
    print_sigma: float,
    names: Sequence[str] = ("",),
    photos: Sequence[str] = (),
) -> Relation:
    """Find the relation of a body's plates, of cameras, or of both.

    The adjustment is of the dots of all markers, each in its own frame, with a pose for each marker in each photograph;
    `moment` (v,) is the photograph of each of its views, one for all cameras that took it at once; `photos` (v,) names
    the photographs, of which pairs that are none are refused. The standard
    deviation of a printed dot about its design is weak knowledge, which keeps markers of few dots flat. The body of the
    result has the markers as designed, at their measured poses.

    Raises
    ------
    InputError
        If photographs do not connect all markers of the body, or all cameras, or are of other moments than others.
    """
    views, marker = adjustment.views, adjustment.network.marker[np.argmax(adjustment.weights > 0, axis=1)]
    seen = views.rotation, views.translation
    plates, plate, placed = (np.eye(3)[None], np.zeros((1, 3))), np.zeros(len(marker), dtype=np.intp), moment
    network = adjustment.network
    if body is None:
        # Markers that are no rig's move by themselves.
        placed = moment * len(names) * (marker.max() + 1) + marker
    else:
        designed = np.array([p.rotation_matrix for p in body.plates]), np.array([p.translation for p in body.plates])
        plate, first = marker, (designed[0][0], designed[1][0])
        plates = _linked(seen, moment * len(names) + views.camera, marker, first, [p.name for p in body.plates])
        network = replace(network, loose=(print_sigma, print_sigma))
    same = np.unique(np.stack([moment, marker]), axis=1, return_inverse=True)[1].ravel()
    cameras = _linked(inverse_pose(seen), same, views.camera, (np.eye(3), np.zeros(3)), names, photos)
    poses = [np.concatenate(pair) for pair in zip(plates, inverse_pose(cameras), strict=True)]
    held = np.isin(np.arange(len(poses[0])), [0, len(plates[0])])
    placed = np.unique(placed, return_inverse=True)[1]
    rigid = RigidPoses(poses[0], poses[1], placed, plate, len(plates[0]) + views.camera, held)
    network = replace(network, cameras=adjustment.cameras, joints=rigid)
    together = adjust(network, views, adjustment.weights, adjustment.places)
    assert together.joints is not None
    looser = together.variance_factor / adjustment.variance_factor
    several = np.bincount(np.unique(np.stack([moment, plate * len(names) + views.camera]), axis=1)[0]) > 1
    looseness = float(np.sqrt(looser)) if adjustment.degrees_of_freedom > 0 else 1.0
    relation = Relation(None, np.zeros(0), np.zeros(0), looseness, int(several.sum()), together, tuple(names))
    if body is None:
        return relation
    size = len(body.plates)
    measured = together.joints.rotation[:size], together.joints.translation[:size]
    (rotations, translations), spread = _as_designed(body, measured, together.rigid_covariance[: 6 * size, : 6 * size])
    rig = body.with_plates(
        [
            Plate(plate.name, plate.marker, tuple(map(tuple, rotation)), tuple(translation))
            for plate, rotation, translation in zip(body.plates, rotations, translations, strict=True)
        ],
        spread,
    )
    angles = np.rad2deg(angle_between(rotations, designed[0]))
    return replace(relation, rig=rig, turned_deg=angles, moved=np.linalg.norm(translations - designed[1], axis=-1))


def _sigmas(covariance: Array) -> tuple[Array, Array]:
    """Standard deviations (k,) of rotations in degrees and translations in m by their covariance (6 k, 6 k)."""
    parts = np.sqrt(np.diag(covariance).reshape(-1, 2, 3).sum(axis=-1))
    return np.rad2deg(parts[:, 0]), parts[:, 1]


def _linked(
    seen: Pose, group: Indices, part: Indices, first: Pose, names: Sequence[str], photos: Sequence[str] | None = None
) -> Pose:
    """Return poses (k, 3, 3) and (k, 3) of parts, from one to the next by the views (v) of a group that show both.

    Of the relations that several groups give, the one nearest to the others is taken. With the names of the views'
    photographs the parts are cameras, and without them markers of a rig.
    """
    reached = {0: first}
    views_of_groups = [np.flatnonzero(group == number).tolist() for number in np.unique(group)]
    while len(reached) < len(names):
        candidates = defaultdict[int, list[tuple[Pose, int, int]]](list)
        for one, other in (pair for together in views_of_groups for pair in permutations(together, 2)):
            neighbor = int(part[other])
            if int(part[one]) in reached and neighbor not in reached:
                (start, end) = ((seen[0][k], seen[1][k]) for k in (one, other))
                pose = pose_product(reached[int(part[one])], pose_product(inverse_pose(start), end))
                candidates[neighbor].append((pose, one, other))
        if not candidates:
            left = ", ".join([name for k, name in enumerate(names) if k not in reached][:5])
            parts, lacking, advice = (
                ("markers of the rig", f"that shows {left} beside one of the others", "leave the marker out of the rig")
                if photos is None
                else ("cameras", f"of a moment at which {left} and another one show the same marker", "name them alike")
            )
            wanted = f"photographs that connect all {parts}, each with another one"
            raise InputError(wanted, f"none {lacking}", f"take such photographs, or {advice}")
        for neighbor, linked in candidates.items():
            rotations = np.array([pose[0] for pose, *_ in linked])
            apart = np.rad2deg(angle_between(rotations[:, None], rotations[None]))
            middle = int(np.median(apart, axis=1).argmin())
            reached[neighbor] = linked[middle][0]
            limit = max(STRAY_DEG, STRAY * float(np.median(apart[middle])))
            strays = [linked[k][1:] for k in np.flatnonzero(apart[middle] > limit)]
            if photos and strays and len(linked) >= LEAST_PAIRS:
                raise InputError(
                    "photographs of one name that were taken at once",
                    "others: " + ", ".join(f"{photos[one]} and {photos[other]}" for one, other in strays[:5]),
                    f"correct their names: the cameras of the other {len(linked) - len(strays)} pairs agree",
                )
    poses = [reached[k] for k in range(len(names))]
    return np.array([rotation for rotation, _ in poses]), np.array([translation for _, translation in poses])


def _as_designed(body: Body, poses: Pose, covariance: Array) -> tuple[Pose, Array]:
    """Return poses and their covariance in the body frame in which designed dots are nearest to the designed body."""
    rotations, translations = poses
    dots = [plate.marker.xyz for plate in body.plates]
    places = np.concatenate(
        [xyz @ rotation.T + translation for xyz, rotation, translation in zip(dots, *poses, strict=True)]
    )
    rotation, translation = rigid_motion(places, body.xyz)
    rotations, translations = rotation @ rotations, translations @ rotation.T + translation
    count = len(rotations)
    rotate_all = np.kron(np.eye(2 * count), rotation)
    covariance = rotate_all @ covariance @ rotate_all.T
    together, metric = np.zeros((6 * count, 6)), np.zeros((6 * count, 6 * count))
    for k in range(count):
        block = slice(6 * k, 6 * k + 6)
        together[block] = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(translations[k]), np.eye(3)]])
        rows = np.concatenate(
            [-skew(dots[k] @ rotations[k].T), np.broadcast_to(np.eye(3), (len(dots[k]), 3, 3))], axis=-1
        ).reshape(-1, 6)
        metric[block, block] = rows.T @ rows
    keep = np.eye(6 * count) - together @ np.linalg.solve(together.T @ metric @ together, together.T @ metric)
    covariance = keep @ covariance @ keep.T
    return (rotations, translations), (covariance + covariance.T) / 2
