"""Options of the plate and of how a marker is made, which ``design`` and ``export`` share."""

from dataclasses import replace
from math import radians
from typing import TYPE_CHECKING, Annotated, Any

import typer

from markergen.cli.console import length

if TYPE_CHECKING:
    from markergen.model.fabrication import Fabrication
    from markergen.model.marker import Marker

Thickness = Annotated[
    float | None, typer.Option(parser=length, metavar="LENGTH", help="Of the plate of solids. [default: 3mm]")
]
Edge = Annotated[
    float | None,
    typer.Option(
        parser=length,
        metavar="LENGTH",
        help="Least width of the plate outside of a disk or a rectangle; a drawing is the plate. [default: 2mm]",
    ),
]
CornerRadius = Annotated[
    float | None,
    typer.Option(parser=length, metavar="LENGTH", help="Of the plate's corners, seen from above. [default: 0mm]"),
]
Chamfer = Annotated[
    float | None,
    typer.Option(parser=length, metavar="LENGTH", help="Around the plate's upper face, 45 degrees. [default: 0mm]"),
]
Outline = Annotated[
    str | None,
    typer.Option(
        metavar="SHAPE|FILE[#LAYER]",
        help="The plate's own outline, holes and all, instead of the boundary's: rect:0.3x0.2, or a "
        "drawing in the marker frame, which moves with the boundary that --boundary takes from one.",
    ),
]
Mount = Annotated[
    list[str] | None,
    typer.Option(
        metavar="HOLES",
        help="Mounting holes: 4xM3@120mm on a pitch circle, 4xM3@120mm/0 with the first one at 0 degrees, 4xM3c@120mm "
        "countersunk, 4x3.4mm@120mm by diameter, or M3:40mm,-20mm;-40mm,-20mm; may be repeated.",
    ),
]
Dowel = Annotated[
    list[str] | None,
    typer.Option(
        metavar="HOLES", help="Holes for dowel pins on the x axis: 2x4mm@130mm, or as --mount; may be repeated."
    ),
]
Process = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="How solids are made: fdm, two materials; cnc, pockets and discs; laser, engraved; print, a recess for a "
        "printed sheet; dome, half-balls or balls. [default: fdm]",
    ),
]
Depth = Annotated[
    float | None,
    typer.Option(
        parser=length, metavar="LENGTH", help="Of pockets, engraving or recess. [default: the process decides]"
    ),
]
Gap = Annotated[
    float | None,
    typer.Option(
        parser=length, metavar="LENGTH", help="Between an inlay and its pocket. [default: the process decides]"
    ),
]
Fit = Annotated[
    str | None, typer.Option(metavar="NAME", help="Of discs in milled pockets: slip or press. [default: slip]")
]
Through = Annotated[bool, typer.Option("--through", help="Holes for dots in place of milled pockets and discs.")]
Tool = Annotated[
    float | None,
    typer.Option(
        parser=length, metavar="LENGTH", help="Diameter of nozzle, mill or beam. [default: the process decides]"
    ),
]
Dome = Annotated[str | None, typer.Option(metavar="NAME", help="For --process dome: half or ball. [default: half]")]
Draft = Annotated[
    float | None,
    typer.Option(metavar="DEGREES", help="By which pillars of a relief widen toward the plate. [default: 0]"),
]
Foot = Annotated[
    float | None,
    typer.Option(parser=length, metavar="LENGTH", help="Radius of the fillet around a pillar's foot. [default: 1mm]"),
]
Engrave = Annotated[
    bool,
    typer.Option(
        "--engrave/--no-engrave", help="Name, spec, numbers, origin and x axis engraved on the back of the plate."
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(parser=length, metavar="LENGTH", help="Of meshes, from the surface they stand for. [default: 5um]"),
]


def fabrication(
    process: str | None,
    depth: float | None = None,
    gap: float | None = None,
    fit: str | None = None,
    through: bool = False,
    tool: float | None = None,
    dome: str | None = None,
    draft: float | None = None,
    foot: float | None = None,
    engrave: bool = True,
    tolerance: float | None = None,
) -> "Fabrication":
    """Collect what was asked for; raises `InputError` for what there is not."""
    from markergen.errors import InputError
    from markergen.model.fabrication import Fabrication

    if dome is not None and process != "dome":
        raise InputError(
            "--dome with --process dome", f"--process {process or 'fdm'}", "leave out --dome, or change it"
        )
    given = {
        "process": process, "depth": depth, "gap": gap, "fit": fit, "through": through, "tool": tool, "dome": dome,
        "draft": None if draft is None else radians(draft), "foot": foot, "engrave": engrave, "tolerance": tolerance,
    }  # fmt: skip
    return Fabrication(**{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]


def plate_values(
    thickness: float | None,
    edge: float | None,
    corner_radius: float | None,
    chamfer: float | None,
    mount: list[str] | None,
    dowel: list[str] | None,
) -> dict[str, Any]:
    """Collect what was asked for, as a spec's ``substrate`` table has it."""
    given = {
        "thickness": thickness, "edge": edge, "corner_radius": corner_radius, "chamfer": chamfer,
        "mount": mount or None, "dowel": dowel or None,
    }  # fmt: skip
    return {name: value for name, value in given.items() if value is not None}


def with_plate(marker: "Marker", values: dict[str, Any], outline: str | None, unit: str | None) -> "Marker":
    """Marker with what is given of its plate (see `plate_values`) instead of its own.

    Mounting holes take the place of all mounting holes, and dowel holes that of all dowel holes.

    Raises
    ------
    InputError
        For what there is not, and for a plate that the marker's dots do not allow.
    """
    from markergen.model.holes import parse_dowel, parse_mount
    from markergen.model.substrate_checks import check_edge, check_holes
    from markergen.read.outlines import read_room

    measures = {name: value for name, value in values.items() if name not in ("mount", "dowel")}
    shapes = read_room(None, [] if outline is None else [outline], unit)[1]
    if not (values or shapes):
        return marker
    holes = [hole for hole in marker.substrate.holes if hole.use not in values]
    holes += [hole for text in values.get("mount", ()) for hole in parse_mount(text)]
    holes += [hole for text in values.get("dowel", ()) for hole in parse_dowel(text)]
    # As a design lists them.
    holes.sort(key=lambda hole: hole.use == "dowel")
    plate = replace(marker.substrate, **measures, holes=tuple(holes), outline=(*shapes, marker.substrate.outline)[0])
    if "edge" in values:
        check_edge(plate, marker.boundary)
    changed = replace(marker, substrate=plate)
    check_holes(changed)
    return changed
