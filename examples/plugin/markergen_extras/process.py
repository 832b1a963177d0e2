"""``--process etch``: dots etched into a coated plate through a photographic mask."""

from markergen.model.fabrication import Fabrication, Process
from markergen.model.marker import Marker
from markergen.workshop.manufacturability import depth_of, tool_of
from markergen.workshop.processes import Accuracy, Cutting, Made, marks, prepare

DEPTH, FINEST = 0.05, 0.05
"""Depth of the etching, and minimum line width of the mask, mm."""


def etch(marker: Marker, fabrication: Fabrication) -> Made:
    """Shallow dark faces without inlays, drawn in the DXF of the mask that accompanies the solid."""
    tool = tool_of(fabrication, "line", FINEST)
    cutting = Cutting(tool, depth_of(marker, fabrication, DEPTH, "an etching"))
    ground = prepare(marker, fabrication, cutting, lambda dot: dot.radius)
    return Made(
        marked=marks(marker, ground.dots, cutting),
        add=ground.pillars,
        notes=ground.notes,
        lines=(f"Etch the dots {cutting.depth:.6g} mm deep and fill them with black lacquer.",),
        accuracy=Accuracy(position=0.02, diameter=0.02, depth=0.02, finish="as coated"),
        depth=cutting.depth,
    )


ETCH = Process(etch, "etched plate", "dots etched into a coated plate, and a .dxf of the mask", engraved=True)
