"""``dome``: hemispheres, or balls on necks, centered on the control points."""
# tests: tests/contracts/test_processes.py

from math import acos, asin, pi, sqrt, tan

from markergen.errors import InputError
from markergen.geometry.contour import Contour
from markergen.model.fabrication import PROCESSES, Fabrication, Process
from markergen.model.marker import Marker
from markergen.solid.plate import Footprint, plate_of
from markergen.solid.primitives import Part, Primitive, Revolved, cylinder
from markergen.workshop.dot_geometry import SolidDot, dots_of
from markergen.workshop.manufacturability import check_apart, check_dots, depth_of, gap_of, tool_of
from markergen.workshop.processes import Accuracy, Cutting, Made, prepare, tag_inlays
from markergen.workshop.relief import balls_hide, designed_poses

DEPTH = 2.0
"""Depth of the plugs in mm."""

FEATURE, WALL = 0.4, 0.5
"""Minimum feature and minimum wall in mm."""

PLUG, NECK = 0.5, 0.4
"""Radius of a hemisphere's plug and of a ball's neck, in ball radii."""

STAND = 0.5
"""Distance from the plate to the centers of balls in the plane, in radii."""


def dome(marker: Marker, fabrication: Fabrication) -> Made:
    """Make balls of the dots' diameters, whose image centers do not depend on the viewing direction."""
    dots = dots_of(marker)
    gap = gap_of(fabrication, 0.0, dots)
    tool = tool_of(fabrication, "tool", FEATURE, WALL)
    depth = depth_of(marker, fabrication, DEPTH, "plugs")
    cutting = Cutting(tool, depth, gap=lambda _: gap)
    made = (
        _balls(marker, cutting, dots, gap) if fabrication.dome == "ball" else _halves(marker, fabrication, cutting, gap)
    )
    poses = designed_poses(marker)
    hidden = balls_hide(dots, poses) if poses is not None else 0
    notes = made.notes
    if poses is not None and hidden:
        notes += (f"In {hidden} of the {len(poses)} poses a ball covers a part of another one.",)
    return Made(
        made.parts,
        made.cut,
        add=made.add,
        notes=notes,
        lines=(
            *made.lines,
            "Balls dark, plate and core light, all matte. A key dot is a dark ring on a light core: glue both.",
        ),
        accuracy=Accuracy(
            position=0.04, play=gap, diameter=0.02, thickness=0.1, height=0.03, flatness=0.1, finish="Ra 1.6"
        ),
        depth=depth,
        face=made.face,
    )


PROCESSES.register("dome")(
    Process(dome, "balls on a plate", "half-balls, or balls on necks, on a plate", choices=("dome",), balls=True)
)


def _halves(marker: Marker, fabrication: Fabrication, cutting: Cutting, gap: float) -> Made:
    """Hemispheres that stand on the plate or on pillars, held by plugs."""
    ground = prepare(marker, fabrication, cutting, lambda dot: dot.radius)
    parts: list[Part] = []
    cut: list[Primitive] = []
    for dot in ground.dots:
        bottom = round(dot.z - cutting.depth, 9)
        plug = dot.inner - gap if dot.inner else PLUG * dot.radius
        cut.append(cylinder(dot.x, dot.y, plug + gap, bottom, dot.z))
        r, inner, z = dot.radius, dot.inner, dot.z
        if inner:
            ring = _revolved(dot, (inner, z), (r, z, acos(inner / r)), (inner, z + _rise(r, inner)))
            over = (plug, z + _rise(r, plug), asin(plug / r))
            core = _revolved(dot, (0.0, bottom), (plug, bottom), over, (0.0, z + r))
            parts += [Part(dot.name, "dark", (ring,)), Part(f"{dot.name}-core", "light", (core,))]
        else:
            half = _revolved(dot, (0.0, bottom), (plug, bottom), (plug, z), (r, z, pi / 2), (0.0, z + r))
            parts.append(Part(dot.name, "dark", (half,)))
    in_tag, tag_pockets = tag_inlays(marker, cutting)
    return Made(
        (*parts, *in_tag),
        (*cut, *tag_pockets),
        add=ground.pillars,
        notes=ground.notes,
        lines=(
            f"Half-balls stand on the face, their plugs {cutting.depth:.6g} mm deep in it; the middle of a ball is in "
            "the plane of its foot.",
        ),
    )


def _balls(marker: Marker, cutting: Cutting, dots: tuple[SolidDot, ...], gap: float) -> Made:
    """Whole balls on necks, with the plate below them."""
    if marker.tag is not None:
        raise InputError(
            "a marker without a tag for balls, which stand on a plate below the plane",
            f"the tag {marker.tag}",
            "use --dome half, or design it without --tag",
        )
    check_dots(dots, cutting.tool)
    face = -round((1 + STAND) * max(dot.radius for dot in dots), 6)
    bottom = face - cutting.depth
    parts: list[Part] = []
    cut: list[Primitive] = []
    prints = []
    for dot in dots:
        neck = min(NECK * dot.radius, 0.8 * (dot.inner - gap)) if dot.inner else NECK * dot.radius
        cut.append(cylinder(dot.x, dot.y, neck + gap, bottom, face))
        # Nor may the balls touch each other or the screws in the holes.
        prints.append(Footprint(dot.name, ((dot.x, dot.y),), dot.radius))
        r, inner, z = dot.radius, dot.inner, dot.z
        foot = ((0.0, bottom), (neck, bottom))
        if inner:
            half, rise = acos(inner / r), _rise(r, inner)
            ring = _revolved(dot, (inner, z - rise, half), (r, z, half), (inner, z + rise))
            wide = inner - gap
            under = (neck, z - _rise(r, neck), acos(neck / r) - acos(wide / r))
            over = (wide, z + _rise(r, wide), asin(wide / r))
            core = _revolved(dot, *foot, under, (wide, z - _rise(r, wide)), over, (0.0, z + r))
            parts += [Part(dot.name, "dark", (ring,)), Part(f"{dot.name}-core", "light", (core,))]
        else:
            ball = _revolved(dot, *foot, (neck, z - _rise(r, neck), acos(neck / r)), (r, z, pi / 2), (0.0, z + r))
            parts.append(Part(dot.name, "dark", (ball,)))
    check_apart(marker, plate_of(marker), prints, cutting.tool)
    return Made(
        tuple(parts),
        tuple(cut),
        notes=(f"The plate's face is {-face:.6g} mm below the plane of the control points, the balls' middles.",),
        lines=(f"Balls stand on necks; the plate's face is at z = {face:.6g} mm, the middles of balls at their z.",),
        face=face,
    )


def _revolved(dot: SolidDot, *corners: tuple[float, ...]) -> Revolved:
    """Body of revolution about a dot's axis: radii and heights, and angles in rad of the arcs that begin there."""
    bulges = (tan(corner[2] / 4) if len(corner) > 2 else 0.0 for corner in corners)
    return Revolved(dot.x, dot.y, Contour(tuple((r, z) for r, z, *_ in corners), tuple(bulges)))


def _rise(radius: float, within: float) -> float:
    """Height of a ball's surface above its center at a distance from its axis."""
    return sqrt(radius**2 - within**2)
