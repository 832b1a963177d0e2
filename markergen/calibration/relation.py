"""The relation of a body's plates, from photographs that show several of them at once.

The adjustment of each plate's marker by itself leaves out that all plates in a photograph move together: the pose of a
view is the pose of the body in its photograph times that of the plate in the body. Here the poses of the body, those of
its plates, the dots in their markers and the camera are adjusted together, by Gauss-Newton steps from that adjustment,
on the same normal equations: with L the derivative of the views' poses by those of the body and of the plates, N
becomes L'N L. The dots of each marker neither shift nor turn with respect to its design, nor do the designed dots of
all markers with respect to the designed body. Photographs give the ratios of the markers' scales; without a measured
length the dots of all markers together do not grow.
"""

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import numpy as np
from scipy.linalg import block_diag, null_space

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import Adjustment, dots_prior, normal_equations, residuals
from markergen.calibration.network import CameraFreedom, Network, Views, moved_camera
from markergen.errors import InputError
from markergen.maths.information import apply_pose_step
from markergen.maths.rotation import angle_between, skew
from markergen.model.body import Body, Plate
from markergen.model.camera import Camera

Pose = tuple[Array, Array]

STEPS, HALVINGS, SMALLEST = 30, 8, 1e-10
"""Maximum number of steps, and of halvings of one; the size of a step, in rad or m, at which they end."""

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

    Parameters
    ----------
    body : Body
        As designed.
    adjustment : Adjustment
        Of the dots of all markers, each in its own frame, with a pose for each marker in each photograph.
    photo : array (v,) of int
        Photograph of each of its views.
    print_sigma : float
        Standard deviation in m of a printed dot about its design along each axis: weak knowledge, which keeps markers
        of few dots flat.

    Returns
    -------
    Relation
        Its body has the markers as designed, at their measured poses.

    Raises
    ------
    InputError
        If photographs do not connect all markers.
    """
    network = _BodyNetwork(adjustment, np.unique(photo, return_inverse=True)[1], len(body.plates), print_sigma)
    state = network.solved(_start(body, network))
    covariance, factor = network.covariance(state)
    count = 6 * len(body.plates)
    (rotations, translations), spread = _as_designed(body, state.plates, covariance[:count, :count])
    plates = [
        Plate(plate.name, plate.marker, tuple(map(tuple, rotation)), tuple(translation))
        for plate, rotation, translation in zip(body.plates, rotations, translations, strict=True)
    ]
    designed = _poses_of(body)
    plates_in_photo = np.unique(np.stack([network.photo, network.plate]), axis=1)[0]
    return Relation(
        body.with_plates(plates, spread),
        np.rad2deg(angle_between(rotations, designed[0])),
        np.linalg.norm(translations - designed[1], axis=-1),
        float(np.sqrt(factor / adjustment.variance_factor)) if adjustment.degrees_of_freedom > 0 else 1.0,
        int((np.bincount(plates_in_photo) > 1).sum()),
        (state.places, covariance[count:, count:]),
    )


def _poses_of(body: Body) -> Pose:
    """Rotations (k, 3, 3) and translations (k, 3) of the plates in the body."""
    return (
        np.array([plate.rotation_matrix for plate in body.plates]),
        np.array([plate.translation_vector for plate in body.plates]),
    )


@dataclass(frozen=True, eq=False)
class _State:
    """Poses of the body in p photographs (p, 3, 3), (p, 3), of its k plates, places of dots (n, 3), and the camera."""

    body: Pose
    plates: Pose
    places: Array
    camera: Camera


@dataclass(frozen=True, eq=False)
class _BodyNetwork:
    """Least squares on a network whose views have the poses of a body in their photographs times those of its plates.

    The unknowns are the poses of the body, of its plates but the first, dots, and the camera's u.
    """

    adjustment: Adjustment
    photo: Indices
    plate_count: int
    print_sigma: float

    @cached_property
    def plate(self) -> Indices:
        """Plate (v,) that each view shows."""
        return self.adjustment.network.marker[np.argmax(self.adjustment.weights > 0, axis=1)]

    @cached_property
    def photo_count(self) -> int:
        return int(self.photo.max()) + 1

    @cached_property
    def network(self) -> Network:
        """What is adjusted: what is known before the photographs stands in `known`."""
        network = self.adjustment.network
        directions = network.freedom.directions
        freedom = CameraFreedom(directions, np.zeros((directions.shape[1],) * 2))
        return replace(network, freedom=freedom, prior=None, loose=None)

    @cached_property
    def free(self) -> Array:
        """Directions (s, f) in which the unknowns are free: the first plate stays, and so does the gauge."""
        first_plate = 6 * self.photo_count
        poses = np.delete(np.eye(first_plate + 6 * self.plate_count), np.s_[first_plate : first_plate + 6], axis=1)
        dots = null_space(_gauge(self.adjustment.network).T) if self.network.free else np.zeros((0, 0))
        return block_diag(poses, dots, np.eye(len(self.network.freedom)))

    @cached_property
    def known(self) -> Array:
        """Information (s, s) about the unknowns before the photographs."""
        network, poses = self.adjustment.network, np.zeros((6 * (self.photo_count + self.plate_count),) * 2)
        if not network.free:
            return block_diag(poses, network.freedom.precision)
        information = np.full((len(network.design), 3, 3), np.eye(3) / self.print_sigma**2)
        if network.prior is not None:
            information = np.where(network.prior.any(axis=(1, 2), keepdims=True), network.prior, information)
        return block_diag(poses, *information, network.freedom.precision)

    def views(self, state: _State) -> Views:
        """Views with poses composed of those of the body and of its plates."""
        rotation, translation = (pose[self.photo] for pose in state.body)
        plate_rotation, plate_translation = (pose[self.plate] for pose in state.plates)
        moved = np.einsum("vij,vj->vi", rotation, plate_translation) + translation
        return replace(self.adjustment.views, rotation=rotation @ plate_rotation, translation=moved)

    def solved(self, state: _State) -> _State:
        """Return the state at the minimum; steps that raise chi2 are halved."""
        information, poses = self.free.T @ self.known @ self.free, 6 * (self.photo_count + self.plate_count)
        away = (state.places - self.network.design).ravel() if self.network.free else np.zeros(0)
        total = self.free.T @ np.r_[np.zeros(poses), away, np.zeros(len(self.network.freedom))]
        normal, gradient, chi2 = self.normal(state)
        for _ in range(STEPS):
            step = np.linalg.solve(normal + information, gradient - information @ total)
            cost = chi2 + total @ information @ total
            for _ in range(HALVINGS):
                tried, after = self.moved(state, self.free @ step), total + step
                normal, gradient, chi2 = self.normal(tried)
                if chi2 + after @ information @ after <= cost * (1 + 1e-9):
                    break
                step = step / 2
            state, total = tried, after
            if np.abs((self.free @ step)[:poses]).max() < SMALLEST:
                break
        return state

    def covariance(self, state: _State) -> tuple[Array, float]:
        """Covariance of the plates' poses, the first one held, and of the dots; and chi2 per degree of freedom."""
        normal, _, chi2 = self.normal(state)
        freedom = 2 * int(np.count_nonzero(self.adjustment.weights)) - len(normal)
        factor = chi2 / freedom if freedom > 0 else 1.0
        whole = self.free @ np.linalg.inv(normal + self.free.T @ self.known @ self.free) @ self.free.T
        chosen = slice(6 * self.photo_count, len(whole) - len(self.network.freedom))
        return max(1.0, factor) * whole[chosen, chosen], factor

    def moved(self, state: _State, step: Array) -> _State:
        """Return the state after a step (s,) of all unknowns."""
        photos, poses = self.photo_count, 6 * (self.photo_count + self.plate_count)
        dots = poses + (state.places.size if self.network.free else 0)
        pose_steps = step[:poses].reshape(-1, 6)
        return _State(
            apply_pose_step(*state.body, pose_steps[:photos]),
            apply_pose_step(*state.plates, pose_steps[photos:]),
            state.places + step[poses:dots].reshape(-1, 3) if self.network.free else state.places,
            moved_camera(state.camera, self.network.freedom.directions @ step[dots:]),
        )

    def normal(self, state: _State) -> tuple[Array, Array, float]:
        """Normal matrix and right side (f, f), (f,) of the free unknowns, and chi2."""
        views, weights = self.views(state), self.adjustment.weights
        residual = residuals(self.network.radii, views, state.places, state.camera)[0]
        parts = normal_equations(self.network, views, state.places, state.camera, weights, residual)
        count = len(views)
        by_pose = np.zeros((count, 6, self.photo_count + self.plate_count, 6))
        rotation, index = state.body[0][self.photo], np.arange(count)
        by_body = np.broadcast_to(np.eye(6), (count, 6, 6)).copy()
        by_body[:, 3:, :3] = -skew(views.translation - state.body[1][self.photo])
        by_pose[index, :, self.photo] = by_body
        by_pose[index, :3, self.photo_count + self.plate, :3] = rotation
        by_pose[index, 3:, self.photo_count + self.plate, 3:] = rotation
        flat = by_pose.reshape(6 * count, -1)
        poses = flat.T @ (parts.pose @ by_pose.reshape(count, 6, -1)).reshape(6 * count, -1)
        cross = flat.T @ parts.cross.reshape(6 * count, -1)
        normal = np.block([[poses, cross], [cross.T, parts.rest]])
        gradient = np.r_[flat.T @ parts.gradient_pose.ravel(), parts.gradient_rest]
        inverse = np.linalg.inv(views.covariance) * weights[..., None, None]
        chi2 = (
            float(np.einsum("vni,vnij,vnj->", residual, inverse, residual)) + dots_prior(self.network, state.places)[0]
        )
        return self.free.T @ normal @ self.free, self.free.T @ gradient, chi2


def _start(body: Body, network: _BodyNetwork) -> _State:
    """Poses of the body by its plate with most dots in each photograph."""
    adjustment, views = network.adjustment, network.adjustment.views
    rotations, translations = _first_plate_poses(body, network)
    rotation, translation = np.zeros((network.photo_count, 3, 3)), np.zeros((network.photo_count, 3))
    for view in np.argsort((adjustment.weights > 0).sum(axis=1), kind="stable"):
        photo, plate = network.photo[view], network.plate[view]
        rotation[photo] = views.rotation[view] @ rotations[plate].T
        translation[photo] = views.translation[view] - rotation[photo] @ translations[plate]
    return _State((rotation, translation), (rotations, translations), adjustment.places, adjustment.camera)


def _first_plate_poses(body: Body, network: _BodyNetwork) -> Pose:
    """Return poses (k, 3, 3) and (k, 3) of plates in the body, from plate to plate by photographs that show both.

    Of the relations that several photographs give, the one nearest to the others is taken.
    """
    views = network.adjustment.views
    reached = {0: (body.plates[0].rotation_matrix, body.plates[0].translation_vector)}
    views_of_photos = [np.flatnonzero(network.photo == photo).tolist() for photo in range(network.photo_count)]
    while len(reached) < len(body.plates):
        candidates = defaultdict[int, list[Pose]](list)
        for first, second in (pair for together in views_of_photos for pair in permutations(together, 2)):
            plate, neighbor = int(network.plate[first]), int(network.plate[second])
            if plate in reached and neighbor not in reached:
                rotation, translation = reached[plate]
                to_plate = views.rotation[first].T
                between = to_plate @ (views.translation[second] - views.translation[first])
                pose = rotation @ (to_plate @ views.rotation[second]), rotation @ between + translation
                candidates[neighbor].append(pose)
        if not candidates:
            left = [plate.name for k, plate in enumerate(body.plates) if k not in reached]
            raise InputError(
                "photographs that connect all markers of the rig, each with another one",
                f"none that shows {', '.join(left[:5])} beside one of the others",
                "photograph its edges, or leave the marker out of the rig",
            )
        for plate, poses in candidates.items():
            rotations = np.array([rotation for rotation, _ in poses])
            apart = angle_between(rotations[:, None], rotations[None])
            reached[plate] = poses[int(np.median(apart, axis=1).argmin())]
    poses = [reached[k] for k in range(len(body.plates))]
    return np.array([rotation for rotation, _ in poses]), np.array([translation for _, translation in poses])


def _gauge(network: Network) -> Array:
    """Directions (3 n, g) in which dots do not move: three shifts and turns of each marker, and the scale of all.

    That is free if measurements fix it.
    """
    markers = [int(marker) for marker in np.unique(network.marker)]
    is_ruled = any(network.scale_known(marker) for marker in markers)
    whole = network.gauge(network.design)
    columns = list[Array]()
    growth, first = np.zeros(len(whole)), 0
    for marker in markers:
        columns += list(whole[:, first : first + 6].T)
        first += 6 if network.scale_known(marker) else 7
        is_on_marker = network.marker == marker
        middle = network.design[is_on_marker].mean(axis=0)
        growth += np.where(is_on_marker[:, None], network.design - middle, 0.0).ravel()
    return np.array([*columns, *([] if is_ruled else [growth])]).T


def _as_designed(body: Body, poses: Pose, covariance: Array) -> tuple[Pose, Array]:
    """Return poses and their covariance in the body frame in which designed dots are nearest to the designed body."""
    rotations, translations = poses
    dots = [plate.marker.xyz for plate in body.plates]
    places = np.concatenate(
        [xyz @ rotation.T + translation for xyz, rotation, translation in zip(dots, *poses, strict=True)]
    )
    middles = places.mean(axis=0), body.xyz.mean(axis=0)
    left, _, right = np.linalg.svd((body.xyz - middles[1]).T @ (places - middles[0]))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    translations = (translations - middles[0]) @ rotation.T + middles[1]
    rotations = rotation @ rotations
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
