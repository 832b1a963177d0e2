"""What the mesh formats share: a marker's parts as meshes, and words about them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from markergen.drawing.scene import marker_name
from markergen.export import ExportOptions, only
from markergen.export.solids import solid_notes
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.marker_json import to_json
from markergen.solid.build import COLORS, build
from markergen.solid.make import Parts, parts_of
from markergen.solid.mesh import Mesh, mesh_of

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
    made: Parts
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
    marker, fabrication = only(markers, suffix).as_designed, options.fabrication
    # One marker is often written in several formats, one after the other.
    key = (to_json(marker), fabrication)
    if key not in _LAST:
        _LAST.clear()
        _LAST[key] = _meshed(marker, fabrication)
    last = _LAST[key]
    return replace(last, notes=(*solid_notes(marker, last.made, options), *last.notes))


_LAST: dict[tuple[bytes, Fabrication], Meshed] = {}
"""The marker that was made last, by its record and how it was made; no other."""


def _meshed(marker: Marker, fabrication: Fabrication) -> Meshed:
    made, tolerance = parts_of(marker, fabrication), fabrication.tolerance * 1e3
    # One after the other, so that no more than one solid is held along with its triangles.
    parts = tuple(MeshedPart(part.name, part.material, mesh_of(build(part), tolerance)) for part in made.parts)
    closeness = f"The mesh is within {tolerance * 1e3:.6g} um of the solid (--tolerance)."
    return Meshed(marker_name(marker), parts, made, (closeness,))
