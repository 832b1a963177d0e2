"""``markergen compare``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli.options import with_options
from markergen.options import CompareKeywords


@with_options(CompareKeywords)
def compare(
    contestants: Annotated[
        list[str],
        typer.Argument(
            metavar="A B...",
            help="MARKER.json, ngon:N, square, random:N, aruco:DICT[:ID], apriltag:FAMILY[:ID] or charuco:CxR[:DICT]; "
            "one alone is compared with one of each.",
        ),
    ],
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the results as JSON; - is standard output.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the errors: .svg or .png.")] = None,
    **options: Any,
) -> None:
    """Compare markers with each other and with square tags and boards: same circle, poses, optics and noise.

    \b
    Example:
      markergen compare marker.json
      markergen compare marker.json aruco:DICT_4X4_50:7 charuco:4x4 --views 400 --plot compare.svg
    """
    from markergen.api.compare import compare as run
    from markergen.cli import console

    to_stdout = str(json) == "-"
    with console.progress_bar() as progress:
        found = run(*contestants, json=None if to_stdout else json, plot=plot, progress=progress, **options)
    console.print_found(found, to_stdout)
