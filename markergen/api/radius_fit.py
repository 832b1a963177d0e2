"""The largest disk whose marker one page of a paper holds."""

from collections.abc import Callable
from dataclasses import replace

from markergen.drawing.paper import SheetOptions
from markergen.drawing.sheet_layout import fits, largest_disk
from markergen.errors import InputError
from markergen.model.spec import AUTO, Spec
from markergen.optimize.design import Design
from markergen.optimize.dot_size import choose_dots, clearance_of, largest_that_leaves_room
from markergen.read.poses import poses_from

Make = Callable[[int], Spec]
"""Spec of a marker by its radius in mm."""


def radius_limits(make: Make, sheet: SheetOptions) -> tuple[int, int]:
    """Radii in mm: one that fits whatever the layout, and the largest whose outline alone fits.

    They differ only if quiet zones, which may extend into the margin, reach beyond it.

    Raises
    ------
    InputError
        If no page holds a marker with these dots, or as `choose_dots` does.
    """
    most = radius = largest_disk(sheet)
    while radius and radius > (held := largest_disk(sheet, _beyond(make(radius)))):
        radius = held
    if not radius:
        raise InputError(
            "a paper that holds the marker with its quiet zones and rulers", str(sheet.paper), "use larger paper"
        )
    return radius, most


def largest_that_fits(
    make: Make, limits: tuple[int, int], sheet: SheetOptions, find: Callable[[Spec], Design]
) -> tuple[Spec, Design]:
    """Design of the largest radius within the limits that one page holds, by bisection from the top, and its spec.

    Raises
    ------
    InputError
        If holes beyond the disk do not fit on the page.
    """
    low, high = limits
    best: tuple[Spec, Design] | None = None
    radius = high
    while low < high:
        spec = make(radius)
        result = find(spec)
        if fits(result.marker, sheet):
            low, best = radius, (spec, result)
        else:
            high = radius - 1
        radius = (low + high + 1) // 2
    spec, result = best or ((spec := make(low)), find(spec))
    if result.marker.dot_diameter and not fits(result.marker, sheet):
        raise InputError(
            f"a marker that a page of {sheet.paper} holds",
            "holes beyond its disk",
            "use larger paper, or move the holes",
        )
    return spec, result


def _beyond(spec: Spec) -> float:
    """Maximum distance in mm of a quiet zone from the disk, which dots touch but for their clearance.

    The fewest of `--n auto` would have the largest dots.
    """
    spec = replace(spec, n=4) if spec.n == AUTO else spec
    if spec.dot == "auto":
        diameter = largest_that_leaves_room(spec)
        clearance = clearance_of(spec, diameter)
    else:
        size = choose_dots(spec, poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief))
        diameter, clearance = size.diameter, size.clearance
    return max(0.0, 1e3 * (diameter / 2 - clearance))
