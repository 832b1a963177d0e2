from markergen.exporters import ExportOptions
from markergen.exporters.formats.points import write_record
from markergen.model.body_json import from_json, to_json


def test_is_the_marker_itself(make_ngon):
    for diameter in (0.0, 0.02):
        marker = make_ngon(5, 0.1, diameter)
        output = write_record([marker], ExportOptions())
        assert output.data == to_json(marker)
        assert from_json(output.data.decode()) == marker
