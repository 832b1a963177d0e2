"""Synthetic view of a rig: its plates with their dots, painted from the farthest to the nearest."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from markergen.model.camera import Camera
from markergen.model.marker import check_supported
from markergen.model.occlusion import painting_levels
from markergen.model.rig import Rig
from markergen.render.optics import Optics
from markergen.render.patches import Patch
from markergen.render.scenery import Scenery
from markergen.render.view import SUBSTRATE, Image, Painted, painted, photograph, seen_patches

Array = NDArray[np.float64]

_OVER = np.diag([1.0, -1.0, -1.0])
"""Rotation that turns a plate's back to the front."""


def render_rig(
    rig: Rig,
    camera: Camera,
    rotation: Array,
    translation: Array,
    optics: Optics,
    rng: np.random.Generator,
    scenery: Scenery | None = None,
) -> Image:
    """Render the camera's image (height, width) of a rig from one pose T_camera_rig, as `render_view` does of a marker.

    A plate hides what is behind it, and its back is plain substrate. If no plate stands in front of another's plane, as
    on a cube or a wall, plates are the faces of a solid, and those that face away are not drawn. Faces that meet at an
    edge leave no gap. A pillar hides nothing on other plates.

    Raises
    ------
    InputError
        If plates hide one another in a circle or pierce one another, a background's size is not the camera's, or
        `check_supported` refuses a marker.
    """
    for each in rig.markers:
        check_supported(each.marker, "to render")
    margins = rig.margins.tolist()

    def patches_of(index: int, turn: Array, shift: Array) -> list[Patch]:
        return seen_patches(rig.markers[index].marker, camera, turn, shift, margins[index])

    return photograph(painted_rig(rig, patches_of, camera, rotation, translation), camera, optics, rng, scenery)


PatchesOf = Callable[[int, Array, Array], list[Patch]]
"""Patches of a plate, by its index and its pose T_camera_marker, the plate itself first."""


def painted_rig(rig: Rig, patches_of: PatchesOf, camera: Camera, rotation: Array, translation: Array) -> Painted:
    """Return what is painted for a rig seen from one pose T_camera_rig."""
    shown: Painted = []
    for level in painting_levels(rig, -rotation.T @ translation):
        grounds, contents = list[tuple[float, tuple[Array, ...]]](), list[tuple[float, tuple[Array, ...]]]()
        for k in level:
            ground, *content = _plate(rig, k, patches_of, camera, rotation, translation)
            grounds.append(ground)
            contents += content
        shown += _joined(grounds) + contents
    return shown


def _plate(rig: Rig, index: int, patches_of: PatchesOf, camera: Camera, rotation: Array, translation: Array) -> Painted:
    """Ground of a plate, and, if it faces the camera, what is on it."""
    turn, shift = rig.markers[index].camera_pose(rotation, translation)
    patches = patches_of(index, turn, shift)
    if turn[:, 2] @ shift < 0:
        return painted(patches, camera, turn, shift)
    back = Patch(tuple(outline @ _OVER for outline in patches[0].outlines), SUBSTRATE)
    return painted([back], camera, turn @ _OVER, shift)


def _joined(grounds: Painted) -> Painted:
    """Grounds that do not overlap, painted as one: an edge between two of them shows nothing of what is behind."""
    below = max((level for level, _ in grounds), default=SUBSTRATE)
    other = [(level, outlines) for level, outlines in grounds if level != below]
    return [(below, tuple(outline for _, outlines in grounds for outline in outlines)), *other]
