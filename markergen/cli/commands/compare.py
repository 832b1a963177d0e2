"""``markergen compare``."""
# tests: tests/cli/test_compare.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Json, Rows, with_options
from markergen.options.compare import CompareKeywords


def _contestants() -> Rows:
    from markergen.comparison.contestants import listed

    return listed()


@with_options(CompareKeywords, listed={"Contestants": _contestants})
def compare(
    contestants: Annotated[
        list[str],
        typer.Argument(
            metavar="A B...", help="In the forms above, or their first word; one alone is compared with nine of them."
        ),
    ],
    json: Json = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the errors: .svg or .png.")] = None,
    **options: Any,
) -> None:
    """Compare markers with each other and with square tags and boards: same room, poses, optics and noise.

    \b
    Example:
      markergen compare marker.json
      markergen compare marker.json aruco:DICT_4X4_50:7 charuco:6x6 --views 400 --plot compare.svg
    """
    from markergen.api.compare import compare as run

    with console.progress_bar() as progress:
        result = run(
            *contestants, json=console.file_of(json), plot=plot, progress=progress, announce=console.note, **options
        )
    console.print_result(result, json)
