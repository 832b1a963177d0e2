"""A layout that the user gives, instead of a search: dots that fit it, and what is wrong with it."""

from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array
from markergen.bounds.confusion.perspective import layout_safety
from markergen.errors import InputError
from markergen.model.boundary import Without
from markergen.model.occlusion import eyes_of
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.objectives import Setting
from markergen.optimize.dot_size import CLEARANCE, DotSize, clearance_of, pixels_in_words, wanted_diameter
from markergen.optimize.problem import TOLERANCE, FeasibleRegion, room_of
from markergen.optimize.relief import relief_breach
from markergen.units import format_length

STEP = 1e-4
"""Diameters are whole multiples of it, m: they can be measured on the sheet."""


@dataclass(frozen=True)
class Fault:
    """What is wrong with some dots of a layout, in words."""

    dots: tuple[int, ...]
    words: str


def size_given(spec: Spec, poses: PoseDistribution) -> DotSize:
    """Size the dots of a spec with points: as asked, or large enough for the camera as far as they fit."""
    asked = spec.dot if isinstance(spec.dot, float) else None
    wanted = wanted_diameter(spec.camera, poses, spec.image_noise) if asked is None else asked
    diameter = wanted if asked is not None else max(STEP, min(wanted, _largest(spec)))
    reason = "as asked" if asked is not None else "for the camera" if diameter == wanted else "the largest that fits"
    description = f"{format_length(diameter)}, {reason}, {pixels_in_words(diameter, spec, poses)}"
    return DotSize(diameter, clearance_of(spec, diameter), description)


def _largest(spec: Spec) -> float:
    """Largest diameter in m, a whole tenth of a mm, that the spec's points leave room for; 0 or less if none."""
    points = np.array(spec.points)[:, :2]
    closest = np.linalg.norm(points[:, None] - points, axis=-1)[np.triu_indices(len(points), 1)].min()
    depth = room_of(spec).depth(points[None]).min()
    if spec.clearance is None:
        most = min(closest / (1 + CLEARANCE), depth / (0.5 + CLEARANCE))
    else:
        most = min(closest - spec.clearance, 2 * (depth - spec.clearance))
    return float(np.floor(min(most, closest - spec.gap) / STEP + 1e-6) * STEP)


def faults(points: Array, region: FeasibleRegion) -> list[Fault]:
    """Find the dots of a layout (n, 2 or 3) in m that are out of the region or too near to each other."""
    plane = points[:, :2]
    room = region.boundary
    whole = room.boundary if isinstance(room, Without) else room
    outside, beyond = (region.inset - area.depth(plane[None])[0] for area in (room, whole))
    breaches = []
    for dot in np.flatnonzero(outside > TOLERANCE).tolist():
        at_edge = beyond[dot] == outside[dot]
        where = "the edge of the room, or beyond it" if at_edge else "a region without dots, or in it"
        breaches.append(Fault((dot,), f"dot {dot} is {format_length(outside[dot])} too near to {where}"))
    short = region.spacing - np.linalg.norm(plane[:, None] - plane, axis=-1)
    for first, second in np.argwhere(np.triu(short > TOLERANCE, 1)).tolist():
        sentence = f"dots {first} and {second} are {format_length(short[first, second])} too near to each other"
        breaches.append(Fault((first, second), sentence))
    return breaches


def refuse_faults(points: Array, region: FeasibleRegion, spec: Spec, setting: Setting) -> None:
    """Refuse a layout with faults, with pillars that hide dots from a pose, or with labels less safe than asked.

    Raises
    ------
    InputError
        Naming the first fault.
    """
    if breaches := faults(points, region):
        more = f", and {len(breaches) - 1} more" * (len(breaches) > 1)
        dots = f"dots of {format_length(region.diameter)} with {format_length(region.clearance)} clearance"
        raise InputError(
            f"points with room for {dots}",
            f"{breaches[0].words}{more}",
            "move them, or give a smaller --dot",
        )
    if spec.relief:
        worst = relief_breach(points, spec.relief, region.diameter, region.clearance, eyes_of(setting.poses))
        if worst > TOLERANCE:
            breach = f"one that is {format_length(worst)} too high, too low, or in the way of another"
            raise InputError(
                f"points of a relief of {format_length(spec.relief)}", breach, "move it, or allow more --relief"
            )
    if spec.asymmetric:
        safety = layout_safety(points, setting, keyed=False).least
        if safety < spec.asymmetric:
            raise InputError(
                f"points with labels safe to {spec.asymmetric:g} px", f"{safety:.3g} px", "move them, or ask for less"
            )
