"""A rig is exported like a marker: by suffix, all files or none."""

import json

import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from markergen.cli import main
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions, exporters_of
from markergen.model.body_json import load_marker_or_rig, rig_to_json, to_json
from markergen.model.boundary import Circle
from markergen.model.marker import build_marker
from markergen.workshop.drafting import views

SQUARE = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
MARKER = build_marker(SQUARE, Circle(0.06), diameter=0.02, clearance=0.002)
SIDE = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
RIG = mg.Rig((mg.Plate("front", MARKER, np.eye(3), (0, 0, 0.1)), mg.Plate("side", MARKER, SIDE, (0.1, 0, 0))))


def test_plate_options_are_for_every_marker(tmp_path):
    [written] = mg.export(RIG, tmp_path / "rig.json", thickness="5mm")
    markers = mg.Rig.load(written.path).markers
    assert [marker.marker.substrate.thickness for marker in markers] == [0.005, 0.005]


def test_the_command_takes_a_rig(tmp_path, capsys):
    RIG.save(tmp_path / "rig.json")
    assert main(["export", str(tmp_path / "rig.json"), "-o", str(tmp_path / "again.json")]) == 0
    assert (tmp_path / "again.json").read_bytes() == rig_to_json(RIG)
    for wrong in ("x.csv", "x"):
        assert main(["export", str(tmp_path / "rig.json"), "-o", str(tmp_path / wrong)]) == 2
        message = capsys.readouterr().err
        assert sentence("no rig suffix") in message
        assert ".json" in message


def test_a_rig_is_exported_by_itself(tmp_path):
    with pytest.raises(InputError, match="or one rig"):
        mg.export([MARKER, RIG], tmp_path / "both.json")
    assert not list(tmp_path.iterdir())


def test_a_marker_or_a_rig_is_told_by_its_content(tmp_path):
    (tmp_path / "m.json").write_bytes(to_json(MARKER))
    RIG.save(tmp_path / "r.json")
    assert load_marker_or_rig(tmp_path / "m.json") == MARKER
    assert load_marker_or_rig(tmp_path / "r.json") == RIG
    assert load_marker_or_rig(json.loads(rig_to_json(RIG))) == RIG
    with (tmp_path / "r.json").open() as file:
        assert load_marker_or_rig(file) == RIG
    assert load_marker_or_rig(RIG) is RIG
    with pytest.raises(InputError, match=r"Marker\.load"):
        load_marker_or_rig(3)


@pytest.mark.parametrize("suffix", sorted(exporters_of("rig")))
def test_the_same_rig_gives_the_same_bytes(suffix, monkeypatch):
    # Callouts are tried in few orders, and pictures have few pixels.
    monkeypatch.setattr(views, "TRIES", 1)
    options = ExportOptions(dpi=100)
    if not EXPORTERS[suffix].kernel:
        assert EXPORTERS[suffix](RIG, options) == EXPORTERS[suffix](RIG, options)
