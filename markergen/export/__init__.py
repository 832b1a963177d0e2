"""Exporters: a table by output suffix, and the one `save` that writes any of them atomically."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from markergen.drawing.paper import find_paper
from markergen.drawing.sheet import check_paper
from markergen.errors import InputError
from markergen.files import check_folder, write_all
from markergen.model.marker import Marker
from markergen.model.spec import Spec
from markergen.registry import Registry
from markergen.units import format_length


@dataclass(frozen=True)
class ExportOptions:
    """What a user may choose about an export.

    Attributes
    ----------
    paper : str or None
        Name of the paper for printable formats; None takes the smallest ISO size that holds the marker.
    """

    paper: str | None = None


@dataclass(frozen=True)
class Output:
    """Bytes of one file, and sentences for the user about it."""

    data: bytes
    notes: tuple[str, ...] = ()


Exporter = Callable[[Marker, ExportOptions], Output]
"""Makes one file's bytes, always the same ones for the same marker; refuses what its format cannot hold."""

EXPORTERS: Registry[Exporter] = Registry("output suffix", __name__)
"""Exporters by suffix with its dot."""

RECORD = ".json"
"""The one format that holds every marker: neither bare points nor a relief can be drawn."""

SHEETS = (".pdf", ".svg")
"""Formats that are printed on paper."""


def save(
    marker: Marker, paths: Sequence[Path], options: ExportOptions | None = None
) -> list[tuple[Path, tuple[str, ...]]]:
    """Write a marker to each path, in the format that its suffix names: all files or none.

    Returns
    -------
    list of (path, notes)
        In the order given; notes are sentences for the user.

    Raises
    ------
    InputError
        If a suffix is unknown (the message lists the known ones), a path is given twice, or a format refuses the
        marker; nothing is written.
    OutputError
        If a file cannot be written; every target is as it was.
    """
    choices = options or ExportOptions()
    check_outputs(paths, choices)
    outputs = [EXPORTERS[path.suffix.lower()](marker, choices) for path in paths]
    write_all({path: output.data for path, output in zip(paths, outputs, strict=True)})
    return [(path, output.notes) for path, output in zip(paths, outputs, strict=True)]


def with_record(paths: Sequence[Path]) -> list[Path]:
    """Add the marker.json that always comes with a design, named after the first path, if it is not among them."""
    if not paths[0].name:
        return list(paths)
    record = paths[0].with_suffix(RECORD)
    return list(paths) if record.resolve() in {path.resolve() for path in paths} else [*paths, record]


def check_outputs(paths: Sequence[Path], options: ExportOptions, spec: Spec | None = None) -> None:
    """Refuse what cannot be written before any work is done; raises as `save` does.

    With a spec, also formats that cannot hold what it asks for.
    """
    if options.paper is not None:
        find_paper(options.paper)
    seen: set[Path] = set()
    for path in paths:
        EXPORTERS[path.suffix.lower()]
        if path.resolve() in seen:
            raise InputError("each output path once", f"{path} twice", "give every -o another name")
        seen.add(path.resolve())
        check_folder(path)
        if spec and path.suffix.lower() != RECORD and (spec.relief or spec.dot == 0):
            what, option = (
                (f"a relief of {format_length(spec.relief)}", "--relief") if spec.relief else ("bare points", "--dot 0")
            )
            remedy = f"write it to marker.json, or leave out {option}"
            raise InputError("dots in one plane for a drawing or a solid", f"{what} for {path}", remedy)
        if spec and path.suffix.lower() in SHEETS:
            check_paper(spec.boundary, options.paper)
