"""What is generated is up to date, and every command and flag of the pages and link of the README is real."""

import re
import tomllib
from pathlib import Path

import pytest
import typer

from docs.blocks import pages
from docs.generate import files, json_schema
from markergen.cli.commands import app
from markergen.model.marker_file import VERSIONS

ROOT = Path(__file__).parents[2]


def test_generated_documents_are_up_to_date():
    texts = files()
    assert {path.name for path in (ROOT / "docs").glob("*.schema.json")} <= texts.keys()
    assert {name: (ROOT / "docs" / name).read_text() for name in texts} == texts


def test_every_key_of_marker_json_is_explained():
    text, schema = (ROOT / "docs" / "marker-json.md").read_text(), json_schema(VERSIONS[-1])
    forms = (
        "_JointCovariance",
        "_MeasuredSize",
        "_Plate",
        "PoseFile",
        "_Rulers",
        "_ControlPoint",
        "_Feature",
        "_PrintCorrection",
    )
    assert set(forms) <= set(schema["$defs"])
    for form in (schema, *(schema["$defs"][name] for name in forms)):
        for key in form["properties"]:
            assert re.search(rf"`([\w\[\]]+\.)*{key}`", text), f"{form['title']}: {key}"


def test_every_command_is_documented_with_an_example():
    for name, command in typer.main.get_command(app).commands.items():
        assert "Example:" in command.help, name
        assert f"## markergen {name}" in (ROOT / "docs" / "cli.md").read_text()


def test_links_of_the_readme_lead_somewhere_from_everywhere():
    """A package index shows the README too, and has nothing beside it."""
    home = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]["Homepage"]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
    assert links
    for link in links:
        if link.startswith("#"):
            continue
        assert link.startswith("https://"), link
        if link.startswith(f"{home}/"):
            kind, branch, path = link.removeprefix(f"{home}/").partition("#")[0].split("/", 2)
            assert kind in ("blob", "raw", "tree"), link
            assert branch == "main", link
            assert (ROOT / path).exists(), link
    for image in re.findall(r'src="([^"]+)"', text):
        assert image.startswith(f"{home}/raw/"), image


def test_every_room_on_the_map_is_there():
    """ARCHITECTURE.md sends readers to files; each of them exists, and every package is in its table."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w.]+(?:/[\w.]*)+|[\w.]+\.(?:py|js|j2|md|yml))`", text))
    assert len(named) > 30
    for path in named:
        assert (ROOT / path).exists() or (ROOT / "markergen" / path).exists(), path
    for link in re.findall(r"\]\(([^)]+)\)", text):
        assert (ROOT / link).exists(), link
    packages = {path.parent.name for path in (ROOT / "markergen").glob("*/__init__.py")}
    assert packages <= set(re.findall(r"`(\w+)`", text))


@pytest.mark.parametrize(
    "path",
    [*pages(), *(ROOT / name for name in ("ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md"))],
    ids=lambda path: path.name,
)
def test_pages_show_and_report(path):
    """Programs and files do not tell; "c tells" is the name of a claim."""
    text = path.read_text(encoding="utf-8").replace("*c tells*", "")
    assert not re.findall(r".*\b(?:told|said|tells)\b.*", text)


OTHERS = {"--aprilcube", "--force-reinstall", "--no-deps", "--packages-select", "--nthreads", "--nworkers"}
"""Flags of other programs, which pages name outside their commands."""


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_commands_and_flags_of_a_page_exist(page):
    """Those inside sentences, too, which nobody runs."""
    text = re.sub(r"`python\s+-m\s[^`]*`", "", page.read_text(encoding="utf-8"))
    reference = (ROOT / "docs" / "cli.md").read_text()
    for flag in set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)) - OTHERS:
        assert re.search(rf"{flag}(?![\w-])", reference), flag
    names = typer.main.get_command(app).commands
    assert set(re.findall(r"`markergen ([a-z]+)\b", text)) <= set(names)
