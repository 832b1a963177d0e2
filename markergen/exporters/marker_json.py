"""The marker itself as marker.json: the only format that holds everything, bare points included."""

from collections.abc import Sequence

from markergen.exporters import ExportOptions, Output, only
from markergen.model.marker import Marker
from markergen.model.marker_json import to_json


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Canonical marker.json; every option is without effect."""
    return Output(to_json(only(markers, ".json")))
