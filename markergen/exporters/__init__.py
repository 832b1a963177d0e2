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


@dataclass(frozen=True)
class ExportOptions:
    """User options of an export.

    Attributes
    ----------
    sheet : SheetOptions
        Paper, margin, tiles and colors of printable formats.
    dpi : int
        Resolution of pixel formats.
    fabrication : Fabrication
        Fabrication of solids.
    stem : str
        File name without folder and suffix, from which accompanying files are named; set by `save`.
    """

    sheet: SheetOptions = field(default_factory=SheetOptions)
    dpi: int = 600
    fabrication: Fabrication = field(default_factory=Fabrication)
    stem: str = "marker"


@dataclass(frozen=True)
class Output:
    """Bytes of a file, and sentences for the user about it.

    Attributes
    ----------
    data : bytes
    notes : tuple of str
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
        Turns markers and `ExportOptions` into an `Output`, with the same bytes for the same markers; rejects markers
        that the format cannot represent. As text, ``module:function``, imported when first needed.
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

    write: Callable[[Sequence["Marker"], "ExportOptions"], "Output"] | str
    description: str
    holds: Literal["points", "flat", "solid"] = "points"
    sheet: bool = False
    many_pages: bool = False
    kernel: bool = False
    check: Callable[["ExportOptions"], None] | str | None = None

    def __call__(self, markers: Sequence["Marker"], options: "ExportOptions") -> "Output":
        """See `write`."""
        made: Output = _function(self.write)(markers, options)
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
    "output suffix", "markergen.exporters.formats", "markergen.exporters", Exporter
)
"""Exporters by suffix with its dot, in lower case; a suffix may have two parts (``.opencv.yaml``)."""

RECORD = ".json"
"""Suffix of the only format that stores a marker completely."""


def catalog() -> list[tuple[tuple[str, ...], str]]:
    """Suffixes and their purpose, one row per description, sheets first; loads no writers."""
    rows: dict[tuple[int, str], list[str]] = {}
    for suffix, exporter in EXPORTERS.items():
        rows.setdefault((exporter._rank, exporter.description), []).append(suffix)
    return [(tuple(suffixes), words) for (_, words), suffixes in sorted(rows.items(), key=lambda row: row[0][0])]


def suffix_of(path: Path) -> str:
    """Return the longest known suffix of a file name, in lower case.

    Raises
    ------
    InputError
        If there is none; the message lists the known ones.
    """
    parts = path.name.lower().split(".")
    endings = ("." + ".".join(parts[first:]) for first in range(1, len(parts)))
    known = next((ending for ending in endings if ending in EXPORTERS), None)
    if not path.suffix:
        known_ones = ", ".join(EXPORTERS.names())
        raise InputError("a known output suffix", f"none in {brief(str(path))}", f"known: {known_ones}")
    if known is None:
        EXPORTERS[path.suffix.lower()]  # the error lists the known suffixes
    return str(known)


def stem_of(path: Path) -> str:
    """File name without its suffix: ``marker`` for ``out/marker.fab.pdf``."""
    return path.name[: -len(suffix_of(path))]


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
