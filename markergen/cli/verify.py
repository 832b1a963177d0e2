"""``markergen verify``."""

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli.console import length


def verify(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="What the files are to hold.")],
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Sheets, solids and configurations, read by suffix.")
    ],
    tolerance: Annotated[
        float | None,
        typer.Option(
            parser=length,
            metavar="LENGTH",
            help="How far a dot may be off. [default: 1 um; 5 um in a mesh; a quarter of a pixel in a PNG]",
        ),
    ] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the results as JSON; - is standard output.")
    ] = None,
) -> None:
    """Read files back by other means than those that wrote them, and hold every dot against marker.json.

    The dots are laid on the marker's by the best turn and shift, never by a scale: what is scaled, mirrored, missing
    or of another marker is told as that. Status 1 if a file is wrong, 2 if one cannot be used.

    \b
    Example:
      markergen verify marker.json marker.pdf marker.svg marker.png
      markergen verify marker.json marker.step marker.3mf marker.glb
    """
    from markergen.cli import FAILED, UNUSABLE
    from markergen.cli.console import complain, print_table
    from markergen.files import check_outputs, write_atomic
    from markergen.model.marker_json import read_marker
    from markergen.verification.check import to_json, verify_all
    from markergen.verification.words import CAPTION, header, lines, row

    to_stdout = str(json) == "-"
    if json and not to_stdout:
        check_outputs([json], [marker, *files])
    checks = verify_all(read_marker(marker), files, tolerance)
    usable = [check for check in checks if not check.error]
    if to_stdout:
        typer.echo(to_json(checks))
    elif usable:
        print_table("", header(), [row(check) for check in usable], CAPTION)
        for check in usable:
            for line in lines(check):
                print(line)
    if json and not to_stdout:
        write_atomic(json, to_json(checks).encode() + b"\n")
        print(f"wrote {json}")
    for check in checks:
        if check.error:
            complain(f"markergen: error: {check.error}")
    if len(usable) < len(checks):
        raise typer.Exit(UNUSABLE)
    if not all(check.passed for check in checks):
        raise typer.Exit(FAILED)
