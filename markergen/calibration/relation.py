"""The relation of a body's plates, from photographs that show several of them at once.

The adjustment of each plate's marker by itself leaves out that all plates in a photograph move together: the pose of a
view is the pose of the body in its photograph times that of the plate in the body. Here the poses of the body, those of
its plates, the dots in their markers and the camera are adjusted together, from that adjustment on, as `PlatePoses`.
The dots of each marker neither shift nor turn with respect to its design, nor do the designed dots of all markers with
respect to the designed body. Photographs give the ratios of the markers' scales; without a measured length the dots of
all markers together do not grow.
"""

from collections import defaultdict
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import Adjustment, adjust
from markergen.calibration.network import PlatePoses, Pose, Views
from markergen.errors import InputError
from markergen.maths.rotation import angle_between, rigid_motion, skew
from markergen.model.body import Body, Plate

LOOSE = 3.0
"""Ratio of residuals with one pose for all plates to those with one for each from which on they count as moving."""


@dataclass(frozen=True, eq=False)
class Relation:
    """A body with its relation as measured.

    Attributes
    ----------
    rig : Body
        With the measured markers, their poses, and the covariance of these.
    turned_deg, moved : arrays (k,), degrees and m
        By how much each marker is turned and shifted from where it was designed.
    looseness : float
        Ratio of residuals with one pose for all markers of a photograph to those with one for each: the root of the
        ratio of chi2 per degree of freedom.
    photographs : int
        Number of photographs that show two markers or more.
    dots : (array (n, 3), array (3 n, 3 n)), m and m^2
        Places of the adjusted dots, each in the frame of its marker, and their covariance, singular along the gauge.
    """

    rig: Body
    turned_deg: Array
    moved: Array
    looseness: float
    photographs: int
    dots: tuple[Array, Array]

    @property
    def sigma(self) -> tuple[Array, Array]:
        """Standard deviations (k,) of the markers' rotations in degrees and translations in m, RMS over directions."""
        assert self.rig.relation_covariance is not None
        parts = np.sqrt(np.diag(self.rig.relation_covariance).reshape(-1, 2, 3).sum(axis=-1))
        return np.rad2deg(parts[:, 0]), parts[:, 1]

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found, and a warning if the markers move relative to each other."""
        turned, moved, *sigma = (np.sqrt(np.mean(np.square(v))) for v in (self.turned_deg, self.moved, *self.sigma))
        displacement = (
            f"The markers are {turned:.2g} deg and {1e3 * moved:.2g} mm RMS from where the rig has them, known to "
            f"{sigma[0]:.1g} deg and {1e3 * sigma[1]:.1g} mm from {self.photographs} photographs that show two or more."
        )
        if self.looseness < LOOSE:
            return (displacement,)
        return (
            displacement,
            f"The markers seem to move relative to each other: residuals with one pose for all of them are "
            f"{self.looseness:.2g} times those with one for each.",
        )


def relate(body: Body, adjustment: Adjustment, photo: Indices, print_sigma: float) -> Relation:
    """Find the relation of a body's plates.

    The adjustment is of the dots of all markers, each in its own frame, with a pose for each marker in each photograph;
    `photo` (v,) is the photograph of each of its views. The standard deviation of a printed dot about its design is
    weak knowledge, which keeps markers of few dots flat. The body of the result has the markers as designed, at their
    measured poses.

    Raises
    ------
    InputError
        If photographs do not connect all markers.
    """
    views, photo = adjustment.views, np.unique(photo, return_inverse=True)[1]
    plate = adjustment.network.marker[np.argmax(adjustment.weights > 0, axis=1)]
    plate_poses = PlatePoses(*_plate_poses(body, views, photo, plate), photo, plate)
    network = replace(
        adjustment.network, camera=adjustment.camera, joints=plate_poses, loose=(print_sigma, print_sigma)
    )
    together = adjust(network, views, adjustment.weights, adjustment.places)
    assert together.joints is not None
    poses = together.joints.rotation, together.joints.translation
    (rotations, translations), spread = _as_designed(body, poses, together.plate_covariance)
    plates = [
        Plate(plate.name, plate.marker, tuple(map(tuple, rotation)), tuple(translation))
        for plate, rotation, translation in zip(body.plates, rotations, translations, strict=True)
    ]
    designed = _poses_of(body)
    plates_in_photo = np.unique(np.stack([photo, plate]), axis=1)[0]
    looser = together.variance_factor / adjustment.variance_factor
    return Relation(
        body.with_plates(plates, spread),
        np.rad2deg(angle_between(rotations, designed[0])),
        np.linalg.norm(translations - designed[1], axis=-1),
        float(np.sqrt(looser)) if adjustment.degrees_of_freedom > 0 else 1.0,
        int((np.bincount(plates_in_photo) > 1).sum()),
        (together.places, together.covariance),
    )


def _poses_of(body: Body) -> Pose:
    """Rotations (k, 3, 3) and translations (k, 3) of the plates in the body."""
    return (
        np.array([plate.rotation_matrix for plate in body.plates]),
        np.array([plate.translation_vector for plate in body.plates]),
    )


def _plate_poses(body: Body, views: Views, photo: Indices, plate: Indices) -> Pose:
    """Return poses (k, 3, 3) and (k, 3) of plates in the body, from plate to plate by photographs that show both.

    Of the relations that several photographs give, the one nearest to the others is taken.
    """
    reached = {0: (body.plates[0].rotation_matrix, body.plates[0].translation_vector)}
    views_of_photos = [np.flatnonzero(photo == number).tolist() for number in range(photo.max() + 1)]
    while len(reached) < len(body.plates):
        candidates = defaultdict[int, list[Pose]](list)
        for first, second in (pair for together in views_of_photos for pair in permutations(together, 2)):
            neighbor = int(plate[second])
            if plate[first] in reached and neighbor not in reached:
                rotation, translation = reached[int(plate[first])]
                to_plate = views.rotation[first].T
                between = to_plate @ (views.translation[second] - views.translation[first])
                pose = rotation @ (to_plate @ views.rotation[second]), rotation @ between + translation
                candidates[neighbor].append(pose)
        if not candidates:
            left = [lost.name for k, lost in enumerate(body.plates) if k not in reached]
            raise InputError(
                "photographs that connect all markers of the rig, each with another one",
                f"none that shows {', '.join(left[:5])} beside one of the others",
                "photograph its edges, or leave the marker out of the rig",
            )
        for neighbor, poses in candidates.items():
            rotations = np.array([rotation for rotation, _ in poses])
            apart = angle_between(rotations[:, None], rotations[None])
            reached[neighbor] = poses[int(np.median(apart, axis=1).argmin())]
    poses = [reached[k] for k in range(len(body.plates))]
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
