"""``markergen export``."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from markergen.cli import sheets, solids


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
    process: solids.Process = None,
    depth: solids.Depth = None,
    gap: solids.Gap = None,
    fit: solids.Fit = None,
    through: solids.Through = False,
    tool: solids.Tool = None,
    dome: solids.Dome = None,
    draft: solids.Draft = None,
    foot: solids.Foot = None,
    engrave: solids.Engrave = True,
    tolerance: solids.Tolerance = None,
    thickness: solids.Thickness = None,
    edge: solids.Edge = None,
    corner_radius: solids.CornerRadius = None,
    chamfer: solids.Chamfer = None,
    outline: solids.Outline = None,
    boundary_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="Of an --outline that names none: mm, cm, m, in, pt, px.")
    ] = None,
    mount: solids.Mount = None,
    dowel: solids.Dowel = None,
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
    from markergen.cli.console import busy, print_outputs
    from markergen.exporters import check_outputs, save
    from markergen.files import check_outputs as check_files
    from markergen.model.marker_json import read_marker

    choices = replace(
        sheets.export_options(paper, orientation, margin, tile, overlap, dpi, colors, compensate),
        fabrication=solids.fabrication(process, depth, gap, fit, through, tool, dome, draft, foot, engrave, tolerance),
    )
    plate = solids.plate_values(thickness, edge, corner_radius, chamfer, mount, dowel)
    inputs = [*marker, *([Path(outline)] if outline else [])]
    check_outputs(output, choices)
    check_files(output, inputs)
    read = [solids.with_plate(read_marker(path), plate, outline, boundary_unit) for path in marker]
    with busy("writing"):
        written = save(read, output, choices, inputs)
    print_outputs(written)
