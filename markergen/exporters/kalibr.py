"""A target file in the style of Kalibr's, for programs that read these; Kalibr itself has no such target."""

from collections.abc import Sequence
from typing import Any

from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.configuration import heading, tag_corners, yaml_text
from markergen.model.marker import Marker

SUFFIX = ".kalibr.yaml"

NOT_KALIBR = "Kalibr knows three targets: checkerboard, circlegrid and aprilgrid, all of them grids; this is none."
"""An aprilgrid has 3 x 3 tags or more, whose black border is two cells wide; a circlegrid 3 x 3 like dots or more,
which the key ring is not."""


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Target in the style of Kalibr, with the type custom."""
    return Output(write_kalibr(only(markers, SUFFIX)).encode(), (NOT_KALIBR,))


def write_kalibr(marker: Marker) -> str:
    """Write ``target_type: custom`` and a list of points with id, place and diameter in m.

    Kalibr refuses any other type than those of its grids, and no layout that markergen designs is one, so the type is
    a new one rather than a lie.
    """
    body: dict[str, Any] = {
        "target_type": "custom",
        "unit": "m",
        "points": [
            {"id": point.id, "x": point.x, "y": point.y, "z": point.z, "diameter": point.feature.diameter}
            for point in marker.control_points
        ],
    }
    if marker.tag is not None:
        tag = {"family": marker.tag.family, "id": marker.tag.id, "size": marker.tag.side}
        body["tag"] = {**tag, "corners": tag_corners(marker)}
    return heading(marker, "Target in the style of Kalibr.", NOT_KALIBR) + yaml_text(body)
