"""Exporters: a table by output suffix, and the one `save` that writes any of them atomically."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from markergen.drawing.paper import find_paper
from markergen.drawing.sheet import Sheet, SheetOptions, check_paper, pages_for
from markergen.errors import InputError, OutputError
from markergen.files import check_folder, folders_for, write_all
from markergen.files import check_outputs as check_files
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.spec import Spec
from markergen.registry import Registry
from markergen.solid.kernel import import_cadquery
from markergen.units import format_length


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


Exporter = Callable[[Sequence[Marker], ExportOptions], Output]
"""Makes one file's bytes, always the same ones for the same markers; refuses what its format cannot hold."""

EXPORTERS: Registry[Exporter] = Registry("output suffix", __name__)
"""Exporters by suffix with its dot; a suffix may have two parts (``.opencv.yaml``)."""

RECORD = ".json"
"""The one format that holds all of a marker."""

SHEETS = (".pdf", ".svg", ".png")
"""Formats that are printed on paper; all but the first hold one page."""

FLAT = (*SHEETS, ".dxf")
"""Formats that hold shapes in one plane: no relief."""

WORKSHOP = ".fab.pdf"
"""The drawing that goes with a solid; it needs no CAD kernel."""

SOLIDS = (".step", ".stp", ".brep", ".stl", ".3mf", ".glb", ".sdf", ".urdf", WORKSHOP)
"""Formats of solids, and of the drawing that goes with them: `ExportOptions.fabrication` is for these."""

DRAWN = (*FLAT, *SOLIDS)
"""Formats that hold shapes: no bare points."""


def save(
    markers: Marker | Sequence[Marker],
    paths: Sequence[Path],
    options: ExportOptions | None = None,
    inputs: Sequence[Path] = (),
) -> list[tuple[Path, tuple[str, ...]]]:
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
    list of (path, notes)
        In the order given, and after them the files that come with others; notes are sentences for the user.

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
    markers: Marker | Sequence[Marker], paths: Sequence[Path], options: ExportOptions | None = None
) -> dict[Path, Output]:
    """Make what `save` writes, by path; raises as `save` does."""
    choices = options or ExportOptions()
    every = (markers,) if isinstance(markers, Marker) else tuple(markers)
    check_outputs(paths, choices)
    return {path: EXPORTERS[suffix_of(path)](every, replace(choices, stem=stem_of(path))) for path in paths}


def write(outputs: Mapping[Path, Output], inputs: Sequence[Path] = ()) -> list[tuple[Path, tuple[str, ...]]]:
    """Write outputs and the files that come with them, all or none; see `save`."""
    files = {path: output.data for path, output in outputs.items()}
    beside = _beside(outputs)
    check_files(list(outputs), inputs)
    with folders_for(beside):
        check_files(list(beside), inputs)
        write_all({**files, **beside})
    return [(path, output.notes) for path, output in outputs.items()] + [(path, ()) for path in beside]


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
    if known is None:
        EXPORTERS[path.suffix.lower()]  # says which ones there are
    return str(known)


def stem_of(path: Path) -> str:
    """Name of a file without its suffix: ``marker`` of ``out/marker.fab.pdf``."""
    return path.name[: -len(suffix_of(path))]


def only(markers: Sequence[Marker], suffix: str = "this format") -> Marker:
    """Return the one marker of a format that holds no more.

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    if len(markers) != 1:
        raise InputError(f"one marker for {suffix}", f"{len(markers)}", "write them one at a time, or as .pdf")
    return markers[0]


def one_page(markers: Sequence[Marker], options: ExportOptions, suffix: str) -> Sheet:
    """Lay markers out on the single page that a format holds.

    Raises
    ------
    InputError
        If they need several; also as `pages_for` does.
    """
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


def check_outputs(paths: Sequence[Path], options: ExportOptions, spec: Spec | None = None) -> None:
    """Refuse what cannot be written before any work is done; raises as `save` does.

    With a spec, also formats that cannot hold what it asks for, or that need a library that is missing.
    """
    seen: set[Path] = set()
    for path in paths:
        suffix = suffix_of(path)
        if path.resolve() in seen:
            raise InputError("each output path once", f"{path} twice", "give every -o another name")
        seen.add(path.resolve())
        check_folder(path)
        if spec and suffix in DRAWN and spec.dot == 0:
            remedy = "write it to marker.json, or leave out --dot 0"
            raise InputError("dots for a drawing or a solid", f"bare points for {path}", remedy)
        if spec and suffix in FLAT and spec.relief:
            remedy = "write it to marker.json or as a solid such as .step, or leave out --relief"
            raise InputError("dots in one plane", f"a relief of {format_length(spec.relief)} for {path}", remedy)
        if spec and suffix in SOLIDS and suffix != WORKSHOP:
            import_cadquery()  # Not after minutes of search.
        if suffix in SHEETS:
            _check_sheet(suffix, options, spec)


def _check_sheet(suffix: str, options: ExportOptions, spec: Spec | None) -> None:
    sheet = options.sheet
    paper = None if sheet.paper is None else find_paper(sheet.paper, sheet.orientation)
    if suffix == ".png":
        from markergen.exporters.png import image_size, pixels_per_meter

        pixels_per_meter(options.dpi)
        if paper is not None:
            image_size(paper, options.dpi)
    if spec is not None:
        # What holds one page holds no tiles either.
        check_paper(spec.boundary, sheet if suffix == ".pdf" else replace(sheet, tile=False))
