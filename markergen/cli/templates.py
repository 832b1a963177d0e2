"""``markergen templates``."""

from typing import Annotated

import typer


def templates(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Print this template, to be edited.")] = None,
) -> None:
    """List the ready-made specs, or print one.

    \b
    Example:
      markergen templates desk-a4 > my.toml
      markergen design --template my.toml -o marker.pdf
    """
    from markergen.cli.console import print_parts
    from markergen.presentation.tables import Table
    from markergen.read.templates import read_template, template_text, templates

    if name:
        print(template_text(name), end="")
        return
    rows = [[known, str(read_template(known).get("title", ""))] for known in templates()]
    print_parts([Table("Templates", ["name", "what it is for"], rows)])
