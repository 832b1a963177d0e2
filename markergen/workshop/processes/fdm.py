"""``fdm``: a two-material 3-D print, dark inlays flush in a light plate."""
# tests: tests/workshop/test_assembly.py

from markergen.model.fabrication import PROCESSES, Fabrication, Process
from markergen.model.marker import Marker
from markergen.workshop.dot_geometry import dots_of
from markergen.workshop.manufacturability import depth_of, gap_of, tool_of
from markergen.workshop.processes import FACE_DOWN, Accuracy, Cutting, Made, inlaid, prepare

DEPTH = 0.6
"""Depth of the inlays in mm: three layers of 0.2 mm, enough to be opaque."""

NOZZLE = 0.4
"""Nozzle diameter in mm of most printers, and their line width."""


def fdm(marker: Marker, fabrication: Fabrication) -> Made:
    """Make inlays, without a gap for printers that change materials; with a gap they are printed apart and inserted."""
    tool = tool_of(fabrication, "nozzle", NOZZLE)
    gap = gap_of(fabrication, 0.0, dots_of(marker))
    cutting = Cutting(tool, depth_of(marker, fabrication, DEPTH, "inlays"), gap=lambda _: gap)
    ground = prepare(marker, fabrication, cutting, lambda dot: dot.radius + gap)
    parts, pockets = inlaid(marker, ground, cutting)
    how = (
        f"Print plate and inlays apart, and put the inlays into their pockets: there is a gap of {gap:.6g} mm all "
        "around them."
        if gap
        else "Print plate and inlays in one go, light and dark material; they share their walls."
    )
    face = "Print with the face up: raised dots stand on pillars." if ground.pillars else FACE_DOWN
    return Made(
        parts,
        pockets,
        add=ground.pillars,
        notes=ground.notes,
        lines=(
            how,
            face,
            f"Nozzle {tool.size:.6g} mm or finer; inlays {cutting.depth:.6g} mm deep, solid, in layers of 0.2 mm or "
            "a divisor of the depth.",
            "Both materials matte. Do not scale the parts; print a measured length, and correct it in the slicer.",
        ),
        accuracy=Accuracy(
            position=0.2,
            play=gap,
            thickness=0.2,
            height=0.2,
            flatness=0.3,
            finish="as printed, matte",
            edges="as printed, no burrs",
        ),
        depth=cutting.depth,
    )


PROCESSES.register("fdm")(Process(fdm, "3-D print in two materials", "dark inlays flush in a light plate"))
