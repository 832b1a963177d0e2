"""Synthetic view of a marker or a rig, or of any scene made of flat patches.

A marker consists of its plate, its tag, and its dots with the pillars of raised ones, painted in that order: in ink on
substrate, or, if its dots are light, plate and pillars in ink and the rest in substrate. Plates of a rig are painted
from the farthest to the nearest.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import dropwhile

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.geometry.coverage import paint
from markergen.model.body import Body, Plate
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.model.marker import ControlPoint, Marker, check_supported
from markergen.model.occlusion import painting_levels, pillar_radius
from markergen.render.optics import FINENESS, FULL_SCALE, Optics, expose, illumination, quantize
from markergen.render.patches import CIRCLE_VERTICES, Patch, circle_polygon, circle_vertices, project_patches
from markergen.render.scenery import Scenery

Grey = NDArray[np.float32]
Image = NDArray[np.uint8] | NDArray[np.uint16]

INK, SUBSTRATE = 0.0, 1.0
"""Reflectance of ink and ground, as shares of the range from the optics' dark to light."""

_RIM_VERTICES = 720
"""Number of vertices of a round plate's rim, whose polygon lacks 1.3e-5 of its area."""

_OVER = np.diag([1.0, -1.0, -1.0])
"""Rotation of a plate's back to the front."""


def render_view(
    body: Body,
    camera: Camera,
    rotation: Array,
    translation: Array,
    optics: Optics,
    rng: np.random.Generator,
    scenery: Scenery | None = None,
) -> Image:
    """Render the camera's image (height, width) of a marker or rig from one pose T_camera_body.

    See `render_patches`; the patches are those of `marker_patches`. A plate of a rig hides what is behind it, and its
    back is plain substrate. If no plate stands in front of another's plane, as on a cube or a wall, plates are the
    faces of a solid, and those that face away are not drawn. Faces that meet at an edge leave no gap. A pillar hides
    nothing on other plates.

    Raises
    ------
    InputError
        If plates hide one another in a circle or pierce one another, a background's size is not the camera's, or
        `check_supported` refuses a marker.
    """
    for plate in body.plates:
        check_supported(plate.marker, "to render")

    def patches_of(index: int, plate_rotation: Array, plate_translation: Array) -> list[Patch]:
        margin = float(body.margins[index])
        return seen_patches(body.plates[index].marker, camera, plate_rotation, plate_translation, margin)

    here = at_depth(optics, camera, translation)
    return photograph(painted_body(body, patches_of, camera, rotation, translation), camera, here, rng, scenery)


def seen_patches(
    marker: Marker, camera: Camera, rotation: Array, translation: Array, margin: float | None = None
) -> list[Patch]:
    """Return the patches of a marker (see `marker_patches`) as they are seen from one pose T_camera_marker."""
    eye = -rotation.T @ translation
    count = circle_vertices(_largest_radius(marker, camera, rotation, translation))
    return marker_patches(marker, margin, eye, count)


def render_patches(
    patches: Sequence[Patch],
    camera: Camera,
    rotation: Array,
    translation: Array,
    optics: Optics,
    rng: np.random.Generator,
    scenery: Scenery | None = None,
) -> Image:
    """Render the camera's image (height, width) of patches, painted in their order, from one pose.

    A subpixel's grey level is exact if each patch covers it completely or not at all. Where the outlines of two patches
    pass through one subpixel, each is assumed to cover the same share of all its parts.

    Parameters
    ----------
    rotation, translation : arrays (3, 3) and (3,), m
        T_camera_marker.
    rng : Generator
        Source of the noise; the same seed gives the same bytes.
    scenery : Scenery
        Background and occluders; None for substrate everywhere behind the patches and nothing in front of them.

    Returns
    -------
    array (height, width) of uint8, or uint16 if the sensor has more than 8 bits
        Patches that face away or lie behind the camera are not visible.

    Raises
    ------
    InputError
        If a background's size is not the camera's.
    """
    here = at_depth(optics, camera, translation)
    return photograph(painted(patches, camera, rotation, translation), camera, here, rng, scenery)


def at_depth(optics: Optics, camera: Camera, translation: Array) -> Optics:
    """Optics at the depth of a body's origin, by which the whole image is blurred, see `Optics.at`."""
    return optics.at(float(camera.focal.mean()), float(translation[2]))


Painted = list[tuple[float, tuple[Array, ...]]]
"""Reflectance and distorted outlines (m, 2) in px of what is painted, in its order."""


def painted(patches: Sequence[Patch], camera: Camera, rotation: Array, translation: Array) -> Painted:
    """Return what is painted for patches seen from one pose T_camera_marker."""
    outlines = project_patches(patches, camera, rotation, translation)
    return [(patch.reflectance, outline_set) for patch, outline_set in zip(patches, outlines, strict=True)]


PatchesOf = Callable[[int, Array, Array], list[Patch]]
"""Patches of a plate, by its index and its pose T_camera_marker, the plate itself first."""


def painted_body(body: Body, patches_of: PatchesOf, camera: Camera, rotation: Array, translation: Array) -> Painted:
    """Return what is painted for a body seen from one pose T_camera_body."""
    layers: Painted = []
    for level in painting_levels(body, -rotation.T @ translation):
        grounds, contents = list[tuple[float, tuple[Array, ...]]](), list[tuple[float, tuple[Array, ...]]]()
        for k in level:
            ground, *content = _painted_plate(body.plates[k], k, patches_of, camera, rotation, translation)
            grounds.append(ground)
            contents += content
        # Grounds do not overlap, and are painted as one: an edge between two of them shows nothing of what is behind.
        below = max((level for level, _ in grounds), default=SUBSTRATE)
        layers.append((below, tuple(outline for _, outlines in grounds for outline in outlines)))
        layers += [ground for ground in grounds if ground[0] != below] + contents
    return layers


def _painted_plate(
    plate: Plate, index: int, patches_of: PatchesOf, camera: Camera, rotation: Array, translation: Array
) -> Painted:
    """Ground of a plate, and, if it faces the camera, what is on it."""
    pose = plate.camera_pose(rotation, translation)
    patches = patches_of(index, *pose)
    if pose[0][:, 2] @ pose[1] < 0:
        return painted(patches, camera, *pose)
    back = Patch(tuple(outline @ _OVER for outline in patches[0].outlines), SUBSTRATE)
    return painted([back], camera, pose[0] @ _OVER, pose[1])


def photograph(
    layers: Painted, camera: Camera, optics: Optics, rng: np.random.Generator, scenery: Scenery | None = None
) -> Image:
    """Render the camera's image of what is painted, see `render_patches`."""
    ink, corner = _ink(layers, camera, optics, scenery or Scenery())
    return quantize(expose(ink, optics, rng, corner, (camera.height, camera.width)), optics.bits)


Window = tuple[Indices, Indices]
"""Part of an image: its top left pixel (2,), and its width and height (2,)."""


def window_of(patches: Sequence[Patch], camera: Camera, rotation: Array, translation: Array, optics: Optics) -> Window:
    """Part of the image that patches seen from a pose affect, and also if they move by less than a pixel."""
    outlines = [outlines for _, outlines in painted(patches, camera, rotation, translation)]
    return _window(
        outlines, at_depth(optics, camera, translation).reach_px + 1, np.array([camera.width, camera.height])
    )


def expected_levels(
    patches: Sequence[Patch],
    camera: Camera,
    rotation: Array,
    translation: Array,
    optics: Optics,
    window: Window | None = None,
) -> Grey:
    """Mean grey levels (height, width) of `render_patches`, or of a window that patches do not reach beyond.

    They are without noise, and saturated but not rounded.
    """
    optics = at_depth(optics, camera, translation)
    even = replace(optics, noise_grey=0.0, full_well=None, exposure=1.0, vignetting=0.0, gradient=0.0)
    layers, none = painted(patches, camera, rotation, translation), np.random.default_rng(0)
    if window is None:
        ink, corner = _ink(layers, camera, even, Scenery())
        grey = expose(ink, even, none, corner, (camera.height, camera.width))
        window = np.zeros(2, dtype=int), np.array([camera.width, camera.height])
    else:
        grey = expose(_ink(layers, camera, even, Scenery(), window)[0], even, none)
    light = illumination(optics, camera.width, camera.height)
    if light is not None:
        (left, top), (width, height) = window
        grey *= light[top : top + height, left : left + width]
    return np.clip(grey, 0, FULL_SCALE, out=grey)


def _ink(
    layers: Painted, camera: Camera, optics: Optics, scenery: Scenery, window: Window | None = None
) -> tuple[Grey, Indices]:
    """Ink coverage of the subpixels around all that is not substrate, and the top left pixel of that window."""
    ink = scenery.ink_behind(camera, optics, FINENESS)
    if ink is None:
        # Skip substrate painted on substrate.
        layers = list(dropwhile(lambda layer: layer[0] == 1, layers))
    corner, size = np.zeros(2, dtype=int), np.array([camera.width, camera.height])
    if ink is None and not scenery.occluders:
        # Everything around the patches is substrate, which need not be blurred.
        corner, size = window or _window([outlines for _, outlines in layers], optics.reach_px, size)
    if ink is None:
        ink = np.zeros(size[::-1] * FINENESS, dtype=np.float32)
    for reflectance, outlines in layers:
        paint(ink, [outline - corner for outline in outlines], np.float32(1 - reflectance), FINENESS)
    scenery.cover(ink, optics, FINENESS)
    return ink, corner


def _window(projected: list[tuple[Array, ...]], reach_px: int, size: Indices) -> Window:
    """Part of an image that outlines affect, including their blur."""
    vertices = [outline for outlines in projected for outline in outlines]
    if not vertices:
        return np.zeros(2, dtype=int), np.ones(2, dtype=int)
    corners = np.concatenate(vertices)
    low = corners.min(axis=0) - reach_px
    high = corners.max(axis=0) + reach_px
    first = np.clip(np.floor(low), 0, size - 1).astype(int)
    last = np.clip(np.ceil(high), 0, size - 1).astype(int)
    return first, last - first + 1


def marker_patches(
    marker: Marker, margin: float | None = None, eye: Array | None = None, count: int = CIRCLE_VERTICES
) -> list[Patch]:
    """Plate, tag, pillars and dots of a marker, in painting order.

    The plate is the boundary's region enlarged by `margin` (which may close its holes), at z = 0 or at the height of
    the lowest dot if that is below. Each dot above the plate stands on a cylinder of substrate whose radius is larger
    by a quarter of the clearance.

    Parameters
    ----------
    margin : float, m
        Margin of the plate around the boundary; one dot diameter by default.
    eye : array (3,), m
        Camera center in the marker frame, -R't. It determines which parts of the pillars are visible and their painting
        order; without it they are seen from far above and hide nothing. Flat markers do not need it.
    count : int
        Number of vertices of each circle.
    """
    margin = marker.dot_diameter if margin is None else margin
    floor = min(0.0, float(marker.xyz[:, 2].min()))
    plate = tuple(np.column_stack([ring, np.full(len(ring), floor)]) for ring in _plate(marker.boundary, margin))
    ink, ground = (SUBSTRATE, INK) if marker.light else (INK, SUBSTRATE)
    patches = [Patch(plate, ground)]
    if marker.tag is not None:
        flat = (np.column_stack([outline, np.zeros(len(outline))]) for outline in marker.tag.outlines)
        patches.append(Patch(tuple(flat), ink))
    for k in _farthest_first(marker, floor, eye):
        point = marker.control_points[k]
        if point.feature.diameter == 0:
            continue
        if point.z > floor:
            patches.append(Patch((_pillar(marker, point, floor, eye, count),), ground))
        diameters = (point.feature.diameter, point.feature.inner_diameter)
        patches.append(Patch(tuple(circle_polygon(marker.xyz[k], d / 2, count) for d in diameters if d > 0), ink))
    return patches


def _largest_radius(marker: Marker, camera: Camera, rotation: Array, translation: Array) -> float:
    """Upper bound in px of the dots' radii in the image; at most the image diagonal."""
    centers = marker.xyz @ rotation.T + translation
    diagonal = float(np.hypot(camera.width, camera.height))
    nearest = centers[:, 2] - marker.dot_diameter
    if nearest.min() <= 0:
        return diagonal
    # The image of a small sphere at distance d and depth z is an ellipse with long semi-axis f r d / z^2.
    stretch = np.linalg.norm(centers, axis=-1) / nearest**2
    return min(float(camera.focal.max() * marker.dot_diameter / 2 * stretch.max()), diagonal)


def _plate(boundary: Boundary, margin: float) -> tuple[Array, ...]:
    """Closed polygons (m, 2) of the boundary's region with a margin around it."""
    if not boundary.is_round:
        return (boundary.region.offset(margin, segments=64) if margin else boundary.region).rings
    # Depth grows toward the inside, so that its gradient points inward.
    rim = boundary.rim(_RIM_VERTICES)
    return (rim - margin * boundary.depth_gradient(rim),)


def _farthest_first(marker: Marker, floor: float, eye: Array | None) -> list[int]:
    """Indices of the control points, farthest first: none hides a later one.

    Two disjoint vertical cylinders are separated by the vertical plane on which (distance to the axis)^2 - radius^2 is
    the same for both. A ray from an eye on one side of it can meet the other cylinder only afterwards.
    """
    if eye is None or not np.any(marker.xyz[:, 2] > floor):
        return list(range(len(marker)))
    radius = np.array([_pillar_radius(marker, point) for point in marker.control_points])
    # Of two cylinders the one with the smaller power of the eye's foot is in front: their radical line separates them,
    # and the eye is on its side.
    power = np.sum((marker.xyz[:, :2] - eye[:2]) ** 2, axis=-1) - radius**2
    # Dots on the plate hide nothing, so they come first.
    power[marker.xyz[:, 2] <= floor] = np.inf
    return [int(k) for k in np.argsort(-power, kind="stable")]


def _pillar_radius(marker: Marker, point: ControlPoint) -> float:
    return pillar_radius(point.feature.diameter, marker.clearance)


def _pillar(marker: Marker, point: ControlPoint, floor: float, eye: Array | None, count: int) -> Array:
    """Silhouette (m, 3) of a cylinder seen from the eye: arcs of its base and top circle, and two sides.

    The sides stand where the tangents from the eye's vertical projection touch the circle. From above, the near arc of
    the base and the far arc of the top are visible; from straight above, only the top.
    """
    axis, radius = np.array([point.x, point.y]), _pillar_radius(marker, point)
    away = None if eye is None else eye[:2] - axis
    distance = 0.0 if away is None else float(np.linalg.norm(away))
    if eye is None or away is None or distance <= radius:
        return circle_polygon(np.array([*axis, point.z]), radius, count)
    toward, half = np.arctan2(away[1], away[0]), np.arccos(radius / distance)
    steps = np.linspace(-1, 1, count)
    near_arc = toward + half * steps
    far = toward + np.pi + (np.pi - half) * steps
    # From above the far half of the top circle is seen behind the near one; from below, the near half alone bounds it.
    upper = far if eye[2] > point.z else near_arc[::-1]
    angle = np.concatenate([near_arc, upper])
    height = np.repeat([floor, point.z], len(steps))
    outline = axis + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.column_stack([outline, height])
