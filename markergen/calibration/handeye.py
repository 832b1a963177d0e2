"""Where a camera is on a robot, or beside it, from photographs of a marker and the robot's poses in them.

The robot measures G_k = T_base_flange of each photograph k, with errors of its own. With the pose M_k of what moves
with respect to the camera, and s the length of the marker's meter in the robot's,

    G_k = F M_k C^-1,

of a camera on the hand M = T_marker_camera, F = T_base_marker and C = T_flange_camera, of one beside the robot
M = T_camera_marker, F = T_base_camera and C = T_flange_marker. From a start in closed form, F, C, s, the poses of all
photographs, the dots and the camera are adjusted together: to the squares of the photographs come those of the robot's
poses, e'e / sigma^2 with

    e = (log(R_G R'), t_G - t),    R, t of F M C^-1,

and the standard deviations sigma of the robot's rotations and translations are those with which the squares of each
are what is expected of them (W. Foerstner, 1979). Photographs from one pose of the robot count as one measurement.

The start is linear: for two poses, P = G_j^-1 G_i and Q = M_j^-1 M_i have P C = C Q up to the scale, so

    R_P (s R_C) = (s R_C) R_Q,    (R_P - I) t_C - (s R_C) t_Q = -t_P.

Of all pairs together, this gives R_C also where rotations are about one axis, if the robot moves, too; t_C and s follow
from the second equation with R_C, and F from all poses.
"""

# tests: tests/calibration/test_handeye.py tests/calibration/test_hand_eye_start.py tests/api/test_handeye.py

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, permutations
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import Adjustment, UndeterminedError, adjust
from markergen.calibration.calibration import Known, adjust_loosely
from markergen.calibration.network import JointRows, Joints, Pose, Views
from markergen.calibration.photos import find_dots
from markergen.calibration.sentences import MOST_NAMED, TOO_FEW, named_unused
from markergen.detect.presentation import transform_as_dict
from markergen.errors import InputError
from markergen.files import Written
from markergen.maths.rotation import inverse_pose, logarithm, pose_product, skew
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.options import Progress
from markergen.presentation.plots import INK, MUTED, SERIES, axes_of, legend_below
from markergen.presentation.results import SavableResult, json_bytes, plain
from markergen.presentation.tables import Table, number
from markergen.units import METERS, two_digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST, UNKNOWNS = 3, 13
"""Fewest photographs, since two rotations about axes that differ determine X and Z; parameters of X, Z and log s."""

PARALLEL_DEG = 2.0
"""RMS angle by which the robot has to turn about a second axis. With 1 degree, a camera is known to centimeters from
a robot that is good to 0.1 mm."""

CLEARLY = 0.1
"""Ratio of squares to which another assignment of poses has to lower them."""

HOPELESS_DEG = 10.0
"""RMS residual of rotations from which the poses are not those of the photographs: hobby arms are good to 2 degrees."""

HOPELESS_SHARE, HOPELESS_M = 0.1, 0.01
"""Likewise of translations, as a share of the spread of the flange's, and the least, m. Quaternions and angles in a
wrong order can be the inverse rotations in other frames: rotations then agree to 3 degrees, and translations are off by
0.3 to 0.4 of their spread. Meters read as mm leave 5 mm, of a spread of 0.3 mm."""

SCALES = (0.5, 2.0)
"""Scales beyond which a unit is wrong, not a print."""

UNITS = ("mm", "cm", "m", "in", "ft")
SAME_UNIT = 1.08
"""Ratio up to which a scale is that of two units; 10 mm in a cm and 12 in in a ft are 1.2 apart."""

SUSPECTS = 8
"""Number of photographs of the largest residuals that may be exchanged, or left out."""

SAME_RAD, SAME_M = 1e-5, 1e-5
"""Differences of poses up to which the robot did not move: numbers are written with five digits or more."""

USUAL, PRIOR = np.array([3e-4, 1e-4]), 4
"""Standard deviations of a robot, rad and m, and the number of measurements that they count as. Without them, eight
photographs made 0.02 mm of a robot's 0.1 mm, and errors of X were 4 of its sigmas."""

REACH, USUAL_SCALE = 0.5, 0.1
"""Standard deviations before of what the flange carries about the flange along each axis, m, and of log s: they hold
what the poses leave open. With 5 m, four photographs of rotations about one axis put the camera 0.4 m aside."""

ROUNDS, SETTLED = 12, 0.02
"""Number of estimates of the robot's errors at most, and the relative change of them that ends it, a fifth of the
error of a standard deviation that comes from 50 measurements."""

ADVICE = "take ten or more, turned by 20 to 60 deg about several axes between them"


@dataclass(frozen=True, eq=False)
class RobotPoses(Joints):
    """A robot's poses, and what they say of the poses of views.

    F and C as rotations (2, 3, 3) and translations (2, 3) in the robot's m, the logarithm of s, and T_base_flange of
    each view (v) with standard deviations `sigma` along each axis, rad and m; `on_hand` if the flange carries the
    camera.
    """

    log_scale: Array
    flange: Pose
    on_hand: bool
    sigma: tuple[float, float] = (1e-3, 1e-3)
    ADJUSTED: ClassVar[tuple[str, ...]] = ("rotation", "translation", "log_scale")

    @property
    def count(self) -> int:
        """See `Joints.count`."""
        return UNKNOWNS

    @property
    def measured(self) -> int:
        """See `Joints.measured`."""
        return round(6 * float(self.share.sum()))

    @cached_property
    def share(self) -> Array:
        """Shares (v,) of the photographs in the measurement that those from one pose of the robot are together."""
        same_rotation = np.linalg.norm(self.flange[0][:, None] - self.flange[0], axis=(-2, -1)) < SAME_RAD
        same_place = np.linalg.norm(self.flange[1][:, None] - self.flange[1], axis=-1) < SAME_M
        return np.asarray(1 / (same_rotation & same_place).sum(axis=1))

    def stepped(self, step: Array) -> Self:
        """See `Joints.stepped`; the last is added to log s."""
        return replace(super().stepped(step[:-1]), log_scale=self.log_scale + step[-1:])

    def moving(self, views: Views) -> tuple[Pose, Array]:
        """Poses M (v), and their derivatives (v, 6, 6) by (w, dt) of the views' poses."""
        scale = float(np.exp(self.log_scale[0]))
        by_view = np.zeros((len(views), 6, 6))
        if not self.on_hand:
            by_view[:] = np.diag([1.0] * 3 + [scale] * 3)
            return (views.rotation, scale * views.translation), by_view
        back = views.rotation.swapaxes(-1, -2)
        by_view[:, :3, :3], by_view[:, 3:, 3:] = -back, -scale * back
        by_view[:, 3:, :3] = -scale * back @ skew(views.translation)
        return inverse_pose((views.rotation, scale * views.translation)), by_view

    def rows(self, views: Views) -> JointRows:
        """See `Joints.rows`: (w, dt) of the flange in the base."""
        (rotation, translation), by_view = self.moving(views)
        (fixed, carried), (fixed_at, carried_at) = self.rotation, self.translation
        flange = fixed @ rotation @ carried.T
        lever = rotation @ (-carried.T @ carried_at)
        reach = (lever + translation) @ fixed.T
        by_moving, by_joints = np.zeros((len(views), 6, 6)), np.zeros((len(views), 6, UNKNOWNS))
        by_moving[:, :3, :3] = by_moving[:, 3:, 3:] = fixed
        by_moving[:, 3:, :3] = -fixed @ skew(lever)
        by_joints[:, :3, :3] = by_joints[:, 3:, 3:6] = np.eye(3)
        by_joints[:, 3:, :3] = -skew(reach)
        by_joints[:, :3, 6:9] = by_joints[:, 3:, 9:12] = -flange
        by_joints[:, 3:, 6:9] = -flange @ skew(carried_at)
        by_joints[:, 3:, 12] = translation @ fixed.T
        rotation_error = logarithm(self.flange[0] @ flange.swapaxes(-1, -2))
        residual = np.concatenate([rotation_error, self.flange[1] - reach - fixed_at], axis=-1)
        weight = self.share[:, None] / np.repeat(self.sigma, 3) ** 2
        precision, off = np.zeros(UNKNOWNS), np.zeros(UNKNOWNS)
        precision[9:12], off[9:12], precision[12], off[12] = REACH**-2, carried_at, USUAL_SCALE**-2, self.log_scale[0]
        return JointRows(residual, weight, by_moving @ by_view, by_joints, precision, off)


@dataclass(frozen=True, eq=False)
class HandEyeFit:
    """Camera and marker on a robot, adjusted together with the photographs.

    Covariance (13, 13) of (w, dt) of F and of C, R <- exp([w]x) R, and of log s, in rad and m; `left_out` (v, 6) are
    poses of the flange less those predicted without it, from its photograph and all others.
    """

    robot: RobotPoses
    adjustment: Adjustment
    covariance: Array
    left_out: Array


def started(views: Views, flange: Pose, on_hand: bool) -> RobotPoses:
    """F, C and s in closed form and by least squares; the least where they are open."""
    robot = RobotPoses(np.stack([np.eye(3)] * 2), np.zeros((2, 3)), np.zeros(1), flange, on_hand)
    fixed, carried, scale = hand_eye_start(flange, robot.moving(views)[0])
    rotation, translation = (np.stack(pair) for pair in zip(fixed, carried, strict=True))
    return fitted(replace(robot, rotation=rotation, translation=translation, log_scale=np.log([scale])), views)


def fitted(robot: RobotPoses, views: Views) -> RobotPoses:
    """F, C and s by least squares (Gauss-Newton), with the poses of the views held."""
    best, least = robot, np.inf
    for _ in range(20):
        rows = robot.rows(views)
        if rows.cost >= least * (1 - 1e-9):
            break
        best, least, root = robot, rows.cost, np.sqrt(rows.weight)
        weights = np.sqrt(rows.precision)
        matrix = np.vstack([(rows.by_joints * root[..., None]).reshape(-1, UNKNOWNS), np.diag(weights)])
        step = np.linalg.lstsq(matrix, np.r_[(rows.residual * root).ravel(), -weights * rows.off], rcond=1e-9)[0]
        robot = robot.stepped(np.clip(step, -1.0, 1.0))
    return best


def agreeing(
    views: Views, flange: Pose, names: Sequence[str], on_hand: bool = True, one_axis: bool = False
) -> tuple[RobotPoses, Indices]:
    """F, C and s by the photographs whose poses agree, and which these are.

    Parameters
    ----------
    flange : (array (v, 3, 3), array (v, 3)), m
        T_base_flange of each view.
    names : sequence of str
        Names of the photographs, for messages.
    one_axis : bool
        Allow a robot that turns about one axis only.

    Raises
    ------
    InputError
        If there are fewer than three photographs, the robot turned about one axis only, or photographs have each
        other's poses, their inverses, or such as no camera agrees with.
    """
    count = len(views)
    if count < LEAST:
        raise InputError(f"{LEAST} photographs or more that have a pose and show the marker", str(count), ADVICE)
    _check_axes(flange[0], one_axis)
    robot = started(views, flange, on_hand)
    squares = robot.rows(views)
    worst = np.argsort(-np.sum(squares.weight * squares.residual**2, axis=1))[:SUSPECTS]
    backward = started(views, inverse_pose(flange), on_hand)
    cost = backward.rows(views).cost
    if cost < CLEARLY * squares.cost and not _disagreement(backward, views):
        mount = "eye-to-hand" if on_hand else "eye-in-hand"
        raise InputError(
            "robot poses of the stated direction",
            f"inverse ones, which fit the photographs {_times(squares.cost, cost)} better",
            f"give the other --robot-frame, or --mounting {mount}",
        )
    index = np.arange(count)
    orders = [
        (f"{names[i]} and {names[j]} exchanged", np.where(index == i, j, np.where(index == j, i, index)))
        for i, j in combinations(worst, 2)
    ]
    neighbors = [
        (f"photographs that have the pose of the {name}", np.roll(index, k))
        for name, k in (("one before", -1), ("next", 1))
    ]
    orders += [*neighbors, ("the order of the poses reversed", index[::-1])]
    costs = [started(views, (flange[0][order], flange[1][order]), on_hand).rows(views).cost for _, order in orders]
    best = int(np.argmin(costs))
    if count > LEAST and costs[best] < CLEARLY * squares.cost:
        raise InputError(
            "photographs that have their own robot poses",
            f"{orders[best][0]}: otherwise they fit {_times(squares.cost, costs[best])} better",
            "correct which photograph a pose belongs to",
        )
    robot, kept = _without_wrong(views, robot, index)
    if problem := _disagreement(robot, views.take(kept)):
        raise InputError(
            "robot poses that agree with the photographs",
            problem,
            "check --robot-rotation, --robot-angle, and which photograph a pose belongs to",
        )
    scale = np.exp(robot.log_scale[0])
    if not SCALES[0] < scale < SCALES[1]:
        # Without the usual scale, which drew 0.001 to 0.02.
        scale *= hand_eye_start((flange[0][kept], flange[1][kept]), robot.moving(views.take(kept))[0])[2]
        remedy = "check --robot-unit and the marker's size, and move the flange, besides turning it"
        for read, right in permutations(UNITS, 2):
            if abs(np.log(scale * float(METERS[right]) / float(METERS[read]))) < np.log(SAME_UNIT):
                remedy = f"these are {right}, read as {read}: give --robot-unit {right}"
        problem = f"a length of the marker of 1 m is {number(float(scale))} m by the robot"
        raise InputError("a robot and a marker of one scale", problem, remedy)
    return robot, kept


def _check_axes(rotation: Array, one_axis: bool) -> None:
    """Refuse poses that turn about one axis, or none: the camera may then be anywhere along it."""
    first, second = np.array(list(combinations(range(len(rotation)), 2))).T
    turns = np.rad2deg(logarithm(rotation[second].swapaxes(-1, -2) @ rotation[first]))
    about = np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(turns))
    if about[0] < PARALLEL_DEG or (about[1] < PARALLEL_DEG and not one_axis):
        hint = "" if about[0] < PARALLEL_DEG else ", or give --one-axis, which leaves the offset along it open"
        raise InputError(
            "robot poses that turn about two axes or more",
            f"rotations about parallel axes, {about[1]:.2g} deg RMS about any other"
            if hint
            else f"rotations of {about[0]:.2g} deg RMS",
            ADVICE + hint,
        )


def _without_wrong(views: Views, robot: RobotPoses, kept: Indices) -> tuple[RobotPoses, Indices]:
    """Leave out photographs without which the others agree clearly better, a quarter of them at most.

    Rotations and translations are compared apart. As sums over both, 14 photographs of a robot that is good to 0.02 deg
    kept one that was off by 5 mm.
    """
    least, flange = max(LEAST + 2, 3 * len(kept) // 4), robot.flange
    while len(kept) > least:
        squares = _squares(robot, views.take(kept))
        before = _variances(squares)
        suspects = np.argsort(-np.sum(squares / before, axis=1))[:SUSPECTS]
        fits = []
        for k in suspects:
            rest = np.delete(kept, k)
            fit = started(views.take(rest), (flange[0][rest], flange[1][rest]), robot.on_hand)
            ratio = float(np.min(_variances(_squares(fit, views.take(rest))) / before))
            fits.append((ratio, fit, rest))
        ratio, fit, rest = min(fits, key=lambda entry: entry[0])
        if ratio > CLEARLY:
            break
        robot, kept = fit, rest
    return robot, kept


def _squares(robot: RobotPoses, views: Views) -> Array:
    """Squares (v, 2) of the lengths of the residual rotations and translations, rad^2 and m^2."""
    return np.asarray(np.sum(robot.rows(views).residual.reshape(-1, 2, 3) ** 2, axis=2))


def _disagreement(robot: RobotPoses, views: Views) -> str:
    """How far poses are apart that no camera agrees with; "" for others."""
    rotation, translation = np.sqrt(_squares(robot, views).mean(axis=0))
    if (rotation_deg := float(np.rad2deg(rotation))) > HOPELESS_DEG:
        return f"rotations {rotation_deg:.3g} deg RMS apart"
    spread = np.sqrt(np.sum(np.var(robot.flange[1], axis=0)))
    if translation > max(HOPELESS_SHARE * spread, HOPELESS_M):
        return f"translations {1e3 * translation:.3g} mm RMS apart, and rotations {rotation_deg:.2g} deg"
    return ""


def _variances(squares: Array) -> Array:
    """Squares per degree of freedom of rotations and of translations, as if each had half of the unknowns."""
    least = np.array([SAME_RAD, SAME_M]) ** 2
    return np.asarray(np.maximum(2 * squares.sum(axis=0) / (6 * len(squares) - UNKNOWNS), least))


def hand_eye(adjustment: Adjustment, robot: RobotPoses) -> HandEyeFit:
    """Adjust photographs and robot together, from an adjustment of the photographs alone and a start of the robot's."""
    # Residuals beyond the noise of the image, of lens or print, are in the weights.
    views = replace(adjustment.views, covariance=adjustment.scale * adjustment.views.covariance)
    size = np.sqrt(np.mean(robot.rows(views).residual.reshape(-1, 2, 3) ** 2, axis=(0, 2)))
    expected = 3 * float(robot.share.sum())
    fits = []
    for sigma in (USUAL, np.maximum(size, USUAL)):
        robot = replace(robot, sigma=(float(sigma[0]), float(sigma[1])))
        adjusted, spread = _settled(adjustment, views, robot)
        deviations = adjusted.joints.sigma if isinstance(adjusted.joints, RobotPoses) else sigma
        fits.append((adjusted.chi2 + 2 * expected * float(np.log(deviations).sum()), adjusted, spread))
    _, adjusted, spread = min(fits, key=lambda fit: fit[0])
    assert isinstance(adjusted.joints, RobotPoses)
    robot, covariance = adjusted.joints, adjusted.unscaled[-UNKNOWNS:, -UNKNOWNS:]
    rows = robot.rows(adjusted.views)
    freedom = 2 * expected - UNKNOWNS
    # Of Student's distribution: the robot's sigma is known by few residuals only.
    covariance = covariance * freedom / max(freedom - 2, 1.0)
    kept = np.eye(6) - spread * rows.weight[:, None]
    left_out = np.asarray(np.linalg.solve(kept, rows.residual[..., None])[..., 0])
    return HandEyeFit(robot, adjusted, covariance, left_out)


def _settled(adjustment: Adjustment, views: Views, robot: RobotPoses) -> tuple[Adjustment, Array]:
    """Adjust, with the robot's sigma as the residuals show it from a start on; also the covariance of F M C^-1."""
    places, expected, parts = adjustment.places, 3 * float(robot.share.sum()), (slice(3), slice(3, 6))
    for _ in range(ROUNDS):
        adjusted = adjust(replace(adjustment.network, joints=robot), views, adjustment.weights, places)
        assert isinstance(adjusted.joints, RobotPoses)
        rows, views, places = adjusted.joints.rows(adjusted.views), adjusted.views, adjusted.places
        poses, mixed = adjusted.pose_covariances
        beside = rows.by_pose @ mixed[..., -UNKNOWNS:] @ rows.by_joints.swapaxes(-1, -2)
        spread = rows.by_pose @ poses @ rows.by_pose.swapaxes(-1, -2) + beside + beside.swapaxes(-1, -2)
        spread = spread + rows.by_joints @ adjusted.unscaled[-UNKNOWNS:, -UNKNOWNS:] @ rows.by_joints.swapaxes(-1, -2)
        taken, squares = np.einsum("vii->vi", spread) * rows.weight, rows.weight * rows.residual**2
        sigma = []
        for part, value, usual in zip(parts, robot.sigma, USUAL, strict=True):
            total, left = float(squares[:, part].sum()), max(expected - float(taken[:, part].sum()), 0.0)
            # The mean of an inverse gamma distribution.
            sigma.append(float(np.sqrt((total * value**2 + PRIOR * usual**2) / (left + PRIOR - 2))))
        if np.allclose(sigma, robot.sigma, rtol=SETTLED):
            break
        robot = replace(adjusted.joints, sigma=(sigma[0], sigma[1]))
    return adjusted, spread


WEAKLY = 1e-6
"""Weight of a scale of 1, beside that of a pose: it decides only where nothing else does."""


def hand_eye_start(robot: Pose, moving: Pose) -> tuple[Pose, Pose, float]:
    """F, C and s by linear least squares over all pairs of poses; the least where they are open.

    Parameters
    ----------
    robot, moving : (array (k, 3, 3), array (k, 3)), m
        G and M, k >= 2.
    """
    first, second = np.array(list(combinations(range(len(robot[0])), 2))).T
    moved, seen = (
        pose_product(inverse_pose((poses[0][second], poses[1][second])), (poses[0][first], poses[1][first]))
        for poses in (robot, moving)
    )
    length = float(np.sqrt(np.mean(moved[1] ** 2))) or 1.0
    eye, pairs = np.eye(3), len(first)
    rows, goal = np.zeros((pairs, 12, 12)), np.zeros((pairs, 12))
    # Row by row, entry (i, j) of A B C has the derivative A_ik C_lj by B_kl.
    turns = np.einsum("nik,lj->nijkl", moved[0], eye) - np.einsum("ik,nlj->nijkl", eye, seen[0])
    rows[:, :9, :9] = turns.reshape(pairs, 9, 9)
    rows[:, 9:, :9] = np.einsum("ik,nl->nikl", eye, -seen[1] / length).reshape(pairs, 3, 9)
    rows[:, 9:, 9:], goal[:, 9:] = moved[0] - eye, -moved[1] / length
    solution = np.linalg.lstsq(rows.reshape(-1, 12), goal.ravel(), rcond=1e-9)[0]
    carried = _rotation_near(np.asarray(solution[:9]).reshape(3, 3))
    rows = np.concatenate([moved[0] - eye, -(seen[1] @ carried.T)[..., None]], axis=-1)
    # Where all poses are as far from one point, s is open, and 1 the best guess.
    rows, goal = np.vstack([rows.reshape(-1, 4), [0, 0, 0, WEAKLY * length]]), np.r_[-moved[1].ravel(), WEAKLY * length]
    *place, scale = np.linalg.lstsq(rows, goal, rcond=1e-9)[0]
    scale = float(scale) if scale > 0 else 1.0
    C = carried, np.array(place)
    F = pose_product(pose_product(robot, C), inverse_pose((moving[0], scale * moving[1])))
    return (_rotation_near(F[0].mean(axis=0)), F[1].mean(axis=0)), C, scale


def _rotation_near(matrix: Array) -> Array:
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _times(cost: float, less: float) -> str:
    """How many times better a fit with the lesser cost is, in words."""
    return f"{two_digits(float(np.sqrt(cost / less)))} times"


# --- The result -------------------------------------------------------------------------------------------------------

MOUNTINGS = ("eye-in-hand", "eye-to-hand")
FRAMES = {"eye-in-hand": ("base", "flange"), "eye-to-hand": ("flange", "base")}
"""Frames of marker and camera by mounting: what each does not move in."""

DIFFERENT = 3.0
"""Sigmas from which the scales of marker and robot differ."""

OPEN_SHARE, OPEN_RAD = 0.05, np.deg2rad(2.0)
"""Standard deviation of a place as a share of the marker's distance, and of a rotation, from which it is open."""

OPEN_SCALE = 0.02
"""Standard deviation of the scale, as a share, from which it is open: prints are good to 0.5 %."""

SURE_SCALE = 0.005
"""Standard deviation up to which a scale near 1 shows that the size is right: three photographs of a print that was
2 % too large had 0.01, four 0.003."""

IMPLAUSIBLE = np.deg2rad(0.3), 2e-3
"""Errors of a robot, rad and m along each axis, from which the camera is doubted: arms for hobbyists reach 1 mm."""

OF_A_POSE = ("wx", "wy", "wz", "tx", "ty", "tz")


@dataclass(frozen=True, eq=False)
class HandEye(SavableResult):
    """Camera and marker on a robot.

    Attributes
    ----------
    fit : HandEyeFit
        The adjustment.
    estimated : tuple of str
        Parameters of the camera that were unknown; empty if it was given.
    photos : tuple of str
        Photographs that took part.
    unused : mapping of str to str
        Photographs that took no part, and why.

    Examples
    --------
    See `markergen.handeye`.

    >>> import markergen as mg
    >>> mg.HandEye.KINDS[".json"]
    'json'
    """

    KINDS: ClassVar[Mapping[str, str]] = {".json": "json", ".svg": "plot", ".png": "plot"}

    fit: HandEyeFit
    estimated: tuple[str, ...]
    photos: tuple[str, ...]
    unused: Mapping[str, str]
    written: tuple[Written, ...] = ()

    @property
    def mounting(self) -> str:
        """eye-in-hand or eye-to-hand."""
        return MOUNTINGS[not self.fit.robot.on_hand]

    @property
    def camera_pose(self) -> Pose:
        """X: T_flange_camera, or T_base_camera of an eye-to-hand; (array (3, 3), array (3,)), the robot's m."""
        return self._pose(self.fit.robot.on_hand)

    @property
    def marker_pose(self) -> Pose:
        """Z: T_base_marker, or T_flange_marker of an eye-to-hand; as `camera_pose`."""
        return self._pose(not self.fit.robot.on_hand)

    def _pose(self, is_carried: bool) -> Pose:
        robot = self.fit.robot
        return robot.rotation[int(is_carried)], robot.translation[int(is_carried)]

    @property
    def scale(self) -> float:
        """Length of the marker's meter in the robot's."""
        return float(np.exp(self.fit.robot.log_scale[0]))

    @property
    def covariance(self) -> Array:
        """Of (w, dt) of X and of Z, R <- exp([w]x) R and t + dt, and of the log of the scale, (13, 13), rad and m."""
        # F is the marker, and C the camera, of a camera on the hand.
        order = np.r_[6:12, 0:6, 12] if self.fit.robot.on_hand else np.arange(13)
        return self.fit.covariance[np.ix_(order, order)]

    @property
    def robot_sigma(self) -> tuple[float, float]:
        """Standard deviations of the robot's rotations (rad) and translations (m) along each axis, as photographed."""
        return self.fit.robot.sigma

    @property
    def camera(self) -> Camera:
        """As given, or as adjusted together with the robot's poses."""
        return self.fit.adjustment.camera

    @property
    def residual(self) -> Array:
        """Measured poses of the flange less the adjusted ones: (w, dt) in the base, (k, 6), rad and m."""
        return self.fit.robot.rows(self.fit.adjustment.views).residual

    @property
    def left_out(self) -> Array:
        """Measured poses of the flange less those predicted without them, as `residual`."""
        return self.fit.left_out

    @property
    def open(self) -> tuple[str, ...]:
        """Directions that the poses leave open, as sentences."""
        return tuple(_open_directions(self.fit))

    @property
    def names(self) -> tuple[str, str]:
        """What X and Z are: T_flange_camera and T_base_marker, or T_base_camera and T_flange_marker."""
        marker, camera = FRAMES[self.mounting]
        return f"T_{camera}_camera", f"T_{marker}_marker"

    @property
    def sigma(self) -> Array:
        """Standard deviations (13,) of the unknowns, rad and m."""
        return np.sqrt(np.diag(self.covariance))

    def __repr__(self) -> str:
        return f"<HandEye: {self.names[0]} from {len(self.photos)} photographs, left out {self._left_out()}>"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw how far each photograph's robot pose is from the one predicted without it: rotation and translation.

        Parameters
        ----------
        ax : matplotlib axes or None
            Axes to draw on; None makes a new figure, available as ``ax.figure``.
        """
        ax = axes_of(ax)
        rotation, translation = self._lengths(self.left_out)
        ax.plot(rotation, translation, color=SERIES[0]["color"], marker="o", linestyle="none")
        for name, x, y in zip(self.photos, rotation, translation, strict=True):
            ax.annotate(Path(name).stem, (x, y), xytext=(4, 3), textcoords="offset points", fontsize=7, color=INK)
        expected = np.sqrt(3) * np.array([np.rad2deg(self.robot_sigma[0]), 1e3 * self.robot_sigma[1]])
        ax.axvline(expected[0], color=MUTED, linewidth=0.8, linestyle="--")
        ax.axhline(expected[1], color=MUTED, linewidth=0.8, linestyle="--", label="RMS of the robot's errors")
        # With room for the name of the outermost photograph.
        ax.set_xlim(0, 1.15 * max(expected[0], rotation.max()))
        ax.set_ylim(0, 1.1 * max(expected[1], translation.max()))
        ax.set_xlabel("rotation from the left-out pose, deg")
        ax.set_ylabel("translation from the left-out pose, mm")
        legend_below(ax)
        return ax

    @staticmethod
    def _lengths(errors: Array) -> tuple[Array, Array]:
        """Lengths of rotations in deg and of translations in mm."""
        parts = np.linalg.norm(errors.reshape(-1, 2, 3), axis=-1)
        return np.rad2deg(parts[:, 0]), 1e3 * parts[:, 1]

    def _left_out(self) -> str:
        rotation, translation = (np.sqrt(np.mean(part**2)) for part in self._lengths(self.left_out))
        return f"{number(translation, 2)} mm and {number(rotation, 2)} deg RMS"

    def brief(self) -> list[str | Table]:
        """See `Result.brief`."""
        (X, Z), sigma = self.names, self.sigma
        rotation, translation = np.rad2deg(self.robot_sigma[0]), 1e3 * self.robot_sigma[1]
        # The usual errors of robots keep an estimate up that is larger than what is left of the poses.
        at_most_deg, at_most_mm = (
            "at most " if np.sqrt(np.mean(left**2)) < np.sqrt(3) * estimate else ""
            for left, estimate in zip(self._lengths(self.left_out), (rotation, translation), strict=True)
        )
        adjustment = self.fit.adjustment
        sentences = [
            _pose_sentence(X, self.camera_pose, sigma[:6]),
            _pose_sentence(Z, self.marker_pose, sigma[6:12]),
            self._scale_sentence(),
            f"{len(self.photos)} photographs, residuals {adjustment.rms:.3f} px RMS; the robot's poses are off by "
            f"{at_most_mm}{number(translation, 2)} mm and {at_most_deg}{number(rotation, 2)} deg along each axis.",
            f"A left-out pose is predicted to {self._left_out()}."
            if len(self.photos) > LEAST
            else f"{LEAST} photographs leave none over to check this with: {ADVICE}.",
        ]
        if self.robot_sigma[0] > IMPLAUSIBLE[0] or self.robot_sigma[1] > IMPLAUSIBLE[1]:
            mended = "the camera is not as given; leave out --camera, or give --camera-covariance"
            doubt = "" if adjustment.network.freedom else f": if this one does not, {mended}"
            sentences[-1] += f" These are more than most robots err{doubt}."
        sentences += [f"Open: {'; '.join(self.open[:2])}{'; and more' * (len(self.open) > 2)}."] if self.open else []
        sentences += [f"Camera, adjusted with the robot: {self.camera}."] if adjustment.network.freedom else []
        sentences += named_unused(list(self.unused.items()))
        return list(sentences)

    def _scale_sentence(self) -> str:
        off, sigma = self.scale - 1, self.scale * float(self.sigma[12])
        verdict = "the marker's size is right"
        if sigma > SURE_SCALE:
            verdict = "too roughly to check the marker's size"
        if abs(off) > DIFFERENT * sigma:
            verdict = (
                f"the print is {100 * abs(off):.2g} % {'larger' if off > 0 else 'smaller'} than the marker's file says"
            )
        return f"1 m of the marker is {self.scale:.5f} m by the robot, known to {number(sigma, 2)}: {verdict}."

    def parts(self) -> list[str | Table]:
        """See `Result.parts`."""
        rows = [
            [Path(name).name, *(number(float(value)) for value in values)]
            for name, *values in zip(
                self.photos, *self._lengths(self.residual), *self._lengths(self.left_out), strict=True
            )
        ]
        header = ["photograph", "residual, deg", "mm", "left out, deg", "mm"]
        caption = "Measured pose of the flange less the adjusted one, and less the one predicted without it."
        table = Table("Poses of the robot", header, rows, caption)
        unused = [f"{name}: {reason}." for name, reason in list(self.unused.items())[MOST_NAMED:]]
        return [*self.brief(), *(f"{sentence}." for sentence in self.open[2:]), table, *unused]

    def to_json(self) -> bytes:
        """See `SavableResult.to_json`; docs/handeye.md says what is what."""
        return json_bytes(plain(self.as_dict()))

    def as_dict(self) -> dict[str, Any]:
        """Return the results as plain JSON values: meters and radians unless a key says otherwise."""
        (X, Z), sigma, adjustment = self.names, self.sigma, self.fit.adjustment
        residual, left_out = self._lengths(self.residual), self._lengths(self.left_out)
        return {
            "mounting": self.mounting,
            X: _pose_as_dict(self.camera_pose, sigma[:6]),
            Z: _pose_as_dict(self.marker_pose, sigma[6:12]),
            "scale": {"value": self.scale, "sigma": self.scale * float(sigma[12])},
            "unknowns": [*(f"{name} {w}" for name in (X, Z) for w in OF_A_POSE), "log scale"],
            "covariance": self.covariance.tolist(),
            "robot": {"rotation_deg": np.rad2deg(self.robot_sigma[0]), "translation_mm": 1e3 * self.robot_sigma[1]},
            "open": list(self.open),
            "camera": {**self.camera.as_dict(), "estimated": list(self.estimated)},
            "rms_px": adjustment.rms,
            "left_out": {
                "rotation_deg": float(np.sqrt(np.mean(left_out[0] ** 2))),
                "translation_mm": float(np.sqrt(np.mean(left_out[1] ** 2))),
            },
            "photos": [
                {
                    "photo": name,
                    "rotation_deg": float(residual[0][k]),
                    "translation_mm": float(residual[1][k]),
                    "left_out": {"rotation_deg": float(left_out[0][k]), "translation_mm": float(left_out[1][k])},
                }
                for k, name in enumerate(self.photos)
            ],
            "unused": dict(self.unused),
        }


def _pose_sentence(name: str, pose: Pose, sigma: Array) -> str:
    def joined(values: Array, form: str) -> str:
        return " ".join(format(value, form) for value in values)

    # Rounded first, and without the sign of a zero.
    place, rotation = (np.round(values, 3) + 0.0 for values in (1e3 * pose[1], np.rad2deg(logarithm(pose[0]))))
    return (
        f"{name}: translation {joined(place, '.3f')} mm +- {joined(1e3 * sigma[3:], '.2g')}, rotation vector "
        f"{joined(rotation, '.3f')} deg +- {joined(np.rad2deg(sigma[:3]), '.2g')}."
    )


def _pose_as_dict(pose: Pose, sigma: Array) -> dict[str, Any]:
    sigmas = {"rotation_deg": np.rad2deg(sigma[:3]).tolist(), "translation": sigma[3:].tolist()}
    return {**transform_as_dict(*pose), "sigma": sigmas}


def solve(
    marker: Marker,
    sources: Sequence[Any],
    flange: Mapping[int, Pose],
    on_hand: bool,
    one_axis: bool,
    prior: Known,
    workers: int | None = None,
    progress: Progress | None = None,
) -> HandEye:
    """Find the dots of the marker in photographs, and adjust them together with the robot's poses.

    Parameters
    ----------
    sources : sequence of path or array
        Photographs.
    flange : mapping of int to (array (3, 3), array (3,))
        T_base_flange in m of photographs by their index.
    on_hand, one_axis : bool
        See `markergen.calibration.handeye.agreeing`.

    Raises
    ------
    InputError
        If fewer than three photographs have a pose and show the marker, or as `agreeing`.
    """
    names = [f"photo {k}" if isinstance(source, np.ndarray) else str(source) for k, source in enumerate(sources)]
    posed = sorted(flange)
    unused = {name: "it has no robot pose" for k, name in enumerate(names) if k not in flange}
    if len(posed) < LEAST:
        raise InputError(f"{LEAST} photographs or more with a robot pose", str(len(posed)), ADVICE)
    sightings, camera = find_dots(
        [marker], [sources[k] for k in posed], prior.camera,
        camera_covariance=prior.covariance, progress=progress, workers=workers,
    )  # fmt: skip
    unused |= {names[posed[k]]: reason.rstrip(".") for k, reason in sightings.unused.items()}
    if len(sightings.views) < LEAST:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in list(unused.items())[:MOST_NAMED])
        expected = f"{LEAST} photographs or more that show the marker"
        raise InputError(expected, str(len(sightings.views)), reasons or ADVICE)
    try:
        cleaned, sightings, estimated = adjust_loosely(marker, sightings, camera, prior)
    except (UndeterminedError, np.linalg.LinAlgError):
        remedy = f"give --camera, or {ADVICE}"
        raise InputError("photographs that determine dots and camera", "others", remedy) from None
    unused |= {names[posed[k]]: TOO_FEW for k in sightings.photo[~cleaned.used]}
    numbers = [posed[k] for k in sightings.photo[cleaned.used]]
    sighted, adjustment = [names[k] for k in numbers], cleaned.adjustment
    rotation, translation = (np.array([flange[k][part] for k in numbers]) for part in range(2))
    robot, kept = agreeing(adjustment.views, (rotation, translation), sighted, on_hand, one_axis)
    photos = tuple(sighted[k] for k in kept)
    unused |= dict.fromkeys(set(sighted) - set(photos), "its robot pose disagrees with the others")
    views, weights, residual = adjustment.views.take(kept), adjustment.weights[kept], adjustment.residual[kept]
    fit = hand_eye(replace(adjustment, views=views, weights=weights, residual=residual), robot)
    return HandEye(fit, estimated, photos, {name: unused[name] for name in names if name in unused})


def _open_directions(fit: HandEyeFit) -> Iterator[str]:
    """Directions in which the poses leave camera or marker open, as sentences."""
    distance = float(np.median(np.linalg.norm(fit.adjustment.views.translation, axis=1)))
    bodies = ("marker", "camera") if fit.robot.on_hand else ("camera", "marker")
    for start, body, frame in ((0, bodies[0], "base"), (6, bodies[1], "flange")):
        for block, limit, what in (
            (slice(start, start + 3), OPEN_RAD, "its rotation about"),
            (slice(start + 3, start + 6), OPEN_SHARE * distance, "its place along"),
        ):
            for variance, vector in zip(*_eigen(fit.covariance[block, block]), strict=True):
                sigma = float(np.sqrt(variance))
                if sigma > limit:
                    axis = " ".join(f"{component:.2f}" for component in vector.round(2) + 0.0)
                    placed = what.endswith("along")
                    size = f"{two_digits(1e3 * sigma)} mm" if placed else f"{two_digits(float(np.rad2deg(sigma)))} deg"
                    yield f"the {body}, {what} ({axis}) of the {frame}, is known to {size} only"
    if (sigma := float(np.sqrt(fit.covariance[12, 12]))) > OPEN_SCALE:
        yield f"the marker's scale by the robot is known to {100 * sigma:.2g} % only: photograph it from nearer, too"


def _eigen(covariance: Array) -> tuple[Array, Array]:
    """Variances, the largest first, and their directions, each with its largest component positive."""
    variances, vectors = np.linalg.eigh(covariance)
    vectors = vectors.T * np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(3)])[:, None]
    return variances[::-1], vectors[::-1]
