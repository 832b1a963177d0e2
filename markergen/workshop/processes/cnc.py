"""``cnc``: milled pockets with turned or milled discs, or through holes."""
# tests: tests/contracts/test_processes.py

from math import ceil

from markergen.errors import InputError
from markergen.model.fabrication import PROCESSES, Fabrication, Process
from markergen.model.marker import Marker
from markergen.solid.primitives import Part, Primitive, cylinder, mm
from markergen.units import format_length
from markergen.workshop.dot_geometry import SolidDot, cell_of, dots_of
from markergen.workshop.iso286 import DiscFit, core_fit, disc_fit
from markergen.workshop.manufacturability import depth_of, gap_of, tool_of
from markergen.workshop.processes import Accuracy, Cutting, Made, inlay, prepare, tag_inlays

DEPTH = 1.0
"""Depth of the pockets in mm; a disc of that thickness stays flat."""

MILLS = (3.0, 2.0, 1.5, 1.0, 0.8, 0.5)
"""Diameters in mm of common end mills; by default the largest that makes every feature is used."""

POSITION = 0.04
"""Diameter in mm of the zone for the axes of pockets and holes."""

WALL = 0.5
"""Minimum wall in mm between pockets that does not deflect under the mill."""


def cnc(marker: Marker, fabrication: Fabrication) -> Made:
    """Mill pockets for slip- or press-fitted discs of the dots' nominal sizes; tag corners have the mill's radius."""
    dots = dots_of(marker)
    kind = fabrication.fit or "slip"
    gap = gap_of(fabrication, 0.0, dots)
    by_iso = fabrication.gap is None
    if fabrication.fit and not by_iso:
        raise InputError(
            "a fit of ISO 286 or a gap of your own",
            f"--fit {fabrication.fit} and --gap {format_length(gap / 1e3)}",
            "leave one of them out",
        )

    def gap_for(diameter: float) -> float:
        # For the tag the nominal size is that of a cell.
        size = diameter or (cell_of(marker.tag) if marker.tag else 0.0)
        return disc_fit(kind, size).gap if by_iso else gap

    def open_(dot: SolidDot) -> bool:
        return fabrication.through and not dot.inner

    inlaid = [dot for dot in dots if not open_(dot)]
    bottom = -mm(marker.substrate.thickness)
    tool = tool_of(fabrication, "mill", _mill(marker, dots), WALL)
    # A sheet with only through holes may be arbitrarily thin.
    depth = depth_of(marker, fabrication, DEPTH, "pockets") if inlaid or marker.tag else -bottom
    cutting = Cutting(tool, depth, tool.size / 2, gap_for)
    ground = prepare(
        marker, fabrication, cutting, lambda dot: dot.radius + gap_for(0 if open_(dot) else 2 * dot.radius)
    )
    parts: list[Part] = []
    cut: list[Primitive] = []
    for dot in dots:
        if open_(dot):
            cut.append(cylinder(dot.x, dot.y, dot.radius, bottom, dot.z))
            continue
        inlay_parts, pocket = inlay(dot, cutting)
        parts += inlay_parts
        cut.append(pocket)
    in_tag, tag_pockets = tag_inlays(marker, cutting)
    diameters = sorted({round(2 * dot.radius, 6) for dot in inlaid}, reverse=True)
    fits = {diameter: disc_fit(kind, diameter) for diameter in diameters} if by_iso else {}
    return Made(
        (*parts, *in_tag),
        (*cut, *tag_pockets),
        add=ground.pillars,
        notes=(*ground.notes, *_notes(marker, fabrication, parts)),
        lines=_lines(marker, fabrication, cutting, fits, bool(parts or in_tag)),
        accuracy=Accuracy(
            position=POSITION,
            play=max((fit.play for fit in fits.values()), default=gap if parts else 0.0),
            diameter=0.05,
            depth=0.03,
            thickness=0.1,
            height=0.03,
            flatness=0.1,
            finish="Ra 1.6",
        ),
        # Together with the excess depth of the pockets.
        tolerances=(("thickness of inlays", "0 / -0.02 mm"), ("inlays, from the face", "0 / -0.05 mm"))
        if parts or in_tag
        else (),
        fits=(
            *(("dot", fit) for fit in fits.values()),
            *(("core", core_fit(kind, bore)) for bore in sorted({2 * dot.inner for dot in inlaid if by_iso} - {0.0})),
        ),
        depth=-bottom if fabrication.through else depth,
    )


PROCESSES.register("cnc")(
    Process(cnc, "milled", "pockets with discs that fit them, or through holes", choices=("fit", "through"))
)


def _mill(marker: Marker, dots: tuple[SolidDot, ...]) -> float:
    """Largest common mill that makes the pockets, the bores of rings, and the tag; the smallest if none does."""
    features = [2 * (dot.inner or dot.radius) for dot in dots]
    if marker.tag:
        features.append(cell_of(marker.tag) - WALL)
    return next((size for size in MILLS if size <= min(features)), MILLS[-1])


def _notes(marker: Marker, fabrication: Fabrication, parts: list[Part]) -> tuple[str, ...]:
    if not fabrication.through:
        return ()
    kept = [part.name for part in parts if part.material == "dark"] + ["the tag"] * (marker.tag is not None)
    exceptions = f" but for {' and '.join(kept)}, whose light insides would fall out" if kept else ""
    return (f"Dots are holes through the plate{exceptions}. Put something dark and matte behind it.",)


def _lines(
    marker: Marker, fabrication: Fabrication, cutting: Cutting, fits: dict[float, DiscFit], inlaid: bool
) -> tuple[str, ...]:
    tool, lines = cutting.tool, []
    if inlaid:
        lines.append(
            f"End mill of {tool.size:.6g} mm or smaller; pockets {cutting.depth:.6g} mm deep with a flat floor."
        )
    if inlaid and fabrication.gap is not None:
        lines.append(f"Pockets are {fabrication.gap * 1e3:.6g} mm larger than their discs all around, as drawn.")
    elif fits and fabrication.fit == "press":
        lines.append(
            "Press fit P7/h6 (ISO 286): discs and pockets are drawn at their nominal size; "
            "chamfer the lower rims of the discs."
        )
    elif fits:
        play = max(fit.play for fit in fits.values())
        lines.append(
            "Slip fit F8/h7 (ISO 286): discs are drawn at their nominal size, pockets with the least clearance; glue "
            f"the discs in, centered: they may lie off by up to {ceil(play * 1e3 - 1e-9) / 1e3:.3f} mm."
        )
    if marker.tag:
        gap = f"; pockets are {cutting.tag_gap:.6g} mm larger all around" if cutting.tag_gap else ""
        lines.append(f"The tag's corners are rounded by {cutting.corner:.6g} mm on inlays and pockets alike{gap}.")
    if fabrication.through:
        lines.append("Break no edge of the holes on the face: their upper rims are the dots.")
    lines.append(
        "Plate light and matte, discs dark and matte: black anodized, or painted before they are put in, with the "
        "sizes here when finished."
        if inlaid
        else "Plate light and matte, with something dark and matte behind it."
    )
    return tuple(lines)
