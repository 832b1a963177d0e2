"""Error budget: contributions of image, print and camera calibration to the error of a pose.

To first order, the error of an estimate that weights image points by W is G e, G = (J'WJ)^-1 J'W, with J the pose
Jacobian of the image points and e their errors. The three errors are independent, so their covariances add up:

    C = G (S_image + S_print + S_camera) G'

W is the inverse of S_image + S_print, block by block. Calibration errors and a wrong scale of the print move all points
together; weights of single points cannot compensate for that, so W ignores them, and no number of points averages them
out.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.defaults import PRINT_SIGMA
from markergen.errors import InputError
from markergen.maths.information import covariance, pose_jacobian, rotation_bound, translation_bound
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import skew
from markergen.model.body import Body
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.spec import check_scale

_DOMINANT = 4.0
"""Variance of the scale of points measured together, in that of their other motions, above which it is all of theirs,
and not the points' own."""


@dataclass(frozen=True, eq=False)
class ErrorSources:
    """Error sources other than the image.

    Attributes
    ----------
    print_sigma : float
        Standard deviation in m of a control point's position along each axis of the marker plane; with relief, of its
        height, too.
    camera_covariance : array (k, k) or None
        Covariance of the camera parameters (fx, fy, cx, cy, then distortion coefficients), px^2 and so on; None means
        an exact calibration.
    place_covariance : array (n, 2, 2) or None
        Covariance in m^2 of the positions, along x and y, of n points measured on the print, which replaces
        print_sigma; nan for points that were not measured. See `of`.
    joint_places : array (n, 3, n, 3) or None
        Joint covariance in m^2 of the positions of n points measured together, instead of that; nan for points that
        were not measured. Weights are those of the single points; what their common errors do to the pose is exact.
    scale_sigma : float
        Standard deviation of the print's scale along x, and independently along y, as a fraction: 0.001 is 0.1 %.
        Measured points have none.

    Raises
    ------
    InputError
        If print_sigma is not 0 to 1 m, scale_sigma not 0 to 0.1, or the matrix is no covariance.
    """

    print_sigma: float = PRINT_SIGMA
    camera_covariance: Array | None = None
    place_covariance: Array | None = None
    joint_places: Array | None = None
    scale_sigma: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.print_sigma <= 1:
            raise InputError(
                "a print error of 0 to 1 m", f"print_sigma={self.print_sigma} m", "give a length such as 0.1mm"
            )
        check_scale(self.scale_sigma)
        if self.camera_covariance is not None:
            matrix = np.asarray(self.camera_covariance, dtype=float)
            if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
                raise _no_covariance(f"shape {matrix.shape}" if np.isfinite(matrix).all() else "numbers not finite")
            # Variances differ by orders of magnitude between units, so the correlations are checked.
            scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
            correlation = matrix / scale / scale[:, None]
            if not np.allclose(correlation, correlation.T, atol=1e-6):
                raise _no_covariance("a matrix that is not symmetric")
            if np.linalg.eigvalsh(correlation)[0] < -1e-6 or np.diag(matrix).min() < 0:
                raise _no_covariance("a negative variance along some direction")

    @property
    def exact(self) -> str:
        """What is common to all dots and taken as exact, such as ``scale and calibration``; empty if nothing is."""
        measured = self.place_covariance is not None or self.joint_places is not None
        counted = {"scale": self.scale_sigma > 0 or measured, "calibration": self.camera_covariance is not None}
        return " and ".join(name for name, is_counted in counted.items() if not is_counted)

    def of(self, marker: Marker, chosen: NDArray[np.intp] | slice = slice(None)) -> "ErrorSources":
        """Sources for the chosen control points of a marker, by index, with their measured positions if any."""
        places, joint = marker.place_covariance, marker.joint_places
        return replace(
            self,
            place_covariance=None if places is None else places[chosen],
            joint_places=None if joint is None else joint[chosen][:, :, chosen],
        )

    def place_blocks(self, points: Array, axes: int) -> Array:
        """Covariances (n, axes, axes) in m^2 of the places of points (n, 2 or 3): as measured, else from print_sigma.

        Of points measured together whose scale is known poorly, its error counts no more than any other of their
        motions: it is another distance in every image, for which no weights compensate. Heights are measured only
        together with all other places.
        """
        n = len(points)
        blocks = np.broadcast_to(self.print_sigma**2 * np.eye(axes), (n, axes, axes)).copy()
        measured = np.flatnonzero(self._measured(n))
        if self.place_covariance is not None:
            blocks[measured, :2, :2] = self.place_covariance[measured]
        if self.joint_places is not None and len(measured):
            rows = np.arange(len(measured))
            joint = self.joint_places[measured][:, :, measured]
            diagonal = joint[rows, :, rows].copy()
            grown = np.zeros((len(measured), 3))
            grown[:, : points.shape[1]] = points[measured] - points[measured].mean(axis=0)
            grown /= max(float(np.linalg.norm(grown)), np.finfo(float).tiny)
            along = np.einsum("minj,nj->mi", joint, grown)
            variances, growth = diagonal.diagonal(axis1=1, axis2=2), float(np.sum(along * grown))
            usual = (variances.sum() - growth) / max(np.count_nonzero(variances) - 1, 1)
            if growth > _DOMINANT * usual:
                mixed = along[:, :, None] * grown[:, None]
                diagonal += (growth + usual) * grown[:, :, None] * grown[:, None] - mixed - mixed.swapaxes(1, 2)
            blocks[measured] = diagonal[:, :axes, :axes]
        return blocks

    def whole(self, n: int, axes: int) -> Array:
        """Joint covariance (axes n, axes n) in m^2 of the places of n points, some of them measured together."""
        measured, index = self._measured(n), np.arange(n)
        whole = np.zeros((n, axes, n, axes))
        whole[index, :, index, :] = self.print_sigma**2 * np.eye(axes)
        if self.place_covariance is not None:
            whole[index[measured], :2, index[measured], :2] = self.place_covariance[measured]
        if self.joint_places is not None:
            whole[measured] = 0.0
            whole += np.nan_to_num(self.joint_places[:, :axes, :, :axes])
        return whole.reshape(axes * n, axes * n)

    def _measured(self, n: int) -> NDArray[np.bool_]:
        """Return which of n points were measured."""
        if self.joint_places is not None:
            index = np.arange(n)
            return np.asarray(np.isfinite(self.joint_places[index, 0, index, 0]))
        if self.place_covariance is not None:
            return np.asarray(np.isfinite(self.place_covariance).all(axis=(-2, -1)))
        return np.zeros(n, dtype=bool)

    def scaled(self, points: Array) -> Array:
        """Displacements (n, 2, 2) in m of points (n, 2 or 3) by one sigma of the scale of x (columns: 0) and y (1)."""
        moved: Array = self.scale_sigma * points[:, :2, None] * np.eye(2)
        moved[self._measured(len(points))] = 0.0
        return moved


def _no_covariance(finding: str) -> InputError:
    return InputError(
        "a covariance of the camera's parameters", finding, "give the symmetric matrix that the calibration reports"
    )


@dataclass(frozen=True, eq=False)
class PoseBudget:
    """Covariances (..., 6, 6) of a pose (w, dt), rad and m, by source, and their sum; see `maths.information`."""

    image: Array
    print: Array
    camera: Array
    total: Array

    @property
    def rotation_deg(self) -> dict[str, Array]:
        """RMS rotation error (...) in degrees by source."""
        return self._each(lambda part: np.rad2deg(rotation_bound(part)))

    @property
    def translation(self) -> dict[str, Array]:
        """RMS translation error (...) in m by source."""
        return self._each(lambda part: np.sqrt(np.trace(part[..., 3:, 3:], axis1=-2, axis2=-1)))

    def translation_pct(self, translation: Array) -> dict[str, Array]:
        """RMS translation error (...) in percent of the distance, by source, for true translations (..., 3) in m."""
        return self._each(lambda part: 100 * translation_bound(part, translation))

    def _each(self, measure: Callable[[Array], Array]) -> dict[str, Array]:
        return {field.name: measure(getattr(self, field.name)) for field in fields(self)}


def pose_budget(
    points: Array,
    rotation: Array,
    translation: Array,
    camera: Camera,
    image_covariance: Array,
    sources: ErrorSources,
) -> PoseBudget:
    """Budget of the pose estimate that weights each image point by its inverse covariance from image and print.

    Parameters
    ----------
    points : array (n, 2 or 3), m, marker frame
        For points in the plane z = 0 the print error is in the plane; otherwise it is along z as well.
    rotation, translation : arrays (P, 3, 3) and (P, 3), m
    image_covariance : array broadcastable to (P, n, 2, 2), px^2
        Covariance of the image points, in distorted px.

    Returns
    -------
    PoseBudget
        Covariances (P, 6, 6); not finite where the points do not determine the pose.

    Raises
    ------
    InputError
        If the size of the camera's covariance does not match its parameters.
    """
    normalized = perspective(to_camera(points, rotation, translation))
    count, n = normalized.shape[:2]
    lens = camera.pixel_jacobian(normalized)
    jacobian = lens @ pose_jacobian(points, rotation, translation, np.ones(2)).reshape(count, n, 2, 6)
    printing = print_covariance(jacobian, points, rotation, sources)
    image_covariance = np.broadcast_to(image_covariance, (count, n, 2, 2))
    spread = image_covariance + printing
    gain = _stack(pose_gain(jacobian, spread))
    image, printed = (
        gain.swapaxes(-1, -2) @ _stack(part @ gain.reshape(count, n, 2, 6)) for part in (image_covariance, printing)
    )
    if sources.joint_places is not None:
        printed = together_covariance(gain.reshape(count, n, 2, 6), jacobian, rotation, sources)
    if sources.scale_sigma:
        together = _stack(jacobian[..., 3:] @ rotation[:, None, :, :2] @ sources.scaled(points))
        scaled = gain.swapaxes(-1, -2) @ together
        printed = printed + scaled @ scaled.swapaxes(-1, -2)
    calibration = np.zeros_like(image)
    if sources.camera_covariance is not None:
        moved = _stack(camera.parameter_jacobian(normalized))
        if moved.shape[-1] != len(sources.camera_covariance):
            raise InputError(
                f"a covariance of the camera's {moved.shape[-1]} parameters",
                f"{len(sources.camera_covariance)} rows",
                "give the covariance of fx, fy, cx, cy and of the camera's distortion coefficients, in this order",
            )
        through = gain.swapaxes(-1, -2) @ moved
        calibration = through @ sources.camera_covariance @ through.swapaxes(-1, -2)
    return PoseBudget(image, printed, calibration, image + printed + calibration)


def pose_gain(jacobian: Array, spread: Array) -> Array:
    """G (P, n, 2, 6) of the estimate that weights points by the inverse of their `spread`: the pose errs by sum G' e.

    Parameters
    ----------
    jacobian : array (P, n, 2, 6)
        Jacobian J of the image points with respect to the pose (w, dt).
    spread : array (P, n, 2, 2)
        Covariance of each image point.
    """
    # Without any error all points have the same weight, as in the limit of small isotropic noise.
    weight = np.linalg.inv(spread) if spread.any() else np.broadcast_to(np.eye(2), spread.shape)
    weighted = weight @ jacobian
    return weighted @ covariance(_stack(weighted).swapaxes(-1, -2) @ _stack(jacobian))[:, None]


def print_covariance(jacobian: Array, points: Array, rotation: Array, sources: ErrorSources) -> Array:
    """Covariance of image points due to the print: J R S R' J', S being the covariance of the printed positions.

    S is print_sigma^2 on each axis with a print error, or `sources.place_covariance` along x and y where it is given.

    Parameters
    ----------
    jacobian : array (P, n, 2, 6)
        Jacobian of the image points with respect to the pose (w, dt), in px or normalized.
    points : array (n, 2 or 3), m, marker frame
        For points in the plane z = 0 the print error is in the plane; otherwise it is along z as well.
    rotation : array (P, 3, 3)

    Returns
    -------
    array (P, n, 2, 2), px^2 or normalized
    """
    # A displaced control point moves in the camera frame as if the marker were translated by R times the displacement.
    axes = 3 if points.shape[1] == 3 and points[:, 2].any() else 2
    displaced = jacobian[..., 3:] @ rotation[:, None, :, :axes]
    if sources.place_covariance is None and sources.joint_places is None:
        displaced = sources.print_sigma * displaced
        return displaced @ displaced.swapaxes(-1, -2)
    return displaced @ sources.place_blocks(points, axes) @ displaced.swapaxes(-1, -2)


def together_covariance(gain: Array, jacobian: Array, rotation: Array, sources: ErrorSources) -> Array:
    """Covariance (P, 6, 6) of a pose due to points that were measured together: G' J R S R' J' G.

    Parameters
    ----------
    gain : array (P, n, 2, 6)
        G of the estimate: the pose's error is the sum over the points of G' e.
    jacobian, rotation, sources
        As for `print_covariance`.
    """
    count, n = gain.shape[:2]
    through = gain.swapaxes(-1, -2) @ jacobian[..., 3:] @ rotation[:, None]
    through = through.swapaxes(1, 2).reshape(count, 6, 3 * n)
    return np.asarray(through @ sources.whole(n, 3) @ through.swapaxes(-1, -2), dtype=float)


def spatial_errors(body: Body, dots: Indices, axes: Array, errors: ErrorSources) -> ErrorSources:
    """Sources for dots (m,) of several plates: errors in each plate, and of the plates' relation.

    They are in a frame whose axes in the body's are the columns of `axes` (3, 3), such as a plate's.

    A dot at R x + t in the body, on a plate whose pose is off by (w, dt), is off by w x R x + dt.
    """
    whole, scaled = np.zeros((len(dots), 3, len(dots), 3)), np.zeros((len(dots), 3, 2))
    for k, plate in enumerate(body.plates):
        on_plate = np.flatnonzero(body.owner[dots] == k)
        if not len(on_plate):
            continue
        rows = dots[on_plate] - body.first[k]
        sources, marker = errors.of(plate.marker, rows), plate.marker
        size = 3 if marker.joint_places is not None or np.ptp(marker.xyz[:, 2]) else 2
        rotation = plate.rotation_matrix[:, :size]
        block = sources.whole(len(rows), size).reshape(len(rows), size, len(rows), size)
        whole[on_plate[:, None, None, None], np.arange(3)[:, None, None], on_plate[:, None], np.arange(3)] = np.einsum(
            "ia,manb,jb->minj", rotation, block, rotation
        )
        scaled[on_plate] = plate.rotation_matrix[:, :2] @ sources.scaled(marker.xyz[rows])
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
    places = np.einsum("ai,manb,bj->minj", axes, whole, axes)
    return replace(errors, place_covariance=None, joint_places=places, scale_sigma=0.0)


def _stack(blocks: Array) -> Array:
    """Stack the blocks (P, n, 2, k) of the points into one matrix (P, 2n, k)."""
    return blocks.reshape(blocks.shape[0], -1, blocks.shape[-1])
