"""``markergen verify``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli.options import with_options
from markergen.options import VerifyKeywords


@with_options(VerifyKeywords)
def verify(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="What the files are to hold.")],
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Sheets, solids and configurations, read by suffix.")
    ],
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the results as JSON; - is standard output.")
    ] = None,
    **options: Any,
) -> None:
    """Read files back with independent readers, and compare every dot with marker.json.

    The dots are aligned with the marker's by the best rotation and translation, never by a scale: dots that are scaled,
    mirrored, missing or of another marker are reported as such. Status 1 if a file is wrong, 2 if one cannot be used.

    \b
    Example:
      markergen verify marker.json marker.pdf marker.svg marker.png
      markergen verify marker.json marker.step marker.3mf marker.glb
    """
    from markergen.api.verify import verify as read_back
    from markergen.cli import FAILED, UNUSABLE, console

    to_stdout = str(json) == "-"
    found = read_back(marker, *files, json=None if to_stdout else json, **options)
    console.print_found(found, to_stdout, found.findings())
    for error in filter(None, (check.error for check in found)):
        console.complain(f"markergen: error: {error}")
    if not found.usable:
        raise typer.Exit(UNUSABLE)
    if not found.passed:
        raise typer.Exit(FAILED)
