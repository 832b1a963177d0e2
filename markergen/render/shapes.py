"""A marker as patches: plate, tag, the pillars of raised dots, and the dots, in the order in which to paint them."""

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary
from markergen.model.marker import ControlPoint, Marker
from markergen.model.occlusion import pillar_radius
from markergen.render.patches import CIRCLE_VERTICES, Patch, circle

Array = NDArray[np.float64]

INK, SUBSTRATE = 0.0, 1.0

_RIM_VERTICES = 720


def marker_patches(
    marker: Marker, margin: float | None = None, eye: Array | None = None, count: int = CIRCLE_VERTICES
) -> list[Patch]:
    """Plate, tag, pillars and dots of a marker, in the order to paint them in.

    The plate is the boundary's region, enlarged by `margin` (which may close its holes), at z = 0 or, if some dot lies
    deeper, at the deepest one's height. Each dot above it stands on a cylinder of substrate, in radius a quarter of the
    clearance larger.

    Parameters
    ----------
    margin : float, m
        Of the plate around the boundary; by default one dot diameter.
    eye : array (3,), m
        The camera's center in the marker frame, -R't. It decides what is seen of the pillars and which of them hides
        which; without it they are seen from far above, and hide nothing. Flat markers do not need it.
    count : int
        Vertices of each circle.
    """
    margin = marker.dot_diameter if margin is None else margin
    floor = min(0.0, float(marker.xyz[:, 2].min()))
    plate = tuple(np.column_stack([ring, np.full(len(ring), floor)]) for ring in _plate(marker.boundary, margin))
    patches = [Patch(plate, SUBSTRATE)]
    if marker.tag is not None:
        flat = (np.column_stack([outline, np.zeros(len(outline))]) for outline in marker.tag.outlines)
        patches.append(Patch(tuple(flat), INK))
    for k in _farthest_first(marker, floor, eye):
        point = marker.control_points[k]
        if point.feature.diameter == 0:
            continue
        if point.z > floor:
            patches.append(_pillar(marker, point, floor, eye, count))
        diameters = (point.feature.diameter, point.feature.inner_diameter)
        patches.append(Patch(tuple(circle(marker.xyz[k], d / 2, count) for d in diameters if d > 0), INK))
    return patches


def _plate(boundary: Boundary, margin: float) -> tuple[Array, ...]:
    """Closed polygons (m, 2) of the boundary's region with a margin around it."""
    if not boundary.is_round:
        return (boundary.region.offset(margin, segments=64) if margin else boundary.region).rings
    rim = boundary.rim(_RIM_VERTICES)
    return (rim - margin * boundary.depth_gradient(rim),)


def _farthest_first(marker: Marker, floor: float, eye: Array | None) -> list[int]:
    """Indices of the control points, each behind or beside all that come after it.

    Two upright cylinders that do not meet are parted by the upright plane on which (distance to the axis)^2 - radius^2
    is the same for both. A ray from an eye on one side of it can meet the other cylinder only afterwards.
    """
    if eye is None or not np.any(marker.xyz[:, 2] > floor):
        return list(range(len(marker)))
    radius = np.array([_pillar_radius(marker, point) for point in marker.control_points])
    power = np.sum((marker.xyz[:, :2] - eye[:2]) ** 2, axis=-1) - radius**2
    # Dots on the plate hide nothing.
    power[marker.xyz[:, 2] <= floor] = np.inf
    return [int(k) for k in np.argsort(-power, kind="stable")]


def _pillar_radius(marker: Marker, point: ControlPoint) -> float:
    return pillar_radius(point.feature.diameter, marker.clearance)


def _pillar(marker: Marker, point: ControlPoint, floor: float, eye: Array | None, count: int) -> Patch:
    """Outline of a cylinder as the eye sees it: part of its foot's circle, part of its top's, and two sides between.

    The sides stand where the tangents from the eye's foot touch the circle. From above, the near half of the foot and
    the far half of the top are seen; from straight above only the top.
    """
    axis, radius = np.array([point.x, point.y]), _pillar_radius(marker, point)
    away = None if eye is None else eye[:2] - axis
    distance = 0.0 if away is None else float(np.linalg.norm(away))
    if eye is None or away is None or distance <= radius:
        return Patch((circle(np.array([*axis, point.z]), radius, count),), SUBSTRATE)
    toward, half = np.arctan2(away[1], away[0]), np.arccos(radius / distance)
    steps = np.linspace(-1, 1, count)
    near = toward + half * steps
    far = toward + np.pi + (np.pi - half) * steps
    upper = far if eye[2] > point.z else near[::-1]
    angle = np.concatenate([near, upper])
    height = np.repeat([floor, point.z], len(steps))
    outline = axis + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return Patch((np.column_stack([outline, height]),), SUBSTRATE)
