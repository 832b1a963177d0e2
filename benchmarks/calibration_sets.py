"""Simulated photographs for a calibration, from plain points: a print with errors, hand-held poses, image noise."""

from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment, adjust
from markergen.calibration.network import CameraFreedom, Network, Views, moved_camera
from markergen.calibration.working_error import sensitivity
from markergen.maths.rotation import exponential, logarithm, rotation_z
from markergen.model.camera import Camera, Distortion

CAMERA = Camera(640, 480, 800.0, 800.0, 320.0, 240.0, Distortion("radtan", (-0.1, 0.05, 0.0, 0.0, 0.0)))
BASE = ("fx", "fy", "cx", "cy", "k1", "k2")
"""Parameters of an unknown camera."""

RADIUS = 0.11
"""Radius in m that the dots lie within."""

_TRIES = 200


@dataclass(frozen=True, eq=False)
class SimulatedSet:
    """A set of photographs and the truth.

    Attributes
    ----------
    design, true : arrays (n, 3), m
        Dots as designed and as printed.
    camera : Camera
    views : Views
        Measured centers, and approximate poses.
    rotation, translation : arrays (v, 3, 3) and (v, 3), m
        True poses.
    """

    design: Array
    true: Array
    camera: Camera
    views: Views
    rotation: Array
    translation: Array

    def network(self, freedom: CameraFreedom | None = None, camera: Camera | None = None) -> Network:
        """Network of free dots, with the true camera held unless given."""
        camera = camera or self.camera
        n = len(self.design)
        return Network(
            self.design, np.zeros(n), (camera,), freedom or CameraFreedom.held(camera), np.zeros(n, dtype=np.intp)
        )

    def unknown_camera(self) -> Network:
        """Network whose camera is unknown: `BASE` free, from a focal length 3 % off, without distortion."""
        focal = 0.97 * self.camera.fx
        start = replace(self.camera, fx=focal, fy=focal, distortion=Distortion("radtan", (0.0,) * 5))
        return self.network(CameraFreedom.of_names(start, BASE), start)


def layout(n: int, radius: float = RADIUS) -> Array:
    """Dots (n, 3) in m: a regular polygon for n up to 8, else scattered on the disk, always the same."""
    if n <= 8:
        angle = 2 * np.pi * np.arange(n) / n
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(n)], axis=-1)
    rng = np.random.default_rng(n)
    angle, distance = rng.uniform(0, 2 * np.pi, n), radius * np.sqrt(rng.uniform(0, 1, n))
    return np.stack([distance * np.cos(angle), distance * np.sin(angle), np.zeros(n)], axis=-1)


def printed(
    design: Array, rng: np.random.Generator, sigma: float = 1e-4, stretch: float = 0.003, sag: float = 5e-4
) -> Array:
    """Dots (n, 3) in m as printed: errors of `sigma` m in the plane, x stretched, the middle higher."""
    true = design * [1 + stretch, 1.0, 1.0]
    true[:, :2] += rng.normal(0, sigma, (len(design), 2))
    true[:, 2] += sag * (1 - (design**2).sum(axis=1) / RADIUS**2)
    return true


def hand_held(
    photos: int,
    rng: np.random.Generator,
    design: Array,
    camera: Camera = CAMERA,
    tilt: tuple[float, float] = (10.0, 60.0),
    distance: tuple[float, float] = (0.4, 1.0),
) -> tuple[Array, Array]:
    """Poses (v, 3, 3) and (v, 3) of hand-held photographs: tilts in deg to all sides, all rolls, dots in view."""
    rotations, translations = [], []
    for _ in range(photos):
        for _ in range(_TRIES):
            angle, azimuth = np.deg2rad(rng.uniform(*tilt)), rng.uniform(0, 2 * np.pi)
            lean = exponential(angle * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
            rotation = lean @ np.diag([1.0, -1.0, -1.0]) @ rotation_z(rng.uniform(0, 2 * np.pi))
            depth = rng.uniform(*distance)
            aside = rng.uniform(-0.3, 0.3, 2) * [camera.width / camera.fx, camera.height / camera.fy]
            translation = depth * np.array([*aside, 1.0])
            pixels = camera.project(design, rotation[None], translation[None])[0]
            if ((pixels >= 5) & (pixels <= [camera.width - 6, camera.height - 6])).all():
                break
        rotations.append(rotation)
        translations.append(translation)
    return np.array(rotations), np.array(translations)


def bends(photos: int, rng: np.random.Generator, design: Array, amplitude: float) -> Array:
    """Heights (v, n) in m that differ between photographs: a cylinder about a random axis, RMS at the rim."""
    angle = rng.uniform(0, np.pi, (photos, 1))
    across = design[:, 0] * np.cos(angle) + design[:, 1] * np.sin(angle)
    return np.asarray(rng.normal(0, amplitude, (photos, 1)) * across**2 / RADIUS**2, dtype=float)


def photographed(
    design: Array,
    true: Array,
    rotation: Array,
    translation: Array,
    rng: np.random.Generator,
    sigma: float = 0.03,
    camera: Camera = CAMERA,
    bent: Array | float = 0.0,
) -> SimulatedSet:
    """Photographs of dots at `true` from given poses, with noise of `sigma` px and approximate poses."""
    item = np.repeat(true[None], len(rotation), axis=0)
    item[..., 2] += bent
    place = item @ rotation.swapaxes(-1, -2) + translation[:, None]
    pixels = camera.to_pixels(place[..., :2] / place[..., 2:])
    pixels = pixels + rng.normal(0, sigma, pixels.shape)
    v, n = pixels.shape[:2]
    views = Views(
        pixels,
        np.broadcast_to(sigma**2 * np.eye(2), (v, n, 2, 2)),
        np.ones((v, n), dtype=bool),
        exponential(rng.normal(0, 0.01, (v, 3))) @ rotation,
        translation * (1 + rng.normal(0, 0.01, (v, 3))),
    )
    return SimulatedSet(design, true, camera, views, rotation, translation)


def simulate(
    n: int, photos: int, rng: np.random.Generator, sigma: float = 0.03, flex: float = 0.0, camera: Camera = CAMERA
) -> SimulatedSet:
    """Hand-held photographs of a print of `layout(n)`, bent by `flex` m (RMS, at the rim) in each."""
    design = layout(n)
    true = printed(design, rng)
    rotation, translation = hand_held(photos, rng, design, camera)
    return photographed(
        design, true, rotation, translation, rng, sigma, camera, bends(photos, rng, design, flex) if flex else 0.0
    )


def in_gauge(network: Network, places: Array, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
    """Bring true dots and poses of one marker into the gauge of a network, by a similarity: the images stay.

    Returns
    -------
    places, rotation, translation : arrays (n, 3), (v, 3, 3) and (v, 3)
    """
    gauge = network.gauge(network.design)
    scaled = gauge.shape[1] == 7
    for _ in range(10):
        middle = places.mean(axis=0)
        centered = places - middle
        columns = [np.broadcast_to(axis, places.shape) for axis in np.eye(3)]
        columns += [np.cross(axis, centered) for axis in np.eye(3)] + ([centered] if scaled else [])
        matrix = np.array([column.ravel() for column in columns]).T
        off = gauge.T @ (network.design - places).ravel()
        step = np.linalg.solve(gauge.T @ matrix, off)
        R, factor = exponential(step[3:6]), 1 + step[6] if scaled else 1.0
        # X' = s T (X - m) + m + d, so R X + t = (R T') X'/s + ..., and the camera sees s times all of it.
        moved = factor * centered @ R.T + middle + step[:3]
        rotation = rotation @ R.T
        translation = factor * translation + factor * (rotation @ R @ middle) - rotation @ (middle + step[:3])
        places = moved
    return places, rotation, translation


def nees(error: Array, covariance: Array, rank: int) -> float:
    """Normalized squared error per degree of freedom, over the `rank` largest eigenvalues of the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    along = vectors[:, -rank:].T @ error
    return float((along**2 / values[-rank:]).mean())


def wrong_camera(rng: np.random.Generator, sigma: Array, camera: Camera = CAMERA) -> tuple[Camera, CameraFreedom]:
    """Camera of an earlier calibration, off by its own `sigma` (k,), and the freedom that this leaves it."""
    return moved_camera(camera, rng.normal(0, 1, len(sigma)) * sigma), CameraFreedom.of_covariance(np.diag(sigma**2))


def claims(
    made: SimulatedSet, result: Adjustment, rng: np.random.Generator, sigma: float = 0.03
) -> tuple[float, float]:
    """NEES per degree of freedom of the measured dots, and of the pose of a fresh view that is fitted with them.

    The covariance of the pose is that of its image noise, and of dots and camera together (see `working_error`).
    """
    network, n = result.network, len(made.design)
    rotation, translation = hand_held(1, rng, made.design, made.camera)
    places, rotations, translations = in_gauge(network, made.true, rotation, translation)
    gauge = network.gauge(network.design).shape[1]
    dots = nees((result.places - places).ravel(), result.covariance, 3 * n - gauge)
    fresh = photographed(made.design, made.true, rotation, translation, rng, sigma, made.camera)
    held = replace(
        network, design=result.places, cameras=result.cameras, freedom=CameraFreedom.held(result.camera), free=False
    )
    start = replace(fresh.views, rotation=rotations, translation=translations)
    pose = adjust(held, start).views
    output = sensitivity(result.places, result.camera, pose.rotation, pose.translation, sigma, np.zeros((n, 3, 3)))
    spread = output.image[0] + output.transfer[0] @ result.joint @ output.transfer[0].T
    rotated = logarithm(pose.rotation[0] @ rotations[0].T)
    off = np.concatenate([rotated, pose.translation[0] - translations[0]])
    scale = np.sqrt(np.diag(spread))
    return dots, nees(off / scale, spread / scale / scale[:, None], 6)
