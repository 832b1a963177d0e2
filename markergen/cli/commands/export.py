"""``markergen export``."""
# tests: tests/cli/test_export.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Json, output_files, rig_suffixes, with_options
from markergen.options.declarations import ExportKeywords


def _processes() -> list[tuple[str, str]]:
    from markergen.model.fabrication import PROCESSES

    return [(name, PROCESSES[name].summary or PROCESSES[name].label) for name in PROCESSES]


def _suffixes() -> list[tuple[str, str]]:
    from markergen.exporters import catalog

    return [(" ".join(suffixes), purpose) for suffixes, purpose in catalog()]


@with_options(
    ExportKeywords,
    listed={"Suffixes": _suffixes, "Processes": _processes, "Suffixes for a rig.json": rig_suffixes},
    first="output paper orientation margin dpi colors net compensate process thickness mount outline",
)
def export(
    marker: Annotated[
        list[Path],
        typer.Argument(
            metavar="MARKER.JSON",
            help="As written by markergen design; several go on the same sheets of a .pdf. Or one rig.json.",
        ),
    ],
    output: Annotated[list[Path], output_files("Output file; its suffix selects the format; may be repeated.")],
    json: Json = None,
    **options: Any,
) -> None:
    """Write a marker at true size: a sheet to print, a drawing or solid to make, or configuration for detectors.

    \b
    Example:
      markergen export marker.json -o marker.step -o marker.svg
      markergen export marker.json -o marker.png --dpi 300 -o board.opencv.yaml
      markergen export marker.json -o cut.pdf --colors black,cut:CutContour
      markergen export marker.json -o marker.3mf --thickness 4mm --chamfer 0.5mm --mount 4xM3c@120mm
      markergen export marker.json -o marker.step -o marker.fab.pdf --process cnc --fit press --tool 3mm

    Options of the plate, from --thickness to --dowel, override marker.json.
    """
    from markergen.api.export import export as write
    from markergen.presentation.results import Files

    with console.status_line("writing"):
        written = write(marker, *output, json=console.file_of(json), **options)
    console.print_result(Files(written), json)
