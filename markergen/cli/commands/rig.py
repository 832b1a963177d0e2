"""``markergen rig``."""
# tests: tests/contracts/test_commands.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Details, Json, rig_suffixes, with_options
from markergen.options.rig import RigKeywords


def _shapes() -> list[tuple[str, str]]:
    from markergen.model.rig_shapes import FORMS, SHAPE_HELP

    return list(zip(FORMS, SHAPE_HELP, strict=True))


@with_options(
    RigKeywords,
    listed={"Shapes": _shapes, "Suffixes for a rig": rig_suffixes},
    first="template edge height pitch plate angle n camera poses dot tag paper output details",
)
def rig(
    shape: Annotated[
        list[str] | None, typer.Argument(metavar="SHAPE", help="One of those above; or that of the --template.")
    ] = None,
    json: Json = None,
    details: Details = False,
    **options: Any,
) -> None:
    """Design a body with a marker on every face, for one pose from all dots in view; <stem>.json always comes with it.

    \b
    Example:
      markergen rig cube --edge 80mm --n 6 -o cube.json
      markergen rig prism:6 --edge 60mm --height 80mm --without -z -o prism.json
      markergen rig wall 3x2 --pitch 0.5m --tag aruco:DICT_4X4_50 -o wall.json
      markergen rig --template cube -o cube.json -o cube.pdf
    """
    from markergen.api.design import rig as find

    options.setdefault("output", [Path("rig.json")])
    with console.interruptible() as limit, console.progress_bar() as progress:
        result = find(" ".join(shape or ()), progress=progress, json=console.file_of(json), **options)
    console.print_result(result, json, details=details)
    if limit.asked:
        raise console.Terminated
