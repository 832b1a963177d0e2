"""``markergen export``."""

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli import sheets


def export(
    marker: Annotated[
        list[Path],
        typer.Argument(
            metavar="MARKER.JSON", help="As written by markergen design; several go on the same sheets of a .pdf."
        ),
    ],
    output: Annotated[
        list[Path], typer.Option("-o", "--output", metavar="PATH", help="Written by suffix; may be repeated.")
    ],
    paper: sheets.Paper = None,
    orientation: sheets.Orientation = None,
    margin: sheets.Margin = None,
    tile: sheets.Tile = True,
    overlap: sheets.Overlap = None,
    dpi: sheets.Dpi = 600,
    colors: sheets.ColorsText = None,
    compensate: sheets.Compensate = False,
) -> None:
    """Write a marker at true size to print, as drawing or solid to make, or as configuration for what detects it.

    \b
    Suffixes:
      .pdf            to print, all pages; with layers and trim box
      .svg            to print or edit, one page
      .png            pixels, one page; see --dpi
      .dxf            to cut and engrave, R2010 in mm
      .step .stp      solids, to machine or to print in two colors
      .json           the marker itself
      .csv            table of the dots, in m
      .opencv.yaml    OpenCV: object points and ids, tag as an ArUco board
      .ros2.yaml      ROS 2: static transform and landmarks
      .kalibr.yaml    target in the style of Kalibr
      .apriltag.yaml  apriltag_ros: bundle of an AprilTag

    \b
    Example:
      markergen export marker.json -o marker.step -o marker.svg
      markergen export marker.json -o marker.png --dpi 300 -o board.opencv.yaml
      markergen export marker.json -o cut.pdf --colors black,cut:CutContour
    """
    from markergen.cli.console import busy, print_outputs
    from markergen.export import check_outputs, save
    from markergen.files import check_outputs as check_files
    from markergen.model.marker_json import read_marker

    choices = sheets.export_options(paper, orientation, margin, tile, overlap, dpi, colors, compensate)
    check_outputs(output, choices)
    check_files(output, marker)
    read = [read_marker(path) for path in marker]
    with busy("writing"):
        written = save(read, output, choices)
    print_outputs(written)
