"""Solids in CAD formats: STEP and BREP, and the notes and accompanying files of all formats of solids."""

from collections.abc import Sequence

from markergen.exporters import EXPORTERS, ExportOptions, Output, only, without_paper
from markergen.model.fabrication import PROCESSES
from markergen.model.marker import Marker, marker_name
from markergen.solid.cad_files import write_brep, write_step
from markergen.solid.kernel import solids_of
from markergen.solid.plate import plate_size
from markergen.solid.processes import Made, parts_of


def export_step(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """One assembly of solids as STEP (AP214), in mm; paper options have no effect."""
    marker = only(markers, ".step").as_designed
    made = parts_of(marker, options.fabrication)
    data = write_step(solids_of(made.parts), marker_name(marker))
    return Output(data, solid_notes(marker, made, options), beside_solid(marker, options))


def export_brep(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """One compound of solids as BREP text, in mm; paper options have no effect."""
    marker = only(markers, ".brep").as_designed
    made = parts_of(marker, options.fabrication)
    data = write_brep(solids_of(made.parts))
    names = ", ".join(part.name for part in made.parts[:4]) + (", ..." if len(made.parts) > 4 else "")
    order = f"BREP has neither names nor colors: the solids are, in this order, {names}."
    return Output(data, (*solid_notes(marker, made, options), order), beside_solid(marker, options))


def solid_notes(marker: Marker, made: Made, options: ExportOptions) -> tuple[str, ...]:
    """Sentences on the solid, for the marker as designed."""
    plates = sum(part.is_plate for part in made.parts)
    others = len(made.parts) - plates
    what = f"{'a plate' if plates == 1 else f'{plates} plates'} {plate_size(marker)}"
    thick = f"{marker.substrate.thickness * 1e3:.6g} mm thick"
    rest = f", and {others} part{'s' * (others > 1)} to go with {'it' if plates == 1 else 'them'}" if others else ""
    process = options.fabrication.process
    sentence = f"Made as {what} and {thick}{rest} ({process}: {PROCESSES[process].label})."
    return (sentence, *made.notes, *without_paper(options))


def beside_solid(marker: Marker, options: ExportOptions) -> dict[str, bytes]:
    """Files that accompany a solid: for an engraved plate the DXF for the machine."""
    if not PROCESSES[options.fabrication.process].engraved:
        return {}
    return {f"{options.stem}.dxf": EXPORTERS[".dxf"]((marker,), options).data}
