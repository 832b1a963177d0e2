"""``markergen.export``: markers as sheets, drawings, solids and configurations, each by its suffix."""

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import radians
from os import PathLike
from pathlib import Path
from typing import Any, Unpack

from markergen.api.arguments import files_among, paths_of
from markergen.drawing.colors import INVERTED, parse_colors
from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError, OutputError
from markergen.exporters import Exporter, ExportOptions, exporter_of, suffix_of
from markergen.exporters.saving import check_exports, frame_of, save
from markergen.files import Written, write_all
from markergen.files import check_outputs as check_files
from markergen.model.body_json import load_marker_or_rig
from markergen.model.fabrication import CHOICES, DEFAULT_PROCESS, Fabrication, check_choice
from markergen.model.marker import Marker, check_supported
from markergen.model.openings import check_edge, check_holes, near_holes
from markergen.model.rig import Rig
from markergen.model.substrate import parse_dowel, parse_mount
from markergen.options import as_list, declared, given, read_as, takes
from markergen.options.declarations import ExportKeywords
from markergen.options.kinds import File, MarkerLike
from markergen.options.shared import PlateKeywords
from markergen.presentation.results import Files
from markergen.read.outlines.boundary import read_room

log = logging.getLogger(__name__)

SHEET = ("paper", "orientation", "margin", "tile", "overlap", "compensate")
MADE = ("process", "depth", "gap", "fit", "through", "tool", "dome", "draft", "foot", "engrave", "tolerance",
        "material", "general_tolerance", "datum", "hole")  # fmt: skip


@takes(ExportKeywords)
def export(
    marker: "MarkerLike | Rig | Iterable[MarkerLike]",
    *paths: str | PathLike[str],
    json: File | None = None,
    **options: Unpack[ExportKeywords],
) -> list[Written]:
    """Write markers, or a rig, at true size: for printing, for manufacturing, or as configuration for detectors.

    Parameters
    ----------
    marker : Marker, Rig, path, dict, or a list of markers
        Several share the sheets of a ``.pdf``.
    *paths : str or path
        The suffix of each selects its format: ``.pdf``, ``.svg``, ``.png``, ``.dxf``, ``.step`` and so on. All
        files are written, or none.
    json : path, optional
        File for the list of what was written.
    **options
        As on the command line, ``markergen export --help``, with underscores: ``corner_radius="5mm"``. Plate options
        override the marker's.

    Returns
    -------
    list of Written
        Paths, including those of accompanying files, and notes for whoever prints or makes them.

    Raises
    ------
    InputError
        If a suffix or an option is unknown, or a format cannot hold the marker; nothing is written.
    OutputError
        If a file cannot be written, or is a drawing of another program; every target is as it was.
    MissingLibraryError
        If a solid is asked for and the extra ``solids`` is not installed.

    Examples
    --------
    >>> import markergen as mg, tempfile, pathlib
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> written = mg.export(mg.design(n=4, dot="20mm", restarts=4).marker, folder / "marker.svg", paper="A2")
    >>> [file.path.name for file in written]
    ['marker.svg']
    """
    asked = given(options, ExportKeywords)
    outputs, choices = paths_of(paths, "a path to write to"), choices_of(asked)
    sources = as_list(marker)
    if not sources:
        raise InputError("one marker or more", "none", "give a Marker, a path, or a list of them")
    inputs = files_among(*sources, asked.get("outline"))
    loaded = [load_marker_or_rig(source) for source in sources]
    frame = frame_of(loaded)
    bodies = [with_plates(body, asked) for body in loaded]
    if choices.net and frame != "rig":
        raise InputError("a rig.json for --net", "markers", "give what markergen rig wrote, or leave out --net")
    check_exports(outputs, choices, frame=frame)
    results = list(read_as("files", json, "json") or ())
    check_files([*outputs, *results], inputs)
    _keep_drawings(outputs)
    markers = [plate.marker for body in bodies for plate in body.plates]
    if "colors" not in asked and all(marker.light for marker in markers):
        choices = replace(choices, sheet=replace(choices.sheet, colors=INVERTED))
    choices = choices.beside([next((path.name for path in files_among(source)), "") for source in sources])
    written = save(bodies, outputs, choices, inputs)
    for warning in _warnings(markers, [exporter_of(suffix_of(path, frame), frame) for path in outputs], choices):
        log.warning("%s", warning)
    write_all({path: Files(written).to_json() for path in results})
    return [*written, *map(Written, results)]


def to_cadquery(body: Marker | Rig, **options: Unpack[ExportKeywords]) -> Any:
    """See `Body.to_cadquery`."""
    from markergen.workshop.formats.solids import assembly_of

    asked = given(options, ExportKeywords)
    body = with_plates(body, asked)
    for plate in body.plates:
        check_supported(plate.marker, "for a solid", light=False)
    return assembly_of(body, choices_of(asked))


def with_plates(body: Marker | Rig, asked: Mapping[str, Any]) -> Marker | Rig:
    """Return a marker or a rig with plate options applied."""
    return body.with_markers(lambda marker: with_plate(marker, asked))


def _keep_drawings(outputs: Sequence[Path]) -> None:
    """Refuse to replace drawings of other programs: most likely the outline that the marker was designed in."""
    for path in outputs:
        if path.suffix.lower() in (".dxf", ".svg") and path.is_file() and b"markergen" not in path.read_bytes():
            raise OutputError(
                f"expected no drawing of another program at {path}, found one; write to another name, or remove it"
            )


def _warnings(markers: Sequence[Marker], formats: Sequence[Exporter], choices: ExportOptions) -> Iterator[str]:
    """Yield what to know before the files are used: dots of the other polarity, and holes near dots."""
    inverted = choices.sheet.colors.inverted
    if any(exporter.sheet for exporter in formats) and any(marker.light != inverted for marker in markers):
        stored, printed = ("dark", "light") if inverted else ("light", "dark")
        yield (
            f"the dots are {stored} in marker.json, and {printed} on the sheet, where markergen detect does not find "
            "them: --colors does not change marker.json"
        )
    if any(exporter.holds != "points" for exporter in formats):
        yield from dict.fromkeys(sentence for marker in markers for sentence in near_holes(marker))


def choices_of(asked: Mapping[str, Any]) -> ExportOptions:
    """Return the given choices about sheets and solids (see `given`); other options are ignored."""
    sheet: dict[str, Any] = {name: asked[name] for name in SHEET if name in asked}
    if "colors" in asked:
        sheet["colors"] = parse_colors(asked["colors"])
    making = {name: asked[name] for name in MADE if name in asked}
    for choice in CHOICES:
        if making.get(choice):  # Even if it is the default: other processes have no such choice.
            check_choice(making.get("process", DEFAULT_PROCESS), choice)
    if "hole" in making:
        making["hole"] = ",".join(making["hole"])
    if "draft" in making:
        making["draft"] = radians(making["draft"])
    dpi = {"dpi": asked["dpi"]} if "dpi" in asked else {}
    return ExportOptions(SheetOptions(**sheet), asked.get("net", False), fabrication=Fabrication(**making), **dpi)


def with_plate(marker: Marker, asked: Mapping[str, Any]) -> Marker:
    """Return the marker with plate options applied.

    Mounting holes replace all of the marker's mounting holes, and dowel holes all of its dowel holes.

    Raises
    ------
    InputError
        If an option has an unusable value, or the marker's dots do not fit on the plate.
    """
    values = {name: asked[name] for name in declared(PlateKeywords) if name in asked}
    unit, ignore_open, outline = asked.get("boundary_unit"), bool(asked.get("ignore_open")), values.pop("outline", None)
    if isinstance(outline, str | PathLike) or unit is not None or ignore_open:
        [outline] = read_room(None, [] if outline is None else [str(outline)], unit, ignore_open=ignore_open)[1]
    if outline is not None:
        values["outline"] = outline
    if not values:
        return marker
    holes = [hole for hole in marker.substrate.holes if hole.use not in values]
    holes += [hole for text in values.pop("mount", ()) for hole in parse_mount(text)]
    holes += [hole for text in values.pop("dowel", ()) for hole in parse_dowel(text)]
    # In the same order as a design.
    holes.sort(key=lambda hole: hole.use == "dowel")
    plate = replace(marker.substrate, **values, holes=tuple(holes))
    if "edge" in values:
        check_edge(plate, marker.boundary)
    changed = replace(marker, substrate=plate)
    check_holes(changed)
    return changed
