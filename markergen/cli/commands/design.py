"""``markergen design``."""
# tests: tests/cli/test_design.py

import os
from pathlib import Path
from typing import Any

from markergen.cli import console
from markergen.cli.options import Details, Json, with_options
from markergen.options.declarations import DesignKeywords


@with_options(
    DesignKeywords,
    first="n radius boundary template camera poses dot keep_out tag objective paper output details",
)
def design(json: Json = None, details: Details = False, **options: Any) -> None:
    """Find the best layout of control points, and write the marker; <stem>.json always comes with it.

    \b
    Example:
      markergen design --n 5 --radius 0.15 -o marker.pdf
      markergen design --n 8 --boundary plate.dxf --camera camera.yaml --poses flights.csv
      markergen design --n 6 --radius 150mm --relief 20mm --mount 4xM4@240mm --dowel 2x4mm@260mm -o marker.step
    """
    from markergen.api.design import design as find
    from markergen.api.design import with_page

    options = with_page(options, os.environ)
    options.setdefault("output", [Path("marker.json" if options.get("relief") else "marker.pdf")])
    with console.interruptible() as limit, console.progress_bar() as progress:
        result = find(progress=progress, json=console.file_of(json), **options)
    console.print_result(result, json, details=details)
    if limit.asked:
        raise console.Terminated
