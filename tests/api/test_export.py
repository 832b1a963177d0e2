import io
from dataclasses import replace

import pytest
from sentences import pattern, sentence

from markergen.api.export import export
from markergen.errors import InputError, OutputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.body_json import to_json
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Substrate


def test_it_writes_what_the_engine_does(pentagon, tmp_path):
    (tmp_path / "marker.json").write_bytes(to_json(pentagon))
    sources = [pentagon, tmp_path / "marker.json", str(tmp_path / "marker.json")]
    for k, source in enumerate(sources):
        written = export(source, tmp_path / f"{k}.svg", str(tmp_path / f"{k}.dxf"))
        assert [file.path.name for file in written] == [f"{k}.svg", f"{k}.dxf"]
    save(pentagon, [tmp_path / "engine.svg", tmp_path / "engine.dxf"], ExportOptions())
    for suffix in (".svg", ".dxf"):
        assert len({(tmp_path / f"{name}{suffix}").read_bytes() for name in (0, 1, 2, "engine")}) == 1


def test_a_marker_saves_itself(pentagon, tmp_path):
    [svg, record] = pentagon.save(tmp_path / "m.svg", tmp_path / "m.json", paper="A1", thickness="4mm")
    assert "A1" not in str(record)
    assert str(svg).splitlines()[0] == f"wrote {tmp_path / 'm.svg'}"
    assert Marker.load(tmp_path / "m.json").substrate == replace(Substrate(), thickness=0.004)
    assert pentagon.substrate == Substrate()


def test_what_disturbs_detection_is_told_once(pentagon, tmp_path, caplog):
    export(pentagon, tmp_path / "m.svg", tmp_path / "m.pdf", tmp_path / "m.dxf", mount=["M4:0mm,100mm"])
    [output] = [record.message for record in caplog.records]
    assert output.startswith(sentence("holes near dots") + ": the hole M4")
    caplog.clear()
    export(pentagon, tmp_path / "m.svg", colors="inverted", mount=["M4:0mm,0mm"])
    assert [record.message.partition(":")[0] for record in caplog.records] == [
        sentence("other colors", "dark", "light"),
    ]
    caplog.clear()
    export(pentagon, tmp_path / "m.csv", mount=["M4:0mm,100mm"])
    export(pentagon, tmp_path / "m.svg", colors="black", mount=["M4:0mm,0mm"])
    assert not caplog.records


def test_several_markers_share_sheets(pentagon, tmp_path):
    export([pentagon, to_json_dict(pentagon)], tmp_path / "both.pdf", paper="A0")
    assert (tmp_path / "both.pdf").read_bytes().startswith(b"%PDF")
    export((item for item in (pentagon, io.BytesIO(to_json(pentagon)))), tmp_path / "again.pdf", paper="A0")
    assert (tmp_path / "again.pdf").read_bytes() == (tmp_path / "both.pdf").read_bytes()


def to_json_dict(marker):
    import json

    return json.loads(to_json(marker))


def test_choices_of_a_process(pentagon, tmp_path, monkeypatch):
    from markergen import api

    seen = []
    monkeypatch.setattr(api.export, "save", lambda markers, paths, choices, inputs: seen.append(choices) or [])
    export(pentagon, tmp_path / "m.step", process="cnc", fit="press", tool="2mm", draft=0.0, engrave=False)
    assert seen[0].fabrication == Fabrication("cnc", fit="press", tool=0.002, engrave=False)


@pytest.mark.parametrize(
    ("paths", "options", "phrase"),
    [
        ((), {}, "a path to write to, found none"),
        ((3,), {}, "a path, found 3"),
        (("m.docx",), {}, "a known output suffix"),
        (("m.svg",), {"papr": "A4"}, "no such option: did you mean 'paper'?"),
        (("m.svg",), {"dpi": 1.5}, "dpi=1.5 (a whole number)"),
        (("m.svg",), {"colors": "pink"}, "expected colors, found 'pink'"),
        (("m.step",), {"process": "cast"}, "known: cnc, dome, fdm, laser, print"),
        (("m.step",), {"dome": "half"}, "--dome with --process dome"),
        (("m.json",), {"mount": ["4xM3@250mm/90"]}, "hole"),
        (("m.json",), {"outline": 4}, "outline=4 (an outline"),
        (("m.json",), {"boundary_unit": "mm"}, "a drawing for --boundary-unit"),
    ],
)
def test_bad_wishes(pentagon, paths, options, phrase, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        export(pentagon, *paths, **options)
    assert phrase in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("marker", [3, None, {"format": "other"}, "no-such.json", []])
def test_what_is_no_marker(marker, tmp_path):
    with pytest.raises(InputError):
        export(marker, tmp_path / "m.svg")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["plate.dxf", "plate.svg"])
def test_a_drawing_of_another_program_is_kept(pentagon, tmp_path, name):
    (tmp_path / name).write_text("drawn by somebody else")
    with pytest.raises(OutputError, match=f"drawing of another program at .*{name}"):
        export(pentagon, tmp_path / name, tmp_path / "m.pdf")
    assert (tmp_path / name).read_text() == "drawn by somebody else"
    assert not (tmp_path / "m.pdf").exists()
    (tmp_path / name).unlink()
    export(pentagon, tmp_path / name)
    export(pentagon, tmp_path / name)


def test_the_file_that_was_read_is_not_overwritten(pentagon, tmp_path):
    (tmp_path / "m.json").write_bytes(to_json(pentagon))
    with pytest.raises(OutputError, match=pattern("input overwritten")):
        export(tmp_path / "m.json", tmp_path / "m.json")
