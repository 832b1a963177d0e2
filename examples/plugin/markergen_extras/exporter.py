"""``-o marker.xyz``: the control points as a point cloud, for CloudCompare and MeshLab."""

from collections.abc import Sequence

from markergen.exporters import Exporter, ExportOptions, Output, only
from markergen.model.marker import Marker


def write(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Write one line ``x y z`` per control point, in m, marker frame."""
    del options
    points = only(markers, ".xyz").control_points
    lines = [f"{point.x!r} {point.y!r} {point.z!r}" for point in points]
    return Output(("\n".join(lines) + "\n").encode(), (f"{len(points)} points in m.",))


XYZ = Exporter(write, "point cloud of the control points, in m")
