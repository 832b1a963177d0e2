import io
import json
import pickle
import sys
from pathlib import Path

import pytest

from markergen.api import compare as module
from markergen.api.compare import compare
from markergen.cli import main
from markergen.comparison import compare as engine
from markergen.comparison import series
from markergen.errors import InputError, MissingLibraryError, OutputError
from markergen.model.body_json import to_json

FEW = {"views": 2, "poses": "cone:distance=1.3..1.5m,count=20", "workers": 1}


@pytest.fixture(scope="module")
def found(pentagon):
    return compare(pentagon, "square", **FEW)


@pytest.fixture
def hostile(found):
    """The same with a name that a file may have."""
    entries = [dict(entry, name="<script>[red]x[/red]") for entry in found.results["contestants"][:1]]
    return type(found)(dict(found.results) | {"contestants": entries})


@pytest.mark.long
def test_markers_paths_dictionaries_and_texts(found, pentagon, tmp_path):
    path = tmp_path / "m.json"
    path.write_bytes(to_json(pentagon))
    assert list(found.contestants) == ["marker", "square"]
    with path.open() as file:
        again = compare(path, json.loads(path.read_text()), file, "square", **FEW)
    assert list(again.contestants) == [str(path), "marker 1", "marker 2", "square"]
    errors = [contestant["rotation_deg"] for contestant in again.contestants.values()]
    assert errors[0] == errors[1] == errors[2] == found.contestants["marker"]["rotation_deg"]
    assert errors[3] == found.contestants["square"]["rotation_deg"]


@pytest.mark.long
def test_one_alone_meets_one_of_each(pentagon, monkeypatch):
    monkeypatch.setattr(engine, "TUNING_VIEWS", 1)
    names = list(compare(pentagon, **{**FEW, "views": 1}).contestants)
    assert names[0] == "marker"
    assert {"square", "aruco:DICT_4X4_50"} <= set(names)


def test_an_open_file_is_a_contestant(pentagon):
    names = list(compare(io.StringIO(to_json(pentagon).decode()), "square", **FEW).contestants)
    assert names == ["marker", "square"]


def test_files_and_their_bytes(found, pentagon, tmp_path):
    names = ("c.json", "c.svg", "c.png")
    again = compare(
        pentagon, "square", **FEW, save=[tmp_path / name for name in names[:2]],
        json=tmp_path / "plain", plot=str(tmp_path / "c.png"),
    )  # fmt: skip
    assert [item.path.name for item in again.written] == ["c.json", "c.svg", "plain", "c.png"]
    (tmp_path / "later").mkdir()
    found.save(*(tmp_path / "later" / name for name in names))
    for name in names:
        assert (tmp_path / "later" / name).read_bytes() == (tmp_path / name).read_bytes()
    assert json.loads((tmp_path / "plain").read_text()) == dict(found.results)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ([], {}, "none"),
        ([3], {}, "a marker, a path, or a text"),
        ([..., None], {}, "a marker, a path, or a text"),
        ([..., "hexagon"], {}, "known: MARKER.json"),
        ([...], {"view": 3}, "did you mean 'views'?"),
        ([...], {"views": "3"}, "views='3' (a whole number)"),
        ([...], {"views": 0}, "one or more views"),
        ([...], {"print_sigma": "5 parsec"}, "a length"),
        ([...], {"plot": "c.json"}, ".svg or .png"),
        ([...], {"save": "c.pdf"}, ".json, .svg, .png"),
    ],
)
def test_bad_input_is_our_own_error_in_one_line(arguments, options, message, pentagon, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        compare(*(pentagon if argument is ... else argument for argument in arguments), **{**FEW, **options})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_single_view_has_no_interval(pentagon):
    single = compare(pentagon, "square", **{**FEW, "views": 1})
    assert single.contestants["square"]["ratio"]["rotation_deg"]["interval"] is None
    assert "–" not in str(single)
    assert single.to_frame()["ratio_low"].isna().all()


def test_what_cannot_be_written_is_told_before_the_work(pentagon, tmp_path, monkeypatch):
    path = tmp_path / "m.json"
    path.write_bytes(to_json(pentagon))
    monkeypatch.setattr(module, "run", None)
    for options in ({"json": path}, {"plot": tmp_path / "no" / "c.svg"}):
        with pytest.raises(OutputError):
            compare(path, "square", **options)


@pytest.mark.long
def test_printed_it_is_what_the_command_prints(pentagon, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # Processor time differs from run to run.
    monkeypatch.setattr(series.time, "process_time", lambda: 0.0)
    comparison = compare(pentagon, "square", **FEW)
    Path("marker").write_bytes(to_json(pentagon))
    arguments = ["compare", "marker", "square", "--views", "2", "--poses", FEW["poses"], "--workers", "1"]
    assert main(arguments) == 0
    assert capsys.readouterr().out == str(comparison) + "\n"
    assert len(repr(comparison)) < 2000
    assert "2 views; marker 0.0" in repr(comparison)


def test_html_is_escaped_and_text_as_it_is(found, hostile):
    assert found._repr_html_().count("<table>") == 7
    assert "<script>" not in hostile._repr_html_()
    assert "&lt;script&gt;[red]x[/red]" in hostile._repr_html_()
    assert "<script>[red]x[/red]" in str(hostile)


def test_rows_for_each_contestant(found, frames):
    rows = found.to_frame()
    assert [row["name"] for row in rows] == ["marker", "square"]
    assert rows[0]["ratio"] == 1
    assert rows[1]["ratio_low"] <= rows[1]["ratio"] <= rows[1]["ratio_high"]
    assert rows[1]["rotation_deg_p95"] == found.contestants["square"]["rotation_deg"]["p95"]


def test_without_pandas_the_message_says_how_to_get_it(found, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingLibraryError, match="pip install pandas"):
        found.to_frame()


def test_the_plot_names_all(found):
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    assert found.plot(ax) is ax
    assert [label.get_text() for label in ax.get_yticklabels()] == ["marker", "square"]
    assert found.plot().figure.axes


def test_it_can_be_sent_to_another_process(found):
    assert str(pickle.loads(pickle.dumps(found))) == str(found)
