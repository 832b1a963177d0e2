"""``markergen inspect``."""
# tests: tests/cli/test_inspect.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Json, with_options
from markergen.options.inspection import InspectKeywords


@with_options(InspectKeywords)
def inspect(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Camera, poses, outline, marker.json, rig.json, spec or points.")
    ],
    to: Annotated[
        Path | None,
        typer.Option("--to", metavar="FILE", help="Write the camera, poses or outline, in the format of its ending."),
    ] = None,
    json: Json = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw it, as .svg or .png.")] = None,
    **options: Any,
) -> None:
    """Show what a file holds and how it is read: format, unit, frame, lens, what was not used, and what is odd.

    \b
    Endings that --to knows:
      cameras   .yaml .xml .json .ros.yaml .kalibr.yaml .toml cameras.txt
      poses     .csv .json .tum .kitti images.txt transforms.json
      outlines  .svg .dxf .geojson

    \b
    Example:
      markergen inspect camera.yaml --plot camera.svg
      markergen inspect trajectory.txt --poses-unit mm --to poses.csv
      markergen inspect board.kicad_pcb --to board.dxf
    """
    from markergen.api.inspect import inspect as look

    result = look(file, to=to, json=console.file_of(json), plot=plot, **options)
    console.print_result(result, json)
