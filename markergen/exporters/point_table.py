"""CSV: a line per control point, for everything that reads tables."""

import csv
from collections.abc import Sequence
from io import StringIO

from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.configuration import heading, tag_corners
from markergen.model.marker import Marker

COLUMNS = ("id", "x_m", "y_m", "z_m", "diameter_m", "inner_diameter_m", "feature")
MEASURED = ("var_x_m2", "cov_xy_m2", "var_y_m2")


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Table of the control points."""
    return Output(write_table(only(markers, ".csv")).encode())


def write_table(marker: Marker) -> str:
    """Write comment lines (``#``), the columns' names, and a row for each control point; numbers read back the same.

    Covariances of measured places have columns of their own if there are any.
    """
    measured = any(point.covariance for point in marker.control_points)
    tag: tuple[str, ...] = ()
    if marker.tag is not None:
        corners = ", ".join(f"({x!r}, {y!r})" for x, y, _ in tag_corners(marker))
        tag = (f"Tag {marker.tag}: side {marker.tag.side!r}, corners from the top left clockwise {corners}.",)
    text = StringIO()
    text.write(heading(marker, "Control points.", *tag))
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(COLUMNS + MEASURED * measured)
    for point in marker.control_points:
        feature = point.feature
        row = [point.id, point.x, point.y, point.z, feature.diameter, feature.inner_diameter, feature.kind]
        lines.writerow([*row, *(point.covariance or ("", "", ""))] if measured else row)
    return text.getvalue()
