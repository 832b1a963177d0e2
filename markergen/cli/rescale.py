"""``markergen rescale``."""

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli.console import length


def rescale(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design.")],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="PATH", help="The marker.json of this print; may be the same file."),
    ],
    measured_x: Annotated[
        float | None, typer.Option(parser=length, metavar="LENGTH", help="What the ruler along x measures.")
    ] = None,
    measured_y: Annotated[
        float | None,
        typer.Option(parser=length, metavar="LENGTH", help="What the ruler along y measures. [default: as along x]"),
    ] = None,
    nominal_x: Annotated[
        float, typer.Option(parser=length, metavar="LENGTH", help="Length printed beside the ruler along x.")
    ] = "200mm",  # type: ignore[assignment]
    nominal_y: Annotated[
        float, typer.Option(parser=length, metavar="LENGTH", help="Length printed beside the ruler along y.")
    ] = "200mm",  # type: ignore[assignment]
    measured_points: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Measured dots: id,x,y[,sigma | ,sx,sy[,rho]]; meters, or units as in x_mm."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Take what is 5 % off or more.")] = False,
) -> None:
    """Correct a marker for a print that came out at another size, by its rulers or by its dots.

    detect and validate then use the places that the dots have in the print.

    \b
    Example:
      markergen rescale marker.json --measured-x 198.6mm --measured-y 199.1mm -o corrected.json
      markergen rescale marker.json --measured-points dots.csv -o corrected.json
    """
    from markergen.cli.console import print_outputs
    from markergen.errors import InputError
    from markergen.files import check_folder, write_atomic
    from markergen.model.marker_json import read_marker, to_json
    from markergen.model.rescale import Rulers, remeasure
    from markergen.model.rescale import rescale as rescaled
    from markergen.read.measured import read_measured

    rulers = Rulers(measured_x, measured_y, nominal_x, nominal_y)
    if measured_points is not None and (measured_x is not None or measured_y is not None):
        raise InputError(
            "either rulers or dots that were measured", "both", "measured dots alone say all: leave out the rulers"
        )
    if output.suffix.lower() != ".json":
        raise InputError("an output that ends in .json", str(output), "a sheet of it is made by markergen export")
    check_folder(output)
    before = read_marker(marker)
    if measured_points is None:
        after, said = rescaled(before, rulers, force)
    else:
        after, said = remeasure(before, read_measured(measured_points), force)
    write_atomic(output, to_json(after))
    print_outputs([(output, said)])
