"""What the formats of solids share: words about the parts, and the drawing that comes with an engraved plate."""

from markergen.exporters import EXPORTERS, ExportOptions, without_paper
from markergen.model.fabrication import PROCESSES
from markergen.model.marker import Marker
from markergen.solid.plate import plate_size
from markergen.solid.processes import Made


def solid_notes(marker: Marker, made: Made, options: ExportOptions) -> tuple[str, ...]:
    """Sentences on what is made, from the marker as it was designed."""
    plates = sum(part.is_plate for part in made.parts)
    others = len(made.parts) - plates
    what = f"{'a plate' if plates == 1 else f'{plates} plates'} {plate_size(marker)}"
    thick = f"{marker.substrate.thickness * 1e3:.6g} mm thick"
    rest = f", and {others} part{'s' * (others > 1)} to go with {'it' if plates == 1 else 'them'}" if others else ""
    process = options.fabrication.process
    sentence = f"Made as {what} and {thick}{rest} ({process}: {PROCESSES[process].label})."
    return (sentence, *made.notes, *without_paper(options))


def beside_solid(marker: Marker, options: ExportOptions) -> dict[str, bytes]:
    """What comes with a solid: of an engraved plate the DXF that the machine works from."""
    if not PROCESSES[options.fabrication.process].engraved:
        return {}
    return {f"{options.stem}.dxf": EXPORTERS[".dxf"]((marker,), options).data}
