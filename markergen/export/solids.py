"""What the formats of solids share: words about the parts, and the drawing that comes with an engraved plate."""

from markergen.export import EXPORTERS, ExportOptions, without_paper
from markergen.model.marker import Marker
from markergen.solid.make import Parts
from markergen.solid.plate import plate_size

LABEL = {
    "fdm": "two-material print",
    "cnc": "milled",
    "laser": "engraved",
    "print": "plate for a printed sheet",
    "dome": "with domes",
}
"""What a process makes, in words."""


def solid_notes(marker: Marker, parts: Parts, options: ExportOptions) -> tuple[str, ...]:
    """Sentences on what is made, from the marker as it was designed."""
    plates = sum(part.name.startswith("plate") for part in parts.parts)
    others = len(parts.parts) - plates
    what = f"{'a plate' if plates == 1 else f'{plates} plates'} {plate_size(marker)}"
    thick = f"{marker.substrate.thickness * 1e3:.6g} mm thick"
    rest = f", and {others} part{'s' * (others > 1)} to go with {'it' if plates == 1 else 'them'}" if others else ""
    made = f"Made as {what} and {thick}{rest} ({options.fabrication.process}: {LABEL[options.fabrication.process]})."
    return (made, *parts.notes, *without_paper(options))


def beside_solid(marker: Marker, options: ExportOptions) -> dict[str, bytes]:
    """What comes with a solid: of an engraved plate the DXF that the laser works from."""
    if options.fabrication.process != "laser":
        return {}
    return {f"{options.stem}.dxf": EXPORTERS[".dxf"]((marker,), options).data}
