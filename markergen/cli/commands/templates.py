"""``markergen templates``."""
# tests: tests/contracts/test_commands.py

from typing import Annotated

import typer

from markergen.cli import console
from markergen.cli.options import Json


def templates(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Print this template, to be edited.")] = None,
    json: Json = None,
) -> None:
    """List the ready-made specs with sizes, cameras and distances, or print one.

    \b
    Example:
      markergen templates desk-a4 > my.toml
      markergen design --template my.toml -o marker.pdf
    """
    from markergen.api.shipped import overview
    from markergen.read.templates import template_text

    if name:
        print(template_text(name), end="")
        return
    console.print_result(overview(console.file_of(json)), json)
