"""``markergen handeye``."""
# tests: tests/api/test_handeye.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Details, Json, calibration_file, output_files, with_options
from markergen.options import FILES
from markergen.options.calibration import HandeyeKeywords


@with_options(HandeyeKeywords)
def handeye(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design or calibrate.")],
    photos: Annotated[
        list[str],
        typer.Argument(metavar="PHOTO...", help="Image files, folders of them, or patterns such as '*.jpg'."),
    ],
    robot: Annotated[
        str,
        typer.Option(
            metavar="FILE|DIR",
            help="Robot's poses: a CSV or JSON table with a column that names the photograph; or a folder, or a "
            "pattern such as 'photos/*.pose.yaml', with a file of a pose beside each photograph.",
            rich_help_panel=FILES,
        ),
    ],
    camera: Annotated[Path | None, calibration_file("estimated, too")] = None,
    output: Annotated[
        list[Path] | None, output_files("Results as .json, plot as .svg or .png; may be repeated.")
    ] = None,
    json: Json = None,
    details: Details = False,
    **options: Any,
) -> None:
    """Find where a camera is on a robot, or beside it, by photographs of a marker and the robot's poses in them.

    Both poses with their joint covariance, the scale of the marker by the robot, and the errors of the robot: see
    docs/handeye.md. Status 1 if the poses leave a direction open: the files are written.

    \b
    Example:
      markergen handeye marker.json photos/ --robot poses.csv --robot-frame flange-in-base --robot-unit mm
          --robot-rotation kuka --camera camera.yaml -o handeye.json
      markergen handeye marker.json photos/ --robot photos/ --mounting eye-to-hand --camera camera.yaml
    """
    from markergen.api.handeye import handeye as find

    with console.progress_bar() as progress:
        result = find(
            marker, photos, robot, camera, save=output or (), json=console.file_of(json), progress=progress, **options
        )
    console.print_result(result, json, details=details)
    if result.open:
        raise typer.Exit(console.FAILED)
