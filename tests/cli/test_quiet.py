"""What is printed where: nothing but errors and JSON with --quiet, and words that a shell completes."""

import json
import os
import shutil
import subprocess
import sys
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


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_is_given_a_script_that_completes(shell):
    environment = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    command = [sys.executable, "-m", "markergen", "--show-completion", shell]
    script = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    assert "markergen" in script
    if not shutil.which(shell):
        pytest.skip(f"no {shell} in the path; its script is written")
    subprocess.run([shell, "-n"], input=script, text=True, check=True)


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("markergen des", "design"),
        ("markergen design --obj", "--objective"),
        ("markergen design --objective trans", "translation"),
        ("markergen design --template desk", "desk-a4 desk-letter"),
        ("markergen rig --template cu", "cube"),
        ("markergen export m.json --process las", "laser"),
    ],
)
def test_words_are_completed_in_bash(line, offered, tmp_path):
    if not shutil.which("bash"):
        pytest.skip("no bash in the path")
    words = line.split()
    (tmp_path / "markergen").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m markergen "$@"\n')
    (tmp_path / "markergen").chmod(0o755)
    script = (
        'eval "$(markergen --show-completion bash)"\n'
        f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}\n"
        '_markergen_completion markergen\necho "${COMPREPLY[@]}"\n'
    )
    environment = {
        **os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"
    }  # fmt: skip
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == offered.split()
