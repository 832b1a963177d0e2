"""One synthetic view of a marker."""

import numpy as np
from numpy.typing import NDArray

from markergen.maths.conic import circle_image
from markergen.maths.projection import plane_homography
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.render.coverage import ellipse_coverage
from markergen.render.optics import FINENESS, Optics, expose, quantize

Array = NDArray[np.float64]


def render_view(
    marker: Marker,
    camera: Camera,
    rotation: Array,
    translation: Array,
    optics: Optics,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """Image (height, width) of the marker's dots, as the camera takes it from one pose T_camera_marker.

    Parameters
    ----------
    rotation, translation : arrays (3, 3) and (3,), m

    Returns
    -------
    array (height, width) of uint8
        Substrate everywhere but on the dots. Dots that turn their face away or reach behind the camera are not seen.
    """
    return quantize(expose(ink_coverage(marker, _finer(camera, FINENESS), rotation, translation), optics, rng))


def ink_coverage(marker: Marker, camera: Camera, rotation: Array, translation: Array) -> Array:
    """Fraction (height, width) of each pixel's area that is ink, exact to rounding, for a sharp pinhole camera."""
    image = np.zeros((camera.height, camera.width))
    for diameters, sign in ((_diameters(marker, inner=False), 1.0), (_diameters(marker, inner=True), -1.0)):
        center, semi, angle = dot_ellipses(marker, camera, rotation, translation, diameters)
        for i in np.flatnonzero((diameters > 0) & np.isfinite(semi).all(axis=-1)):
            tile, top, left = ellipse_coverage(center[i], semi[i], float(angle[i]), camera.width, camera.height)
            image[top : top + tile.shape[0], left : left + tile.shape[1]] += sign * tile
    return image


def dot_ellipses(
    marker: Marker, camera: Camera, rotation: Array, translation: Array, diameters: Array
) -> tuple[Array, Array, Array]:
    """Image ellipses of circles around the control points, each in the plane of its own height.

    Parameters
    ----------
    diameters : array (n,), m

    Returns
    -------
    center (n, 2), semi (n, 2), angle (n,)
        See `ellipse_of_conic`; nan for circles of diameter 0, seen from behind, or not wholly in front of the camera.
    """
    xyz = marker.xyz
    normal = rotation[:, 2]
    centers = xyz @ rotation.T + translation
    nearest = centers[:, 2] - diameters / 2 * np.hypot(rotation[2, 0], rotation[2, 1])
    seen = (diameters > 0) & (nearest > 0) & (centers @ normal < 0)
    center, semi, angle = np.full((len(xyz), 2), np.nan), np.full((len(xyz), 2), np.nan), np.full(len(xyz), np.nan)
    if seen.any():
        planes = np.broadcast_to(rotation, (int(seen.sum()), 3, 3))
        homography = plane_homography(planes, translation + xyz[seen, 2:] * normal, camera.matrix)
        center[seen], semi[seen], angle[seen] = circle_image(xyz[seen, :2], diameters[seen] / 2, homography)
    return center, semi, angle


def _finer(camera: Camera, factor: int) -> Camera:
    """Return the camera with each pixel divided by a whole factor; the image's corner stays at (-0.5, -0.5)."""
    cx, cy = ((center + 0.5) * factor - 0.5 for center in (camera.cx, camera.cy))
    return Camera(camera.width * factor, camera.height * factor, camera.fx * factor, camera.fy * factor, cx, cy)


def _diameters(marker: Marker, inner: bool) -> Array:
    features = [point.feature for point in marker.control_points]
    return np.array([feature.inner_diameter if inner else feature.diameter for feature in features])
