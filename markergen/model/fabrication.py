"""How a marker is made as a solid: the process, and what of it a user may choose."""

from dataclasses import dataclass
from typing import Literal

PROCESSES = ("fdm", "cnc", "laser", "print", "dome")
"""Two-material 3-D print, milled pockets with discs, engraved plate, recess for a sheet, half-balls or balls."""


@dataclass(frozen=True)
class Fabrication:
    """Choices about making a solid; None and an empty word leave them to the process.

    Attributes
    ----------
    process : str
        One of `PROCESSES`.
    depth : float or None
        Of pockets, of what is engraved, or of the recess, m.
    gap : float or None
        Between an inlay and the wall of its pocket all around, m.
    fit : {"", "slip", "press"}
        Of discs in milled pockets.
    through : bool
        Holes in place of milled pockets with discs.
    tool : float or None
        Diameter in m of nozzle, mill or beam: the smallest feature that it can make.
    dome : {"half", "ball"}
    draft : float
        Angle in rad by which pillars widen toward the plate.
    foot : float
        Radius in m of the fillet around a pillar's foot.
    engrave : bool
        Whether name, spec hash, origin and x-axis are engraved on the back.
    tolerance : float
        Largest distance in m of a mesh from the surface it stands for.
    """

    process: str = "fdm"
    depth: float | None = None
    gap: float | None = None
    fit: Literal["", "slip", "press"] = ""
    through: bool = False
    tool: float | None = None
    dome: Literal["half", "ball"] = "half"
    draft: float = 0.0
    foot: float = 0.001
    engrave: bool = True
    tolerance: float = 5e-6
