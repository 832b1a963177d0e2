"""``markergen rescale``."""
# tests: tests/cli/test_rescale.py

from pathlib import Path
from typing import Annotated, Any

from markergen.cli import console
from markergen.cli.options import Json, MarkerFile, output_files, with_options
from markergen.options.declarations import RescaleKeywords


@with_options(RescaleKeywords)
def rescale(
    marker: MarkerFile,
    output: Annotated[Path, output_files("The marker.json of this print; may be the same file.")],
    json: Json = None,
    **options: Any,
) -> None:
    """Correct a marker for a print that came out at another size, by its rulers or by its dots.

    detect and validate then use the dot positions of the print.

    \b
    Example:
      markergen rescale marker.json --measured-x 198.6mm --measured-y 199.1mm -o printed.json
      markergen rescale marker.json --measured-points dots.csv -o printed.json
      markergen rescale rig.json --measured-x 99.4mm --also "+z=99.7mm" -o printed.json
    """
    from markergen.api.rescale import rescale as correct

    console.print_result(correct(marker, output, json=console.file_of(json), **options), json, ())
