"""With --quiet, errors are still printed; that all else is silent, tests/contracts/test_commands.py says."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

import markergen as mg
from markergen.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    result = tmp_path_factory.mktemp("quiet")
    marker = mg.design(
        n=4, radius="60mm", dot="20mm", restarts=1, poses="cone:distance=0.4..0.6,tilt=0..40,count=4"
    ).marker
    marker.save(result / "m.json", result / "m.svg")
    return result


def test_quiet_keeps_errors_and_json(folder, monkeypatch, capfd):
    monkeypatch.chdir(folder)
    assert main(["validate", "m.json", "--runs", "2", "--views", "0", "--quiet", "--json", "-"]) == 0
    output = capfd.readouterr()
    assert json.loads(output.out)["headline"]
    assert output.err == ""
    assert main(["--quiet", "validate", "none.json"]) == 2
    output = capfd.readouterr()
    assert (output.out, output.err.count("\n")) == ("", 1)
    # The next command speaks again.
    assert main(["templates"]) == 0
    assert "desk-a4" in capfd.readouterr().out


@pytest.mark.parametrize(
    "encoding", ["ascii", *(pytest.param(name, marks=pytest.mark.long) for name in ("cp1252", "latin-1"))]
)
def test_terminals_that_lack_letters_show_others_instead(encoding):
    done = subprocess.run(
        [sys.executable, "-m", "markergen", "templates"],
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": encoding},
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"?" in done.stdout


def test_a_terminated_command_leaves_no_file_half_written(tmp_path):
    arguments = ["design", "--n", "12", "--restarts", "4000", "--poses", "cone:count=8", "-o", "a.pdf"]
    process = subprocess.Popen([sys.executable, "-m", "markergen", *arguments], cwd=tmp_path, stderr=subprocess.PIPE)
    time.sleep(2)
    process.send_signal(signal.SIGTERM)
    _, complaint = process.communicate(timeout=60)
    # What a search has by then is written; before it begins, and while modules are imported, there is nothing to write.
    assert process.returncode in (130, 128 + signal.SIGTERM, -signal.SIGTERM)
    assert b"Traceback" not in complaint
    assert {path.name for path in tmp_path.iterdir()} == ({"a.pdf", "a.json"} if process.returncode == 130 else set())
