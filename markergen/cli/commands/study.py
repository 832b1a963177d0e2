"""``markergen study``."""
# tests: tests/cli/test_study.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Json, with_options
from markergen.options.compare import StudyKeywords


@with_options(StudyKeywords)
def study(
    what: Annotated[
        str,
        typer.Argument(
            metavar="paper|NAME|SPEC.toml",
            help="paper: the claims of the paper, measured. Otherwise a sweep: a TOML file with [study] and [grid], or "
            "one that is shipped: layouts.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for tables, figures and finished cells.")
    ],
    json: Json = None,
    **options: Any,
) -> None:
    """Reproduce the paper, or run any grid of designs, as one tidy table with figures and a page.

    The results do not depend on the number of workers or on where they run. After an interruption, --resume
    continues.

    \b
    Example:
      markergen study paper --scale 0.01 -o paper
      markergen study layouts -o layouts
      markergen study sweep.toml -o sweep --scheduler tcp://10.0.0.1:8786
    """
    from markergen.api.study import study as run

    try:
        with console.cells_progress() as progress:
            result = run(what, output, progress=progress, announce=console.note, json=console.file_of(json), **options)
    except KeyboardInterrupt:
        console.complain(f"markergen: finished cells remain in {output}; continue with the same command and --resume")
        raise
    console.print_result(result, json, ())
