"""Synthetic views of a rig, detected like photos and compared with the truth."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.detect import Detection, detect
from markergen.detect.bodies import Body, body_of
from markergen.detect.pose import PoseEstimate
from markergen.detect.presentation import overlay
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import exponential, logarithm
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.pool import map_counted, ranges, workers_for
from markergen.render import DEFAULT_OPTICS, Optics, Scenery, render_rig
from markergen.render.scenery import BACKGROUNDS
from markergen.validation.metrics import flipped
from markergen.validation.print_error import misprinted
from markergen.validation.view_records import AT_ONCE, WORTH_A_WORKER
from markergen.validation.views import FAILURES, MOST_VIEWS, TYPICAL, WORST, WRONG_PX, Picture, spread

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RigViews:
    """Parameters of a series of synthetic views of a rig; equal ones give the same images at any time.

    Attributes
    ----------
    rig : Rig
    camera : Camera
    poses : PoseDistribution
        T_camera_rig.
    count, seed, optics, background
        As for `SyntheticViews`.
    errors : ErrorSources
        `print_sigma` displaces every dot in its plate; the rig's `relation_covariance` its plates.

    Raises
    ------
    InputError
        If a number is out of range, the background is unknown, or a dot has no size.
    """

    rig: Rig
    camera: Camera
    poses: PoseDistribution
    count: int = 20
    seed: int = 0
    optics: Optics = DEFAULT_OPTICS
    background: str = "plain"
    errors: ErrorSources = field(default_factory=lambda: ErrorSources(print_sigma=0.0))

    def __post_init__(self) -> None:
        if not 0 <= self.count <= MOST_VIEWS:
            raise InputError(f"0 to {MOST_VIEWS} views", f"views={self.count}", "give a whole number such as 20")
        if self.seed < 0:
            raise InputError("a seed of 0 or more", f"seed={self.seed}", "give a non-negative whole number")
        if not self.rig.radii.all():
            raise InputError("dots that can be seen", "a dot of diameter 0", "design the markers with dots above 0")
        if self.background != "plain":
            _ = BACKGROUNDS[self.background]

    @cached_property
    def body(self) -> Body:
        """The rig as it is detected."""
        return body_of(self.rig)

    def pose_of(self, k: int) -> int:
        """Return the index into the pose distribution for view k."""
        jitter = np.random.default_rng([self.seed, self.count, k, 3]).random()
        return int((k + jitter) * len(self.poses) / self.count)


@dataclass(frozen=True, eq=False)
class RigView:
    """One synthetic image, the detection in it, and the images (n, 2) in px of the dots' centers as printed."""

    index: int
    pose: int
    image: NDArray[np.uint8] | NDArray[np.uint16]
    detection: Detection
    truth: Array

    @property
    def error(self) -> Array:
        """Errors (m, 2) in px of the detected control points; empty if there are none."""
        return self.detection.pixels - self.truth[self.detection.ids]


@dataclass(frozen=True, eq=False)
class RigRecord:
    """Errors of a view, without its image.

    Attributes
    ----------
    index, pose : int
    detected, wrong : bool
    failure : str
    dots : array (m,) of int
        Numbers of the control points found.
    error : array (m, 2), px
    pose_error : array (6,)
        log(R_hat R'), rad, and t_hat - t, m, of T_camera_rig in the camera frame; nan if it was not found.
    nees : float
        Normalized estimation error squared.
    plates : array (k,) of int
        Markers that were found by themselves.
    plate_deg : array (k,)
        Rotation errors of their own poses, degrees.
    plate_sigma_deg : array (k,)
        Standard deviations that the detection claims for these, RMS over the directions.
    plate_flipped : array (k,) of bool
        True where such a pose is nearer to the mirrored pose than to the true one.
    """

    index: int
    pose: int
    detected: bool
    wrong: bool
    failure: str
    dots: Indices
    error: Array
    pose_error: Array
    nees: float
    plates: Indices
    plate_deg: Array
    plate_sigma_deg: Array
    plate_flipped: NDArray[np.bool_]

    @property
    def rotation_deg(self) -> float:
        """Rotation error."""
        return float(np.rad2deg(np.linalg.norm(self.pose_error[:3])))

    @property
    def translation_mm(self) -> float:
        """Translation error."""
        return float(1e3 * np.linalg.norm(self.pose_error[3:]))

    @property
    def best_alone(self) -> int | None:
        """Position of the plate whose own pose claims the least error; None if none was found by itself."""
        return int(self.plate_sigma_deg.argmin()) if len(self.plates) else None


def built(rig: Rig, errors: ErrorSources, rng: np.random.Generator) -> Rig:
    """Return the rig as printed and assembled: its dots displaced, and its plates by the covariance of the relation."""
    markers = [replace(each, marker=misprinted(each.marker, errors, rng)) for each in rig.markers]
    relation = rig.relation_covariance
    if relation is not None:
        values, vectors = np.linalg.eigh(relation)
        steps = (vectors * np.sqrt(np.maximum(values, 0))) @ rng.standard_normal(len(values))
        for k, (each, step) in enumerate(zip(markers, steps.reshape(-1, 6), strict=True)):
            turn = exponential(step[:3]) @ each.turn
            markers[k] = replace(each, rotation=tuple(map(tuple, turn)), translation=tuple(each.shift + step[3:]))
    return replace(rig, markers=tuple(markers))


def take_view(series: RigViews, k: int) -> RigView:
    """Render and detect view k (0 to count - 1) of a series."""
    camera, pose = series.camera, series.pose_of(k)
    rotation, translation = series.poses.rotation[pose], series.poses.translation[pose]
    # Each source has its own random stream, so that switching off the print error changes nothing else.
    noise, misprint, surroundings = (np.random.default_rng([series.seed, series.count, k, part]) for part in range(3))
    made = built(series.rig, series.errors, misprint)
    scenery = Scenery(None if series.background == "plain" else BACKGROUNDS[series.background](camera, surroundings))
    image = render_rig(made, camera, rotation, translation, series.optics, noise, scenery)
    found = detect(image, series.rig, camera, series.errors)
    return RigView(k, pose, image, found, camera.project(made.xyz, rotation[None], translation[None])[0])


def record(series: RigViews, view: RigView) -> RigRecord:
    """Compare a view with the truth."""
    error, detection = view.error, view.detection
    wrong = bool(np.any(np.linalg.norm(error, axis=-1) > WRONG_PX))
    failure = f"wrong label: a dot is {np.linalg.norm(error, axis=-1).max():.1f} px off" if wrong else detection.reason
    own = detection.pose
    if wrong or own is None:
        none = np.zeros(0)
        return RigRecord(
            view.index, view.pose, False, wrong, failure, none.astype(np.intp), np.zeros((0, 2)), np.full(6, np.nan),
            np.nan, none.astype(np.intp), none, none, none.astype(bool),
        )  # fmt: skip
    rotation, translation = series.poses.rotation[view.pose], series.poses.translation[view.pose]
    off = np.concatenate([logarithm(own.rotation @ rotation.T), own.translation - translation])
    plates = [(series.body.parts[part.marker].plate.placed, part.pose) for part in detection.parts if part.pose]
    alone = [(each.camera_pose(rotation, translation), pose) for each, pose in plates]
    return RigRecord(
        view.index, view.pose, True, False, "", detection.ids, error, off,
        float(off @ np.linalg.solve(own.budget.total, off)),
        np.array([series.rig.markers.index(each) for each, _ in plates], dtype=np.intp),
        np.array([_turned_deg(pose, turn) for (turn, _), pose in alone]),
        np.array([float(pose.budget.rotation_deg["total"]) for _, pose in alone]),
        np.array([flipped(pose.rotation[None], turn, shift)[0] for (turn, shift), pose in alone], dtype=bool),
    )  # fmt: skip


def take_records(
    series: RigViews, workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> list[RigRecord]:
    """Take all views of a series, distributed over processes; the records do not depend on the number of processes."""
    workers = workers_for(workers, 1 + series.count // WORTH_A_WORKER)
    parts = map_counted(partial(_chunk, series), ranges(series.count, AT_ONCE), workers, progress)
    return [each for part in parts for each in part]


def pictures(series: RigViews, views: Mapping[str, Any]) -> Iterator[Picture]:
    """Render views worth a closer look, with the detection drawn in: failures, the worst, and typical ones."""
    for each in spread(views["failures"], FAILURES):
        yield _picture(series, each, "failure", each["reason"])
    ranked = sorted(views["samples"], key=lambda each: -each["rotation_deg"])
    for kind, chosen in (("worst", ranked[:WORST]), ("typical", spread(ranked[WORST:], TYPICAL))):
        for each in chosen:
            said = f"rotation off by {each['rotation_deg']:.3f} deg, translation by {each['translation_mm']:.3f} mm"
            yield _picture(series, each, kind, f"{len(each['dots'])} dots, {said}")


def _chunk(series: RigViews, indices: Iterable[int]) -> list[RigRecord]:
    return [record(series, take_view(series, k)) for k in indices]


def _turned_deg(pose: PoseEstimate, rotation: Array) -> float:
    return float(np.rad2deg(np.linalg.norm(logarithm(pose.rotation @ rotation.T))))


def _picture(series: RigViews, each: Mapping[str, Any], kind: str, said: str) -> Picture:
    view = take_view(series, each["view"])
    where = f"{each['plates']} plate{'s' * (each['plates'] != 1)} in view at {each['distance']:.3g} m"
    marks = [view.detection] if view.detection.found else []
    return Picture(
        f"{kind}-{each['view']:04d}", f"{kind.capitalize()}: {where}", f"View {each['view']}, {where}: {said}.",
        overlay(view.image, series.rig, series.camera, marks),
    )  # fmt: skip
