"""Commands are thin, and their help is made of what is declared."""

import ast
import re
from pathlib import Path

import pytest
from typer.main import get_command

from markergen.cli import main
from markergen.cli.commands import app
from markergen.options import GUESSES

SOURCE = Path(__file__).parents[2] / "markergen" / "cli" / "commands"
COMMANDS = ("design", "validate", "export", "detect", "compare", "verify", "rescale", "study", "templates")
MOST_STATEMENTS = 25


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_parses_calls_and_prints(name):
    tree = ast.parse((SOURCE / f"{name}.py").read_text())
    [body] = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name]
    statements = [node for node in ast.walk(body) if isinstance(node, ast.stmt) and node is not body]
    assert len(statements) <= MOST_STATEMENTS


def test_what_a_command_is_for_is_listed_whole(capsys):
    assert main(["--help"]) == 0
    listed = capsys.readouterr().out.partition("Commands:")[2]
    assert "..." not in listed
    assert re.search(r"inspect +Show what a file holds and how it is read\.", listed)
    assert listed.count(".\n") >= len(COMMANDS)


def test_help_comes_in_groups(capsys):
    assert main(["design", "--help-all"]) == 0
    text = capsys.readouterr().out
    titles = ["Layout:", "Camera and poses:", "Dots and labels:", "Sheet:", "Solid:", "Search:", "Files:", "Options:"]
    places = [text.index(f"\n{title}\n") for title in titles]
    assert places == sorted(places)
    # Each option stands in its group.
    assert places[0] < text.index("--keep-out") < places[1] < text.index("--poses NAME") < places[2]
    assert places[5] < text.index("--objective") < places[6]


@pytest.mark.parametrize("name", ["design", "validate", "export"])
def test_help_lists_the_options_most_needed(name, capsys):
    assert main([name, "--help"]) == 0
    brief = re.findall(r"^  (?:-\w, )?(--[\w-]+)", capsys.readouterr().out, re.MULTILINE)
    assert main([name, "--help-all"]) == 0
    everything = re.findall(r"^  (?:-\w, )?(--[\w-]+)", capsys.readouterr().out, re.MULTILINE)
    assert 12 <= len(brief) <= 14
    assert len(everything) > 1.5 * len(brief)
    assert set(brief) - {"--help-all"} <= set(everything)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_an_example(name, capsys):
    assert main([name, "--help"]) == 0
    assert f"  markergen {name} " in capsys.readouterr().out.replace("Usage: ", "")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("design --size 200mm", "No such option: --size; the room is --radius 150mm or --boundary rect:200mmx100mm"),
        ("design --dots 8", "write --n 8"),
        ("export m.json --format pdf", "its suffix is the format"),
        ("detect x.png --calibration c.yaml", "write --camera camera.yaml"),
        ("compare a.json --camera c.yaml", "the camera of the first marker's design"),
        ("design --raduis 80mm", "(Possible options: --radius);"),
        ("design desk.toml", "a spec goes with --template desk.toml"),
        ("design --radius 50 mm", "write 50mm, without a space;"),
        ("detect m.json a.png", "Missing option '--marker'. Write --marker m.json; see markergen detect --help"),
        ("calibrate a.png --marker m.json", "m.json comes first, without --marker; see"),
        ("rig cube --sides 6", "No such option: --sides; see"),
        ("desgin", "Did you mean 'design'? See markergen --help"),
    ],
)
def test_names_of_other_tools_and_misspelled_ones_are_answered(arguments, message, capsys):
    assert main(arguments.split()) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        ("calibrate photos m.json", "; the marker comes first: markergen calibrate m.json photos"),
        ("calibrate photos/1.png a.png m.json", "; the marker comes first: markergen calibrate m.json photos/1.png"),
        ("handeye photos m.json --robot r.csv", "; the marker comes first: markergen handeye m.json photos"),
        ("verify m.svg m.json", "; the marker comes first: markergen verify m.json m.svg"),
        ("verify m.svg m.pdf", "; give the .json that was written with it"),
        ("design --n 3", "a homography needs four"),
        ("validate photos", "found Is a directory; check the path"),
    ],
)
def test_exchanged_arguments_are_answered_with_their_order(arguments, remedy, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "1.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    for name in ("m.svg", "m.pdf", "m.json", "a.png"):
        (tmp_path / name).write_text("<svg/>")
    assert main(arguments.split()) == 2
    complaint = capsys.readouterr().err
    assert remedy in complaint
    assert complaint.count("\n") == 1


def test_answers_name_options_that_exist():
    options = [command.params for command in get_command(app).commands.values()]
    flags = {flag for params in options for param in params for flag in param.opts}
    for guess, (option, answer) in GUESSES.items():
        assert any(option in names and guess not in names for names in ({param.name for param in o} for o in options))
        assert {word for word in answer.split() if word.startswith("--")} <= flags
