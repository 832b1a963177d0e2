"""``markergen detect``."""
# tests: tests/cli/test_detect.py

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Refine, calibration_file, with_options
from markergen.options import VIEW
from markergen.options.declarations import DetectKeywords


@with_options(DetectKeywords)
def detect(
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGE...",
            help="Image files, folders of them, or patterns such as '*.png'; or one video, camera number such as 0, "
            "stream such as rtsp://..., or GStreamer pipeline.",
        ),
    ],
    marker: Annotated[
        list[Path], typer.Option(metavar="MARKER.JSON", help="Marker or rig to look for; may be repeated.")
    ],
    camera: Annotated[Path | None, calibration_file("none: pixels and homography")] = None,
    image_size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH",
            help="Size of the images in px, for a camera's file without it: 640x480.",
            rich_help_panel=VIEW,
        ),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the detections as JSON, of a video a line for each frame; - is standard output."
        ),
    ] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(metavar="DIR|FILE.mp4", help="Write each image here, or the video, with its detections drawn in."),
    ] = None,
    refine: Refine = None,  # noqa: ARG001 - of the release before
    **options: Any,
) -> None:
    """Find markers in images or a video: dot centers and pose T_camera_marker, with covariance, and homography.

    Status 1 if any image or frame has no marker, 2 if any image cannot be used; the others are processed regardless.

    \b
    Example:
      markergen detect photos/ --marker marker.json --camera camera.yaml --json found.json --overlay seen
      markergen detect walk.mp4 --marker marker.json --camera camera.yaml --json found.jsonl --overlay seen.mp4
      markergen detect 0 --marker marker.json --camera camera.yaml --json - | jq .markers[0].pose
    """
    from markergen.detect.batch import detect_files
    from markergen.detect.video import detect_video
    from markergen.read.cameras import sized
    from markergen.read.videos import is_video

    camera = sized(camera, image_size, images)
    # While the progress bar is shown, it replaces the stream.
    stdout = sys.stdout
    to_stdout = console.is_stdout(json)
    options.update(json=stdout if to_stdout else json, overlay=overlay, warn=console.note)
    # Lines for people must not mix with data.
    options["tell"] = console.note if to_stdout else console.report
    result: Any
    if any(map(is_video, images)):
        with nullcontext() if to_stdout and stdout.isatty() else console.status_line("waiting for a frame") as show:
            result = detect_video(images, marker, camera, show=show, **options)
    else:
        with console.progress_bar() as progress:
            result = detect_files(images, marker, camera, progress=progress, **options)
    raise typer.Exit(result.status)
