"""The commands and the options that belong to none of them."""

from typing import Annotated

import typer

from markergen import __version__
from markergen.cli.compare import compare
from markergen.cli.design import design
from markergen.cli.detect import detect
from markergen.cli.export import export
from markergen.cli.options import GroupedCommand
from markergen.cli.rescale import rescale
from markergen.cli.study import study
from markergen.cli.templates import templates
from markergen.cli.validate import validate
from markergen.cli.verify import verify

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)


def _version(wanted: bool) -> None:
    if wanted:
        print("markergen", __version__)
        raise typer.Exit


@app.callback()
def markergen(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Design fiducial markers: the layout of control points that gives the most accurate pose, printed at true size,
    made as solids, and proved.

    \b
    Example:
      markergen design --n 5 --radius 0.15 -o marker.pdf
      markergen validate marker.json
      markergen export marker.json -o marker.step
      markergen detect photos/ --marker marker.json --camera camera.yaml

    Lengths are meters, or carry a unit: 0.15, 150mm, 6in. Add --debug to see where an error came from.
    """


for command in (design, validate, export, detect, compare, verify, rescale, study, templates):
    app.command(cls=GroupedCommand)(command)
