"""Exporters: the table of output formats by suffix, and its entries. A new format is a new file in `formats`."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, TypeVar

from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError, among, brief
from markergen.model.body import Body
from markergen.model.fabrication import Fabrication
from markergen.registry import Registry

B = TypeVar("B", bound=Body)


LEAST_DPI, MOST_DPI = 10, 10_000
"""Limits of the resolution: pixels of 2.54 mm, in which no dot is round, and of 2.54 um, finer than printers."""


def check_dpi(dpi: float) -> None:
    """Refuse a resolution in pixels per inch that is not between `LEAST_DPI` and `MOST_DPI`."""
    if not LEAST_DPI <= dpi <= MOST_DPI:
        raise InputError(f"a dpi of {LEAST_DPI} to {MOST_DPI}", f"dpi={dpi:g}", "use 300 or 600")


@dataclass(frozen=True)
class ExportOptions:
    """User options of an export.

    Attributes
    ----------
    sheet : SheetOptions
        Paper, margin, tiles and colors of printable formats.
    net : bool
        True to draw the paper net of a rig's body instead of its faces one by one.
    dpi : int
        Resolution of pixel formats, `LEAST_DPI` to `MOST_DPI`.
    fabrication : Fabrication
        Fabrication of solids.
    stem : str
        File name without folder and suffix, from which accompanying files are named; set by `save`.
    """

    sheet: SheetOptions = field(default_factory=SheetOptions)
    net: bool = False
    dpi: int = 600
    fabrication: Fabrication = field(default_factory=Fabrication)
    stem: str = "marker"

    def __post_init__(self) -> None:
        check_dpi(self.dpi)

    def beside(self, records: Sequence[str]) -> "ExportOptions":
        """Options of sheets whose commands name these files of the bodies, in their order; unchanged without any."""
        return replace(self, sheet=replace(self.sheet, records=tuple(records))) if records else self


@dataclass(frozen=True)
class Output:
    """Bytes of a file, and sentences for the user about it.

    Attributes
    ----------
    beside : mapping
        Accompanying files: bytes by name relative to the file's folder, such as ``meshes/marker.glb``.
    """

    data: bytes
    notes: tuple[str, ...] = ()
    beside: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Exporter:
    """Output format: its writer and its properties.

    Attributes
    ----------
    write : callable or str
        Turns a sequence of bodies, one or more markers or the only rig, and `ExportOptions` into an `Output`, with the
        same bytes for the same input; rejects what the format cannot represent. As text, ``module:function``, imported
        when first needed.
    description : str
        Purpose in a few words for a list of formats: "table of the dots, in m".
    holds : {"points", "flat", "solid"}
        Points with or without dots and relief; shapes in one plane, without relief; or the marker as a solid, or a
        drawing of it, to which `ExportOptions.fabrication` applies.
    sheet : bool
        True if it is printed on paper: several markers share it, and `ExportOptions.sheet` applies.
    many_pages : bool
        True if it can hold several sheets.
    kernel : bool
        True if it needs the CAD kernel.
    check : callable, str or None
        Rejects invalid `ExportOptions` before any work is done; as text like `write`.
    rig_description : str
        Purpose for a rig; empty if it holds markers alone.
    parts : callable, str or None
        Of a solid whose parts can be compared: takes a body and a `Fabrication`, and returns the parts and a function
        that meshes them within a tolerance in mm; as text like `write`.
    """

    write: Callable[[Any, "ExportOptions"], "Output"] | str
    description: str
    holds: Literal["points", "flat", "solid"] = "points"
    sheet: bool = False
    many_pages: bool = False
    kernel: bool = False
    check: Callable[["ExportOptions"], None] | str | None = None
    rig_description: str = ""
    parts: Callable[[Body, Fabrication], tuple[Sequence[Any], Callable[[float], Sequence[Any]]]] | str | None = None

    def __call__(self, bodies: Body | Sequence[Body], options: "ExportOptions") -> "Output":
        """See `write`."""
        output: Output = _function(self.write)((bodies,) if isinstance(bodies, Body) else bodies, options)
        return output

    def refuse(self, options: "ExportOptions") -> None:
        """See `check`."""
        if self.check is not None:
            _function(self.check)(options)

    def parts_of(self, body: Body, fabrication: Fabrication) -> tuple[Sequence[Any], Callable[[float], Sequence[Any]]]:
        """See `parts`."""
        assert self.parts is not None
        parts: tuple[Sequence[Any], Callable[[float], Sequence[Any]]] = _function(self.parts)(body, fabrication)
        return parts

    def purpose(self, frame: str) -> str:
        """Return the description for bodies of a frame, ``marker`` or ``rig``; empty if it does not hold them."""
        return self.rig_description if frame == "rig" else self.description

    @property
    def _rank(self) -> int:
        """Rank in a list of formats: printed on paper, flat, made by the kernel, other solids, points."""
        return 0 if self.sheet else {"flat": 1, "solid": 3 - self.kernel, "points": 4}[self.holds]


def _function(named: Callable[..., Any] | str) -> Callable[..., Any]:
    if not isinstance(named, str):
        return named
    module, _, name = named.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function


EXPORTERS: Registry[Exporter] = Registry(
    "output suffix", "markergen.exporters.formats markergen.workshop.table", "markergen.exporters", Exporter
)
"""Exporters by suffix with its dot, in lower case; a suffix may have two parts (``.opencv.yaml``)."""

_FORMER: Registry[Exporter] = Registry("output suffix for a rig", "", "markergen.rig_exporters", Exporter)
"""Exporters of a rig as plug-ins of the release before have them; they go with the next."""

RECORD = ".json"
"""Suffix of the only format that stores a marker, or a rig, completely."""


def __getattr__(name: str) -> Any:
    if name != "RIG_EXPORTERS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn(
        "markergen.exporters.RIG_EXPORTERS is now EXPORTERS, whose entries with a rig_description take a rig",
        DeprecationWarning,
        stacklevel=2,
    )
    for suffix, exporter in EXPORTERS.items():
        if exporter.rig_description and suffix not in _FORMER:
            _FORMER.register(suffix)(replace(exporter, description=exporter.rig_description))
    return _FORMER


def _of_former(suffix: str) -> Exporter:
    former = _FORMER[suffix]

    def write(bodies: Sequence[Body], options: ExportOptions) -> Output:
        output: Output = _function(former.write)(only(bodies, suffix), options)
        return output

    return replace(former, write=write, rig_description=former.description)


def exporters_of(frame: str = "marker") -> dict[str, Exporter]:
    """Exporters by suffix that hold bodies of a frame, ``marker`` or ``rig``; loads no writers."""
    exporters = {suffix: exporter for suffix, exporter in EXPORTERS.items() if exporter.purpose(frame)}
    former = [suffix for suffix in _FORMER if suffix not in exporters] if frame == "rig" else []
    return exporters | {suffix: _of_former(suffix) for suffix in former}


def exporter_of(suffix: str, frame: str = "marker") -> Exporter:
    """Return the exporter with that suffix for bodies of a frame.

    Raises
    ------
    InputError
        If there is none; the message lists the known suffixes.
    """
    if suffix in EXPORTERS and EXPORTERS[suffix].purpose(frame):
        return EXPORTERS[suffix]
    if frame == "rig" and suffix in _FORMER:
        return _of_former(suffix)
    raise InputError(f"a known {_kind(frame)}", repr(suffix), among(suffix, sorted(exporters_of(frame))))


def _kind(frame: str) -> str:
    return f"{EXPORTERS.kind} for a rig" if frame == "rig" else EXPORTERS.kind


def catalog(frame: str = "marker") -> list[tuple[tuple[str, ...], str]]:
    """Suffixes for bodies of a frame and their purpose, one row per description, sheets first; loads no writers."""
    rows: dict[tuple[int, str], list[str]] = {}
    for suffix, exporter in exporters_of(frame).items():
        rows.setdefault((exporter._rank, exporter.purpose(frame)), []).append(suffix)
    return [(tuple(suffixes), purpose) for (_, purpose), suffixes in sorted(rows.items(), key=lambda row: row[0][0])]


def suffix_of(path: Path, frame: str = "marker") -> str:
    """Return the longest suffix of a file name that bodies of a frame are written to, in lower case.

    Raises
    ------
    InputError
        If there is none; the message lists the known ones.
    """
    parts = path.name.lower().split(".")
    for first in range(1, len(parts)):
        ending = "." + ".".join(parts[first:])
        if (ending in EXPORTERS and EXPORTERS[ending].purpose(frame)) or (frame == "rig" and ending in _FORMER):
            return ending
    if not path.suffix:
        suffixes = ", ".join(sorted(exporters_of(frame)))
        inside = f"name a file in it, such as {path / frame}.json" if path.is_dir() else f"known: {suffixes}"
        actual = f"the folder {brief(str(path))}" if path.is_dir() else f"none in {brief(str(path))}"
        raise InputError(f"a known {_kind(frame)}", actual, inside)
    exporter_of(path.suffix.lower(), frame)  # the error lists the known suffixes
    return path.suffix.lower()


def stem_of(path: Path, frame: str = "marker") -> str:
    """File name without its suffix: ``marker`` for ``out/marker.fab.pdf``."""
    return path.name[: -len(suffix_of(path, frame))]


def only(bodies: Sequence[B], suffix: str = "this format") -> B:
    """Return the only marker, or the rig, for a format that holds just one.

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    if len(bodies) != 1:
        raise InputError(f"one marker for {suffix}", f"{len(bodies)}", "write them one at a time, or as .pdf")
    return bodies[0]


def without_paper(options: ExportOptions) -> tuple[str, ...]:
    """Note for formats without paper, if the user requested compensation, which applies only to sheets."""
    return ("Drawn as designed: --compensate is for sheets.",) if options.sheet.compensate else ()
