"""``laser``: dots and tag engraved dark into a plate."""
# tests: tests/contracts/test_processes.py

from markergen.model.fabrication import PROCESSES, Fabrication, Process
from markergen.model.marker import Marker
from markergen.workshop.manufacturability import depth_of, tool_of
from markergen.workshop.processes import Accuracy, Cutting, Made, marks, prepare

DEPTH = 0.1
"""Depth of the engraving in mm."""

BEAM = 0.1
"""Width of a laser's line in mm."""


def laser(marker: Marker, fabrication: Fabrication) -> Made:
    """Engrave without inlays; the DXF written with the solid has the same outlines to engrave and to cut."""
    tool = tool_of(fabrication, "beam", BEAM)
    cutting = Cutting(tool, depth_of(marker, fabrication, DEPTH, "an engraving"))
    ground = prepare(marker, fabrication, cutting, lambda dot: dot.radius)
    lines = [
        f"Engrave the dots{' and the tag' if marker.tag else ''} {cutting.depth:.6g} mm deep or less, dark on light: "
        "anodized aluminum bleaches, so take a laminate with a dark core, or marking ink.",
        "The middle of the beam goes half its width inside of the outlines: they are the edges of what is dark.",
    ]
    if ground.pillars:
        lines.append("Focus on each dot's own height before it is engraved.")
    return Made(
        marked=marks(marker, ground.dots, cutting),
        add=ground.pillars,
        notes=ground.notes,
        lines=tuple(lines),
        accuracy=Accuracy(position=0.1, depth=0.0, height=0.05, finish="as supplied, matte"),
        depth=cutting.depth,
    )


PROCESSES.register("laser")(
    Process(laser, "engraved plate", "dots and tag engraved dark, and a .dxf to work from", engraved=True)
)
