"""Synthetic views of a rig, detected like photos and compared with the truth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.detect import detect
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import exponential, logarithm
from markergen.model.rig import Rig
from markergen.render import Scenery, render_view
from markergen.validation.metrics import flipped
from markergen.validation.print_error import misprinted
from markergen.validation.views import View, ViewSeries, take_views

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RigViews(ViewSeries[Rig]):
    """A series of views of a rig; `errors` move its plates, too, by its `relation_covariance`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.rig.radii.all():
            raise InputError("dots that can be seen", "a dot of diameter 0", "design the markers with dots above 0")

    @property
    def rig(self) -> Rig:
        """Rig in the views."""
        return self.subject

    def take(self, k: int) -> View:
        """See `ViewSeries.take`."""
        camera, pose = self.camera, self.pose_of(k)
        rotation, translation = self.poses.rotation[pose], self.poses.translation[pose]
        noise, misprint, surroundings = self.streams(k)
        made = built(self.rig, self.errors, misprint)
        image = render_view(made, camera, rotation, translation, self.optics, noise, Scenery(self.behind(surroundings)))
        found = detect(image, self.rig, camera, self.errors)
        truth = camera.project(made.xyz, rotation[None], translation[None])[0]
        return View(k, pose, image, found, truth, self.rig.ids)

    def words(self, sample: Mapping[str, Any]) -> tuple[str, str]:
        """See `ViewSeries.words`."""
        where = f"{sample['plates']} plate{'s' * (sample['plates'] != 1)} in view at {sample['distance']:.3g} m"
        if "reason" in sample:
            return where, sample["reason"]
        said = f"rotation off by {sample['rotation_deg']:.3f} deg, translation by {sample['translation_mm']:.3f} mm"
        return where, f"{len(sample['dots'])} dots, {said}"


@dataclass(frozen=True, eq=False)
class RigRecord:
    """Errors of a view, without its image.

    Attributes
    ----------
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
            turn = exponential(step[:3]) @ each.rotation_matrix
            markers[k] = replace(
                each, rotation=tuple(map(tuple, turn)), translation=tuple(each.translation_vector + step[3:])
            )
    return replace(rig, markers=tuple(markers))


def record(series: RigViews, view: View) -> RigRecord:
    """Compare a view with the truth."""
    detection = view.detection
    own = detection.pose
    if view.wrong or own is None:
        none = np.zeros(0)
        return RigRecord(
            view.index, view.pose, False, view.wrong, view.failure, none.astype(np.intp), np.zeros((0, 2)),
            np.full(6, np.nan), np.nan, none.astype(np.intp), none, none, none.astype(bool),
        )  # fmt: skip
    rotation, translation = series.poses.rotation[view.pose], series.poses.translation[view.pose]
    off = np.concatenate([logarithm(own.rotation @ rotation.T), own.translation - translation])
    plates = [(series.rig.constellations[part.marker].plate, part.pose) for part in detection.parts if part.pose]
    alone = [(each.camera_pose(rotation, translation), pose) for each, pose in plates]
    return RigRecord(
        view.index, view.pose, True, False, "", detection.ids, view.error, off,
        float(off @ np.linalg.solve(own.budget.total, off)),
        np.array([series.rig.markers.index(each) for each, _ in plates], dtype=np.intp),
        np.array([float(np.rad2deg(np.linalg.norm(logarithm(pose.rotation @ turn.T)))) for (turn, _), pose in alone]),
        np.array([float(pose.budget.rotation_deg["total"]) for _, pose in alone]),
        np.array([flipped(pose.rotation[None], turn, shift)[0] for (turn, shift), pose in alone], dtype=bool),
    )  # fmt: skip


def take_records(
    series: RigViews, workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> list[RigRecord]:
    """Take all views of a series, distributed over processes; the records do not depend on the number of processes."""
    return take_views(partial(_record, series), series.count, workers, progress)


def _record(series: RigViews, k: int) -> RigRecord:
    return record(series, series.take(k))
