"""STEP: the marker as a plate with inlaid dots, to machine or to print in two colors."""

from collections.abc import Sequence

from markergen.drawing.scene import marker_name
from markergen.export import EXPORTERS, ExportOptions, Output, only, without_paper
from markergen.model.marker import Marker
from markergen.solid.inlay import marker_solids, plate_size
from markergen.solid.step import write_step


@EXPORTERS.register(".step", ".stp")
def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Named and colored solids as STEP; the paper is without effect."""
    marker = only(markers, ".step").as_designed
    data = write_step(marker_solids(marker), marker_name(marker))
    plate = f"{plate_size(marker)} and {marker.thickness * 1e3:.6g} mm thick"
    notes = [f"The solid is a plate {plate}, with one inlay per dot flush with its face.", *without_paper(options)]
    if marker.tag is not None:
        notes.append(f"The tag {marker.tag} is no part of the solid yet: print it, and glue it into the middle.")
    return Output(data, tuple(notes))
