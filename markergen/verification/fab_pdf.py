"""Fabrication sheets are no artefacts: drawn to scale, with every number in a table of what goes into the solid."""

from markergen.errors import InputError, brief
from markergen.model.marker import Marker
from markergen.verification.reading import READERS, Reading


@READERS.register(".fab.pdf")
def read(data: bytes, name: str, marker: Marker) -> Reading:
    """Refuse a drawing to scale, of which no dot can be measured."""
    del data, marker
    raise InputError(
        "a file with the marker at true size",
        f"the fabrication sheet {brief(name)}, a drawing to scale",
        "verify the solid that goes with it: .step, .3mf, .stl or .glb",
    )
