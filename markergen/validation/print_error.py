"""Simulated print errors, consistent with the error budget."""
# tests: tests/validation/test_measured_print.py tests/validation/test_expectation.py

from dataclasses import replace
from typing import TypeVar

import numpy as np

from markergen.arrays import Array
from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import exponential
from markergen.model.marker import Marker
from markergen.model.rig import Rig

B = TypeVar("B", Marker, Rig)


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


def misprinted(body: B, errors: ErrorSources, rng: np.random.Generator) -> B:
    """Return a marker as printed, or itself without errors; and a rig as printed and assembled.

    The plates of a rig have one scale, and are moved by the covariance of their relation.
    """
    if isinstance(body, Rig):
        return _assembled(body, errors, rng)
    if not (errors.scale_sigma or errors.print_sigma or body.places_measured):
        return body
    return displaced(body, displacement(body, errors, rng))


def _assembled(rig: Rig, errors: ErrorSources, rng: np.random.Generator) -> Rig:
    plates = [
        replace(plate, marker=misprinted(plate.marker, replace(errors, scale_sigma=0.0), rng)) for plate in rig.plates
    ]
    relation = rig.relation_covariance
    if relation is not None:
        values, vectors = np.linalg.eigh(relation)
        steps = (vectors * np.sqrt(np.maximum(values, 0))) @ rng.standard_normal(len(values))
        for k, (plate, step) in enumerate(zip(plates, steps.reshape(-1, 6), strict=True)):
            rotation = exponential(step[:3]) @ plate.rotation_matrix
            translation = tuple(plate.translation_vector + step[3:])
            plates[k] = replace(plate, rotation=tuple(map(tuple, rotation)), translation=translation)
    if errors.scale_sigma:
        scale = rng.standard_normal(2)
        for k, (plate, designed) in enumerate(zip(plates, rig.plates, strict=True)):
            scaled = errors.of(designed.marker).scaled(designed.marker.xyz) @ scale
            plates[k] = replace(plate, marker=displaced(plate.marker, scaled))
    return replace(rig, markers=tuple(plates))


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
