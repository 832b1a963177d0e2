"""The network that a calibration adjusts: dots seen in views, and what is known besides."""

# tests: tests/calibration/test_adjustment.py

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from markergen.arrays import Array, Indices, Mask
from markergen.maths.batched import Batched
from markergen.maths.information import apply_pose_step
from markergen.maths.rotation import inverse_pose, pose_product, skew
from markergen.model.camera import Camera, Distortion
from markergen.model.marker import Marker

Pose = tuple[Array, Array]

LEAST_DOTS = 4
"""Minimum number of dots of a view: three determine its pose, and say nothing of dots or camera."""


@dataclass(frozen=True, eq=False)
class Views(Batched):
    """Dots seen in v views: each a photograph of one marker, with its approximate pose.

    Attributes
    ----------
    pixels : array (v, n, 2), px
        Centers of the dots' image ellipses in the image as taken; anything finite where a dot was not seen.
    covariance : array (v, n, 2, 2), px^2
        Covariance of `pixels`, from the image's noise.
    seen : array (v, n) of bool
    rotation, translation : arrays (v, 3, 3) and (v, 3), m
        Approximate poses T_camera_marker.
    camera : array (v,) of int
        Camera of each, among those of the network; the first if not given.
    """

    pixels: Array
    covariance: Array
    seen: Mask
    rotation: Array
    translation: Array
    camera: Indices = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.camera is None:
            object.__setattr__(self, "camera", np.zeros(len(self.seen), dtype=np.intp))

    def of_dots(self, kept: Mask) -> "Views":
        """Return the views of the dots `kept` (n,) alone."""
        return replace(self, pixels=self.pixels[:, kept], covariance=self.covariance[:, kept], seen=self.seen[:, kept])


class JointRows(NamedTuple):
    """Measurements of the poses of v views and of s further unknowns.

    Residuals (v, m), measured minus predicted, and inverse variances; derivatives of what is predicted by (w, dt) of
    the views' poses (v, m, 6) and by the unknowns (v, m, s); their inverse variances (s,) before, and how far off they
    are.
    """

    residual: Array
    weight: Array
    by_pose: Array
    by_joints: Array
    precision: Array
    off: Array

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return float(np.sum(self.weight * self.residual**2) + np.sum(self.precision * self.off**2))


@dataclass(frozen=True, eq=False)
class Joints:
    """What binds the poses of views to each other: k further poses, which are adjusted with them.

    Attributes
    ----------
    rotation, translation : arrays (k, 3, 3) and (k, 3), m
    """

    rotation: Array
    translation: Array
    ADJUSTED: ClassVar[tuple[str, ...]] = ("rotation", "translation")

    @property
    def measured(self) -> int:
        """Number of measurements beside the photographs."""
        return 0

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return 6 * len(self.rotation)

    def stepped(self, step: Array) -> Self:
        """Apply a step (s,) to the unknowns, (w, dt) of each pose in turn: exp([w]x) R and t + dt."""
        rotation, translation = apply_pose_step(self.rotation, self.translation, step.reshape(-1, 6))
        return replace(self, rotation=rotation, translation=translation)

    def bodies(self, views: Views) -> Pose:
        """Poses (p, 3, 3) and (p, 3) that are eliminated: those of the views, unless some hang together."""
        return views.rotation, views.translation

    def composed(self, views: Views, bodies: Pose) -> Views:
        """Views with the poses that follow from those that are eliminated."""
        return replace(views, rotation=bodies[0], translation=bodies[1])

    def rows(self, views: Views) -> JointRows:
        """Measurements beside the photographs."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class RigidPoses(Joints):
    """Plates that move as one body, and cameras that are held together: a view's pose is camera, body and plate's.

    V = L B P, with B the pose of the body in a photograph, or of all cameras' photographs of one moment.

    Attributes
    ----------
    rotation, translation : arrays (k, 3, 3) and (k, 3), m
        Poses P = T_body_plate, then L = T_camera_first.
    photo, plate, camera : arrays (v,) of int
        Body in a photograph that each view shows, and which poses are its plate's and its camera's.
    held : array (k,) of bool
        Poses that frames are defined by: of the first plate, and of the first camera.
    """

    photo: Indices
    plate: Indices
    camera: Indices
    held: Mask

    @property
    def count(self) -> int:
        """See `Joints.count`."""
        return 6 * int((~self.held).sum())

    def at(self, index: Indices) -> Pose:
        """Return some of the poses."""
        return self.rotation[index], self.translation[index]

    def stepped(self, step: Array) -> Self:
        """See `Joints.stepped`."""
        whole = np.zeros((len(self.held), 6))
        whole[~self.held] = step.reshape(-1, 6)
        return super().stepped(whole.ravel())

    def bodies(self, views: Views) -> Pose:
        """Poses of the body in each photograph, by the view of it that shows the most dots."""
        order = np.argsort(views.seen.sum(axis=1), kind="stable")
        best = np.zeros(int(self.photo.max()) + 1, dtype=np.intp)
        best[self.photo[order]] = order
        from_plate = pose_product(
            (views.rotation[best], views.translation[best]), inverse_pose(self.at(self.plate[best]))
        )
        return pose_product(inverse_pose(self.at(self.camera[best])), from_plate)

    def composed(self, views: Views, bodies: Pose) -> Views:
        """See `Joints.composed`."""
        seen = pose_product(self.at(self.camera), (bodies[0][self.photo], bodies[1][self.photo]))
        rotation, translation = pose_product(seen, self.at(self.plate))
        return replace(views, rotation=rotation, translation=translation)

    def derivatives(self, views: Views) -> tuple[Array, Array]:
        """Derivatives of the views' poses by those of the body (v, 6, 6) and of all poses not held (v, 6, s)."""
        v, index = len(views), np.arange(len(views))
        (camera, away), (plate, lever) = self.at(self.camera), self.at(self.plate)
        rotation = views.rotation @ plate.swapaxes(-1, -2)
        by_body, by_poses = np.zeros((v, 6, 6)), np.zeros((v, 6, len(self.held), 6))
        by_body[:, :3, :3] = by_body[:, 3:, 3:] = camera
        by_body[:, 3:, :3] = -skew(np.einsum("vij,vj->vi", rotation, lever)) @ camera
        for part in (slice(3), slice(3, 6)):
            by_poses[index, part, self.plate, part] = rotation
            by_poses[index, part, self.camera, part] = np.eye(3)
        by_poses[index, 3:, self.camera, :3] = -skew(views.translation - away)
        return by_body, by_poses[:, :, ~self.held].reshape(v, 6, -1)


@dataclass(frozen=True)
class Length:
    """A length in m measured with a ruler between the centers of two dots, by their index, and its sigma."""

    first: int
    second: int
    length: float
    sigma: float


def lengths_among(lengths: Sequence[Length], kept: Mask) -> tuple[Length, ...]:
    """Return the lengths between dots `kept` (n,), by their index among these."""
    number = np.cumsum(kept) - 1
    return tuple(
        replace(ruler, first=int(number[ruler.first]), second=int(number[ruler.second]))
        for ruler in lengths
        if kept[ruler.first] and kept[ruler.second]
    )


@dataclass(frozen=True, eq=False)
class CameraFreedom:
    """Parameters of cameras that the photographs may move: c = start + directions u.

    Attributes
    ----------
    directions : array (k, r)
        Columns in the space of the `Camera.parameter_names` of all cameras, in px and the units of the coefficients.
    precision : array (r, r)
        Information about u before the photographs; 0 if nothing is known.
    """

    directions: Array
    precision: Array

    def __len__(self) -> int:
        return self.directions.shape[1]

    @classmethod
    def held(cls, camera: Camera) -> "CameraFreedom":
        """Take the camera as exact."""
        return cls(np.zeros((len(camera.parameter_names), 0)), np.zeros((0, 0)))

    @classmethod
    def joined(cls, freedoms: Sequence["CameraFreedom"]) -> "CameraFreedom":
        """Let several cameras move, each by itself."""
        return cls(*(block_diag(*(getattr(f, name) for f in freedoms)) for name in ("directions", "precision")))

    @property
    def none(self) -> "CameraFreedom":
        """The same cameras held."""
        return CameraFreedom(self.directions[:, :0], self.precision[:0, :0])

    @classmethod
    def of_names(cls, camera: Camera, names: Sequence[str]) -> "CameraFreedom":
        """Free the named parameters, of which nothing is known; fx alone moves fy in proportion."""
        columns = []
        for name in names:
            column = np.array([float(parameter == name) for parameter in camera.parameter_names])
            if name == "fx" and "fy" not in names:
                column[1] = camera.fy / camera.fx
            columns.append(column)
        return cls(np.array(columns).reshape(-1, len(camera.parameter_names)).T, np.zeros((len(columns),) * 2))

    @classmethod
    def of_covariance(cls, covariance: Array) -> "CameraFreedom":
        """Let the parameters move within the covariance (k, k) of an earlier calibration; exact where that is 0."""
        scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        inverse = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
        values, vectors = np.linalg.eigh(covariance * inverse * inverse[:, None])
        kept = values > 1e-12 * max(values[-1], 1e-300)
        directions = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        return cls(directions, np.eye(directions.shape[1]))


def moved_camera(camera: Camera, step: Array) -> Camera:
    """Return the camera with a step (k,) added to its parameters, in the order of `Camera.parameter_names`.

    The focal lengths are bounded below, so that every step gives a camera.
    """
    fx, fy, cx, cy = np.array([camera.fx, camera.fy, camera.cx, camera.cy]) + step[:4]
    model, coefficients = camera.distortion.model, np.array(camera.distortion.coefficients) + step[4:]
    lens = Distortion(model, tuple(coefficients.tolist()))
    return replace(
        camera, fx=max(float(fx), 1e-3), fy=max(float(fy), 1e-3), cx=float(cx), cy=float(cy), distortion=lens
    )


def moved_cameras(cameras: Sequence[Camera], step: Array) -> tuple[Camera, ...]:
    """Return the cameras with a step added to their parameters, of one camera after the other."""
    ends = np.cumsum([len(camera.parameter_names) for camera in cameras])
    return tuple(moved_camera(*pair) for pair in zip(cameras, np.split(step, ends[:-1]), strict=True))


@dataclass(frozen=True, eq=False)
class Network:
    """What is adjusted, and what is known of it.

    Attributes
    ----------
    design : array (n, 3), m
        Designed places of the dots, each marker's in its own marker frame: they define the gauge, and are the start.
    radii : array (n,), m
        Radii of the dots, whose images are ellipses; 0 for points.
    cameras : tuple of Camera
        Cameras, or starts for them.
    freedom : CameraFreedom
        What the photographs may move of them.
    marker : array (n,) of int
        Marker that a dot is on; a view sees dots of one.
    free : bool
        True if the dots may move; False holds them at `design`.
    lengths : tuple of Length
        Measured lengths; without any, the scale of a marker's dots is that of its design.
    prior : array (n, 3, 3), 1/m^2
        Inverse covariance of dots measured before, about `design`; 0 for others. Only their shape counts: the rigid
        motion of the frame they were measured in is unknown.
    loose : (float, float), m, optional
        Standard deviations of printed dots about the design, in the marker plane and in height, as weak knowledge: it
        keeps dots that few photographs show near the design, and tells nothing of what the gauge fixes.
    joints : Joints, optional
        How the poses of views hang together; each view has its own if not given.
    """

    design: Array
    radii: Array
    cameras: tuple[Camera, ...]
    freedom: CameraFreedom
    marker: NDArray[np.intp]
    free: bool = True
    lengths: tuple[Length, ...] = ()
    prior: Array | None = field(default=None)
    loose: tuple[float, float] | None = None
    joints: Joints | None = None

    @classmethod
    def of_markers(cls, markers: Sequence[Marker], camera: Camera, freedom: CameraFreedom, **beside: Any) -> "Network":
        """Return the network of all dots of some markers."""
        points, radii = (np.concatenate([getattr(marker, name) for marker in markers]) for name in ("xyz", "radii"))
        numbers = np.repeat(np.arange(len(markers)), [len(marker) for marker in markers])
        return cls(points, radii, (camera,), freedom, numbers, **beside)

    @property
    def camera(self) -> Camera:
        """The first camera."""
        return self.cameras[0]

    def parameters(self, number: int) -> slice:
        """Return which rows of the freedom's directions are a camera's."""
        first = sum(len(camera.parameter_names) for camera in self.cameras[:number])
        return slice(first, first + len(self.cameras[number].parameter_names))

    def held(self, places: Array, cameras: tuple[Camera, ...]) -> "Network":
        """Return the network of dots and cameras that are exact."""
        exact = replace(self, design=places, cameras=cameras, freedom=self.freedom.none)
        return replace(exact, free=False, lengths=(), prior=None)

    def of_dots(self, kept: Mask) -> "Network":
        """Return the network of the dots `kept` (n,) alone; lengths between others are left out."""
        return replace(
            self,
            design=self.design[kept],
            radii=self.radii[kept],
            marker=self.marker[kept],
            lengths=lengths_among(self.lengths, kept),
            prior=None if self.prior is None else self.prior[kept],
        )

    def scale_known(self, marker: int) -> bool:
        """Return whether measurements on the print fix the scale of a marker's dots."""
        is_on_marker = self.marker == marker
        ruled = any(is_on_marker[ruler.first] for ruler in self.lengths)
        measured = self.prior is not None and (np.trace(self.prior[is_on_marker], axis1=1, axis2=2) > 0).sum() > 1
        return bool(ruled or measured)

    def gauge(self, places: Array) -> Array:
        """Directions (3 n, g) in which dots at `places` (n, 3) move together, unit columns: what no photograph shows.

        Three translations and three rotations of each marker, and its scale unless measurements fix that; markers whose
        views are bound together have one scale.
        """
        columns, growths = list[Array](), list[Array]()
        for number in np.unique(self.marker):
            is_on_marker = self.marker == number
            centered = np.where(is_on_marker[:, None], places - places[is_on_marker].mean(axis=0), 0.0)
            shifts = [np.where(is_on_marker[:, None], axis, 0.0) for axis in np.eye(3)]
            turns = [np.cross(axis, centered) for axis in np.eye(3)]
            columns += [*shifts, *turns]
            growths += [] if self.scale_known(number) else [centered]
        if isinstance(self.joints, RigidPoses):
            growths = [np.sum(growths, axis=0)] if len(columns) == 6 * len(growths) else []
        columns += growths
        matrix = np.array([column.ravel() for column in columns]).T
        return matrix / np.linalg.norm(matrix, axis=0)

    def looseness(self, places: Array) -> Array:
        """Information (3 n, 3 n) about the dots by `loose`, in 1/m^2, less that about their motions."""
        plane, height = self.loose or (np.inf, np.inf)
        weight = np.tile(np.array([plane, plane, height]) ** -2.0, len(places))
        gauge = self.gauge(places)
        through = weight[:, None] * gauge
        return np.asarray(np.diag(weight) - through @ np.linalg.solve(gauge.T @ through, through.T), dtype=float)
