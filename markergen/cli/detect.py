"""``markergen detect``."""

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli.console import length


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
        ),
    ] = None,
    camera_covariance: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Covariance, or a row of standard deviations, of fx, fy, cx, cy, ..."),
    ] = None,
    print_sigma: Annotated[
        float,
        typer.Option(
            parser=length, metavar="LENGTH", help="Error of each dot's place in print, 1 sigma along an axis."
        ),
    ] = "0.1mm",  # type: ignore[assignment]
    refine: Annotated[
        str, typer.Option(metavar="NAME", help="none, or photometric: align the rendered model with the image.")
    ] = "none",
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write what was found as JSON; - is standard output.")
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write each image here with what was found drawn in.")
    ] = None,
) -> None:
    """Find markers in images: dot centers with their covariance, homography, and pose T_camera_marker with its own.

    Status 1 if any image has no marker, 2 if any could not be used; the others are done all the same.

    \b
    Example:
      markergen detect photos/ --marker marker.json --camera camera.yaml --json found.json --overlay seen
    """
    from markergen.cli import FAILED, UNUSABLE
    from markergen.cli.console import complain, progress_bar
    from markergen.detect.batch import job_from_files, overlay_names, to_json
    from markergen.detect.sentences import image_lines, summary
    from markergen.errors import OutputError
    from markergen.files import check_outputs, make_folder, write_atomic
    from markergen.read.images import find_images

    to_stdout = str(json) == "-"
    job = job_from_files(marker, camera, camera_covariance, print_sigma, refine)
    paths = find_images(images)
    inputs = [*paths, *marker, *(path for path in (camera, camera_covariance) if path)]
    drawings = [overlay / name for name in overlay_names(paths)] if overlay else []
    if overlay:
        make_folder(overlay)
    check_outputs([*([json] if json and not to_stdout else []), *drawings], inputs)
    tell = complain if to_stdout else print
    outcomes, unwritten = [], 0
    try:
        with progress_bar() as progress:
            progress("detecting", 0, len(paths))
            for number, path in enumerate(paths):
                outcome = job.run(path)
                for line in image_lines(job, outcome):
                    (complain if outcome.error else tell)(line)
                if overlay and (drawn := job.overlay(outcome)):
                    try:
                        write_atomic(drawings[number], drawn)
                    except OutputError as error:
                        complain(f"{path}: {error}")
                        unwritten += 1
                # The image itself is not needed any more, and a folder of them would not fit into memory.
                outcomes.append(outcome.without_image())
                progress("detecting", len(outcomes), len(paths))
    finally:
        # Also when interrupted: what was found so far is not lost.
        if to_stdout:
            typer.echo(to_json(job, outcomes).decode(), nl=False)
        elif json:
            write_atomic(json, to_json(job, outcomes))
            print(f"wrote {json}")
    if len(paths) > 1:
        tell(summary(outcomes))
    if unwritten or any(outcome.error for outcome in outcomes):
        raise typer.Exit(UNUSABLE)
    if not all(outcome.found for outcome in outcomes):
        raise typer.Exit(FAILED)
