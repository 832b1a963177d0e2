"""``markergen verify``."""
# tests: tests/cli/test_verify.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Json, with_options
from markergen.options.declarations import VerifyKeywords


@with_options(VerifyKeywords, first="process through thickness edge outline mount dowel tolerance unit json")
def verify(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="Marker or rig that the files should contain.")],
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Sheets, solids and configurations, read by suffix.")
    ],
    json: Json = None,
    **options: Any,
) -> None:
    """Read files back with independent readers, and compare everything in them with marker.json.

    The dots are aligned with the marker's by the best rotation and translation, never by a scale: dots that are scaled,
    mirrored, missing or from another marker are reported as such. In solids of a rig.json, its markers' places
    count too. Lists of points and models for simulators are made again and compared value by value, with the options
    that they record; give those of the export for others. Status 1 if a file is wrong, 2 if one cannot be used.

    \b
    Example:
      markergen verify marker.json marker.pdf marker.svg marker.png
      markergen verify marker.json marker.step marker.3mf marker.glb
      markergen verify rig.json cube.step cube.3mf cube.mjcf.xml
    """
    from markergen.api.verify import verify as read_back

    result = read_back(marker, *files, json=console.file_of(json), **options)
    console.print_result(result, json, result.findings())
    for error in filter(None, (check.error for check in result)):
        console.complain(f"markergen: error: {error}")
    if not result.usable:
        raise typer.Exit(console.UNUSABLE)
    if not result.passed:
        raise typer.Exit(console.FAILED)
