"""Bodies made into solids by Open CASCADE: one named and colored solid per part, in mm, marker frame."""

from dataclasses import dataclass
from typing import Any

from markergen.errors import OutputError
from markergen.solid.bodies import Part, part_volume
from markergen.solid.kernel import import_cadquery, joined, solid_of

COLORS = {"light": (1.0, 1.0, 1.0), "dark": (0.05, 0.05, 0.05)}
"""Red, green, blue from 0 to 1 of a material, sRGB."""

SAME = 1e-5
"""How far the kernel's volume of a part may be off the closed form, as a share."""


@dataclass(frozen=True)
class NamedSolid:
    """One part as the CAD kernel holds it.

    Attributes
    ----------
    name : str
        As in `Part`.
    material : {"light", "dark"}
    color : (red, green, blue)
        From 0 to 1, sRGB.
    shape : cadquery.Solid
        In mm, marker frame: the face of the plate is z = 0, the plate is below.
    marked : tuple of cadquery.Face
        Faces of `shape` that have the other material's color.
    """

    name: str
    material: str
    color: tuple[float, float, float]
    shape: Any
    marked: tuple[Any, ...] = ()


def build(part: Part) -> NamedSolid:
    """Make one part.

    Raises
    ------
    OutputError
        If the kernel makes no valid solid of it, or one of another volume than the part has.
    MissingLibraryError
        If cadquery or a system library it needs is missing.
    """
    cadquery = import_cadquery()
    try:
        made, floors = joined(*([solid_of(body) for body in bodies] for bodies in (part.add, part.cut, part.marked)))
        shape = cadquery.Solid(made)
        volume = shape.Volume()
        sound = shape.isValid() and abs(volume - part_volume(part)) <= SAME * abs(volume)
    except Exception as error:
        # Open CASCADE raises errors of many classes, none of them Python's.
        raise _failed(part, " ".join(str(error).split()) or type(error).__name__) from None
    if not sound:
        raise _failed(part, f"{volume:.9g} mm^3 instead of {part_volume(part):.9g} mm^3")
    return NamedSolid(part.name, part.material, COLORS[part.material], shape, tuple(map(cadquery.Face, floors)))


def _failed(part: Part, found: str) -> OutputError:
    return OutputError(
        f"expected Open CASCADE to make a valid solid of the part {part.name!r}, found {found}; change the depth, "
        "the thickness or the outline a little"
    )
