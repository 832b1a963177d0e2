"""Print the tests of what changed since a branch, committed or not: `make check` runs them.

    python tests/changed.py [BRANCH]

`markergen/PKG/mod.py` is tested by `tests/PKG/test_mod.py`. A module of other or several files of tests names them in
one of its first lines, as `# tests: tests/PKG/test_other.py`. Of any other module they are those of tests/PKG that
import it, or all of these.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
ALWAYS = ["tests/contracts", "tests/test_layers.py"]
"""Where any module changed."""
OUTSIDE = {
    "detector": "detector/tests",
    "docs": "tests/docs",
    "examples": "tests/examples",
    "templates": "tests/api/test_templates.py",
}
"""Tests of folders beside the package."""
HEAD = 10
"""Lines in which a module may name its tests."""


def main() -> None:
    """Print the paths of the tests, one a line."""
    base = git("merge-base", "HEAD", *(sys.argv[1:] or ["main"]))[0]
    changed = git("diff", "--name-only", "--diff-filter=d", base) + git("ls-files", "--others", "--exclude-standard")
    print(*selected(changed, ROOT), sep="\n")


def git(*phrase: str) -> list[str]:
    """Return the lines that a command of git prints."""
    done = subprocess.run(["git", *phrase], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def selected(changed: list[str], root: Path) -> list[str]:
    """Return the tests of changed files, without those inside of a folder that is named itself."""
    named = set(ALWAYS if any(path.startswith("markergen/") for path in changed) else ())
    for path in map(Path, changed):
        match path.parts:
            case ("markergen", *_):
                named |= set(_of_module(path, root))
            case ("tests", "support", *_):
                named |= set(_importing(("tests", "support", path.stem), root / "tests", root))
            case ("tests", *_):
                named |= {path.as_posix()} if path.name.startswith("test_") else set()
            case (folder, _, *_) if folder in OUTSIDE:
                named.add(OUTSIDE[folder])
            case _:
                named.add("tests/docs" if path.suffix == ".md" else "tests/test_packaging.py")
    return sorted(path for path in named if not any(parent.as_posix() in named for parent in Path(path).parents))


def _of_module(path: Path, root: Path) -> list[str]:
    """Tests of a module, or of a file beside modules."""
    folder = Path("tests", *path.parent.parts[1:])
    mirror = folder / f"test_{path.stem}.py"
    if path.suffix == ".py":
        head = "\n".join((root / path).read_text(encoding="utf-8").splitlines()[:HEAD])
        if comment := re.search(r"^# tests: (.+)$", head, re.MULTILINE):
            return comment[1].split()
    if (root / mirror).is_file():
        return [mirror.as_posix()]
    if folder == Path("tests"):
        return []
    package = folder.with_name(f"test_{folder.name}.py")
    while not (root / folder).is_dir():
        folder = folder.parent
    return (
        _importing(path.with_suffix("").parts, root / folder, root)
        or [package.as_posix()] * (root / package).is_file()
        or [folder.as_posix()]
    )


def _importing(module: tuple[str, ...], folder: Path, root: Path) -> list[str]:
    """Tests of a folder that import a module, also by its last name alone, as those of tests/support."""
    package, name = r"\.".join(module[:-1]), module[-1]
    imports = re.compile(
        rf"\b{package}\.{name}\b|^from {package} import .*\b{name}\b|^(from|import) {name}\b", re.MULTILINE
    )
    tests = (path for path in sorted(folder.rglob("test_*.py")) if imports.search(path.read_text(encoding="utf-8")))
    return [path.relative_to(root).as_posix() for path in tests]


if __name__ == "__main__":
    main()
