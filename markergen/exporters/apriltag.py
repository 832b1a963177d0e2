"""A bundle for apriltag_ros: the marker's AprilTag with its place in the marker's frame."""

from collections.abc import Sequence
from typing import Any

from markergen.errors import InputError
from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.configuration import frame_name, heading, picometers, yaml_text
from markergen.model.marker import Marker

SUFFIX = ".apriltag.yaml"
FAMILY = "apriltag:"


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Tag bundle for apriltag_ros; needs an AprilTag."""
    return Output(write_bundle(only(markers, SUFFIX)).encode())


def write_bundle(marker: Marker) -> str:
    """Write ``tag_bundles`` with the tag as its only member: the bundle's frame is the marker's.

    Both frames have x to the right, y up and z toward the viewer, so the tag's rotation is the identity.

    Raises
    ------
    InputError
        If the marker has no tag, or one that is no AprilTag.
    """
    tag = marker.tag
    if tag is None or not tag.family.startswith(FAMILY):
        found = "none" if tag is None else str(tag)
        raise InputError("a marker with an AprilTag", found, "design it with --tag apriltag:36h11:0, for example")
    x, y = (picometers(value * scale) for value, scale in zip(tag.center, marker.print_scale, strict=True))
    place: dict[str, Any] = {"x": x, "y": y, "z": 0.0, "qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
    layout = [{"id": tag.id, "size": tag.side, **place}]
    body = {"standalone_tags": [], "tag_bundles": [{"name": frame_name(marker), "layout": layout}]}
    family = f"tag{tag.family.removeprefix(FAMILY)}"
    title = "Tag bundle for apriltag_ros (tags.yaml)."
    remarks = (f"Set tag_family: '{family}' in settings.yaml; size is the side of the black square.",)
    return heading(marker, title, *remarks) + yaml_text(body)
