"""``markergen design``."""

from pathlib import Path
from typing import Any

from markergen.cli.options import with_options
from markergen.options import DesignKeywords


@with_options(DesignKeywords)
def design(**options: Any) -> None:
    """Find the best layout of control points, and write the marker; <stem>.json always comes with it.

    \b
    Example:
      markergen design --n 5 --radius 0.15 -o marker.pdf
      markergen design --n 8 --boundary plate.dxf --camera camera.yaml --poses flights.csv
      markergen design --n 6 --relief 20mm --mount 4xM4@240mm --dowel 2x4mm@260mm -o marker.step
    """
    from markergen.api.design import design as find
    from markergen.cli import console

    options.setdefault("output", [Path("marker.json" if options.get("relief") else "marker.pdf")])
    with console.progress_bar() as progress:
        found = find(progress=progress, **options)
    console.print_parts([*found.parts(), *map(str, found.written)])
