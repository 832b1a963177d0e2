"""Solids in CAD formats: STEP and BREP, and the notes and accompanying files of all formats of solids."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from markergen.exporters import EXPORTERS, ExportOptions, Output, only, without_paper
from markergen.model.fabrication import PROCESSES
from markergen.model.marker import Marker, marker_name
from markergen.model.rig import Rig
from markergen.model.rig_json import rig_name
from markergen.solid.plate import plate_size
from markergen.workshop.cad_files import write_brep, write_step
from markergen.workshop.kernel import NamedSolid, solids_of
from markergen.workshop.processes import Made, parts_of
from markergen.workshop.rig_kernel import solids_of_rig
from markergen.workshop.rig_solids import RigMade, check_apart, designed, parts_of_rig

MADE = (".step", ".brep", ".stl", ".3mf")
"""Suffixes of solids that are made, in which plates must not overlap; others are looked at."""


@dataclass(frozen=True)
class Designed:
    """What a solid is made of: a marker as designed, or a rig of such markers.

    Attributes
    ----------
    notes : tuple of str
        Sentences for the user.
    beside : mapping
        Files that accompany the solid, by name.
    """

    name: str
    subject: Marker | Rig
    made: Made | RigMade
    notes: tuple[str, ...]
    beside: Mapping[str, bytes]

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the parts in their order."""
        return tuple(part.name for part in self.made.parts)


def designed_of(bodies: Sequence[Marker | Rig], options: ExportOptions, suffix: str) -> Designed:
    """Make the only marker of a format, or a rig.

    Raises
    ------
    InputError
        If there is not exactly one marker, or it cannot be made as requested.
    """
    body = only(bodies, suffix)
    if not isinstance(body, Marker):
        rig = designed(body)
        made = parts_of_rig(rig, options.fabrication)
        if suffix in MADE:
            check_apart(made)
        return Designed(rig_name(rig), rig, made, rig_notes(rig, made, options), {})
    marker = body.as_designed
    parts = parts_of(marker, options.fabrication)
    notes = solid_notes(marker, parts, options)
    return Designed(marker_name(marker), marker, parts, notes, beside_solid(marker, options))


def export_step(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One assembly of solids as STEP (AP214), in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".step")
    return Output(write_step(_solids(work.made), work.name), work.notes, work.beside)


def export_brep(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One compound of solids as BREP text, in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".brep")
    names = ", ".join(work.part_names[:4]) + (", ..." if len(work.part_names) > 4 else "")
    order = f"BREP has neither names nor colors: the solids are, in this order, {names}."
    return Output(write_brep(_solids(work.made)), (*work.notes, order), work.beside)


def _solids(made: Made | RigMade) -> tuple[NamedSolid, ...]:
    return solids_of(made.parts) if isinstance(made, Made) else solids_of_rig(made.parts)


def rig_notes(rig: Rig, made: RigMade, options: ExportOptions) -> tuple[str, ...]:
    """Sentences on the solids of a rig as designed."""
    process, count = options.fabrication.process, len(rig.markers)
    how = f"({process}: {PROCESSES[process].label})"
    points = np.concatenate([face.ring() for face in made.block]) if made.block else np.zeros((1, 3))
    size = " x ".join(f"{side:.6g}" for side in np.ptp(points, axis=0))
    said = (
        f"Made as one body of {size} mm with {count} of its {len(made.block)} faces marked {how}."
        if made.block
        else f"Made as an assembly of {count} plate{'s' * (count > 1)} {how}."
    )
    overlap = [f"Note that {made.overlap}."] if made.overlap else []
    return (said, *overlap, *made.notes, *without_paper(options))


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
