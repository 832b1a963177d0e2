import shutil
import sys

import pytest
from sentences import sentence

from markergen.cli import main

BOUNDS = """
dot = "30mm"
poses = "cone:distance=0.6..1m,tilt=0..60,count=4,seed=1"
[study]
runs = 0
[grid]
n = [4, 5]
layout = ["ngon"]
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sweep.toml").write_text(BOUNDS)
    return tmp_path


def run(arguments, capsys):
    status = main(arguments.split())
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_a_sweep_is_written_refused_and_continued(here, capsys):
    status, out, err = run("study sweep.toml -o out --workers 1", capsys)
    assert status == 0
    assert out.splitlines()[-1] == "wrote out/index.html"
    assert "4 of 4 cells, 0 s left" in err
    before = {path: path.read_bytes() for path in (here / "out").rglob("*") if path.is_file()}
    status, _, err = run("study sweep.toml -o out", capsys)
    assert status == 2
    assert err.splitlines() == ["markergen: error: " + sentence("study there", "out")]
    assert run("study sweep.toml -o out --resume --workers 1", capsys)[0] == 0
    assert {path: path.read_bytes() for path in (here / "out").rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("study sweep.toml", "Missing option"),
        ("study sweep -o out", "expected paper, a known study, or a .toml file, found 'sweep'; known: paper, layouts"),
        ("study layuots -o out", "found 'layuots'; did you mean 'layouts'? Known: paper, layouts"),
        ("study none.toml -o out", "found No such file or directory"),
        ("study sweep.toml -o sweep.toml", "Not a directory"),
        ("study sweep.toml -o . ", "expected a new or empty folder"),
        ("study sweep.toml -o out --workers 0", "found workers=0"),
        ("study sweep.toml -o out --runs -1", "study.runs: a whole number"),
        ("study sweep.toml -o out --scale 0.1", "expected --scale with the study paper"),
        ("study sweep.toml -o out --scheduler here", "missing port number in address 'here'"),
        ("study paper -o out --scale 2", "expected a scale above 0"),
    ],
)
def test_what_cannot_be_is_told_in_a_line_before_anything_is_written(here, capsys, arguments, complaint):
    status, out, err = run(arguments, capsys)
    assert (status, out) == (2, "")
    assert complaint in err
    assert len(err.splitlines()) == 1
    assert sorted(path.name for path in here.iterdir()) == ["sweep.toml"]


def test_without_dask_a_scheduler_is_told_what_to_install(here, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, err = run("study sweep.toml -o out --scheduler tcp://127.0.0.1:1", capsys)
    assert status == 2
    assert "[cluster]'" in err


def test_a_full_disk_is_told_in_a_line(here, capsys, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    (here / "sweep.toml").write_text(BOUNDS.replace("[4, 5]", "[4]"))
    assert run("study sweep.toml -o out --workers 1", capsys)[0] == 0
    shutil.rmtree(here / "out" / "cells")
    monkeypatch.setattr("os.fsync", full)
    status, _, err = run("study sweep.toml -o out --workers 1 --resume", capsys)
    assert status == 2
    assert sentence("disk full") in err.splitlines()[-1]
