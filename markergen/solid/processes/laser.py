"""``laser``: dots and tag engraved into a plate, dark."""

from markergen.model.fabrication import PROCESSES, Fabrication, Process
from markergen.model.marker import Marker
from markergen.solid.bodies import cylinder
from markergen.solid.inlays import Cutting, prepare, tag_marks
from markergen.solid.limits import depth_of, tool_of
from markergen.solid.processes import Made

DEPTH = 0.1
"""Of the engraving in mm."""

BEAM = 0.1
"""Width of a laser's line in mm."""


def laser(marker: Marker, fabrication: Fabrication) -> Made:
    """Engraved faces without inlays; the DXF beside the solid has the same outlines to engrave and to cut."""
    tool = tool_of(fabrication, "beam", BEAM)
    cutting = Cutting(tool, depth_of(marker, fabrication, DEPTH, "an engraving"))
    ground = prepare(marker, fabrication, cutting, lambda dot: dot.radius)
    marks = tuple(
        cylinder(dot.x, dot.y, dot.radius, round(dot.z - cutting.depth, 9), dot.z, dot.inner) for dot in ground.dots
    )
    lines = [
        f"Engrave the dots{' and the tag' if marker.tag else ''} {cutting.depth:.6g} mm deep or less, dark on light: "
        "anodized aluminum bleaches, so take a laminate with a dark core, or marking ink.",
        "The middle of the beam goes half its width inside of the outlines: they are the edges of what is dark.",
    ]
    if ground.pillars:
        lines.append("Focus on each dot's own height before it is engraved.")
    return Made(
        marked=(*marks, *tag_marks(marker, cutting)),
        add=ground.pillars,
        notes=ground.notes,
        lines=tuple(lines),
        tolerances=(("dot centers, from each other", "+/- 0.05 mm"), ("dot diameters", "+/- 0.1 mm")),
        depth=cutting.depth,
    )


PROCESSES.register("laser")(Process(laser, "engraved plate", engraved=True))
