"""Fabrication of a marker as a solid: the table of processes, and the user's choices."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, isfinite, pi
from typing import TYPE_CHECKING, Any, Literal

from markergen.errors import InputError, brief
from markergen.registry import Registry

if TYPE_CHECKING:
    from markergen.model.marker import Marker


@dataclass(frozen=True)
class Process:
    """A way to make the dots, the tag and the pillars of a marker, with everything that other modules need of it.

    Attributes
    ----------
    make : callable
        Function that makes a `markergen.workshop.processes.Made` of a designed marker and the `Fabrication`, or
        raises a one-line InputError.
    label : str
        Name on screen and paper, besides the one in the table: "milled".
    summary : str
        Short description for the list of processes in help, which otherwise shows the label.
    choices : tuple of str
        Supported choices, from `CHOICES`.
    balls : bool
        True if dots are spheres, whose diameters a drawing marks with an S.
    engraved : bool
        True if the machine cuts and engraves from a drawing of flat paths: a .dxf then shows the whole plate with
        `Made.marked`, and accompanies solids.
    """

    make: Callable[["Marker", "Fabrication"], Any]
    label: str
    summary: str = ""
    choices: tuple[str, ...] = ()
    balls: bool = False
    engraved: bool = False

    def __call__(self, marker: "Marker", fabrication: "Fabrication") -> Any:
        """See `make`."""
        return self.make(marker, fabrication)


PROCESSES: Registry[Process] = Registry("process", "markergen.workshop.processes", "markergen.processes", Process)
"""Processes by name. Their modules are in a higher layer, and are imported when one is looked up."""

DEFAULT_PROCESS = "fdm"

CHOICES = {"fit": "--fit", "through": "--through", "dome": "--dome"}
"""Choices that only some processes support, with their options."""

GENERAL_TOLERANCE = "ISO 2768-mK"
"""Medium for lengths and angles, K for form and position."""

LONGEST_ENTRY = 60
"""Maximum number of characters of an entry of the title block."""

DATUM = re.compile(r"A=face|[BC]=(?:H[1-9]\d{0,3}|edge|rim)")
"""A datum: B and C are holes by their names on the sheet, a straight edge or the rim."""

HOLE = re.compile(r"H[1-9]\d{0,3}:H(?:6|7|8|13)")
"""A hole by its name on the sheet, and its tolerance class (ISO 286)."""

SMALLEST_TOLERANCE, LARGEST_TOLERANCE = 1e-7, 1e-3
"""Limits for the tolerance of a mesh in m: finer ones take endless triangles, coarser ones show no dots."""


@dataclass(frozen=True)
class Fabrication:
    """Choices about making a solid; None and an empty string leave them to the process.

    Attributes
    ----------
    process : str
        Name of one of `PROCESSES`.
    depth : float or None
        Depth of pockets, engraving or recess, m.
    gap : float or None
        Gap between an inlay and the wall of its pocket all around, m.
    fit : {"", "slip", "press"}
        Fit of discs in milled pockets.
    through : bool
        True to make holes in place of pockets with discs.
    tool : float or None
        Diameter in m of the nozzle, end mill or beam: the smallest feature that it can make.
    dome : {"half", "ball"}
        Shape of balls on a plate.
    draft : float
        Angle in rad at which pillars widen toward the plate.
    foot : float
        Radius in m of the fillet around a pillar's foot.
    engrave : bool
        True to engrave name, spec hash, origin and x axis on the back.
    tolerance : float
        Maximum distance in m of a mesh from the true surface.
    material, general_tolerance : str
        Entries of the fabrication sheet's title block; an empty material leaves a field to fill in.
    datum : str
        Datum features of the fabrication sheet, such as ``A=face,B=H1,C=H6``; empty for those that suit the plate.
    hole : str
        Tolerance classes of holes by their names there, such as ``H1:H7``.

    Raises
    ------
    InputError
        If the process or a choice is unknown, a dimension is negative or not finite, or the process does not support a
        choice.
    """

    process: str = DEFAULT_PROCESS
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
    material: str = ""
    general_tolerance: str = GENERAL_TOLERANCE
    datum: str = ""
    hole: str = ""

    @property
    def shape_options(self) -> dict[str, Any]:
        """Choices that change a solid, by name, where they are not the defaults."""
        entries, usual = ("material", "general_tolerance", "datum", "hole"), Fabrication.__dataclass_fields__
        return {
            name: value for name, value in vars(self).items() if name not in entries and value != usual[name].default
        }

    @property
    def datums(self) -> dict[str, str]:
        """Names of the features by the letters of the datums."""
        return dict(entry.strip().split("=") for entry in self.datum.split(",") if entry)

    @property
    def fits(self) -> dict[str, str]:
        """Tolerance classes by the names of the holes."""
        return dict(entry.strip().split(":") for entry in self.hole.split(",") if entry)

    def __post_init__(self) -> None:
        for name, form, example in (("datum", DATUM, "A=face,B=H1,C=H6"), ("hole", HOLE, "H1:H7")):
            entries = [entry.strip() for entry in getattr(self, name).split(",") if getattr(self, name)]
            firsts = [entry[: 1 if name == "datum" else None].split(":")[0] for entry in entries]
            if not all(map(form.fullmatch, entries)) or len(set(firsts)) < len(firsts):
                only = {"datum": "A is the face with the dots", "hole": "classes are H6, H7, H8 and H13"}[name]
                raise InputError(
                    f"{name}s such as {example}", brief(getattr(self, name)), f"use --{name} {example}; {only}"
                )
        if self.datum and sorted(self.datums) not in (["A", "B"], ["A", "B", "C"], ["B"], ["B", "C"]):
            raise InputError("datum B, and perhaps C", brief(self.datum), "name B first: --datum A=face,B=H1,C=H6")
        # Formats without solids need no process: the default is valid without a look-up.
        if self.process != DEFAULT_PROCESS:
            PROCESSES[self.process]
        if self.fit not in ("", "slip", "press"):
            raise InputError("a fit of slip or press", repr(self.fit), "use --fit slip or --fit press")
        if self.dome not in ("half", "ball"):
            raise InputError("domes of half or ball", repr(self.dome), "use --dome half or --dome ball")
        for choice in CHOICES:
            if getattr(self, choice) != getattr(Fabrication, choice):
                check_choice(self.process, choice)
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
        for name, example in (("material", "EN AW-5083"), ("general_tolerance", GENERAL_TOLERANCE)):
            entry = getattr(self, name)
            if len(entry) > LONGEST_ENTRY or not (entry or name == "material") or not entry.isprintable():
                option = name.replace("_", "-")
                raise InputError(
                    f"a {option.replace('-', ' ')} in 1 to {LONGEST_ENTRY} characters on one line",
                    brief(entry),
                    f"use --{option} '{example}', for example",
                )
        if not 0 <= self.draft < pi / 4:
            raise InputError("a draft of 0 to below 45 degrees", f"{degrees(self.draft):.6g}", "use --draft 3")
        if not SMALLEST_TOLERANCE <= self.tolerance <= LARGEST_TOLERANCE:
            raise InputError(
                f"a tolerance of {SMALLEST_TOLERANCE * 1e6:g} um to {LARGEST_TOLERANCE * 1e6:g} um",
                f"tolerance={self.tolerance * 1e6:.6g} um",
                "use --tolerance 5um",
            )


def check_choice(process: str, choice: str) -> None:
    """Refuse one of `CHOICES` for a process that does not support it.

    Raises
    ------
    InputError
        If it does not, or there is no such process.
    """
    option = CHOICES[choice]
    if choice not in PROCESSES[process].choices:
        able = " or ".join(name for name in PROCESSES if choice in PROCESSES[name].choices)
        raise InputError(f"{option} with --process {able}", f"--process {process}", f"leave out {option}, or change it")
