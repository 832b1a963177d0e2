"""Adjustment of a network: Levenberg-Marquardt on dots, poses and camera at once, with their joint covariance.

The weighted squares of the distances between measured and predicted ellipse centers are minimized,

    cost = sum_ij r_ij' W_ij r_ij + prior terms,    r_ij = z_ij - center_ij(R_j, t_j, X_i, camera),

with the exact center of what is fitted to a disk's image (`maths.conics`). Poses are eliminated view by view (Schur
complement), so the system to be solved has 3 n + r unknowns, for n dots and r parameters of the camera. What no
photograph tells, the marker frame and without a measured length the scale, is fixed by inner constraints: the dots, all
together, neither translate nor rotate nor grow with respect to the design, C'(X - X0) = 0. With the normal matrix N, an
orthonormal basis G of the columns of C, and P = I - G G', the covariance under the constraints is, for any s > 0,

    Q = (P N P + s G G')^-1 - G G' / s

(B. Triggs et al., "Bundle adjustment: a modern synthesis", 1999). Where markers are plates of a body, or photographs
are of several cameras held together, the unknowns are the poses of bodies, which are eliminated, and after the cameras'
those of plates and cameras but the first: with L the derivative of the views' poses by these, N becomes L'N L.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from markergen.arrays import Array, Mask
from markergen.calibration.network import JointRows, Joints, Network, RigidPoses, Views, moved_cameras
from markergen.errors import InputError
from markergen.maths.conics import outlines, pose_rows
from markergen.maths.information import apply_pose_step
from markergen.maths.levenberg_marquardt import Arrays, Attempt, Damping, LeastSquares, levenberg_marquardt
from markergen.model.camera import Camera

DAMPING = Damping(start=1e-3, least=1e-12, most=1e12, slack=1e-12)
STEPS = 100
"""Maximum number of steps of an adjustment."""

TOLERANCE = 1e-12
"""Relative decrease of the cost below which the adjustment ends, unless another is given."""

SINGULAR = 1e-13
"""Smallest eigenvalue of a normal matrix, as correlations, that is not taken for rounding."""


class UndeterminedError(np.linalg.LinAlgError):
    """The photographs leave more than the gauge open, or no more measurements than unknowns."""


@dataclass(frozen=True, eq=False)
class Adjustment:
    """An adjusted network.

    Attributes
    ----------
    network : Network
        What was adjusted.
    views : Views
        With the adjusted poses.
    places : array (n, 3), m
        Adjusted dots.
    cameras : tuple of Camera
        Adjusted cameras.
    weights : array (v, n)
        Factors on the weights of the measurements; 0 where a dot was not seen.
    residual : array (v, n, 2), px
        Measured minus predicted ellipse centers; 0 where a dot was not seen.
    chi2 : float
        Cost at the minimum, with the weights of the image alone.
    degrees_of_freedom : int
        Measurements less unknowns: the expected value of chi2 if the covariances are right.
    joints : Joints or None
        With the adjusted poses that views share.
    """

    network: Network
    views: Views
    places: Array
    cameras: tuple[Camera, ...]
    weights: Array
    residual: Array
    chi2: float
    degrees_of_freedom: int
    joints: Joints | None = None

    @property
    def camera(self) -> Camera:
        """The first camera."""
        return self.cameras[0]

    def led_by(self, number: int) -> "Adjustment":
        """Return the same with a camera as the first, and those after it, up to the one before it."""
        count, network = len(self.cameras), self.network
        order = [(number + k) % count for k in range(count)]
        rows = np.concatenate([network.freedom.directions[network.parameters(k)] for k in order])
        return replace(
            self,
            network=replace(
                network,
                cameras=tuple(network.cameras[k] for k in order),
                freedom=replace(network.freedom, directions=rows),
            ),
            views=replace(self.views, camera=(self.views.camera - number) % count),
            cameras=tuple(self.cameras[k] for k in order),
        )

    def of_camera(self, number: int) -> "Adjustment":
        """Return the views of one camera."""
        led, rows = self.led_by(number), self.views.camera == number
        return replace(led, views=led.views.take(rows), weights=led.weights[rows], residual=led.residual[rows])

    @property
    def variance_factor(self) -> float:
        """chi2 over its expected value: factor by which the covariances of the image are too small."""
        return self.chi2 / self.degrees_of_freedom if self.degrees_of_freedom > 0 else float("inf")

    @property
    def scale(self) -> float:
        """Factor, 1 or more, on all covariances."""
        return max(1.0, self.variance_factor)

    @property
    def image_variance(self) -> float:
        """Median variance of a dot's center in the image along each axis, px^2."""
        spread = np.trace(self.views.covariance, axis1=2, axis2=3)[self.weights > 0]
        return float(np.median(spread)) / 2

    @property
    def rms(self) -> float:
        """RMS over all measurements that took part of the length of the residual, px."""
        return float(np.sqrt((self.residual[self.weights > 0] ** 2).sum(axis=-1).mean()))

    @cached_property
    def normal(self) -> "NormalEquations":
        """Normal equations at the minimum."""
        information = np.linalg.inv(self.views.covariance) * self.weights[..., None, None]
        return normal_equations(self.network, self.views, self.places, self.cameras, information, joints=self.joints)

    @cached_property
    def unscaled(self) -> Array:
        """Covariance (q, q) of dots (m), camera parameters u and plates, if the image's covariances are right.

        Raises
        ------
        UndeterminedError
            If the photographs do not determine the unknowns.
        """
        if self.degrees_of_freedom < 0:
            # Rounding may make a singular matrix appear to be a regular one.
            raise UndeterminedError("photographs that determine every unknown")
        reduced, size = self.normal.reduced(), self.normal.dots
        weight = float(np.trace(reduced[:size, :size])) / size if size else 1.0
        gauge = np.zeros((len(reduced), 0))
        if size:
            columns = np.linalg.qr(self.network.gauge(self.network.design))[0]
            gauge = np.pad(columns, ((0, len(reduced) - size), (0, 0)))
        # P N P + s G G' in one, so that few products are as large as N.
        through = reduced @ gauge
        through -= gauge @ (gauge.T @ through + weight * np.eye(gauge.shape[1])) / 2
        inverse = _inverse(reduced - gauge @ through.T - through @ gauge.T) - gauge @ gauge.T / weight
        return np.asarray((inverse + inverse.T) / 2)

    @property
    def is_determined(self) -> bool:
        """Whether the photographs determine all unknowns."""
        try:
            return bool(self.unscaled.size)
        except np.linalg.LinAlgError:
            return False

    @property
    def covariance(self) -> Array:
        """Covariance (3 n, 3 n) of the dots, m^2, x y z of each in turn, scaled; singular along the gauge."""
        size = self.normal.dots
        return self.scale * self.unscaled[:size, :size]

    @property
    def camera_covariance(self) -> Array:
        """Covariance (k, k) of the `Camera.parameter_names` of all cameras, scaled."""
        return self.joint[self.normal.dots :, self.normal.dots :]

    @property
    def joint(self) -> Array:
        """Covariance (3 n + k, 3 n + k) of the dots and of all cameras' parameters together, scaled."""
        size, directions = self.normal.dots, self.network.freedom.directions
        lift = block_diag(np.eye(size), directions)
        unknowns = lift.shape[1]
        return np.asarray(self.scale * lift @ self.unscaled[:unknowns, :unknowns] @ lift.T)

    @property
    def rigid_covariance(self) -> Array:
        """Covariance (6 k, 6 k) of the poses of `RigidPoses`, scaled; 0 for those held."""
        assert isinstance(self.joints, RigidPoses)
        first, free = self.normal.dots + len(self.network.freedom), np.repeat(~self.joints.held, 6)
        whole = np.zeros((len(free),) * 2)
        whole[np.ix_(free, free)] = self.scale * self.unscaled[first:, first:]
        return whole

    @cached_property
    def pose_covariances(self) -> tuple[Array, Array]:
        """Covariances, unscaled, of the poses that are eliminated (v, 6, 6), and of them with the others (v, 6, q)."""
        inverse = np.linalg.inv(self.normal.pose)
        through = inverse @ self.normal.cross
        mixed = -through @ self.unscaled
        return inverse - mixed @ through.swapaxes(-1, -2), mixed

    def residual_covariance(self) -> Array:
        """Covariance (v, n, 2, 2) of the residuals, px^2, unscaled.

        S - J C J' for a measurement that took part, less than its own; S + J C J' for one of weight 0; in between,
        S + (1 - 2 w) J C J'.
        """
        parts, unscaled = self.normal, self.unscaled
        # Blocks of the covariance of a view's pose (6), a dot (3) and the camera (r).
        poses, mixed = self.pose_covariances
        v, n = self.views.seen.shape
        size, r = parts.dots, parts.rest.shape[0] - parts.dots
        predicted = parts.rows_pose @ poses[:, None] @ parts.rows_pose.swapaxes(-1, -2)
        cameras = np.broadcast_to(unscaled[size:, size:], (v, n, r, r))
        rows = parts.rows_camera
        cross = np.broadcast_to(mixed[:, None, :, size:], (v, n, 6, r))
        if size:
            index = np.arange(n)
            dots = unscaled[:size, :size].reshape(n, 3, n, 3)[index, :, index, :]
            aside = unscaled[:size, size:].reshape(n, 3, r)
            block = np.block([[dots, aside], [aside.swapaxes(-1, -2), cameras[0]]])
            cameras = np.broadcast_to(block, (v, *block.shape))
            rows = np.concatenate([parts.rows_dot, parts.rows_camera], axis=-1)
            cross = np.concatenate([mixed[..., :size].reshape(v, 6, n, 3).swapaxes(1, 2), cross], axis=-1)
        predicted = predicted + rows @ cameras @ rows.swapaxes(-1, -2)
        both = parts.rows_pose @ cross @ rows.swapaxes(-1, -2)
        predicted = predicted + both + both.swapaxes(-1, -2)
        sign = (1 - 2 * self.weights)[..., None, None]
        return np.where(self.views.seen[..., None, None], self.views.covariance + sign * predicted, np.eye(2))


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal matrix of a network in blocks, with its gradient, and what its rows are.

    Blocks are of the poses (v, 6, 6) of the views or, where they are bound, of the bodies, of these with the q = 3 n +
    r other unknowns (v, 6, q), to which those of `Joints` are added, and of the others (q, q). `dots` is 3 n, or 0 if
    they are held; rows (v, n, 2, ...) are by pose, dot and cameras' u.
    """

    pose: Array
    cross: Array
    rest: Array
    dots: int
    rows_pose: Array
    rows_dot: Array
    rows_camera: Array
    gradient_pose: Array
    gradient_rest: Array

    def reduced(self) -> Array:
        """Matrix (q, q) that remains when the poses are eliminated."""
        root = np.linalg.inv(np.linalg.cholesky(self.pose)) @ self.cross
        flat = root.reshape(6 * len(root), -1)
        return self.rest - flat.T @ flat

    def with_rows(self, rows: JointRows) -> "NormalEquations":
        """Normal equations with measurements of the poses of views and of further unknowns."""
        lowered = rows.by_pose.swapaxes(-1, -2) * rows.weight[:, None]
        heavy = rows.by_joints.swapaxes(-1, -2) * rows.weight[:, None]
        residual = rows.residual[..., None]
        return replace(
            self,
            pose=self.pose + lowered @ rows.by_pose,
            cross=np.concatenate([self.cross, lowered @ rows.by_joints], axis=-1),
            rest=block_diag(self.rest, (heavy @ rows.by_joints).sum(axis=0) + np.diag(rows.precision)),
            gradient_pose=self.gradient_pose + (lowered @ residual)[..., 0],
            gradient_rest=np.r_[self.gradient_rest, (heavy @ residual).sum(axis=0)[:, 0] - rows.precision * rows.off],
        )

    def of_bodies(self, views: Views, rigid: RigidPoses) -> "NormalEquations":
        """Normal equations of the poses of bodies and of `RigidPoses` in the place of those of the views: L'N L."""
        by_body, by_poses = rigid.derivatives(views)
        lowered, gradient = by_body.swapaxes(-1, -2), self.gradient_pose[..., None]
        cross = np.concatenate([self.cross, self.pose @ by_poses], axis=-1)
        bound = np.einsum("via,vib->ab", by_poses, cross)
        beside = bound[:, : len(self.rest)]

        def by_photo(rows: Array) -> Array:
            total = np.zeros((int(rigid.photo.max()) + 1, *rows.shape[1:]))
            np.add.at(total, rigid.photo, rows)
            return total

        return replace(
            self,
            pose=by_photo(lowered @ self.pose @ by_body),
            cross=by_photo(lowered @ cross),
            rest=np.vstack([np.hstack([self.rest, beside.T]), bound]),
            gradient_pose=by_photo(lowered @ gradient)[..., 0],
            gradient_rest=np.r_[self.gradient_rest, np.einsum("via,vi->a", by_poses, self.gradient_pose)],
        )


def adjust(
    network: Network,
    views: Views,
    weights: Array | None = None,
    places: Array | None = None,
    tolerance: float = TOLERANCE,
) -> Adjustment:
    """Adjust a network by least squares.

    Parameters
    ----------
    weights : array (v, n), optional
        Factors on the weights of the measurements, 1 if not given; 0 leaves one out.
    places : array (n, 3), optional, m
        Start for the dots; the design if not given, and where they are held.
    tolerance : float
        Relative decrease of the cost below which the adjustment ends.

    Raises
    ------
    UndeterminedError
        If there is no view, or one has fewer than three dots.
    """
    factors: Array = views.seen * (np.ones(views.seen.shape) if weights is None else weights)
    if not len(views) or ((factors > 0).sum(axis=1) < 3).any():
        raise UndeterminedError("three dots or more in every view")
    # In 1/m^2, of the order of what the photographs tell of a dot. The minimum does not depend on it.
    information = np.linalg.inv(views.covariance) * factors[..., None, None]
    stiffness = (
        float(np.trace(information, axis1=2, axis2=3).sum() / len(network.design))
        * (network.camera.fx / float(views.translation[:, 2].mean())) ** 2
    )
    problem, joints = _Adjusting(network, views, information, stiffness, tolerance), network.joints
    start = (
        *((views.rotation, views.translation) if joints is None else joints.bodies(views)),
        network.design if places is None or not network.free else places.copy(),
        np.zeros(len(network.freedom)),
        *(() if joints is None else (getattr(joints, name) for name in joints.ADJUSTED)),
    )
    unknowns, cost = levenberg_marquardt(problem, tuple(block[None] for block in start), DAMPING, STEPS)
    adjusted, places, moved, joints = problem.state(unknowns)
    cameras = moved_cameras(network.cameras, network.freedom.directions @ moved)
    residual = residuals(network.radii, adjusted, places, cameras)[0]
    if not np.isfinite(cost[0]):
        raise UndeterminedError("poses that have all dots in front of the camera")
    if network.free and network.loose is not None:
        # So weak that the image's residuals have the degrees of freedom that they have without it.
        off = (network.design - places).ravel()
        cost = cost - off @ network.looseness(places) @ off
    freedom = _freedom(network, int(np.count_nonzero(factors)), len(unknowns[0][0]))
    return Adjustment(network, adjusted, places, cameras, factors, residual, float(cost[0]), freedom, joints)


def attempt(network: Network, views: Views, *arguments: Any, **options: Any) -> Adjustment | None:
    """Adjust as `adjust` does; None if the views do not determine the network."""
    try:
        return adjust(network, views, *arguments, **options)
    except (np.linalg.LinAlgError, InputError):
        return None


def _freedom(network: Network, measured: int, poses: int) -> int:
    """Measurements less unknowns; what is known before counts as measurements."""
    measurements_before = int(np.linalg.matrix_rank(network.freedom.precision)) if len(network.freedom) else 0
    unknown = 6 * poses + len(network.freedom)
    if network.joints is not None:
        unknown += network.joints.count
        measurements_before += network.joints.measured
    if network.free:
        unknown += 3 * len(network.design) - network.gauge(network.design).shape[1]
        measurements_before += len(network.lengths)
        if network.prior is not None:
            measurements_before += sum(
                int(np.linalg.matrix_rank(_without_motion(network, network.design, marker)))
                for marker in np.unique(network.marker)
            )
    return 2 * measured + measurements_before - unknown


@dataclass(frozen=True, eq=False)
class _Adjusting(LeastSquares):
    """One network as a batch of one.

    The unknowns are rotations and translations of views, or of the body in each photograph; dots; the camera's u; and
    where markers are plates of a body, rotations and translations of these.
    """

    network: Network
    views: Views
    information: Array
    stiffness: float
    tolerance: float

    def state(self, unknowns: Arrays) -> tuple[Views, Array, Array, Joints | None]:
        """Return the views with their poses, the dots' places, u, and what binds the poses."""
        rotation, translation, places, moved, *bound = (block[0] for block in unknowns)
        if self.network.joints is None:
            return replace(self.views, rotation=rotation, translation=translation), places, moved, None
        joints = replace(self.network.joints, **dict(zip(self.network.joints.ADJUSTED, bound, strict=True)))
        return joints.composed(self.views, (rotation, translation)), places, moved, joints

    def residuals(self, unknowns: Arrays) -> Arrays:
        """See `LeastSquares.residuals`."""
        views, places, moved, joints = self.state(unknowns)
        cameras = moved_cameras(self.network.cameras, self.network.freedom.directions @ moved)
        residual, front = residuals(self.network.radii, views, places, cameras)
        cost = float(np.einsum("vni,vnij,vnj->", residual, self.information, residual))
        cost += float(moved @ self.network.freedom.precision @ moved) + dots_prior(self.network, places)[0]
        cost += 0.0 if joints is None or isinstance(joints, RigidPoses) else joints.rows(views).cost
        if self.network.free:
            cost += self.stiffness * float(np.sum((self.gauge.T @ (places - self.network.design).ravel()) ** 2))
        return np.array([cost if front and cost < np.inf else np.inf]), residual[None]

    @cached_property
    def gauge(self) -> Array:
        """See `Network.gauge`."""
        return self.network.gauge(self.network.design)

    def jacobian(self, unknowns: Arrays, evaluated: Arrays) -> Any:
        """See `LeastSquares.jacobian`: here the normal equations in blocks."""
        views, places, moved, joints = self.state(unknowns)
        cameras = moved_cameras(self.network.cameras, self.network.freedom.directions @ moved)
        parts = normal_equations(self.network, views, places, cameras, self.information, evaluated[1][0], joints)
        size, after = parts.dots, parts.dots + len(moved)
        parts.gradient_rest[size:after] -= self.network.freedom.precision @ moved
        if size:
            off = self.gauge.T @ (self.network.design - places).ravel()
            parts.gradient_rest[:size] += self.stiffness * self.gauge @ off
        return parts

    def damped_step(self, jacobian: Any, residual: Array, strength: Array, ridge: float) -> Array:
        """See `LeastSquares.damped_step`, by Schur's complement."""
        del residual, ridge
        parts: NormalEquations = jacobian
        damping, size = 1 + float(strength[0]), parts.dots
        pose, rest = parts.pose.copy(), parts.rest.copy()
        diagonal = np.einsum("vii->vi", pose)
        diagonal *= damping
        np.einsum("ii->i", rest)[:] *= damping
        root = np.linalg.inv(np.linalg.cholesky(pose))
        cross = root @ parts.cross
        gradient = np.einsum("vab,vb->va", root, parts.gradient_pose)
        flat = cross.reshape(6 * len(cross), -1)
        reduced, right = rest - flat.T @ flat, parts.gradient_rest - flat.T @ gradient.ravel()
        step = np.zeros(len(rest))
        if len(rest):
            if size:
                reduced[:size, :size] += self.stiffness * self.gauge @ self.gauge.T
            step = np.linalg.solve(reduced, right)
        poses = np.einsum("vba,vb->va", root, gradient - cross @ step)
        return np.concatenate([poses.ravel(), step])[None]

    def moved(self, unknowns: Arrays, step: Array) -> Arrays:
        """See `LeastSquares.moved`."""
        rotation, translation, places, moved, *bound = (block[0] for block in unknowns)
        poses, size, camera = 6 * len(rotation), places.size if self.network.free else 0, len(moved)
        of_poses, of_dots, of_camera, of_joints = np.split(step[0], np.cumsum([poses, size, camera]))
        rotation, translation = apply_pose_step(rotation, translation, of_poses.reshape(-1, 6))
        if size:
            places = places + of_dots.reshape(-1, 3)
        if self.network.joints is not None:
            names = self.network.joints.ADJUSTED
            joints = replace(self.network.joints, **dict(zip(names, bound, strict=True))).stepped(of_joints)
            bound = [getattr(joints, name) for name in names]
        return tuple(block[None] for block in (rotation, translation, places, moved + of_camera, *bound))

    def converged(self, attempt: Attempt) -> Mask:
        """See `LeastSquares.converged`; from a start that sees nothing there is no way."""
        if not np.isfinite(attempt.before).all():
            return ~np.isfinite(attempt.after)
        return attempt.good & (attempt.before - attempt.after <= self.tolerance * attempt.before)

    def take(self, chosen: Mask) -> "_Adjusting":
        """See `LeastSquares.take`: the batch is of one."""
        del chosen
        return self


def residuals(radii: Array, views: Views, places: Array, cameras: Sequence[Camera]) -> tuple[Array, bool]:
    """Residuals (v, n, 2) in px, 0 where not seen; and whether every seen dot is in front of the camera."""
    drawn = outlines(places, radii, views.rotation, views.translation)
    bent = np.zeros(views.pixels.shape)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        for number, camera in enumerate(cameras):
            rows = views.camera == number
            center, shape = drawn.center[rows], drawn.shape[rows]
            bent[rows] = camera.dot_centers(center, shape) if radii.any() else camera.to_pixels(center)
        residual = views.pixels - bent
    bad = views.seen & ~(drawn.front & np.isfinite(residual).all(axis=-1))
    return np.where(views.seen[..., None], residual, 0.0), not bad.any()


def normal_equations(
    network: Network,
    views: Views,
    places: Array,
    cameras: Sequence[Camera],
    information: Array,
    residual: Array | None = None,
    joints: Joints | None = None,
) -> NormalEquations:
    """Normal equations of views at their poses, with the gradient if residuals (v, n, 2) in px are given.

    Each dot of a view has information (v, n, 2, 2) in 1/px^2, 0 where it is left out.
    Poses change by (w, dt): R <- exp([w]x) R, t <- t + dt.
    """
    center = outlines(places, network.radii, views.rotation, views.translation).center
    center = np.where(views.seen[..., None], center, 0.0)
    lens, moved = np.zeros((*center.shape, 2)), np.zeros((*center.shape, len(network.freedom)))
    for number, camera in enumerate(cameras):
        of_camera = views.camera == number
        lens[of_camera] = camera.pixel_jacobian(center[of_camera])
        directions = network.freedom.directions[network.parameters(number)]
        moved[of_camera] = camera.parameter_jacobian(center[of_camera]) @ directions
    rows = lens @ pose_rows(places, views.rotation, views.translation)
    rows = np.where(views.seen[..., None, None], rows, 0.0)
    dots = rows[..., 3:] @ views.rotation[:, None] if network.free else rows[..., :0]
    moved = np.where(views.seen[..., None, None], moved, 0.0)
    v, n = views.seen.shape
    size, r = 3 * n if network.free else 0, len(network.freedom)
    weighted, heavy, heavy_dots = (information @ part for part in (rows, moved, dots))
    # All measurements of a view at once, and of all views: a product of matrices for each dot takes twice as long.
    of_view, of_all = weighted.reshape(v, 2 * n, 6).swapaxes(-1, -2), heavy.reshape(2 * v * n, r).T
    pose = of_view @ rows.reshape(v, 2 * n, 6)
    cross, rest = np.zeros((v, 6, size + r)), np.zeros((size + r, size + r))
    cross[..., size:] = of_view @ moved.reshape(v, 2 * n, r)
    rest[size:, size:] = of_all @ moved.reshape(2 * v * n, r) + network.freedom.precision
    gradient_pose, gradient_rest = np.zeros((v, 6)), np.zeros(size + r)
    if residual is not None:
        gradient_pose = (of_view @ residual.reshape(v, -1, 1))[..., 0]
        gradient_rest[size:] = of_all @ residual.ravel()
    if size:
        cross[..., :size] = (weighted.swapaxes(-1, -2) @ dots).transpose(0, 2, 1, 3).reshape(v, 6, size)
        # Of each dot, all views at once.
        of_dot, by_dot = (part.transpose(1, 3, 0, 2).reshape(n, 3, 2 * v) for part in (heavy_dots, dots))
        index = np.arange(n)
        rest[:size, :size].reshape(n, 3, n, 3)[index, :, index, :] = of_dot @ by_dot.swapaxes(-1, -2)
        rest[:size, size:] = (of_dot @ moved.swapaxes(0, 1).reshape(n, 2 * v, r)).reshape(size, r)
        rest[size:, :size] = rest[:size, size:].T
        _, gradient, matrix = dots_prior(network, places)
        rest[:size, :size] += matrix
        if residual is not None:
            gradient_rest[:size] = (of_dot @ residual.swapaxes(0, 1).reshape(n, -1, 1)).ravel() + gradient
    parts = NormalEquations(pose, cross, rest, size, rows, dots, moved, gradient_pose, gradient_rest)
    if isinstance(joints, RigidPoses):
        return parts.of_bodies(views, joints)
    return parts if joints is None else parts.with_rows(joints.rows(views))


def dots_prior(network: Network, places: Array) -> tuple[float, Array | float, Array | float]:
    """Cost of what is known of the dots besides the photographs, minus half its gradient (3 n,), and its matrix."""
    if not network.free or (not network.lengths and network.prior is None and network.loose is None):
        return 0.0, 0.0, 0.0
    off = (network.design - places).ravel()
    cost, gradient, matrix = 0.0, np.zeros(places.size), np.zeros((places.size,) * 2)
    for ruler in network.lengths:
        apart = places[ruler.first] - places[ruler.second]
        length = float(np.linalg.norm(apart))
        row = np.zeros(places.shape)
        row[ruler.first], row[ruler.second] = apart / length, -apart / length
        short, weight = ruler.length - length, ruler.sigma**-2
        cost += weight * short**2
        gradient += weight * short * row.ravel()
        matrix += weight * np.outer(row, row)
    informations = [] if network.loose is None else [network.looseness(places)]
    if network.prior is not None:
        informations += [_without_motion(network, places, marker) for marker in np.unique(network.marker)]
    for information in informations:
        cost += float(off @ information @ off)
        gradient += information @ off
        matrix += information
    return cost, gradient, matrix


def _without_motion(network: Network, places: Array, marker: int) -> Array:
    """Information (3 n, 3 n) of the measured dots of one marker about their shape: rigid motions are unknown."""
    assert network.prior is not None
    is_on_marker = network.marker == marker
    n = len(places)
    information = np.zeros((n, 3, n, 3))
    index = np.flatnonzero(is_on_marker)
    information[index, :, index, :] = network.prior[index]
    whole = information.reshape(3 * n, 3 * n)
    if not whole.any():
        return whole
    centered = places - places[is_on_marker].mean(axis=0)
    motion = [
        *(np.broadcast_to(axis, places.shape) for axis in np.eye(3)),
        *(np.cross(axis, centered) for axis in np.eye(3)),
    ]
    columns = np.array([(column * is_on_marker[:, None]).ravel() for column in motion]).T
    through = whole @ columns
    return np.asarray(whole - through @ np.linalg.pinv(columns.T @ through, hermitian=True) @ through.T, dtype=float)


def _inverse(matrix: Array) -> Array:
    """Inverse of a symmetric positive definite matrix.

    Raises
    ------
    UndeterminedError
        If an eigenvalue of it, as correlations, is that of rounding.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / scale / scale[:, None])
    if len(values) and values[0] <= SINGULAR * values[-1]:
        raise UndeterminedError("photographs that determine every unknown")
    return np.asarray((vectors / values) @ vectors.T / scale / scale[:, None], dtype=float)
