"""Exporters: a table by output suffix, and the one `save` that writes any of them atomically."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError, OutputError, brief
from markergen.files import Written, check_folder, folders_for, write_all
from markergen.files import check_outputs as check_files
from markergen.model.fabrication import Fabrication
from markergen.model.marker import check_supported
from markergen.registry import Registry
from markergen.units import format_length

if TYPE_CHECKING:
    from markergen.drawing.scene import Sheet
    from markergen.model.marker import Marker
    from markergen.model.spec import Spec


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


def save(
    markers: "Marker | Sequence[Marker]",
    paths: Sequence[Path],
    options: ExportOptions | None = None,
    inputs: Sequence[Path] = (),
) -> list[Written]:
    """Write a marker or several to each path, in the format that its suffix names: all files or none.

    Parameters
    ----------
    markers : Marker or sequence of Marker
    paths : sequence of Path
    options : ExportOptions, optional
    inputs : sequence of Path
        Files that must not be written over, not even by one that comes with another.

    Returns
    -------
    list of Written
        Paths and notes in the order given, and after them the files that come with others.

    Raises
    ------
    InputError
        If a suffix is unknown (the message lists the known ones), a path is given twice, or a format refuses the
        markers; nothing is written.
    OutputError
        If a file cannot be written, or two would have one name; every target is as it was.
    """
    return write(outputs_of(markers, paths, options), inputs)


def outputs_of(
    markers: "Marker | Sequence[Marker]", paths: Sequence[Path], options: ExportOptions | None = None
) -> dict[Path, Output]:
    """Make what `save` writes, by path; raises as `save` does."""
    choices = options or ExportOptions()
    every = tuple(markers) if isinstance(markers, Sequence) else (markers,)
    check_outputs(paths, choices)
    for path in paths:
        if suffix_of(path) != RECORD:
            for marker in every:
                check_supported(marker, f"for {suffix_of(path)}", joint=False)
    return {path: EXPORTERS[suffix_of(path)](every, replace(choices, stem=stem_of(path))) for path in paths}


def write(outputs: Mapping[Path, Output], inputs: Sequence[Path] = ()) -> list[Written]:
    """Write outputs and the files that come with them, all or none; see `save`."""
    files = {path: output.data for path, output in outputs.items()}
    beside = _beside(outputs)
    check_files(list(outputs), inputs)
    with folders_for(beside):
        check_files(list(beside), inputs)
        write_all({**files, **beside})
    return [Written(path, output.notes) for path, output in outputs.items()] + [Written(path) for path in beside]


def _beside(outputs: Mapping[Path, Output]) -> dict[Path, bytes]:
    """Files that come with outputs, by path; those that are asked for themselves are not among them.

    Raises
    ------
    OutputError
        If two outputs bring different files of one name, or one brings what is asked for as something else.
    """
    asked = {path.resolve(): output.data for path, output in outputs.items()}
    found: dict[Path, tuple[Path, bytes]] = {}
    for path, output in outputs.items():
        for name, data in output.beside.items():
            target = path.parent / name
            _, known = found.setdefault(target.resolve(), (target, asked.get(target.resolve(), data)))
            if known != data:
                raise OutputError(
                    f"expected to write {target}, which comes with {path}, found another output of that name; "
                    "nothing was changed, choose another path for one of them"
                )
    return {target: data for real, (target, data) in found.items() if real not in asked}


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


def one_page(markers: Sequence["Marker"], options: ExportOptions, suffix: str) -> "Sheet":
    """Lay markers out on the single page that a format holds.

    Raises
    ------
    InputError
        If they need several; also as `pages_for` does.
    """
    from markergen.drawing.sheet_layout import pages_for

    pages = pages_for(markers, options.sheet)
    if len(pages) != 1:
        raise InputError(
            f"one page for {suffix}", f"{len(pages)} pages on {pages[0].paper}", "use .pdf, or a larger --paper"
        )
    return pages[0]


def with_record(paths: Sequence[Path]) -> list[Path]:
    """Add the marker.json that always comes with a design, named after the first path, if it is not among them."""
    first = paths[0]
    if not first.name:
        return list(paths)
    record = first.with_name(first.name.removesuffix(_ending(first)) + RECORD)
    return list(paths) if record.resolve() in {path.resolve() for path in paths} else [*paths, record]


def _ending(path: Path) -> str:
    """Suffix as written, known or not."""
    try:
        return path.name[-len(suffix_of(path)) :]
    except InputError:
        return path.suffix


def without_paper(options: ExportOptions) -> tuple[str, ...]:
    """A sentence for formats without paper, where what was asked for sheets would be expected of them too."""
    return ("Drawn as designed: --compensate is for sheets.",) if options.sheet.compensate else ()


def check_outputs(paths: Sequence[Path], options: ExportOptions, spec: "Spec | None" = None) -> None:
    """Refuse what cannot be written before any work is done; raises as `save` does.

    With a spec, also formats that cannot hold what it asks for, or that need a library that is missing.
    """
    seen: set[Path] = set()
    for path in paths:
        suffix = suffix_of(path)
        if path.resolve() in seen:
            raise InputError("each output path once", f"{path} twice", "give each another name")
        seen.add(path.resolve())
        check_folder(path)
        exporter = EXPORTERS[suffix]
        if spec and exporter.holds != "points" and spec.dot == 0:
            remedy = "write it to marker.json, or leave out --dot 0"
            raise InputError("dots for a drawing or a solid", f"bare points for {path}", remedy)
        if spec and exporter.holds == "flat" and spec.relief:
            remedy = "write it to marker.json or as a solid such as .step, or leave out --relief"
            raise InputError("dots in one plane", f"a relief of {format_length(spec.relief)} for {path}", remedy)
        if spec and exporter.kernel:
            from markergen.solid.kernel import import_cadquery

            import_cadquery()  # Not after minutes of search.
        exporter.refuse(options)
        if exporter.sheet:
            _check_sheet(exporter, options, spec)


def _check_sheet(exporter: Exporter, options: ExportOptions, spec: "Spec | None") -> None:
    from markergen.drawing.paper import find_paper
    from markergen.drawing.sheet_layout import check_paper

    sheet = options.sheet
    if sheet.paper is not None:
        find_paper(sheet.paper, sheet.orientation)
    if spec is not None:
        # What holds one page holds no tiles either.
        check_paper(spec.boundary, sheet if exporter.many_pages else replace(sheet, tile=False))
