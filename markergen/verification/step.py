"""STEP and BREP: what the CAD kernel makes of them."""

from markergen.model.marker import Marker
from markergen.solid.reading import read_brep, read_step
from markergen.solid.surface import Surface
from markergen.verification.reading import READERS, Reading
from markergen.verification.solids import reading_of


@READERS.register(".step", ".stp")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Parts of a STEP file, with their names and colors, moved to where assemblies have them."""
    return reading_of("STEP", Surface(read_step(data, name)))


@READERS.register(".brep")
def read_native(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001
    """Parts of a BREP file."""
    return reading_of("BREP", Surface(read_brep(data, name)))
