"""Examples, notebooks and templates that are shipped, and copies of them to begin with."""
# tests: tests/api/test_example.py

import re
from pathlib import Path

from markergen.errors import InputError, OutputError, among
from markergen.files import Written, folders_for, shipped_folder, write_all
from markergen.presentation.results import Files
from markergen.read.templates import shipped_templates


def examples() -> dict[str, Path]:
    """Return all that can be copied, by name: scripts, notebooks, folders of packages, and templates."""
    folder = shipped_folder("examples")
    packages = [path.parent for name in ("package.xml", "pyproject.toml") for path in folder.glob(f"*/{name}")]
    paths = [*folder.glob("*.py"), *folder.glob("notebooks/*.ipynb"), *packages]
    return {path.stem: path for path in sorted(paths)} | shipped_templates()


def summary_of(path: Path) -> str:
    """Return the first sentence that an example says of itself, in its docstring, comment, heading or README."""
    text = (path / "README.md" if path.is_dir() else path).read_text(encoding="utf-8")
    first = re.search(r'^(?:"""|# | *"# )?([A-Z][^\n"]{9,}?)(?:[.:;] |\.?$|\.?\\n)', text, re.MULTILINE)
    return first[1] if first else ""


def copied_example(name: str, folder: str | Path = ".") -> Files:
    """Copy an example into a folder, where nothing of its name may be.

    Raises
    ------
    InputError
        If there is no such example.
    OutputError
        If it is there already, or cannot be written.
    """
    paths = examples()
    if name not in paths:
        raise InputError("a known example", repr(name), among(name, sorted(paths)))
    source, target = paths[name], Path(folder) / paths[name].name
    if target.exists():
        raise OutputError(f"expected nothing at {target}, found it there; remove it, or copy to another folder")
    files = [path for path in sorted(source.rglob("*")) if path.is_file()] if source.is_dir() else [source]
    contents = {
        target / path.relative_to(source): path.read_bytes() for path in files if "__pycache__" not in path.parts
    }
    with folders_for(contents):
        write_all(contents)
    return Files(list(map(Written, contents)))
