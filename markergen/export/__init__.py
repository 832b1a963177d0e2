"""Exporters: a table by output suffix, and the one `save` that writes any of them atomically."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from markergen.errors import InputError
from markergen.files import write_all
from markergen.model.marker import Marker
from markergen.registry import Registry


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
    check_outputs(paths)
    outputs = [EXPORTERS[path.suffix.lower()](marker, options or ExportOptions()) for path in paths]
    write_all({path: output.data for path, output in zip(paths, outputs, strict=True)})
    return [(path, output.notes) for path, output in zip(paths, outputs, strict=True)]


def check_outputs(paths: Sequence[Path]) -> None:
    """Refuse unknown suffixes and repeated paths before any work is done; raises as `save` does."""
    seen: set[Path] = set()
    for path in paths:
        EXPORTERS[path.suffix.lower()]
        if path.resolve() in seen:
            raise InputError("each output path once", f"{path} twice", "give every -o another name")
        seen.add(path.resolve())
