"""Commands are thin, and their help is made of what is declared."""

import ast
from pathlib import Path

import pytest

from markergen.cli import main

SOURCE = Path(__file__).parents[2] / "markergen" / "cli" / "commands.py"
COMMANDS = ("design", "validate", "export", "detect", "compare", "verify", "rescale", "study", "templates")
MOST_STATEMENTS = 25


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_parses_calls_and_prints(name):
    tree = ast.parse(SOURCE.read_text())
    [body] = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name]
    statements = [node for node in ast.walk(body) if isinstance(node, ast.stmt) and node is not body]
    assert len(statements) <= MOST_STATEMENTS


def test_help_comes_in_groups(capsys):
    assert main(["design", "--help"]) == 0
    text = capsys.readouterr().out
    titles = ["Layout:", "Camera and poses:", "Dots and labels:", "Sheet:", "Solid:", "Search:", "Files:", "Options:"]
    places = [text.index(f"\n{title}\n") for title in titles]
    assert places == sorted(places)
    # Each option stands in its group.
    assert places[0] < text.index("--keep-out") < places[1] < text.index("--poses NAME") < places[2]
    assert places[5] < text.index("--objective") < places[6]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_an_example(name, capsys):
    assert main([name, "--help"]) == 0
    assert f"  markergen {name} " in capsys.readouterr().out.replace("Usage: ", "")
