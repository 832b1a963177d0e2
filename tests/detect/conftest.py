from dataclasses import dataclass

import numpy as np
import pytest
from plain_blobs import plain_blobs

from markergen.detect import kernel
from markergen.detect.blobs import Blobs
from markergen.maths.conics import outlines
from markergen.detect.pose_hypotheses import layout_of
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper_roll

IRREGULAR = [(0.12, 0.03), (-0.1, 0.07), (0.02, -0.11), (-0.05, -0.02), (0.05, 0.1), (-0.11, -0.05)]
ROLLED = paper_roll()


def build(points, rings=(0,), diameter=0.036, heights=None):
    features = [key_ring(diameter) if i in rings else Feature(diameter) for i in range(len(points))]
    heights = np.zeros(len(points)) if heights is None else heights
    return Marker(
        # Identifiers that are not positions in the list, so that one cannot stand for the other.
        tuple(
            ControlPoint(10 + i, float(x), float(y), float(z), f)
            for i, ((x, y), z, f) in enumerate(zip(points, heights, features, strict=True))
        ),
        Circle(0.15),
        0.0036,
    )


def regular(n, **options):
    angle = np.pi / 2 + 2 * np.pi * np.arange(n) / n
    return build(0.1284 * np.stack([np.cos(angle), np.sin(angle)], axis=-1), **options)


@dataclass(frozen=True)
class Sight:
    """Blobs as a detector would give them, what they are (position of the dot, -1 for a stranger), and the truth."""

    blobs: Blobs
    dot: np.ndarray
    pixels: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


def look(marker, pose, camera=PAPER_CAMERA, hidden=(), strangers=0, noise=0.02, semi_noise=0.1, seed=0, poses=ROLLED):
    """Blobs of a marker and of strangers, a tenth of them rings, in random order, with noise in px."""
    rng = np.random.default_rng([seed, pose])
    layout = layout_of(marker)
    rotation, translation = poses.rotation[[pose]], poses.translation[[pose]]
    drawn = outlines(layout.points, layout.radii, rotation, translation)
    values, vectors = np.linalg.eigh(drawn.shape[0] * np.outer(camera.focal, camera.focal))
    kept = np.setdiff1d(np.arange(len(layout)), hidden)
    center = camera.to_pixels(drawn.center[0])[kept]
    semi = np.sqrt(values)[kept, ::-1] + semi_noise * rng.standard_normal((len(kept), 2))
    size = np.exp(rng.uniform(np.log(3), np.log(30), (strangers, 1)))
    center = np.concatenate([center, rng.uniform(0, [camera.width, camera.height], (strangers, 2))])
    semi = np.concatenate([semi, np.concatenate([size, size * rng.uniform(0.3, 1, (strangers, 1))], axis=1)])
    semi = np.sort(np.maximum(semi, 0.6), axis=-1)[:, ::-1]
    angle = np.arctan2(vectors[kept, 1, 1], vectors[kept, 0, 1])
    angle = np.concatenate([angle, rng.uniform(-1.5, 1.5, strangers)])
    ring = np.concatenate([layout.rings[kept], rng.random(strangers) < 0.1])
    center = center + noise * rng.standard_normal(center.shape)
    order = rng.permutation(len(center))
    covariance = np.broadcast_to(noise**2 * np.eye(2), (len(center), 2, 2))
    return Sight(
        plain_blobs(center[order], semi[order], angle[order], ring[order], covariance),
        np.concatenate([kept, np.full(strangers, -1)])[order],
        camera.project(marker.xyz, rotation, translation)[0],
        rotation[0],
        translation[0],
    )


@pytest.fixture(scope="session")
def pentagon():
    return regular(5)


@pytest.fixture(scope="session")
def make():
    """Build markers: make(points, rings=..., diameter=..., heights=...)."""
    return build


@pytest.fixture(scope="session")
def ngon():
    """Build regular markers: ngon(n, rings=..., diameter=..., heights=...)."""
    return regular


@pytest.fixture(scope="session")
def irregular():
    return build(IRREGULAR)


@pytest.fixture(scope="session")
def sight():
    """Blobs of a marker from a pose, without an image: sight(marker, pose, hidden=..., strangers=..., noise=...)."""
    return look


@pytest.fixture(params=["compiled", "numpy"])
def path(request, monkeypatch):
    """Run a test with the compiled part of detection, if it is there, and without it."""
    if request.param == "numpy":
        monkeypatch.setattr(kernel, "library", lambda: None)
    elif kernel.library() is None:
        pytest.skip(kernel.missing())
    return request.param
