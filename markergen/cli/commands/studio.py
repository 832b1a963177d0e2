"""``markergen studio``: the page in the browser."""
# tests: tests/cli/test_studio.py

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli.options import parser_of
from markergen.options.kinds import KINDS


def studio(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="Begin with this marker.json, rig.json, spec .toml or drawing."),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(metavar="N", parser=parser_of(KINDS["int"]), help="Port to serve at. [default: a free one]"),
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """Design on a page in the browser, served to this computer alone: drag dots and see what to expect, download, share
    by the address. Ctrl-C ends it.

    \b
    Example:
      markergen studio
      markergen studio marker.json --port 8000 --no-browser
    """
    from markergen.studio import serve

    serve(file, port, browser)
