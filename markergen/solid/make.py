"""The marker as parts to make: a plate, and what the process puts into it, on it, or takes from it."""

from dataclasses import replace
from functools import lru_cache

from markergen.geometry.region import Region
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate_checks import check_holes
from markergen.solid.build import NamedSolid, build
from markergen.solid.engraving import engraving
from markergen.solid.plate import face_of, plate_parts, plate_regions, with_cuts
from markergen.solid.processes import Made


def parts_of(marker: Marker, fabrication: Fabrication) -> Made:
    """All parts of a marker as it was designed, the plates first, without any CAD kernel.

    Raises
    ------
    InputError
        If something is below what the process can make, or does not fit onto the plate; one line.
    """
    marker = marker.as_designed
    regions = plate_regions(marker)
    face = face_of(regions, marker.substrate.chamfer * 1e3)
    check_holes(marker, Region(face).mapped(lambda mm: mm / 1e3))
    made: Made = PROCESSES[fabrication.process](marker, fabrication)
    plates = with_cuts(plate_parts(marker, made.face), made.cut, made.marked, made.add)
    notes = made.notes
    if fabrication.engrave:
        bottom = made.face - marker.substrate.thickness * 1e3
        cut = [body for plate in plates for body in (*plate.cut, *plate.marked)]
        engraved = engraving(marker, face_of(regions), bottom, cut)
        plates = with_cuts(plates, engraved.cut)
        notes = (*notes, *engraved.notes)
    return replace(made, parts=(*plates, *made.parts), notes=notes)


# Several files of one marker are written one after the other, and the kernel is what takes the time.
@lru_cache(maxsize=1)
def solids_of(made: Made) -> tuple[NamedSolid, ...]:
    """All parts as the CAD kernel makes them; raises as `build` does."""
    return tuple(map(build, made.parts))
