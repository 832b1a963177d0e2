"""``markergen detect``."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli.options import with_options
from markergen.options import DetectKeywords
from markergen.options.base import VIEW


@with_options(DetectKeywords)
def detect(
    images: Annotated[
        list[str], typer.Argument(metavar="IMAGE...", help="Image files, folders of them, or patterns such as '*.png'.")
    ],
    marker: Annotated[
        list[Path], typer.Option(metavar="MARKER.JSON", help="What to look for; may be repeated for several markers.")
    ],
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: none: pixels and homography only]",
            rich_help_panel=VIEW,
        ),
    ] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write what was found as JSON; - is standard output.")
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write each image here with what was found drawn in.")
    ] = None,
    **options: Any,
) -> None:
    """Find markers in images: dot centers with their covariance, homography, and pose T_camera_marker with its own.

    Status 1 if any image has no marker, 2 if any could not be used; the others are processed regardless.

    \b
    Example:
      markergen detect photos/ --marker marker.json --camera camera.yaml --json found.json --overlay seen
    """
    from markergen.cli.console import complain, progress_bar
    from markergen.detect.batch import detect_files

    # While there is a bar, it stands in for the stream.
    stdout = sys.stdout
    to_stdout = str(json) == "-"
    with progress_bar() as progress:
        outcomes = detect_files(
            images,
            marker,
            camera,
            json=stdout if to_stdout else json,
            overlay=overlay,
            progress=progress,
            # Lines for people must not mix with data.
            tell=complain if to_stdout else print,
            warn=complain,
            **options,
        )
    raise typer.Exit(outcomes.status)
