"""``markergen rescale``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli.options import with_options
from markergen.options import RescaleKeywords


@with_options(RescaleKeywords)
def rescale(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design.")],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="PATH", help="The marker.json of this print; may be the same file."),
    ],
    **options: Any,
) -> None:
    """Correct a marker for a print that came out at another size, by its rulers or by its dots.

    detect and validate then use the positions of the dots in the print.

    \b
    Example:
      markergen rescale marker.json --measured-x 198.6mm --measured-y 199.1mm -o corrected.json
      markergen rescale marker.json --measured-points dots.csv -o corrected.json
    """
    from markergen.api.rescale import rescale as correct
    from markergen.cli.console import print_parts
    from markergen.files import Written

    found = correct(marker, output, **options)
    print_parts([str(Written(output, found.notes))])
