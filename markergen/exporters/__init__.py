"""Exporters: the table of output formats by suffix, and its entries. A new format is a new file in `formats`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError, brief
from markergen.model.fabrication import Fabrication
from markergen.registry import Registry

if TYPE_CHECKING:
    from markergen.model.marker import Marker
    from markergen.model.rig import Rig


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
        Resolution of pixel formats.
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
        Turns a sequence of markers, or a rig in the table of rigs, and `ExportOptions` into an `Output`, with the same
        bytes for the same input; rejects what the format cannot represent. As text, ``module:function``, imported when
        first needed.
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
    """

    write: Callable[[Any, "ExportOptions"], "Output"] | str
    description: str
    holds: Literal["points", "flat", "solid"] = "points"
    sheet: bool = False
    many_pages: bool = False
    kernel: bool = False
    check: Callable[["ExportOptions"], None] | str | None = None

    def __call__(self, what: "Sequence[Marker] | Rig", options: "ExportOptions") -> "Output":
        """See `write`."""
        made: Output = _function(self.write)(what, options)
        return made

    def refuse(self, options: "ExportOptions") -> None:
        """See `check`."""
        if self.check is not None:
            _function(self.check)(options)

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

RIG_EXPORTERS: Registry[Exporter] = Registry(
    "output suffix for a rig", "markergen.exporters.rigs markergen.workshop.table", "markergen.rig_exporters", Exporter
)
"""Exporters of a whole rig, by suffix as in `EXPORTERS`; their `write` takes a `Rig` instead of markers."""

RECORD = ".json"
"""Suffix of the only format that stores a marker, or a rig, completely."""


def catalog(table: Registry[Exporter] = EXPORTERS) -> list[tuple[tuple[str, ...], str]]:
    """Suffixes and their purpose, one row per description, sheets first; loads no writers."""
    rows: dict[tuple[int, str], list[str]] = {}
    for suffix, exporter in table.items():
        rows.setdefault((exporter._rank, exporter.description), []).append(suffix)
    return [(tuple(suffixes), words) for (_, words), suffixes in sorted(rows.items(), key=lambda row: row[0][0])]


def suffix_of(path: Path, table: Registry[Exporter] = EXPORTERS) -> str:
    """Return the longest suffix of a file name that a table knows, in lower case.

    Raises
    ------
    InputError
        If there is none; the message lists the known ones.
    """
    parts = path.name.lower().split(".")
    endings = ("." + ".".join(parts[first:]) for first in range(1, len(parts)))
    known = next((ending for ending in endings if ending in table), None)
    if not path.suffix:
        known_ones = ", ".join(table.names())
        raise InputError(f"a known {table.kind}", f"none in {brief(str(path))}", f"known: {known_ones}")
    if known is None:
        table[path.suffix.lower()]  # the error lists the known suffixes
    return str(known)


def stem_of(path: Path, table: Registry[Exporter] = EXPORTERS) -> str:
    """File name without its suffix: ``marker`` for ``out/marker.fab.pdf``."""
    return path.name[: -len(suffix_of(path, table))]


def only(markers: Sequence["Marker"], suffix: str = "this format") -> "Marker":
    """Return the only marker, for a format that holds just one.

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    if len(markers) != 1:
        raise InputError(f"one marker for {suffix}", f"{len(markers)}", "write them one at a time, or as .pdf")
    return markers[0]


def without_paper(options: ExportOptions) -> tuple[str, ...]:
    """Note for formats without paper, if the user requested compensation, which applies only to sheets."""
    return ("Drawn as designed: --compensate is for sheets.",) if options.sheet.compensate else ()
