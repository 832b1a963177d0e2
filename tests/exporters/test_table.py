"""One table of formats for all bodies; that of rigs, of the release before, is read for one more."""

import numpy as np
import pytest
from sentences import pattern

import markergen as mg
from markergen import exporters
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, Exporter, ExportOptions, Output, catalog, exporters_of
from markergen.exporters.saving import frame_of, save
from tests.support.rigs import cube

RIG = cube(0.08)
MARKER = RIG.plates[0].marker


@pytest.fixture
def added():
    """Formats that a script registers, gone after the test."""
    tables = {"markers": EXPORTERS, "rigs": exporters._FORMER}
    before = {name: dict(table._entries) for name, table in tables.items() if table.names() is not None}
    yield tables
    for name, table in tables.items():
        table._entries = before[name]
        table._outside = {suffix: place for suffix, place in table._outside.items() if suffix in before[name]}


def test_every_format_of_a_rig_holds_markers_as_well():
    assert set(exporters_of("rig")) < set(exporters_of()) == set(EXPORTERS)
    for frame in ("marker", "rig"):
        rows = {suffix: purpose for suffixes, purpose in catalog(frame) for suffix in suffixes}
        assert rows == {suffix: EXPORTERS[suffix].purpose(frame) for suffix in exporters_of(frame)}


def test_a_format_of_markers_alone_refuses_a_rig_in_one_line(added, tmp_path):
    writer = Exporter(lambda markers, _: Output(f"{len(markers[0])}".encode()), "number of dots")
    added["markers"].register(".count")(writer)
    [written] = save(MARKER, [tmp_path / "a.count"])
    assert written.path.read_text() == f"{len(MARKER)}"
    with pytest.raises(InputError, match=pattern("no rig suffix")) as error:
        save(RIG, [tmp_path / "rig.count"])
    assert "\n" not in str(error.value)
    assert not (tmp_path / "rig.count").exists()


def test_formats_of_a_rig_as_the_release_before_had_them(added, tmp_path):
    with pytest.warns(DeprecationWarning, match="now EXPORTERS"):
        table = exporters.RIG_EXPORTERS
    assert table[".urdf"].description == EXPORTERS[".urdf"].rig_description
    assert table[".json"](RIG, ExportOptions()) == EXPORTERS[".json"](RIG, ExportOptions())
    table.register(".faces")(Exporter(lambda rig, _: Output(f"{len(rig.markers)}".encode()), "number of faces"))
    [written] = save(RIG, [tmp_path / "rig.faces"])
    assert written.path.read_text() == "6"
    assert ((".faces",), "number of faces") in catalog("rig")
    with pytest.raises(InputError, match="known output suffix"):
        save(MARKER, [tmp_path / "marker.faces"])
    with pytest.raises(AttributeError):
        exporters.NO_EXPORTERS  # noqa: B018


def test_a_rig_is_alone():
    assert frame_of([MARKER, MARKER]) == "marker"
    assert frame_of([RIG]) == "rig"
    with pytest.raises(InputError, match="or one rig"):
        frame_of([MARKER, RIG])


def test_an_image_of_a_rig_says_its_size(tmp_path):
    [written] = mg.export(mg.Rig((mg.Plate("a", MARKER, np.eye(3), (0, 0, 0)),)), tmp_path / "a.png", dpi=100)
    assert any("pixels" in note for note in written.notes)
