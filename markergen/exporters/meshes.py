"""What the mesh formats share: a marker's parts as meshes, and words about them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from markergen.exporters import ExportOptions, only
from markergen.exporters.solids import solid_notes
from markergen.model.marker import Marker, marker_name
from markergen.solid.bodies import COLORS
from markergen.solid.kernel import solids_of
from markergen.solid.mesh import Mesh, mesh_of
from markergen.solid.processes import Made, parts_of

MATERIALS = tuple(COLORS)
"""Names of the materials, in the order in which the formats list them."""


@dataclass(frozen=True)
class MeshedPart:
    """A part's name, its material, and its surface in mm, marker frame."""

    name: str
    material: str
    mesh: Mesh


@dataclass(frozen=True)
class Meshed:
    """A marker's name, its parts as meshes and as bodies, and sentences for the user."""

    name: str
    parts: tuple[MeshedPart, ...]
    made: Made
    notes: tuple[str, ...]


def meshed(markers: Sequence[Marker], options: ExportOptions, suffix: str) -> Meshed:
    """Make the one marker of a mesh format.

    Raises
    ------
    InputError
        If there is not just one marker, or it cannot be made as asked for.
    OutputError
        If the kernel fails.
    MissingLibraryError
        If cadquery or a system library it needs is missing.
    """
    marker = only(markers, suffix).as_designed
    made, tolerance = parts_of(marker, options.fabrication), options.fabrication.tolerance * 1e3
    closeness = f"The mesh is within {tolerance * 1e3:.6g} um of the solid (--tolerance)."
    notes = (*solid_notes(marker, made, options), closeness)
    return Meshed(marker_name(marker), _meshes(made, tolerance), made, notes)


# Of several formats of one marker all but the first have their meshes at once.
@lru_cache(maxsize=1)
def _meshes(made: Made, tolerance: float) -> tuple[MeshedPart, ...]:
    return tuple(MeshedPart(each.name, each.material, mesh_of(each, tolerance)) for each in solids_of(made.parts))
