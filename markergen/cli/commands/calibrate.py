"""``markergen calibrate``."""
# tests: tests/cli/test_calibrate.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Json, MarkerFile, Report, output_files, with_options
from markergen.options import VIEW
from markergen.options.calibration import CalibrateKeywords


@with_options(CalibrateKeywords)
def calibrate(
    marker: MarkerFile,
    photos: Annotated[
        list[str],
        typer.Argument(
            metavar="PHOTO...",
            help="Image files, folders of them, or patterns such as '*.jpg'; or one video, camera number such as 0, or "
            "stream: still views are taken by themselves until more hardly help.",
        ),
    ],
    camera: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE|NAME=FILE",
            help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. Of several cameras held together, one for "
            "each, and photos in folders of their names; NAME= is estimated. [default: estimated from the photos, too]",
            rich_help_panel=VIEW,
        ),
    ] = None,
    output: Annotated[
        list[Path] | None,
        output_files("measured.json: the marker or rig as printed; camera.yaml: the camera; may be repeated."),
    ] = None,
    report: Report = None,
    json: Json = None,
    **options: Any,
) -> None:
    """Measure a print by ten to forty photographs of it: every dot's x, y and z with their joint covariance, and the
    camera if it is unknown.

    detect and validate then use the dots of the print. docs/calibrate.md says how to take the photographs. Status 1 if
    left-out photographs do not confirm what was measured, or it is no better than the design: the files are written.

    \b
    Example:
      markergen calibrate marker.json photos/ --camera camera.yaml -o measured.json --report calibration.html
      markergen calibrate marker.json 0 --camera camera.yaml -o measured.json
      markergen calibrate marker.json photos/ --measured 0-2=244.1mm -o measured.json -o camera.yaml
      markergen calibrate marker.json photos/ --geometry nominal -o camera.yaml
      markergen calibrate cube.json photos/ --camera camera.yaml -o measured-cube.json
      markergen calibrate marker.json left/ right/ --camera left=left.yaml --camera right=right.yaml --json rig.json
    """
    from markergen.api.calibrate import calibrate as measure
    from markergen.calibration.sentences import closing_sentence

    with console.progress_bar() as progress:
        result = measure(
            marker, photos, camera or None, save=output or (), report=report, json=console.file_of(json),
            progress=progress, tell=console.note, **options,
        )  # fmt: skip
    console.print_result(result, json)
    if closing := closing_sentence(result, console.is_stdout(json)):
        (console.note if result.to_use else console.complain)(closing)
    if not result.to_use:
        raise typer.Exit(console.FAILED)
