"""What the command line refuses."""

from pathlib import Path

from markergen.cli import main


def refused(here: Path, capsys, *phrase: str) -> str:
    """Status 2, one line, and nothing written."""
    before = {path: path.read_bytes() for path in here.iterdir()}
    assert main(list(phrase)) == 2
    output = capsys.readouterr()
    assert output.out == ""
    (complaint,) = output.err.splitlines()
    assert {path: path.read_bytes() for path in here.iterdir()} == before
    return complaint
