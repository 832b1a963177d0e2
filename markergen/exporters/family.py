"""Families of markers: all of them on the same sheets, and a file for each in formats that hold one marker."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from markergen.drawing.paper import ISO
from markergen.drawing.sheet_layout import pages_for
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions, outputs_of, suffix_of, write
from markergen.files import Written
from markergen.model.marker import Marker


def family_paths(paths: Sequence[Path], ids: Sequence[int]) -> list[Path]:
    """What `save_family` writes for these paths: for ``stem.json`` a ``stem-<id>.json`` for each id, and so on."""
    return [own for path in paths for own in ([path] if _is_sheet(path) else [_own(path, k) for k in ids])]


def save_family(
    markers: Sequence[Marker], paths: Sequence[Path], options: ExportOptions, inputs: Sequence[Path] = ()
) -> list[Written]:
    """Write markers that differ by the ids of their tags: sheets with all of them, and all else for each by itself.

    Without a paper named, all markers share one page of the smallest ISO size that holds them, if one does. Returns
    paths and notes as `save` does, and raises as it does: all files are written or none.
    """
    ids = [marker.tag.id for marker in markers if marker.tag]
    if len(ids) < len(markers):
        raise InputError("markers with tags", "one without", "design them with --tag")
    sheets = [path for path in paths if _is_sheet(path)]
    made = outputs_of(markers, sheets, _on_one_page(markers, options)) if sheets else {}
    for marker, number in zip(markers, ids, strict=True):
        made |= outputs_of(marker, [_own(path, number) for path in paths if not _is_sheet(path)], options)
    return write(made, inputs)


def _on_one_page(markers: Sequence[Marker], options: ExportOptions) -> ExportOptions:
    if options.sheet.paper is not None:
        return options
    sizes = (replace(options.sheet, paper=paper.name, tile=False) for paper in ISO)
    for sheet in sizes:
        try:
            if len(pages_for(markers, sheet)) == 1:
                return replace(options, sheet=sheet)
        except InputError:
            continue  # too small for any of them
    return options


def _is_sheet(path: Path) -> bool:
    return EXPORTERS[suffix_of(path)].sheet


def _own(path: Path, number: int) -> Path:
    suffix = path.name[-len(suffix_of(path)) :]
    return path.with_name(f"{path.name.removesuffix(suffix)}-{number}{suffix}")
