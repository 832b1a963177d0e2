"""``markergen.handeye``: a camera on a robot or beside it, by photographs of a marker and the robot's poses."""

# tests: tests/api/test_handeye.py

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

import numpy as np

from markergen.api.arguments import as_camera, files_among, marker_of
from markergen.arrays import Array
from markergen.calibration.adjustment import UndeterminedError
from markergen.calibration.calibration import Known, adjust_loosely
from markergen.calibration.handeye import ADVICE, LEAST, HandEyeFit, agreeing, hand_eye
from markergen.calibration.network import Pose
from markergen.calibration.photos import find_dots
from markergen.errors import InputError
from markergen.files import Written
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.rig import planned_print
from markergen.options import Progress, as_list, check_progress, settle, signature_of
from markergen.options.handeye import HandeyeKeywords
from markergen.options.kinds import CameraLike, File, Files, MarkerLike
from markergen.presentation.plots import INK, MUTED, SERIES, axes_of, figure_bytes, new_figure
from markergen.presentation.results import SavableResult, json_bytes, plain
from markergen.presentation.tables import Table, number
from markergen.read.cameras import sized
from markergen.read.cameras.covariance import camera_covariance
from markergen.read.images import find_images
from markergen.read.poses.rows import numbers_of
from markergen.read.robot_poses import RobotConvention, robot_poses

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOUNTINGS = ("eye-in-hand", "eye-to-hand")
FRAMES = {"eye-in-hand": ("base", "flange"), "eye-to-hand": ("flange", "base")}
"""Frames of marker and camera by mounting: what each does not move in."""

DIFFERENT = 3.0
"""Sigmas from which the scales of marker and robot differ."""

OPEN_SHARE, OPEN_RAD = 0.05, np.deg2rad(2.0)
"""Standard deviation of a place as a share of the marker's distance, and of a rotation, from which it is open."""

OPEN_SCALE = 0.02
"""Standard deviation of the scale, as a share, from which it is open: prints are good to 0.5 %."""

IMPLAUSIBLE = np.deg2rad(0.3), 2e-3
"""Errors of a robot, rad and m along each axis, from which the camera is doubted: arms for hobbyists reach 1 mm."""

MOST_NAMED = 3
"""Number of photographs that a sentence names; the others are counted."""

UNKNOWNS = ("wx", "wy", "wz", "tx", "ty", "tz")


@dataclass(frozen=True, eq=False)
class HandEye(SavableResult):
    """Camera and marker on a robot.

    Attributes
    ----------
    mounting : str
        eye-in-hand or eye-to-hand.
    camera_pose, marker_pose : (array (3, 3), array (3,)), the robot's m
        X and Z: T_flange_camera and T_base_marker; of an eye-to-hand, T_base_camera and T_flange_marker.
    scale : float
        Length of the marker's meter in the robot's.
    covariance : array (13, 13), rad and m
        Of (w, dt) of X and of Z, R <- exp([w]x) R and t + dt, and of the logarithm of the scale.
    robot_sigma : (float, float), rad and m
        Standard deviations of the robot's rotations and translations along each axis, as the photographs show them.
    camera : Camera
        As given, or as adjusted together with the robot's poses.
    estimated : tuple of str
        Parameters of the camera that were unknown; empty if it was given.
    photos : tuple of str
        Photographs that took part.
    residual, left_out : arrays (k, 6), rad and m
        Measured pose of the flange less the adjusted one, (w, dt) in the base; and less the one predicted without it.
    unused : mapping of str to str
        Photographs that took no part, and why.
    open : tuple of str
        Directions that the poses leave open, as sentences.
    fit : HandEyeFit
        The adjustment.

    Examples
    --------
    See `markergen.handeye`.

    >>> import markergen as mg
    >>> mg.HandEye.KINDS[".json"]
    'json'
    """

    KINDS: ClassVar[Mapping[str, str]] = {".json": "json", ".svg": "plot", ".png": "plot"}

    mounting: str
    camera_pose: Pose
    marker_pose: Pose
    scale: float
    covariance: Array
    robot_sigma: tuple[float, float]
    camera: Camera
    estimated: tuple[str, ...]
    photos: tuple[str, ...]
    residual: Array
    left_out: Array
    unused: Mapping[str, str]
    open: tuple[str, ...]
    fit: HandEyeFit
    written: tuple[Written, ...] = ()

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

    def save(self, *paths: Any, **named: Any) -> list[Written]:
        """Write the results (.json) and the plot (.svg, .png)."""
        return self.write(self.targets(paths, **named).checked())

    def content(self, kind: str, path: Path) -> bytes:
        """See `SavableResult.content`."""
        return figure_bytes(self._figure, path) if kind == "plot" else super().content(kind, path)

    def _figure(self) -> "Figure":
        figure = new_figure()
        self.plot(figure.add_subplot())
        return figure

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
        adjustment = self.fit.adjustment
        sentences = [
            _pose_sentence(X, self.camera_pose, sigma[:6]),
            _pose_sentence(Z, self.marker_pose, sigma[6:12]),
            self._scale_sentence(),
            f"{len(self.photos)} photographs, residuals {adjustment.rms:.3f} px RMS; the robot's poses are off by "
            f"{number(translation, 2)} mm and {number(rotation, 2)} deg along each axis.",
            f"A left-out pose is predicted to {self._left_out()}.",
        ]
        if self.robot_sigma[0] > IMPLAUSIBLE[0] or self.robot_sigma[1] > IMPLAUSIBLE[1]:
            sentences[-1] += (
                " These are more than most robots err: if this one does not, the camera is not as given; leave out "
                "--camera, or give --camera-covariance."
                if not adjustment.network.freedom
                else " These are more than most robots err."
            )
        sentences += [f"Open: {'; '.join(self.open[:2])}{'; and more' * (len(self.open) > 2)}."] if self.open else []
        sentences += [f"Camera, adjusted with the robot: {self.camera}."] if adjustment.network.freedom else []
        if self.unused:
            listed = list(self.unused.items())
            more = f"; and {len(listed) - MOST_NAMED} more" if len(listed) > MOST_NAMED else ""
            named = "; ".join(f"{name}: {reason}" for name, reason in listed[:MOST_NAMED])
            sentences.append(f"Not used: {named}{more}.")
        return list(sentences)

    def _scale_sentence(self) -> str:
        off, sigma = self.scale - 1, self.scale * float(self.sigma[12])
        verdict = "as marker.json has it"
        if abs(off) > DIFFERENT * sigma:
            verdict = f"the print is {100 * abs(off):.2g} % {'larger' if off > 0 else 'smaller'} than in marker.json"
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
        unused = [f"{name}: {reason}." for name, reason in self.unused.items()]
        return [*self.brief(), *(f"{sentence}." for sentence in self.open[2:]), table, *unused[MOST_NAMED:]]

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
    from markergen.maths.rotation import logarithm

    def joined(values: Array, form: str) -> str:
        return " ".join(format(value, form) for value in values)

    turned = np.rad2deg(logarithm(pose[0]))
    return (
        f"{name}: translation {joined(1e3 * pose[1], '.3f')} mm +- {joined(1e3 * sigma[3:], '.2g')}, rotation vector "
        f"{joined(turned, '.3f')} deg +- {joined(np.rad2deg(sigma[:3]), '.2g')}."
    )


def _pose_as_dict(pose: Pose, sigma: Array) -> dict[str, Any]:
    rotation = np.asarray(pose[0])
    quaternion = numbers_of(np.asarray(pose[1])[None], rotation.reshape(1, 9), lambda _: "")[0, 3:]
    return {
        "rotation": rotation.tolist(),
        "translation": list(map(float, pose[1])),
        "quaternion_xyzw": quaternion.tolist(),
        "sigma": {"rotation_deg": np.rad2deg(sigma[:3]).tolist(), "translation": sigma[3:].tolist()},
    }


def handeye(
    marker: MarkerLike,
    photos: Any,
    robot: Any,
    camera: CameraLike | None = None,
    *,
    save: Files = (),
    json: File | None = None,
    progress: Progress | None = None,
    **options: Unpack[HandeyeKeywords],
) -> HandEye:
    """Find where a camera is on a robot, or beside it, by photographs of a marker and the robot's poses in them.

    In the photographs k, T_base_flange,k T_flange_camera T_camera_marker,k = T_base_marker of a camera on the hand, and
    T_base_flange,k T_flange_marker = T_base_camera T_camera_marker,k of one beside the robot. The poses of all
    photographs, the dots, the camera if it is not exact, and the scale between marker and robot are adjusted together;
    see docs/handeye.md.

    Parameters
    ----------
    marker : Marker, path or dict
        As designed, or as measured by `calibrate`.
    photos : path, folder, pattern, image, or several of these
        Photographs of one size; an image is an array (h, w) or (h, w, 3) in BGR.
    robot : path or array (k, 4, 4)
        A table with a column that names the photograph; a folder, or a pattern, of files with a pose beside each; or
        matrices T_base_flange in m of the photographs in order, where nothing else is stated.
    camera : Camera, path, dict or None
        Exact, unless there is a covariance; None: it is estimated, too.
    save : path or list of paths
        Files to write, by suffix: .json for the results, .svg or .png for the plot.
    json : path or None
        File for the results as JSON.
    progress : callable or None
        Called with the stage, the amount done, and the total.
    **options
        As on the command line, ``markergen handeye --help``, with underscores.

    Returns
    -------
    HandEye

    Raises
    ------
    InputError
        If an argument is wrong; direction, unit or rotation of the poses are not stated; fewer than three photographs
        have a pose and show the marker; the robot turned about parallel axes; or photographs have each other's poses.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import markergen as mg
    >>> import numpy as np
    >>> from markergen.maths.rotation import exponential
    >>> from markergen.render import Optics, render_view
    >>> marker = mg.design(n=5, radius="60mm", dot="16mm", restarts=2).marker
    >>> camera = mg.Camera(320, 240, 400, 400, 159.5, 119.5)
    >>> tilts = [[0.5, 0, 0], [-0.5, 0, 0], [0, 0.5, 0], [0, -0.5, 0], [0.4, 0.4, 0.5], [-0.4, 0.4, 1]]
    >>> flange = np.tile(np.eye(4), (6, 1, 1))  # Here the camera's frame is the flange's, the marker's the base.
    >>> flange[:, :3, :3] = np.swapaxes(exponential(np.array(tilts)) @ np.diag([1.0, -1.0, -1.0]), 1, 2)
    >>> flange[:, :3, 3] = -flange[:, :3, 2] * [[0.3], [0.32], [0.34], [0.3], [0.36], [0.38]]
    >>> rng = np.random.default_rng(0)
    >>> views = [(pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]) for pose in flange]
    >>> photos = [render_view(marker, camera, *view, Optics(), rng) for view in views]
    >>> result = mg.handeye(marker, photos, flange, camera)
    >>> bool(np.linalg.norm(result.camera_pose[1]) < 1e-3)
    True
    """
    check_progress(progress)
    settled = settle(options, HandeyeKeywords)
    if settled["mounting"] not in MOUNTINGS:
        raise InputError(f"the mounting {' or '.join(MOUNTINGS)}", repr(settled["mounting"]), "see --help")
    convention = RobotConvention(*(settled[f"robot_{key}"] for key in ("frame", "unit", "rotation", "angle")))
    design, listed = marker_of(marker), list(as_list(photos))
    camera = sized(camera, settled["image_size"], listed)
    taken = as_camera(camera)
    if taken is None and settled["camera_covariance"] is not None:
        raise InputError("a camera that the covariance belongs to", "none", "give it with --camera")
    covariance = None if taken is None else camera_covariance(settled["camera_covariance"], camera, taken)
    targets = HandEye.targets(save, json=json)
    targets.check(
        files_among(marker, camera, robot if isinstance(robot, str | Path) else "", settled["camera_covariance"])
    )
    sources, flange = _posed(photos, robot, convention)
    sigma = planned_print(design) if settled["print_sigma"] is None else settled["print_sigma"]
    prior = Known(taken, covariance, print_sigma=sigma)
    result = _settled_pose(design, sources, flange, prior, settled, progress)
    return replace(result, written=tuple(result.write(targets)))


def _posed(photos: Any, robot: Any, convention: RobotConvention) -> tuple[list[Any], dict[int, Pose]]:
    """Photographs, and T_base_flange of those that have one."""
    sources: list[Any] = [photos] if isinstance(photos, np.ndarray) and photos.ndim < 4 else list(as_list(photos))
    if not (sources and isinstance(sources[0], np.ndarray)):
        sources = list(find_images([*map(str, sources)]))
    if isinstance(robot, str | Path):
        if isinstance(sources[0], np.ndarray):
            raise InputError(
                "matrices of the robot's poses with images as arrays", str(robot), "give paths of photographs"
            )
        return sources, robot_poses(robot, sources, convention)
    try:
        matrices = np.array(robot, dtype=float)
    except (TypeError, ValueError):
        matrices = np.empty(0)
    if matrices.shape != (len(sources), 4, 4):
        raise InputError(
            f"a path, or matrices ({len(sources)}, 4, 4) of T_base_flange, one for each photograph",
            f"{type(robot).__name__} of shape {matrices.shape}",
            "give one matrix for each photograph, in their order",
        )
    return sources, {k: (pose[:3, :3], pose[:3, 3]) for k, pose in enumerate(matrices)}


def _settled_pose(
    marker: Marker,
    sources: Sequence[Any],
    flange: Mapping[int, Pose],
    prior: Known,
    settled: Mapping[str, Any],
    progress: Progress | None,
) -> HandEye:
    names = [f"photo {k}" if isinstance(source, np.ndarray) else str(source) for k, source in enumerate(sources)]
    posed, on_hand = sorted(flange), settled["mounting"] == MOUNTINGS[0]
    unused = {names[k]: "it has no robot pose" for k in range(len(sources)) if k not in flange}
    if len(posed) < LEAST:
        raise InputError(f"{LEAST} photographs or more with a robot pose", str(len(posed)), ADVICE)
    sightings, camera = find_dots(
        [marker], [sources[k] for k in posed], prior.camera,
        camera_covariance=prior.covariance, progress=progress, workers=settled["workers"],
    )  # fmt: skip
    unused |= {names[posed[k]]: reason.rstrip(".") for k, reason in sightings.unused.items()}
    if len(sightings.views) < LEAST:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in list(unused.items())[:MOST_NAMED])
        raise InputError(
            f"{LEAST} photographs or more that show the marker", str(len(sightings.views)), reasons or ADVICE
        )
    try:
        cleaned, sightings, estimated = adjust_loosely(marker, sightings, camera, prior)
    except (UndeterminedError, np.linalg.LinAlgError):
        raise InputError(
            "photographs that determine dots and camera", "others", f"give --camera, or {ADVICE}"
        ) from None
    numbers = [posed[k] for k in sightings.photo[cleaned.used]]
    unused |= {
        names[posed[k]]: "too few dots that agree with the other photographs" for k in sightings.photo[~cleaned.used]
    }
    adjustment, poses = cleaned.adjustment, tuple(np.array([flange[k][part] for k in numbers]) for part in range(2))
    robot, kept = agreeing(
        adjustment.views, (poses[0], poses[1]), [names[k] for k in numbers], on_hand, settled["one_axis"]
    )
    unused |= {
        names[numbers[k]]: "its robot pose disagrees with the others"
        for k in set(range(len(numbers))) - set(kept.tolist())
    }
    adjustment = replace(
        adjustment,
        views=adjustment.views.take(kept),
        weights=adjustment.weights[kept],
        residual=adjustment.residual[kept],
    )
    fit = hand_eye(adjustment, robot)
    # F is the marker, and C the camera, of a camera on the hand.
    order = np.r_[6:12, 0:6, 12] if on_hand else np.arange(13)
    carried, fixed = ((fit.robot.rotation[k], fit.robot.translation[k]) for k in (1, 0))
    X, Z = (carried, fixed) if on_hand else (fixed, carried)
    return HandEye(
        settled["mounting"],
        X,
        Z,
        float(np.exp(fit.robot.log_scale[0])),
        fit.covariance[np.ix_(order, order)],
        fit.robot.sigma,
        fit.adjustment.camera,
        estimated,
        tuple(names[numbers[k]] for k in kept),
        fit.robot.rows(fit.adjustment.views).residual,
        fit.left_out,
        {name: unused[name] for name in names if name in unused},
        tuple(_open_directions(fit, on_hand)),
        fit,
    )


def _open_directions(fit: HandEyeFit, on_hand: bool) -> Iterator[str]:
    """Directions in which the poses leave camera or marker open, as sentences."""
    distance = float(np.median(np.linalg.norm(fit.adjustment.views.translation, axis=1)))
    bodies = ("marker", "camera") if on_hand else ("camera", "marker")
    for start, body, frame in ((0, bodies[0], "base"), (6, bodies[1], "flange")):
        for block, limit, what in (
            (slice(start, start + 3), OPEN_RAD, "its rotation about"),
            (slice(start + 3, start + 6), OPEN_SHARE * distance, "its place along"),
        ):
            for variance, vector in zip(*_eigen(fit.covariance[block, block]), strict=True):
                sigma = float(np.sqrt(variance))
                if sigma > limit:
                    axis = " ".join(f"{component:.2f}" for component in vector.round(2) + 0.0)
                    size = f"{1e3 * sigma:.2g} mm" if what.endswith("along") else f"{np.rad2deg(sigma):.2g} deg"
                    yield f"the {body}, {what} ({axis}) of the {frame}, is known to {size} only"
    if (sigma := float(np.sqrt(fit.covariance[12, 12]))) > OPEN_SCALE:
        yield f"the marker's scale by the robot is known to {100 * sigma:.2g} % only: photograph it from nearer, too"


def _eigen(covariance: Array) -> tuple[Array, Array]:
    """Variances, the largest first, and their directions, each with its largest component positive."""
    variances, vectors = np.linalg.eigh(covariance)
    vectors = vectors.T * np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(3)])[:, None]
    return variances[::-1], vectors[::-1]


handeye.__signature__ = signature_of(handeye, HandeyeKeywords)  # type: ignore[attr-defined]
