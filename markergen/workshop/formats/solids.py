"""Solids in CAD formats: STEP and BREP, and the notes and accompanying files of all formats of solids."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from markergen.exporters import EXPORTERS, ExportOptions, Output, only, without_paper
from markergen.model.body import Body
from markergen.model.fabrication import PROCESSES
from markergen.model.marker import Marker, marker_name
from markergen.model.rig import Rig
from markergen.model.rig_json import rig_name
from markergen.solid.plate import plate_size
from markergen.workshop.assembly import MadeBody, check_apart, designed, made_of
from markergen.workshop.cad_files import cadquery_assembly, write_brep, write_step
from markergen.workshop.kernel import solids_of
from markergen.workshop.processes import Made

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
    made: MadeBody
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
    body = designed(only(bodies, suffix))
    made = made_of(body, options.fabrication)
    if suffix in MADE:
        check_apart(made)
    name = marker_name(body) if isinstance(body, Marker) else rig_name(body)
    return Designed(name, body, made, solid_notes(body, made, options), _beside(body, options))


def export_step(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One assembly of solids as STEP (AP214), in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".step")
    return Output(write_step(solids_of(work.made.parts), work.name), work.notes, work.beside)


def export_brep(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One compound of solids as BREP text, in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".brep")
    names = ", ".join(work.part_names[:4]) + (", ..." if len(work.part_names) > 4 else "")
    order = f"BREP has neither names nor colors: the solids are, in this order, {names}."
    return Output(write_brep(solids_of(work.made.parts)), (*work.notes, order), work.beside)


def assembly_of(body: Marker | Rig, options: ExportOptions) -> Any:
    """Return the solids of a body as a `cadquery.Assembly`, which raises as `export_step` does."""
    work = designed_of([body], options, ".step")
    return cadquery_assembly(solids_of(work.made.parts), work.name)


def solid_notes(body: Body, made: MadeBody, options: ExportOptions) -> tuple[str, ...]:
    """Sentences on the solid, for the body as designed."""
    process = options.fabrication.process
    how = f"({process}: {PROCESSES[process].label})"
    first, count = body.plates[0].marker, len(body.plates)
    what = _of_rig(made, count) if body.frame == "rig" else _of_marker(first, made.made[0])
    overlap = [f"Note that {made.overlap}."] if made.overlap else []
    return (f"Made as {what} {how}.", *overlap, *made.notes, *without_paper(options))


def _of_rig(made: MadeBody, count: int) -> str:
    if not made.block:
        return f"an assembly of {count} plate{'s' * (count > 1)}"
    size = " x ".join(f"{side:.6g}" for side in np.ptp(np.concatenate([face.ring() for face in made.block]), axis=0))
    return f"one body of {size} mm with {count} of its {len(made.block)} faces marked"


def _of_marker(marker: Marker, made: Made) -> str:
    plates = sum(part.is_plate for part in made.parts)
    others = len(made.parts) - plates
    what = f"{'a plate' if plates == 1 else f'{plates} plates'} {plate_size(marker)}"
    rest = f", and {others} part{'s' * (others > 1)} to go with {'it' if plates == 1 else 'them'}" if others else ""
    return f"{what} and {marker.substrate.thickness * 1e3:.6g} mm thick{rest}"


def _beside(body: Body, options: ExportOptions) -> dict[str, bytes]:
    """Files that accompany a solid: for an engraved plate the DXF for the machine."""
    if body.frame == "rig" or not PROCESSES[options.fabrication.process].engraved:
        return {}
    return {f"{options.stem}.dxf": EXPORTERS[".dxf"](body, options).data}
