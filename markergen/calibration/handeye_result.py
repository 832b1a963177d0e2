"""What photographs of a marker and a robot's poses tell: where the camera is, in words, numbers and a plot."""

# tests: tests/api/test_handeye.py

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from markergen.arrays import Array
from markergen.calibration.adjustment import UndeterminedError
from markergen.calibration.calibration import Known, adjust_loosely
from markergen.calibration.handeye import ADVICE, LEAST, HandEyeFit, agreeing, hand_eye
from markergen.calibration.network import Pose
from markergen.calibration.photos import find_dots
from markergen.calibration.sentences import MOST_NAMED, TOO_FEW, named_unused
from markergen.detect.presentation import transform_as_dict
from markergen.errors import InputError
from markergen.files import Written
from markergen.maths.rotation import logarithm
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.options import Progress
from markergen.presentation.plots import INK, MUTED, SERIES, axes_of
from markergen.presentation.results import SavableResult, json_bytes, plain
from markergen.presentation.tables import Table, number
from markergen.units import two_digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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

UNKNOWNS = ("wx", "wy", "wz", "tx", "ty", "tz")


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
        ax.set_xlim(left=0)
        ax.set_ylim(bottom=0)
        ax.set_xlabel("rotation from the left-out pose, deg")
        ax.set_ylabel("translation from the left-out pose, mm")
        ax.legend(loc="lower right")
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
        turned, moved = (
            "at most " if np.sqrt(np.mean(left**2)) < np.sqrt(3) * estimate else ""
            for left, estimate in zip(self._lengths(self.left_out), (rotation, translation), strict=True)
        )
        adjustment = self.fit.adjustment
        sentences = [
            _pose_sentence(X, self.camera_pose, sigma[:6]),
            _pose_sentence(Z, self.marker_pose, sigma[6:12]),
            self._scale_sentence(),
            f"{len(self.photos)} photographs, residuals {adjustment.rms:.3f} px RMS; the robot's poses are off by "
            f"{moved}{number(translation, 2)} mm and {turned}{number(rotation, 2)} deg along each axis.",
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
            "unknowns": [*(f"{name} {w}" for name in (X, Z) for w in UNKNOWNS), "log scale"],
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
    place, turned = (np.round(values, 3) + 0.0 for values in (1e3 * pose[1], np.rad2deg(logarithm(pose[0]))))
    return (
        f"{name}: translation {joined(place, '.3f')} mm +- {joined(1e3 * sigma[3:], '.2g')}, rotation vector "
        f"{joined(turned, '.3f')} deg +- {joined(np.rad2deg(sigma[:3]), '.2g')}."
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
    shown, adjustment = [names[k] for k in numbers], cleaned.adjustment
    rotation, translation = (np.array([flange[k][part] for k in numbers]) for part in range(2))
    robot, kept = agreeing(adjustment.views, (rotation, translation), shown, on_hand, one_axis)
    photos = tuple(shown[k] for k in kept)
    unused |= dict.fromkeys(set(shown) - set(photos), "its robot pose disagrees with the others")
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
