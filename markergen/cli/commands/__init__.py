"""The commands, one file for each: it declares the arguments, calls the library's function, and prints the result."""

from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated

import typer

from markergen import __version__
from markergen.cli.options import GroupedCommand

FIRST = "design rig validate export detect compare verify rescale calibrate handeye study inspect templates example"
"""Commands that help lists first, in the order of a user's work; the others follow by name."""

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)


def _version(wanted: bool) -> None:
    if wanted:
        print("markergen", __version__)
        raise typer.Exit


@app.callback(context_settings={"help_option_names": ["--help", "-h"]})
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

    Lengths are meters, or carry a unit: 0.15, 150mm, 6in. Add --quiet to see
    nothing but errors, and --debug for the traceback of one.
    """


def _rank(name: str) -> tuple[int, str]:
    listed = FIRST.split()
    return listed.index(name) if name in listed else len(listed), name


for name in sorted((module.name for module in iter_modules(__path__)), key=_rank):
    app.command(cls=GroupedCommand)(getattr(import_module(f"{__name__}.{name}"), name))
