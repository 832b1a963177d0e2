import json

import pytest

from markergen.cli import main
from markergen.comparison import compare, series
from markergen.comparison.contestants import printed
from markergen.model.body_json import to_json


@pytest.fixture
def here(tmp_path, monkeypatch, pentagon):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compare, "TUNING_VIEWS", 2)
    # Large images take most of the time.
    monkeypatch.setattr(printed, "IMAGES", {"image as it is": 1, "image x2": 2})
    monkeypatch.setattr(series, "BUDGET", 12)
    (tmp_path / "marker.json").write_bytes(to_json(pentagon))
    return tmp_path


def test_tables_json_and_picture(here, capsys):
    arguments = ["compare", "marker.json", "square", "aruco:DICT_4X4_50:7", "--views", "2", "--workers", "1"]
    arguments += ["--poses", "cone:distance=1.3..1.5m,count=20"]
    assert main([*arguments, "--json", "c.json", "--plot", "c.svg"]) == 0
    output = capsys.readouterr().out
    for phrase in ("marker.json", "square", "aruco:DICT_4X4_50:7", "ratio", "wrote c.json", "wrote c.svg"):
        assert phrase in output
    assert json.loads((here / "c.json").read_text())["views"]["count"] == 2
    assert "<svg" in (here / "c.svg").read_text()
    assert main([*arguments[:3], *arguments[4:], "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["contestants"][1]["name"] == "square"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["marker.json", "hexagon"], "known: MARKER.json, ngon:N"),
        (["marker.json", "apriltag:36h11:587"], "an id of 0 to 586"),
        (["marker.json", "nowhere.json"], "nowhere.json"),
        (["marker.json", "--plot", "c.gif"], ".svg or .png"),
        (["marker.json", "--plot", "no/c.svg"], "the folder no does not exist"),
        (["marker.json", "--views", "0"], "one or more views"),
        (["marker.json", "--print-sigma", "5 parsecs"], "a length"),
        ([], "compare --help"),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments, message, here, capsys):
    assert main(["compare", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert captured.err.startswith("markergen: error: ")
    assert message in captured.err
    assert {path.name for path in here.iterdir()} == {"marker.json"}
