"""A shell completes commands, options, names and files, set up as README says."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from markergen.api.names import NAMES, names_of
from markergen.options import declared
from markergen.options.calibration import CalibrateKeywords
from markergen.options.declarations import DesignKeywords, DetectKeywords, ExportKeywords, ValidateKeywords

ROOT = Path(__file__).parents[2]
TABLES = (DesignKeywords, ExportKeywords, ValidateKeywords, DetectKeywords, CalibrateKeywords)
LISTED_ELSEWHERE = ("boundary_unit", "paper", "poses", "process", "template")
"""Options whose help says where the names are, or gives the usual ones or a range."""

BASH = """
markergen --install-completion
source ~/.bashrc
complete -p markergen
complete_words() {
    COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMPREPLY=()
    _markergen_completion markergen
    echo "${COMPREPLY[@]}"
}
complete_words markergen de
complete_words markergen rescale marker.json --measured-
complete_words markergen design --objective ''
"""

ZSH = 'autoload -Uz compinit; compinit; eval "$(_MARKERGEN_COMPLETE=source_zsh markergen)"'


@pytest.fixture
def home(tmp_path, monkeypatch) -> Path:
    """A home of its own, with ``markergen`` in the path and a marker."""
    for name in ("my-marker.json", "bin/markergen"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch(mode=0o755)
    (tmp_path / "bin" / "markergen").write_text(f'#!/bin/sh\nexec {sys.executable} -m markergen "$@"\n')
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in ("HOME", "ZDOTDIR", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def output_of(*command: str) -> list[str]:
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert result.stderr == ""
    return result.stdout.splitlines()


def needs(shell: str) -> None:
    if not shutil.which(shell):
        pytest.skip(f"{shell} is not installed")


def test_bash(home):
    *installed, registered, command, option, name = output_of("bash", "-c", BASH)
    assert installed[0].startswith("bash completion installed")
    # With nothing to offer, bash completes files.
    assert registered == "complete -o default -F _markergen_completion markergen"
    assert command == "design detect"
    assert option == "--measured-x --measured-y --measured-points"
    assert name == " ".join(names_of("objective"))


def test_fish(home):
    needs("fish")
    output_of("fish", "--no-config", "-c", "markergen --install-completion; true")
    [script] = home.glob("**/markergen.fish")

    def complete(line: str) -> list[str]:
        return [item.partition("\t")[0] for item in output_of("fish", "-c", f"source {script}; complete -C '{line}'")]

    assert complete("markergen de") == ["design", "detect"]
    assert complete("markergen rescale marker.json --measured-p") == ["--measured-points"]
    assert complete("markergen design --objective ") == names_of("objective")
    assert complete("markergen validate my-") == ["my-marker.json"]


def test_what_zsh_is_given(home, monkeypatch):
    assert f"\n{ZSH}\n" in (ROOT / "docs" / "install.md").read_text()
    monkeypatch.setenv("_MARKERGEN_COMPLETE", "complete_zsh")
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "markergen design --objective trans")
    assert output_of("markergen") == ["_arguments '*: :((\"translation\"))'"]


@pytest.mark.parametrize("name", [name for name in NAMES if name not in LISTED_ELSEWHERE])
def test_help_has_every_name(name):
    options = [declared(table)[name] for table in TABLES if name in declared(table)]
    assert options
    for option in options:
        assert all(item in option.help for item in names_of(name))


def test_names_of_open_ended_options_are_the_usual_ones():
    assert {"mm", "in", "px"} <= {*names_of("boundary_unit")}
    assert {"A4", "A4-landscape", "letter"} <= {*names_of("paper")}
    assert {"paper", "cone"} <= {*names_of("poses")}
    assert "cnc" in names_of("process")
    assert "desk-a4" in names_of("template")
