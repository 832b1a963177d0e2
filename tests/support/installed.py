"""Packages with entry points, put where pip would put them: no network, no build, and nothing stays behind."""

import os
import shutil
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLUGIN = ROOT / "examples" / "plugin"


def install(source: Path, folder: Path) -> Path:
    """Put the packages of a project into a folder, with what pip writes beside them; returns the folder."""
    project = tomllib.loads((source / "pyproject.toml").read_text())["project"]
    for package in source.iterdir():
        if (package / "__init__.py").exists():
            shutil.copytree(package, folder / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    describe(folder, project["name"], project["entry-points"])
    return folder


def describe(folder: Path, name: str, groups: dict[str, dict[str, str]]) -> None:
    """Write the metadata of an installed package with these entry points."""
    place = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    place.mkdir(parents=True)
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [
        line for group, points in groups.items() for line in (f"[{group}]", *(f"{k} = {v}" for k, v in points.items()))
    ]
    (place / "entry_points.txt").write_text("\n".join(lines) + "\n")


def environment(*folders: Path) -> dict[str, str]:
    """Environment of a process that finds these folders and this project."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(str, [*folders, ROOT, *sys.path])),
        "OPENBLAS_NUM_THREADS": "1",
    }
