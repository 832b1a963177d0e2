"""Exporters: the table of output formats by suffix, and what an entry is. A new format is a new file in `formats`."""

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
    """What a user may choose about an export.

    Attributes
    ----------
    sheet : SheetOptions
        Paper, margin, tiles and colors of printable formats.
    dpi : int
        Of pixel formats.
    fabrication : Fabrication
        How solids are made.
    stem : str
        Name of the file without folder and suffix, which files beside it are named after; `save` sets it.
    """

    sheet: SheetOptions = field(default_factory=SheetOptions)
    dpi: int = 600
    fabrication: Fabrication = field(default_factory=Fabrication)
    stem: str = "marker"


@dataclass(frozen=True)
class Output:
    """Bytes of one file, and sentences for the user about it.

    Attributes
    ----------
    data : bytes
    notes : tuple of str
    beside : mapping
        Further files that come with it: bytes by name relative to its folder, as in ``meshes/marker.glb``.
    """

    data: bytes
    notes: tuple[str, ...] = ()
    beside: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Exporter:
    """A format: how it is written, and what it holds.

    Attributes
    ----------
    write : callable or str
        Make one file's bytes of markers and `ExportOptions`, an `Output`, always the same ones for the same markers;
        refuse what the format cannot hold. As text, ``module:function``, which is imported when it is first needed.
    description : str
        What it is for, in a few words for a list of formats: "table of the dots, in m".
    holds : {"points", "flat", "solid"}
        Points with or without dots and relief; shapes in one plane, without relief; or the marker as a solid, or the
        drawing of one, which `ExportOptions.fabrication` is for.
    sheet : bool
        Whether it is printed on paper: several markers share it, and `ExportOptions.sheet` is for it.
    many_pages : bool
        Whether it holds several sheets.
    kernel : bool
        Whether it needs the CAD kernel.
    check : callable, str or None
        Refuse `ExportOptions` before any work is done; as text like `write`.
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
        """Place in a list of formats: on paper, in a plane, by the kernel, other solids, points."""
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
"""The one format that holds all of a marker."""


def catalog() -> list[tuple[tuple[str, ...], str]]:
    """Suffixes and what they are for, one row for each description, sheets first; loads nothing that writes them."""
    rows: dict[tuple[int, str], list[str]] = {}
    for suffix, exporter in EXPORTERS.items():
        rows.setdefault((exporter._rank, exporter.description), []).append(suffix)
    return [(tuple(suffixes), words) for (_, words), suffixes in sorted(rows.items(), key=lambda row: row[0][0])]


def suffix_of(path: Path) -> str:
    """Longest ending of a file's name that is a known suffix, in lower case.

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
        EXPORTERS[path.suffix.lower()]  # says which ones there are
    return str(known)


def stem_of(path: Path) -> str:
    """Name of a file without its suffix: ``marker`` of ``out/marker.fab.pdf``."""
    return path.name[: -len(suffix_of(path))]


def only(markers: Sequence["Marker"], suffix: str = "this format") -> "Marker":
    """Return the one marker of a format that holds no more.

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    if len(markers) != 1:
        raise InputError(f"one marker for {suffix}", f"{len(markers)}", "write them one at a time, or as .pdf")
    return markers[0]


def without_paper(options: ExportOptions) -> tuple[str, ...]:
    """A sentence for formats without paper, where what was asked for sheets would be expected of them too."""
    return ("Drawn as designed: --compensate is for sheets.",) if options.sheet.compensate else ()
