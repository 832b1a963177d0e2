"""The command prints facts, warnings and files, and answers unusable input in one line."""

import json

from markergen.cli import main
from markergen.model.camera import Camera


def test_facts_on_the_terminal_and_as_json(tmp_path, capsys):
    path = tmp_path / "camera.yaml"
    Camera(640, 480, 800.0, 800.0, 320.0, 240.0).save(path)
    assert main(["inspect", str(path), "--to", str(tmp_path / "a.kalibr.yaml"), "--plot", str(tmp_path / "a.png")]) == 0
    printed = capsys.readouterr().out
    assert "640 x 480 px" in printed
    assert "a.kalibr.yaml" in printed
    assert main(["inspect", str(path), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["camera"]["fx"] == 800
    assert main(["inspect", str(path), "--to", str(tmp_path / "a.doc")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "a.doc").exists()
