"""The marker itself as marker.json: the only format that holds everything, bare points included."""

from markergen.export import EXPORTERS, ExportOptions, Output
from markergen.model.marker import Marker
from markergen.model.marker_json import to_json


@EXPORTERS.register(".json")
def export(marker: Marker, options: ExportOptions) -> Output:  # noqa: ARG001  (every exporter is called alike)
    """Canonical marker.json; every option is without effect."""
    return Output(to_json(marker))
