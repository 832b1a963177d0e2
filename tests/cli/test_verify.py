import json
import shutil

import pytest
from sentences import sentence

from markergen.cli import main
from markergen.exporters.saving import save
from markergen.model.body_json import to_json


@pytest.fixture(scope="module")
def written(make_ngon, tmp_path_factory):
    folder = tmp_path_factory.mktemp("verify")
    marker = make_ngon(5, 0.05, 0.012)
    (folder / "marker.json").write_bytes(to_json(marker))
    save(
        marker,
        [
            folder / f"marker{suffix}"
            for suffix in (".pdf", ".svg", ".dxf", ".csv", ".opencv.yaml", ".ros2.yaml", ".kalibr.yaml")
        ],
    )
    save(make_ngon(6, 0.05, 0.012), [folder / "other.svg"])
    return folder


@pytest.fixture
def here(written, tmp_path, monkeypatch):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_what_was_written_is_right(here, capsys):
    names = sorted(path.name for path in here.glob("marker.*"))
    assert main(["verify", "marker.json", *names]) == 0
    output = capsys.readouterr()
    assert not output.err
    assert output.out.count("   ok\n") == len(names) == 8
    assert "148 x 210 mm" in output.out
    assert "100.0000 %" in output.out


def test_what_is_wrong_is_status_1(here, capsys):
    text = (here / "marker.svg").read_text()
    (here / "scaled.svg").write_text(
        text.replace('width="148mm"', 'width="147.852mm"').replace('height="210mm"', 'height="209.79mm"')
    )
    assert main(["verify", "marker.json", "marker.csv", "scaled.svg", "other.svg"]) == 1
    output = capsys.readouterr().out
    assert output.count("WRONG") == 2
    assert "scaled.svg: " + sentence("scaled", "0.999 along x and y") in output
    assert "other.svg: another marker" in output
    assert "99.9000 %" in output
    # What is 43 um off may be so if that is good enough.
    assert main(["verify", "marker.json", "scaled.svg", "--tolerance", "0.1mm"]) == 0


def test_standard_output_is_json_alone(here, capsys):
    assert main(["verify", "marker.json", "marker.svg", "other.svg", "--json", "-"]) == 1
    good, bad = json.loads(capsys.readouterr().out)
    assert good["passed"]
    assert good["largest_m"] < 1e-8
    assert good["pages_mm"] == [pytest.approx([148, 210])]
    assert bad["findings"][0]["kind"] == "another marker"
    assert main(["verify", "marker.json", "marker.csv", "--json", "found.json"]) == 0
    assert json.loads((here / "found.json").read_text())[0]["dots"] == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["marker.json", "none.svg"], "No such file"),
        (["none.json", "marker.svg"], "none.json"),
        (["marker.json", "marker.jpg"], "Known: .3mf, .apriltag.yaml, .b"),
        (["marker.json", "broken.pdf"], "complete PDF"),
        (["marker.json", "empty.svg"], "empty"),
        (["marker.json", "marker.svg", "--tolerance", "0"], "tolerance above 0"),
        (["marker.json", "marker.svg", "--tolerance", "much"], "length"),
        (["marker.json", "marker.svg", "--json", "marker.svg"], "one of the inputs"),
        (["marker.json", "marker.svg", "--json", "no/folder/x.json"], "no/folder"),
        (["marker.json"], "FILE"),
    ],
)
def test_bad_input_is_one_line_and_status_2(here, capsys, arguments, message):
    (here / "broken.pdf").write_bytes((here / "marker.pdf").read_bytes()[:2000])
    (here / "empty.svg").write_bytes(b"")
    before = {path: path.read_bytes() for path in here.iterdir()}
    assert main(["verify", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("markergen: error: ")
    assert len(error.strip().splitlines()) == 1
    assert message in error
    assert {path: path.read_bytes() for path in here.iterdir()} == before


def test_the_others_are_verified_all_the_same(here, capsys):
    assert main(["verify", "marker.json", "none.svg", "marker.csv"]) == 2
    output = capsys.readouterr()
    assert "none.svg" in output.err
    assert "   ok\n" in output.out
    assert "by the best rotation and translation" in " ".join(output.out.split())
