"""Tags and families from the command line: what is written, and what is refused before any search."""

import json

import numpy as np
import pytest

from markergen.cli import main
from markergen.model.body_json import read_marker
from markergen.optimize.problem import breach

QUICK = ["design", "--restarts", "1", "--radius", "60mm", "--dot", "20mm", "--poses", "cone:count=8"]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_tag_in_the_middle(here):
    assert main([*QUICK, "--tag", "apriltag:36h11:3", "--tag-size", "24mm", "-o", "m.json"]) == 0
    marker = read_marker(here / "m.json")
    assert (str(marker.tag), marker.tag.side) == ("apriltag:36h11:3", 0.024)
    stored = json.loads((here / "m.json").read_text())
    np.testing.assert_allclose(stored["tag"]["corners"][0], [-0.012, 0.012, 0.0], atol=1e-15, rtol=0)
    assert (stored["provenance"]["spec"]["tag"], stored["provenance"]["spec"]["tag_side"]) == (str(marker.tag), 0.024)
    assert breach(marker.xyz, marker.boundary, marker.blocked, marker.dot_diameter, marker.clearance) <= 1e-9


@pytest.mark.long
def test_a_family_on_one_sheet(here, capsys):
    assert main([*QUICK, "--tag", "aruco:DICT_4X4_50", "--ids", "0-2,9", "--paper", "A2", "-o", "f.pdf"]) == 0
    names = ["f-0.json", "f-1.json", "f-2.json", "f-9.json", "f.pdf"]
    assert sorted(path.name for path in here.iterdir()) == names
    markers = [read_marker(here / name) for name in names[:-1]]
    assert [str(marker.tag) for marker in markers] == [f"aruco:DICT_4X4_50:{k}" for k in (0, 1, 2, 9)]
    assert len({marker.control_points for marker in markers}) == 1
    assert len({marker.spec_hash for marker in markers}) == 4
    # A third of the radius.
    assert markers[0].tag.side == 0.02
    out = capsys.readouterr().out
    assert all(f"wrote {name}" in out for name in names)


@pytest.mark.long
def test_a_member_is_what_a_design_of_its_own_gives(here):
    tag = ["--tag", "aruco:DICT_4X4_50:9"]
    assert main([*QUICK, *tag, "--ids", "0,9", "-o", "f.json"]) == 0
    assert main([*QUICK, *tag, "-o", "alone.json"]) == 0
    assert (here / "f-9.json").read_bytes() == (here / "alone.json").read_bytes()
    assert not (here / "f.json").exists()


@pytest.mark.long
def test_the_solid_has_the_tag(here):
    assert main([*QUICK, "--tag", "aruco:DICT_4X4_50:1", "-o", "m.step"]) == 0
    assert "PRODUCT('tag-" in (here / "m.step").read_text(encoding="ascii")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--tag", "aruco:DICT_4X4_51:1"], "did you mean 'aruco:DICT_4X4_50'? Known: aruco:DICT_4X4_50 to "),
        (["--tag", "aruco:DICT_4X4_50:50"], "expected an id of 0 to 49 in aruco:DICT_4X4_50, found id=50"),
        (["--tag", "apriltag:36h11:x"], "write the id as a number"),
        (["--tag", "apriltag:36h11:1", "--tag-size", "100mm"], "in the middle of a disk of radius 60 mm; use --tag-s"),
        (["--tag", "apriltag:36h11:1", "--tag-size", "0mm"], "a tag side above 0"),
        (["--tag", "apriltag:36h11:1", "--keep-out", "circle:5mm"], "no room in the middle: leave out --tag"),
        (["--tag-size", "20mm"], "a tag with a tag size"),
        (["--ids", "0-9"], "expected a tag for the ids, found --ids without --tag"),
        (["--tag", "aruco:DICT_4X4_50", "--ids", "0-50"], "ids of 0 to 49"),
        (["--tag", "aruco:DICT_4X4_50", "--ids", "none"], "ids such as 0-9 or 0,3,7"),
        (["--tag", "aruco:DICT_4X4_50", "--ids", "1,1"], "id 1 twice"),
    ],
)
def test_what_does_not_go_is_one_line_and_nothing_written(here, capsys, options, message, monkeypatch):
    monkeypatch.setattr("markergen.optimize.design.design", None)
    assert main([*QUICK, *options, "-o", "m.pdf"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert list(here.iterdir()) == []


def test_members_are_not_written_over_an_input(here, capsys):
    (here / "f-1.json").write_text("{}")
    assert main([*QUICK, "--tag", "aruco:DICT_4X4_50", "--ids", "1", "--poses", "f-1.json", "-o", "f.json"]) == 2
    assert (here / "f-1.json").read_text() == "{}"
    assert capsys.readouterr().err.count("\n") == 1
