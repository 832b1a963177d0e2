"""rig.json, the only complete format of a rig."""

from markergen.exporters import RIG_EXPORTERS, Exporter, ExportOptions, Output
from markergen.model.rig import Rig
from markergen.model.rig_json import rig_to_json


def write_record(rig: Rig, options: ExportOptions) -> Output:  # noqa: ARG001  (same signature for every exporter)
    """rig.json with all markers inline; no option has an effect."""
    return Output(rig_to_json(rig))


RIG_EXPORTERS.register(".json")(Exporter(write_record, "the rig itself, all its markers in one file"))
