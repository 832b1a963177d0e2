"""``markergen export``."""

from pathlib import Path
from typing import Annotated

import typer


def export(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design.")],
    output: Annotated[
        list[Path], typer.Option("-o", "--output", metavar="PATH", help="Written by suffix; may be repeated.")
    ],
    paper: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="A0..A5, letter, ... [default: the smallest ISO size that holds it]"),
    ] = None,
) -> None:
    """Write a marker as PDF or SVG at true size, or as STEP solids.

    \b
    Example:
      markergen export marker.json -o marker.step -o marker.svg
    """
    from markergen.cli.console import busy, print_outputs
    from markergen.export import ExportOptions, check_outputs, save
    from markergen.model.marker_json import read_marker

    choices = ExportOptions(paper=paper)
    check_outputs(output, choices)
    read = read_marker(marker)
    with busy("writing"):
        written = save(read, output, choices)
    print_outputs(written)
