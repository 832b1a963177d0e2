"""STEP: the marker as named and colored parts, to machine or to print in two materials."""

from collections.abc import Sequence

from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.solids import beside_solid, solid_notes
from markergen.model.marker import Marker, marker_name
from markergen.solid.cad_files import write_step
from markergen.solid.kernel import solids_of
from markergen.solid.processes import parts_of


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """One assembly of solids as STEP (AP214), in mm; the paper is without effect."""
    marker = only(markers, ".step").as_designed
    made = parts_of(marker, options.fabrication)
    data = write_step(solids_of(made.parts), marker_name(marker))
    return Output(data, solid_notes(marker, made, options), beside_solid(marker, options))
