"""With --quiet, nothing is printed but errors and JSON."""

import json
from pathlib import Path

import pytest

import markergen as mg
from markergen.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("quiet")
    marker = mg.design(
        n=4, radius="60mm", dot="20mm", restarts=1, poses="cone:distance=0.4..0.6,tilt=0..40,count=4"
    ).marker
    marker.save(found / "m.json", found / "m.svg")
    return found


@pytest.mark.parametrize(
    "words",
    [
        "design --n 4 --radius 60mm --restarts 1 -o new.pdf",
        "design --n 4 --radius 60mm --restarts 1 --dot 0 -o bare.json",
        "export m.json -o m.dxf",
        "validate m.json --runs 2 --views 0 --json v.json",
        "verify m.json m.svg --json c.json",
        "rescale m.json --measured-x 99mm --measured-y 99mm -o smaller.json",
        "templates",
    ],
)
def test_quiet_says_nothing_and_does_the_same(words, folder, monkeypatch, capfd):
    monkeypatch.chdir(folder)
    assert main([*words.split(), "--quiet"]) == 0
    assert capfd.readouterr() == ("", "")
    for target in [word for word in words.split()[2:] if "." in word and not word.startswith("--")]:
        assert Path(target).exists()


def test_quiet_keeps_errors_and_json(folder, monkeypatch, capfd):
    monkeypatch.chdir(folder)
    assert main(["validate", "m.json", "--runs", "2", "--views", "0", "--quiet", "--json", "-"]) == 0
    said = capfd.readouterr()
    assert json.loads(said.out)["headline"]
    assert said.err == ""
    assert main(["--quiet", "validate", "none.json"]) == 2
    said = capfd.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    # The next command speaks again.
    assert main(["templates"]) == 0
    assert "desk-a4" in capfd.readouterr().out
