"""How large the dots are printed: as many pixels as detection needs, as long as they fit."""

from dataclasses import dataclass

import numpy as np

from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.optimize.goal import room_of
from markergen.optimize.packing import count_that_fit, fitting, largest_diameter
from markergen.optimize.region import Region
from markergen.options import Progress
from markergen.units import format_length

PIXELS = 8.0
"""Smallest extent in px that the dots' images should have."""

PERCENTILE = 94.0
"""Share of the poses, in per cent, in which they should have it."""

ROOM = 0.9
"""Largest share of the diameter that just fits: the optimizer needs room to move the dots."""

FEWEST_PIXELS, FEWEST_PIXELS_LONG = 4.0, 6.0
"""Below this many px along its image's short and long axis, a dot is too small to be detected reliably."""

CLEARANCE = 0.1
"""Default clearance as a share of the diameter."""


@dataclass(frozen=True)
class DotSize:
    """Diameter and clearance in m, one line that explains the choice, and one that warns of it, if there is cause."""

    diameter: float
    clearance: float
    reason: str
    warning: str = ""


def clearance_of(spec: Spec, diameter: float) -> float:
    """Clearance in m that the spec asks for with dots of that diameter."""
    return CLEARANCE * diameter if spec.clearance is None else spec.clearance


def choose_dots(spec: Spec, poses: PoseDistribution, progress: Progress | None = None) -> DotSize:
    """Size the dots of a spec for the poses that see the marker.

    Raises
    ------
    InputError
        If the dots or the clearance that the spec asks for leave room for fewer than n; the message says for how many.
    """
    if spec.dot == "auto":
        # It is found by designing for several sizes, of what this module says about them.
        from markergen.optimize.diameter import best_dots

        size = best_dots(spec, poses, progress)
    elif spec.dot is None:
        size = _default(spec, poses)
    else:
        clearance = clearance_of(spec, spec.dot)
        size = DotSize(spec.dot, clearance, f"{format_length(spec.dot)}, as asked, {_pixels(spec.dot, spec, poses)}")
    if size.diameter > 0 or size.clearance > 0:
        _refuse_what_does_not_fit(spec, size)
    return size


def wanted_diameter(camera: Camera, poses: PoseDistribution) -> float:
    """Diameter in m, a whole mm, whose image is 8 px along its short axis in 94 % of the poses.

    d = 8 px z / (f cos tilt) at the marker's origin, f the geometric mean of the focal lengths.
    """
    focal = np.sqrt(camera.fx * camera.fy)
    diameters = PIXELS * poses.translation[:, 2] / (focal * poses.cos_tilt)
    return float(np.ceil(np.percentile(diameters, PERCENTILE) * 1e3 - 1e-6) / 1e3)


def largest_that_leaves_room(spec: Spec) -> float:
    """Largest diameter in m, a whole tenth of a mm, that leaves the optimizer room to move n dots.

    Raises
    ------
    InputError
        If it is below 0.1 mm.
    """
    fits = ROOM * largest_diameter(room_of(spec), spec.n, spec.clearance)
    # Whole tenths of a millimeter: a size that can be measured on the sheet.
    diameter = float(np.floor(fits * 1e4) / 1e4)
    if not diameter:
        raise InputError(
            "room for dots of 0.1 mm and more",
            f"{spec.n} dots in a {room_of(spec)}",
            "use a larger marker or a smaller --n",
        )
    return diameter


def smallest_detectable(camera: Camera, poses: PoseDistribution) -> float:
    """Diameter in m, a whole tenth of a mm, whose image is 4 px wide and 6 px long or more in 94 % of the poses."""
    focal = np.sqrt(camera.fx * camera.fy)
    depth = poses.translation[:, 2]
    needed = np.maximum(FEWEST_PIXELS * depth / poses.cos_tilt, FEWEST_PIXELS_LONG * depth) / focal
    return float(np.ceil(np.percentile(needed, PERCENTILE) * 1e4 - 1e-6) / 1e4)


def _default(spec: Spec, poses: PoseDistribution) -> DotSize:
    wanted, diameter = wanted_diameter(spec.camera, poses), largest_that_leaves_room(spec)
    if wanted <= diameter:
        reason = f"{format_length(wanted)}: its image is at least {PIXELS:g} px across in {PERCENTILE:g} % of the poses"
        return DotSize(wanted, clearance_of(spec, wanted), reason)
    reason = (
        f"{format_length(diameter)}, {100 * ROOM:g} % of the largest at which {spec.n} dots fit; "
        f"{PIXELS:g} px would need {format_length(wanted)}, this leaves {_pixels(diameter, spec, poses)}"
    )
    return DotSize(diameter, clearance_of(spec, diameter), reason)


def pixels_across(diameter: float, camera: Camera, poses: PoseDistribution) -> float:
    """Extent in px that the image of a dot has along its short axis in 94 % of the poses (see `wanted_diameter`)."""
    focal = np.sqrt(camera.fx * camera.fy)
    return float(diameter * focal / np.percentile(poses.translation[:, 2] / poses.cos_tilt, PERCENTILE))


def _pixels(diameter: float, spec: Spec, poses: PoseDistribution) -> str:
    return f"{pixels_across(diameter, spec.camera, poses):.1f} px"


def _refuse_what_does_not_fit(spec: Spec, size: DotSize) -> None:
    room = room_of(spec)
    # The search relies on what is found here: where it is stuck, it begins with it.
    if fitting(Region(room, size.diameter, size.clearance), spec.n) is not None:
        return
    fit = count_that_fit(room, size.diameter, size.clearance, spec.n - 1)
    raise InputError(
        f"{spec.n} dots that fit in a {room}",
        f"dots of {format_length(size.diameter)} with {format_length(size.clearance)} clearance, of which {fit} fit",
        f"use --dot {np.floor(ROOM * largest_diameter(room, spec.n) * 1e4) / 10:g}mm or less, "
        "a larger marker, or a smaller --n",
    )
