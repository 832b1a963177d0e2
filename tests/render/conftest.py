import numpy as np
import pytest

from markergen.geometry.coverage import paint
from markergen.render.patches import project_patches


def coverage(patches, camera, rotation, translation):
    """Share of each pixel's area that is ink, as the patches' outlines have it."""
    image = np.zeros((camera.height, camera.width), dtype=np.float32)
    for patch, outlines in zip(patches, project_patches(patches, camera, rotation, translation), strict=True):
        paint(image, outlines, 1 - patch.reflectance, 1)
    return image


def rays(camera, rotation, translation, factor):
    """Camera center and directions (factor h, factor w, 3) in the marker frame of factor x factor points per pixel."""
    step = (np.arange(factor) + 0.5) / factor - 0.5
    x, y = ((np.arange(side)[:, None] + step).ravel() for side in (camera.width, camera.height))
    normalized = camera.from_pixels(np.stack(np.meshgrid(x, y), axis=-1))
    ahead = np.concatenate([normalized, np.ones((*normalized.shape[:-1], 1))], axis=-1)
    return -rotation.T @ translation, ahead @ rotation


def trace(marker, camera, rotation, translation, factor=16, rim=0.25):
    """Share of factor x factor rays of each pixel that meet ink first: on the plane z = 0, or on upright cylinders."""
    eye, ray = rays(camera, rotation, translation, factor)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = -eye[2] / ray[..., 2]
        reach[~(reach > 0)] = np.inf
        ink = np.zeros(reach.shape, dtype=bool)
        for point in (p for p in marker.control_points if p.z == 0):
            ink |= _on_dot(point, eye + reach[..., None] * ray)
        for point in (p for p in marker.control_points if p.z > 0):
            radius = point.feature.diameter / 2 + rim * marker.clearance
            top = (point.z - eye[2]) / ray[..., 2]
            place = eye + top[..., None] * ray
            meets = (top > 0) & (top < reach) & (np.hypot(place[..., 0] - point.x, place[..., 1] - point.y) < radius)
            ink[meets], reach[meets] = _on_dot(point, place)[meets], top[meets]
            # |o + s d| = radius in the plane, the nearer of the two solutions.
            o, d = eye[:2] - [point.x, point.y], ray[..., :2]
            square, slope = np.sum(d**2, axis=-1), d @ o
            side = (-slope - np.sqrt(slope**2 - square * (o @ o - radius**2))) / square
            height = eye[2] + side * ray[..., 2]
            meets = (side > 0) & (side < reach) & (height >= 0) & (height <= point.z)
            ink[meets], reach[meets] = False, side[meets]
    return ink.reshape(camera.height, factor, camera.width, factor).mean(axis=(1, 3))


def _on_dot(point, place):
    distance = np.hypot(place[..., 0] - point.x, place[..., 1] - point.y)
    return (distance < point.feature.diameter / 2) & (distance >= point.feature.inner_diameter / 2)


def find_centroid(weight):
    y, x = np.indices(weight.shape)
    return np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()


@pytest.fixture(scope="session")
def ink_of():
    return coverage


@pytest.fixture(scope="session")
def rays_of():
    return rays


@pytest.fixture(scope="session")
def traced():
    return trace


@pytest.fixture(scope="session")
def centroid():
    return find_centroid
