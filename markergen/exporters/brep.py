"""BREP: the parts as Open CASCADE holds them, for CAD programs built on it."""

from collections.abc import Sequence

from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.solids import beside_solid, solid_notes
from markergen.model.marker import Marker
from markergen.solid.cad_files import write_brep
from markergen.solid.kernel import solids_of
from markergen.solid.processes import parts_of


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """One compound of solids as BREP text, in mm; the paper is without effect."""
    marker = only(markers, ".brep").as_designed
    made = parts_of(marker, options.fabrication)
    data = write_brep(solids_of(made.parts))
    names = ", ".join(part.name for part in made.parts[:4]) + (", ..." if len(made.parts) > 4 else "")
    order = f"BREP has neither names nor colors: the solids are, in this order, {names}."
    return Output(data, (*solid_notes(marker, made, options), order), beside_solid(marker, options))
