"""ROS 2 parameters: where the marker is, as a static transform, and its dots as landmarks in its frame."""

from collections.abc import Sequence
from typing import Any

from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.configuration import diameters, frame_name, heading, ids, points, tag_corners, yaml_text
from markergen.model.marker import Marker

SUFFIX = ".ros2.yaml"


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Static transform and landmarks as ROS 2 parameters."""
    note = "The transform from map is the identity: set it to where the marker hangs."
    return Output(write_ros2(only(markers, SUFFIX)).encode(), (note,))


def write_ros2(marker: Marker) -> str:
    """Write parameters of two nodes: ``<frame>_transform`` for tf2_ros' static broadcaster, ``<frame>_landmarks``.

    ROS 2 parameters hold lists of numbers but no lists of lists, so the landmarks are one list per coordinate.
    """
    frame = frame_name(marker)
    x, y, z = (list(values) for values in zip(*points(marker), strict=True))
    landmarks: dict[str, Any] = {
        "frame_id": frame, "ids": ids(marker), "x": x, "y": y, "z": z, "diameter": diameters(marker),
    }  # fmt: skip
    if marker.tag is not None:
        corner_x, corner_y, _ = (list(values) for values in zip(*tag_corners(marker), strict=True))
        family, tag = marker.tag.family, {"id": marker.tag.id, "size": marker.tag.side}
        landmarks["tag"] = {"family": family, **tag, "corner_x": corner_x, "corner_y": corner_y}
    transform = {
        "frame_id": "map",
        "child_frame_id": frame,
        "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
        "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }
    remarks = (
        "Transform: parameters of tf2_ros::StaticTransformBroadcasterNode. It is the identity until translation and",
        "rotation say where in the map the marker hangs.",
        "Landmarks: dot ids[k] is at (x[k], y[k], z[k]) in the marker's frame.",
        *(("Tag: size is the side of its black square; corners are clockwise from the top left.",) * bool(marker.tag)),
    )
    nodes = {"transform": transform, "landmarks": landmarks}
    body = {f"{frame}_{name}": {"ros__parameters": values} for name, values in nodes.items()}
    return heading(marker, "Parameters for ROS 2.", *remarks) + yaml_text(body)
