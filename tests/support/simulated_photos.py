"""Simulated sets: a print that is not as designed, in hand-held photographs, as plain points."""

from dataclasses import dataclass

import numpy as np

from markergen.calibration.network import CameraFreedom, Network, Views
from markergen.maths.rotation import exponential, rotation_z
from markergen.model.camera import Camera, Distortion

CAMERA = Camera(640, 480, 800.0, 800.0, 320.0, 240.0, Distortion("radtan", (-0.1, 0.05, 0.0, 0.0, 0.0)))
UNKNOWN = ("fx", "cx", "cy", "k1", "k2")


@dataclass(frozen=True, eq=False)
class Scene:
    """A network with the camera held, views with noise and rough poses, and the truth behind them."""

    network: Network
    views: Views
    places: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray

    def unknown_camera(self, names=UNKNOWN):
        """Return the network with a rough camera to be estimated."""
        start = Camera(640, 480, 780.0, 780.0, 319.5, 239.5, Distortion("radtan", (0.0,) * 5))
        return Network(
            self.network.design, self.network.radii, (start,), CameraFreedom.of_names(start, names), self.network.marker
        )


def layout(n, radius=0.11):
    """Return a polygon with a dot off the middle; from 9 dots on, scattered ones."""
    if n < 9:
        angle = np.arange(n) * 2 * np.pi / n
        return radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-radius, radius, (n, 2)), np.zeros(n)])


def hand_held(m, rng, tilt=(10, 60)):
    """Return m poses within reach of the camera: tilts in degrees, all directions and rolls, 0.4 to 1 m."""
    tilts, direction, roll, angle = np.deg2rad(rng.uniform(*tilt, m)), *rng.uniform(0, 2 * np.pi, (3, m))
    axis = np.column_stack([np.cos(direction), np.sin(direction), 0 * roll])
    rotation = rotation_z(roll) @ exponential(tilts[:, None] * axis) @ np.diag([1.0, -1.0, -1.0]) @ rotation_z(angle)
    depth = rng.uniform(0.4, 1, m)
    aside = rng.uniform(-0.05, 0.05, (m, 2)) * depth[:, None]
    return rotation, np.column_stack([aside, depth])


def scene(n, m, rng, *, sigma=0.03, misprint=1e-4, stretch=0.003, sag=5e-4, radius=0.0, poses=None):
    """Return m photographs of n dots: misprinted, stretched along x, and bulging, with noise of sigma px."""
    design = layout(n)
    places = design + np.column_stack([rng.normal(0, misprint, (n, 2)), np.zeros(n)])
    places[:, 0] += stretch * design[:, 0]
    places[:, 2] += sag * (1 - np.sum(design**2, axis=1) / 0.11**2)
    rotation, translation = hand_held(m, rng) if poses is None else poses
    pixels = CAMERA.project(places, rotation, translation)
    if radius:
        from markergen.maths.conics import outlines

        drawn = outlines(places, np.full(n, radius), rotation, translation)
        pixels = CAMERA.dot_centers(drawn.center, drawn.shape)
    noisy = pixels + rng.normal(0, sigma, pixels.shape)
    seen = CAMERA.sees(noisy)
    spread = np.broadcast_to(sigma**2 * np.eye(2), (m, n, 2, 2))
    rough = exponential(rng.normal(0, 0.02, (m, 3))) @ rotation
    views = Views(noisy, spread, seen, rough, translation * (1 + rng.normal(0, 0.02, translation.shape)))
    network = Network(design, np.full(n, radius), (CAMERA,), CameraFreedom.held(CAMERA), np.zeros(n, dtype=int))
    return Scene(network, views, places, rotation, translation)


def in_gauge(places, network):
    """Move true places (n, 3) as a whole, and scale them unless that is known, so that the gauge of a network holds."""
    gauge, moved = network.gauge(network.design), places.copy()
    for _ in range(6):
        free = network.gauge(moved)
        moved = moved - (free @ np.linalg.solve(gauge.T @ free, gauge.T @ (moved - network.design).ravel())).reshape(
            -1, 3
        )
    return moved


def nees(error, covariance):
    """Return error' C^+ error per degree of freedom, for a covariance that is singular along the gauge."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > values[-1] * 1e-9
    return float(np.mean((vectors.T @ error.ravel())[kept] ** 2 / values[kept]))
