"""The relation of a rig's markers, from photographs that show several of them at once.

The adjustment of each marker by itself leaves out that all markers in a photograph have one pose. Here the poses of the
rig in all photographs, those of the markers in the rig, the dots in their markers and the camera are adjusted together,
by Gauss-Newton steps from that adjustment. The dots of each marker neither shift nor turn with respect to its design,
nor do the designed dots of all markers with respect to the designed rig. Photographs tell the ratios of the markers'
scales; without a measured length the dots of all markers together do not grow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, null_space

from markergen.calibration.adjustment import Adjustment
from markergen.calibration.network import Network, moved_camera
from markergen.detect.conic_projection import outlines, pose_rows
from markergen.errors import InputError
from markergen.maths.rotation import angle_between, exponential, skew
from markergen.model.body import Plate
from markergen.model.camera import Camera
from markergen.model.rig import Rig

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

STEPS, HALVINGS, SMALLEST = 30, 8, 1e-10
"""Maximum number of steps, and of halvings of one; the size of a step, in rad or m, at which they end."""

LOOSE = 3.0
"""Ratio of residuals with one pose for all markers to those with one for each from which on they are said to move."""


@dataclass(frozen=True, eq=False)
class Relation:
    """A rig with its relation as measured.

    Attributes
    ----------
    rig : Rig
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

    rig: Rig
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
        turn, place = (np.sqrt(np.mean(np.square(each))) for each in (self.turned_deg, 1e3 * self.moved))
        sigma = [np.sqrt(np.mean(np.square(each))) for each in self.sigma]
        said = (
            f"The markers are {turn:.2g} deg and {place:.2g} mm RMS from where the rig has them, known to "
            f"{sigma[0]:.1g} deg and {1e3 * sigma[1]:.1g} mm from {self.photographs} photographs that show two or more."
        )
        if self.looseness < LOOSE:
            return (said,)
        return (
            said,
            f"The markers seem to move relative to each other: residuals with one pose for all of them are "
            f"{self.looseness:.2g} times those with one for each.",
        )


@dataclass(frozen=True, eq=False)
class _View:
    """One marker in one photograph: dots (m,) among those adjusted, and its pose by itself."""

    row: int
    photo: int
    marker: int
    dots: Indices
    rotation: Array
    translation: Array


@dataclass(frozen=True, eq=False)
class _State:
    """Poses of the rig (p, 3, 3), (p, 3), of its markers (k, 3, 3), (k, 3), places of dots (n, 3), and the camera."""

    rotation: Array
    translation: Array
    turns: Array
    shifts: Array
    places: Array
    camera: Camera


def relate(rig: Rig, adjustment: Adjustment, photo: Indices, print_sigma: float) -> Relation:
    """Find the relation of a rig's markers.

    Parameters
    ----------
    rig : Rig
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
        Its rig has the markers as designed, at their measured poses.

    Raises
    ------
    InputError
        If photographs do not connect all markers.
    """
    numbers = {number: k for k, number in enumerate(np.unique(photo).tolist())}
    views = []
    for v in range(len(adjustment.views)):
        dots = np.flatnonzero(adjustment.weights[v] > 0)
        pose = adjustment.views.rotation[v], adjustment.views.translation[v]
        views.append(_View(v, numbers[int(photo[v])], int(adjustment.network.marker[dots[0]]), dots, *pose))
    problem = _Problem(adjustment, views, len(numbers), len(rig.markers), print_sigma)
    state = problem.solved(_start(rig, adjustment, views, len(numbers)))
    covariance, factor = problem.covariance(state)
    count = 6 * len(rig.markers)
    turns, shifts, spread = _as_designed(rig, state.turns, state.shifts, covariance[:count, :count])
    placed = tuple(
        Plate(each.name, each.marker, tuple(map(tuple, turn)), tuple(shift))
        for each, turn, shift in zip(rig.markers, turns, shifts, strict=True)
    )
    designed = (
        np.array([each.rotation_matrix for each in rig.markers]),
        np.array([each.translation_vector for each in rig.markers]),
    )
    shown = [{each.marker for each in views if each.photo == k} for k in range(len(numbers))]
    return Relation(
        replace(rig, markers=placed, relation=tuple(map(tuple, spread))),
        np.rad2deg(angle_between(turns, designed[0])),
        np.linalg.norm(shifts - designed[1], axis=-1),
        float(np.sqrt(factor / adjustment.variance_factor)) if adjustment.degrees_of_freedom > 0 else 1.0,
        sum(len(each) > 1 for each in shown),
        (state.places, covariance[count:, count:]),
    )


def _start(rig: Rig, adjustment: Adjustment, views: Sequence[_View], photos: int) -> _State:
    turns, shifts = _starts(rig, views)
    rotation, translation = np.zeros((photos, 3, 3)), np.zeros((photos, 3))
    for each in sorted(views, key=lambda view: len(view.dots)):
        rotation[each.photo] = each.rotation @ turns[each.marker].T
        translation[each.photo] = each.translation - rotation[each.photo] @ shifts[each.marker]
    return _State(rotation, translation, turns, shifts, adjustment.places, adjustment.camera)


def _starts(rig: Rig, views: Sequence[_View]) -> tuple[Array, Array]:
    """Return poses T_rig_marker (k, 3, 3) and (k, 3), from marker to marker by photographs that show both.

    Of the relations that several photographs tell, the one nearest to the others is taken.
    """
    known, together = {0: (rig.markers[0].rotation_matrix, rig.markers[0].translation_vector)}, dict[int, list[_View]]()
    for each in views:
        together.setdefault(each.photo, []).append(each)
    while len(known) < len(rig.markers):
        told = dict[int, list[tuple[Array, Array]]]()
        for shown in together.values():
            for each, other in permutations(shown, 2):
                if each.marker in known and other.marker not in known:
                    turn, shift = known[each.marker]
                    between = each.rotation.T @ other.rotation, each.rotation.T @ (other.translation - each.translation)
                    told.setdefault(other.marker, []).append((turn @ between[0], turn @ between[1] + shift))
        if not told:
            left = [each.name for k, each in enumerate(rig.markers) if k not in known]
            raise InputError(
                "photographs that connect all markers of the rig, each with another one",
                f"none that shows {', '.join(left[:5])} beside one of the others",
                "photograph its edges, or leave the marker out of the rig",
            )
        for marker, candidates in told.items():
            turns = np.array([turn for turn, _ in candidates])
            apart = angle_between(turns[:, None], turns[None])
            known[marker] = candidates[int(np.median(apart, axis=1).argmin())]
    ordered = [known[k] for k in range(len(rig.markers))]
    return np.array([turn for turn, _ in ordered]), np.array([shift for _, shift in ordered])


class _Problem:
    """Least squares; the unknowns are poses of the rig, those of its markers but the first, dots, and the camera."""

    def __init__(
        self, adjustment: Adjustment, views: Sequence[_View], photos: int, markers: int, print_sigma: float
    ) -> None:
        self.adjustment, self.views, self.photos, self.markers = adjustment, views, photos, markers
        network = adjustment.network
        self.first_dot = 6 * (photos + markers)
        self.first_camera = self.first_dot + 3 * len(network.design)
        self.size = self.first_camera + len(network.freedom.directions)
        # Columns: directions in which the unknowns are free.
        dots = null_space(_gauge(network).T) if network.free else np.zeros((3 * len(network.design), 0))
        held = np.delete(np.eye(6 * (photos + markers)), np.s_[6 * photos : 6 * photos + 6], axis=1)
        self.free = block_diag(held, dots, network.freedom.directions)
        known = np.zeros((self.free.shape[1],) * 2)
        if len(network.freedom):
            known[-len(network.freedom) :, -len(network.freedom) :] = network.freedom.precision
        if network.free:
            own = slice(held.shape[1], held.shape[1] + dots.shape[1])
            printed = np.full((len(network.design), 3, 3), np.eye(3) / print_sigma**2)
            told = (
                printed
                if network.prior is None
                else np.where(network.prior.any(axis=(1, 2), keepdims=True), network.prior, printed)
            )
            known[own, own] += dots.T @ block_diag(*told) @ dots
        self.known = known

    def solved(self, state: _State) -> _State:
        """Return the state at the minimum; steps that raise chi2 are halved."""
        away = (state.places - self.adjustment.network.design).ravel()
        total = self.free.T @ np.r_[np.zeros(self.first_dot), away, np.zeros(self.size - self.first_camera)]
        normal, right, chi2 = self.normal(state)
        for _ in range(STEPS):
            step = np.linalg.solve(normal + self.known, right - self.known @ total)
            cost = chi2 + total @ self.known @ total
            for _ in range(HALVINGS):
                tried, after = self.moved(state, self.free @ step), total + step
                again = self.normal(tried)
                if again[2] + after @ self.known @ after <= cost * (1 + 1e-9):
                    break
                step = step / 2
            state, (normal, right, chi2), total = tried, again, after
            if np.abs(self.free @ step)[: self.first_dot].max() < SMALLEST:
                break
        return state

    def covariance(self, state: _State) -> tuple[Array, float]:
        """Covariance of the markers' poses, the first one held, and of the dots; and chi2 per degree of freedom."""
        normal, _, chi2 = self.normal(state)
        freedom = 2 * sum(len(each.dots) for each in self.views) - len(normal)
        factor = chi2 / freedom if freedom > 0 else 1.0
        whole = self.free @ np.linalg.inv(normal + self.known) @ self.free.T
        own = slice(6 * self.photos, self.first_camera)
        return max(1.0, factor) * whole[own, own], factor

    def moved(self, state: _State, step: Array) -> _State:
        """Return the state after a step (s,) of all unknowns."""
        turned, moved = step[: self.first_dot].reshape(-1, 2, 3).swapaxes(0, 1)
        count = self.photos
        return _State(
            exponential(turned[:count]) @ state.rotation,
            state.translation + moved[:count],
            exponential(turned[count:]) @ state.turns,
            state.shifts + moved[count:],
            state.places + step[self.first_dot : self.first_camera].reshape(-1, 3),
            moved_camera(state.camera, step[self.first_camera :]),
        )

    def normal(self, state: _State) -> tuple[Array, Array, float]:
        """Normal matrix and right side (f, f), (f,) of the free unknowns, and chi2."""
        normal, right, chi2 = np.zeros((self.size, self.size)), np.zeros(self.size), 0.0
        measured, radii, camera = self.adjustment.views, self.adjustment.network.radii, state.camera
        for each in self.views:
            rotation, translation = state.rotation[each.photo], state.translation[each.photo]
            turn, shift = state.turns[each.marker], state.shifts[each.marker]
            turned = state.places[each.dots] @ turn.T
            pose = rotation @ turn, rotation @ shift + translation
            drawn = outlines(state.places[each.dots], radii[each.dots], pose[0][None], pose[1][None])
            lens = camera.pixel_jacobian(drawn.point[0])
            rows = lens @ pose_rows(turned + shift, rotation[None], translation[None])[0]
            moved = rows[..., 3:] @ rotation
            by_camera = camera.parameter_jacobian(drawn.point[0])
            by_place = np.zeros((len(each.dots), 2, 3 * len(each.dots)))
            for m in range(len(each.dots)):
                by_place[m, :, 3 * m : 3 * m + 3] = moved[m] @ turn
            whole = np.concatenate([rows, -moved @ skew(turned), moved, by_place, by_camera], axis=-1)
            place = 6 * (self.photos + each.marker)
            columns = np.r_[
                6 * each.photo : 6 * each.photo + 6,
                place : place + 6,
                (self.first_dot + 3 * each.dots[:, None] + np.arange(3)).ravel(),
                self.first_camera : self.size,
            ]
            weight = np.linalg.inv(measured.covariance[each.row, each.dots])
            weight = weight * self.adjustment.weights[each.row, each.dots, None, None]
            residual = measured.pixels[each.row, each.dots] - camera.to_pixels(drawn.center[0])
            weighted = (weight @ whole).reshape(-1, len(columns))
            normal[np.ix_(columns, columns)] += weighted.T @ whole.reshape(-1, len(columns))
            right[columns] += weighted.T @ residual.ravel()
            chi2 += float(np.einsum("mi,mij,mj->", residual, weight, residual))
        for ruler in self.adjustment.network.lengths:
            apart = state.places[ruler.second] - state.places[ruler.first]
            length = float(np.linalg.norm(apart))
            columns = self.first_dot + 3 * np.array([[ruler.first], [ruler.second]]) + np.arange(3)
            row = np.concatenate([-apart, apart]) / (length * ruler.sigma)
            missed = (ruler.length - length) / ruler.sigma
            normal[np.ix_(columns.ravel(), columns.ravel())] += np.outer(row, row)
            right[columns.ravel()] += row * missed
            chi2 += missed**2
        return self.free.T @ normal @ self.free, self.free.T @ right, chi2


def _gauge(network: Network) -> Array:
    """Directions (3 n, g) in which dots do not move: three shifts and turns of each marker, and the scale of all.

    That is free if measurements fix it.
    """
    ruled = any(network.scale_known(int(each)) for each in np.unique(network.marker))
    whole = network.gauge(network.design)
    columns = list[Array]()
    grown, first = np.zeros(len(whole)), 0
    for each in np.unique(network.marker):
        columns += list(whole[:, first : first + 6].T)
        first += 6 if network.scale_known(int(each)) else 7
        own = network.marker == each
        middle = network.design[own].mean(axis=0)
        grown += np.where(own[:, None], network.design - middle, 0.0).ravel()
    return np.array([*columns, *([] if ruled else [grown])]).T


def _as_designed(rig: Rig, turns: Array, shifts: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Return poses and their covariance in the rig frame in which the designed dots are nearest to the designed rig."""
    places = [each.marker.xyz for each in rig.markers]
    found = np.concatenate([place @ turn.T + shift for place, turn, shift in zip(places, turns, shifts, strict=True)])
    middles = found.mean(axis=0), rig.xyz.mean(axis=0)
    left, _, right = np.linalg.svd((rig.xyz - middles[1]).T @ (found - middles[0]))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    shifts = (shifts - middles[0]) @ turn.T + middles[1]
    turns = turn @ turns
    count = len(turns)
    spin = np.kron(np.eye(2 * count), turn)
    covariance = spin @ covariance @ spin.T
    together, metric = np.zeros((6 * count, 6)), np.zeros((6 * count, 6 * count))
    for k in range(count):
        own = slice(6 * k, 6 * k + 6)
        together[own] = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(shifts[k]), np.eye(3)]])
        rows = np.concatenate(
            [-skew(places[k] @ turns[k].T), np.broadcast_to(np.eye(3), (len(places[k]), 3, 3))], axis=-1
        ).reshape(-1, 6)
        metric[own, own] = rows.T @ rows
    keep = np.eye(6 * count) - together @ np.linalg.solve(together.T @ metric @ together, together.T @ metric)
    covariance = keep @ covariance @ keep.T
    return turns, shifts, (covariance + covariance.T) / 2
