"""``view``: poses that have the marker anywhere in the camera's view, over all six degrees of freedom."""
# tests: tests/model/test_view_poses.py

from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import exponential
from markergen.model.camera import Camera
from markergen.model.pose_sources.cone import Cone, even_points
from markergen.model.poses import POSES, SEEN, PoseDistribution, PoseSource, pose_arguments, visibility

FORM = "view:distance=A..B,tilt=A..B,azimuth=A..B,roll=A..B,margin=M%,count=N,seed=S"
KEYS = ("distance", "tilt", "azimuth", "roll", "margin", "count", "seed")
MOST_TRIED = 64
"""Points of the sequence that are tried for each pose: where one in 64 has the marker in view, most of the range of
distances does not serve, and fewer poses are made."""


@dataclass(frozen=True)
class ViewCone:
    """Poses with the marker anywhere in the camera's view.

    Distance, tilt, azimuth and roll are those of a `Cone` about the line of sight to the marker's origin, whose pixel
    is uniform over the image. Of one sequence of low discrepancy in six dimensions those points are taken from which
    the whole marker is seen, `margin` from the image's border.

    Attributes
    ----------
    cone : Cone
        Ranges, count and seed.
    margin : float
        Width around the image that stays free, as a share of its shorter side, 0 to below 0.5.

    Examples
    --------
    >>> str(ViewCone.parse("view:distance=0.5..1.5m,tilt=0..60,margin=5%"))
    'view:distance=0.5..1.5,tilt=0..60,azimuth=0..360,roll=0..360,margin=5%,count=400,seed=0'
    """

    cone: Cone
    margin: float = 0.05

    @staticmethod
    def parse(text: str) -> "ViewCone":
        """View of a text in the form above; raises InputError as `Cone` does, or for a margin beyond its range."""
        arguments = pose_arguments(text, KEYS, FORM)
        written = arguments.pop("margin", "5%")
        try:
            margin = float(written.removesuffix("%")) / 100 if written.endswith("%") else np.nan
        except ValueError:
            margin = np.nan
        if not 0 <= margin < 0.5:
            raise InputError("a margin from 0% to below 50%", f"margin={brief(written)}", "write such as margin=5%")
        return ViewCone(Cone.parse(f"cone:{','.join(f'{key}={value}' for key, value in arguments.items())}"), margin)

    def __str__(self) -> str:
        """Text that `parse` reads back, the same for equal views."""
        values = dict(item.split("=") for item in str(self.cone).partition(":")[2].split(","))
        values["margin"] = f"{100 * self.margin:.10g}%"
        return f"view:{','.join(f'{key}={values[key]}' for key in KEYS)}"

    def placed(self, camera: Camera, points: Array | None) -> tuple[Array, Array]:
        """See `Placing.placed`; fewer poses than the count if hardly any point of the sequence serves."""
        size = np.array([camera.width, camera.height], dtype=float)
        free = self.margin * size.min()
        start = np.random.default_rng(self.cone.seed).random(6)
        kept: list[tuple[Array, Array]] = []
        count = 0
        for batch in range(MOST_TRIED):
            index = np.arange(float(batch * self.cone.count), float((batch + 1) * self.cone.count))
            cube = even_points(index, start)
            rotation, translation = self.cone.at(cube[:, :4])
            ray = camera.from_pixels(free - 0.5 + cube[:, 4:] * (size - 2 * free))
            reached = np.isfinite(ray).all(axis=-1)
            to_ray = _rotation_to(ray[reached])
            rotation, translation = to_ray @ rotation[reached], (to_ray @ translation[reached, :, None])[..., 0]
            seen = slice(None) if points is None else self._sees(points, rotation, translation, camera, free)
            kept.append((rotation[seen], translation[seen]))
            count += len(kept[-1][0])
            if count >= self.cone.count:
                break
        if not count:
            return rotation, translation
        rotations, translations = (np.concatenate(parts)[: self.cone.count] for parts in zip(*kept, strict=True))
        return rotations, translations

    def at_distance(self, distance: float) -> PoseDistribution:
        """See `Placing.at_distance`."""
        return _poses_of(replace(self, cone=replace(self.cone, distance=(distance, distance))))

    def _sees(self, points: Array, rotation: Array, translation: Array, camera: Camera, free: float) -> Array:
        seen = visibility(points, rotation, translation, camera) == SEEN
        size = np.array([camera.width, camera.height])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            pixels = camera.to_pixels(perspective(to_camera(points, rotation, translation)))
            inside = (pixels >= free - 0.5) & (pixels <= size - 0.5 - free)
        return np.asarray(seen & inside.all(axis=(-2, -1)))


def _rotation_to(ray: Array) -> Array:
    """Rotations (P, 3, 3) that turn the optical axis, by the shortest way, to rays (P, 2) of normalized coordinates."""
    length = np.linalg.norm(ray, axis=-1)
    # From the axis z to (x, y, 1) about (-y, x, 0), by the angle whose tangent is the length.
    per_length = np.arctan(length) / np.maximum(length, np.finfo(float).tiny)
    axis = np.stack([-ray[:, 1], ray[:, 0], np.zeros(len(ray))], axis=-1)
    return exponential(per_length[:, None] * axis)


def _poses_of(view: ViewCone) -> PoseDistribution:
    return PoseDistribution(str(view), *view.cone.sample(), placing=view)


POSES.register("view")(PoseSource(lambda text: _poses_of(ViewCone.parse(text)), FORM))
