"""Simulated print errors, consistent with the error budget."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from markergen.estimators.budget import ErrorSources
from markergen.model.marker import Marker

Array = NDArray[np.float64]


def displacement(
    marker: Marker, errors: ErrorSources, rng: np.random.Generator, axes: int = 3, prints: tuple[int, ...] = ()
) -> Array:
    """Sample errors (n, axes) in m of the dots: Gaussian in the plane, with 3 axes also in height if any dot is raised.

    Errors of measured dots follow their covariance, all together if they were measured together, those of others
    ``errors.print_sigma`` along each axis and, all together, ``errors.scale_sigma``. `prints` is the shape of a batch,
    the first axes of the result; () samples one print.
    """
    offset = rng.standard_normal((*prints, len(marker), axes))
    places = errors.of(marker)
    if not marker.xyz[:, 2].any() and places.joint_places is None:
        offset[..., 2:] = 0
    scaled = np.zeros_like(offset)
    if places.scale_sigma:
        scaled[..., :2] = (places.scaled(marker.xyz) @ rng.standard_normal((*prints, 1, 2, 1)))[..., 0]
    if places.joint_places is not None:
        values, vectors = np.linalg.eigh(places.whole(len(marker), axes))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return (offset.reshape(*prints, -1) @ root.T).reshape(offset.shape) + scaled
    if places.place_covariance is None:
        return errors.print_sigma * offset + scaled
    values, vectors = np.linalg.eigh(places.place_blocks(marker.xyz, axes))
    roots: Array = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.swapaxes(-1, -2)
    return np.asarray((roots @ offset[..., None])[..., 0]) + scaled


def misprinted(marker: Marker, errors: ErrorSources, rng: np.random.Generator) -> Marker:
    """Return the marker as printed, or itself if there are no errors."""
    if not (errors.scale_sigma or errors.print_sigma or marker.places_measured):
        return marker
    return displaced(marker, displacement(marker, errors, rng))


def displaced(marker: Marker, offset: Array) -> Marker:
    """Return the marker with its control points displaced by offsets (n, 2 or 3) in m."""
    offset = np.pad(offset, ((0, 0), (0, 3 - offset.shape[1])))
    return replace(
        marker,
        control_points=tuple(
            replace(point, x=point.x + dx, y=point.y + dy, z=point.z + dz)
            for point, (dx, dy, dz) in zip(marker.control_points, offset.tolist(), strict=True)
        ),
    )
