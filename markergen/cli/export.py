"""``markergen export``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli.options import with_options
from markergen.options import ExportKeywords


@with_options(ExportKeywords)
def export(
    marker: Annotated[
        list[Path],
        typer.Argument(
            metavar="MARKER.JSON", help="As written by markergen design; several go on the same sheets of a .pdf."
        ),
    ],
    output: Annotated[
        list[Path],
        typer.Option("-o", "--output", metavar="PATH", help="Written by suffix; may be repeated."),
    ],
    **options: Any,
) -> None:
    """Write a marker at true size to print, as drawing or solid to make, or as configuration for what detects it.

    \b
    Suffixes:
      .pdf            to print, all pages; with layers and trim box
      .svg            to print or edit, one page
      .png            pixels, one page; see --dpi
      .dxf            to cut and engrave, R2010 in mm; see --process laser
      .step .stp      solids, named and colored, in mm, to machine or to print
      .brep           the same for Open CASCADE
      .stl            mesh in mm, all in one, and one more for each material
      .3mf            mesh with materials, for slicers
      .glb            mesh with materials, in m, to look at
      .sdf .urdf      model for simulators, with the .glb that it shows
      .fab.pdf        drawing with dimensions and a table of the dots, for the workshop
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
      markergen export marker.json -o marker.3mf --thickness 4mm --chamfer 0.5mm --mount 4xM3c@120mm
      markergen export marker.json -o marker.step -o marker.fab.pdf --process cnc --fit press --tool 3mm

    What is said of the plate, from --thickness to --dowel, takes the place of what marker.json says.
    """
    from markergen.api.export import export as write
    from markergen.cli import console

    with console.busy("writing"):
        written = write(marker, *output, **options)
    console.print_parts(map(str, written))
