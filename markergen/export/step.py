"""STEP: the marker as a plate with inlaid dots, to machine or to print in two colors."""

from markergen.drawing.scene import marker_name
from markergen.export import EXPORTERS, ExportOptions, Output
from markergen.model.marker import Marker
from markergen.solid.inlay import marker_solids, plate_size
from markergen.solid.step import write_step


@EXPORTERS.register(".step", ".stp")
def export(marker: Marker, options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Named and colored solids as STEP; the paper is without effect."""
    data = write_step(marker_solids(marker), marker_name(marker))
    plate = f"{plate_size(marker)} and {marker.thickness * 1e3:.6g} mm thick"
    return Output(data, (f"The solid is a plate {plate}, with one inlay per dot flush with its face.",))
