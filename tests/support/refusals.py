"""What the command line refuses."""

from pathlib import Path

from markergen.cli import main


def refused(here: Path, capsys, *words: str) -> str:
    """Status 2, one line, and nothing written."""
    before = {path: path.read_bytes() for path in here.iterdir()}
    assert main(list(words)) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (complaint,) = said.err.splitlines()
    assert {path: path.read_bytes() for path in here.iterdir()} == before
    return complaint
