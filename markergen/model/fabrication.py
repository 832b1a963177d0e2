"""How a marker is made as a solid: the process, and what of it a user may choose."""

from dataclasses import dataclass
from math import degrees, isfinite, pi
from typing import Literal

from markergen.errors import InputError

PROCESSES = {
    "fdm": "3-D print in two materials",
    "cnc": "milled",
    "laser": "engraved plate",
    "print": "plate with a recess for a printed sheet",
    "dome": "balls on a plate",
}
"""Processes, and what they are called on screen and paper."""

SMALLEST_TOLERANCE, LARGEST_TOLERANCE = 1e-7, 1e-3
"""Of a mesh in m: finer ones have no end of triangles, coarser ones show no dots."""


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

    Raises
    ------
    InputError
        If the process or a choice is unknown, a measure is negative or not finite, or a choice is made that another
        process is for.
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

    def __post_init__(self) -> None:
        if self.process not in PROCESSES:
            raise InputError("a known process", repr(self.process), f"known: {', '.join(PROCESSES)}")
        if self.fit not in ("", "slip", "press"):
            raise InputError("a fit of slip or press", repr(self.fit), "use --fit slip or --fit press")
        if self.dome not in ("half", "ball"):
            raise InputError("domes of half or ball", repr(self.dome), "use --dome half or --dome ball")
        for name, given, process in (
            ("--fit", self.fit, "cnc"),
            ("--through", self.through, "cnc"),
            ("--dome ball", self.dome == "ball", "dome"),
        ):
            if given and self.process != process:
                raise InputError(
                    f"{name} with --process {process}", f"--process {self.process}", f"leave out {name}, or change it"
                )
        for name, zero, example in (
            ("depth", False, "0.6mm"),
            ("gap", True, "0.1mm"),
            ("tool", False, "0.4mm"),
            ("foot", True, "1mm"),
        ):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and (value > 0 or (zero and value == 0))):
                least = "of 0 or more" if zero else "above 0"
                raise InputError(f"a {name} {least}", f"{name}={value} m", f"use --{name} {example}, for example")
        if not 0 <= self.draft < pi / 4:
            raise InputError("a draft of 0 to below 45 degrees", f"{degrees(self.draft):.6g}", "use --draft 3")
        if not SMALLEST_TOLERANCE <= self.tolerance <= LARGEST_TOLERANCE:
            raise InputError(
                f"a tolerance of {SMALLEST_TOLERANCE * 1e6:g} um to {LARGEST_TOLERANCE * 1e6:g} um",
                f"tolerance={self.tolerance * 1e6:.6g} um",
                "use --tolerance 5um",
            )
