"""The architecture: data flows down, and starting up is light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "markergen"
ORDER = [
    ("errors", "units", "registry", "files"), ("geometry",), ("maths",), ("model",), ("read",), ("objectives",),
    ("estimators",), ("optimize",), ("drawing",), ("solid",), ("export",), ("render",), ("detect",), ("validate",),
    ("verify",), ("study",), ("cli", "__main__"),
]  # fmt: skip
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
MODULES = sorted(ROOT.rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Top-level parts of markergen that a module imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            if node.module == "markergen":
                found.update(alias.name for alias in node.names if alias.name in LEVEL)
            elif (node.module or "").startswith("markergen."):
                found.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            found.update(alias.name.split(".")[1] for alias in node.names if alias.name.startswith("markergen."))
    return found


def part_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_reaches_back_up(path):
    if path == ROOT / "__init__.py":
        assert not imported(path)
        return
    here = LEVEL[part_of(path)]
    assert {name for name in imported(path) if LEVEL[name] > here} == set()


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_modules_stay_small(path):
    assert len(path.read_text().splitlines()) <= 500


@pytest.mark.parametrize(
    ("call", "only_in"),
    [
        ("solvePnP", "estimators"),
        ("cadquery", "solid"),
        ("OCP", "solid"),
        ("findContours", "detect"),
        ("reportlab", "export"),
    ],
)
def test_what_belongs_in_one_place_stays_there(call, only_in):
    def used(path):
        names = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                names.add((node.module or "").split(".")[0])
            elif isinstance(node, ast.Import):
                names.update(alias.name.split(".")[0] for alias in node.names)
        return any(name.startswith(call) for name in names)

    assert {part_of(path) for path in MODULES if used(path)} == {only_in}


def test_importing_and_helping_loads_nothing_heavy():
    code = (
        "import sys, markergen, markergen.cli\n"
        "try: markergen.cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'cv2', 'cadquery', 'OCP', 'matplotlib', 'reportlab', 'skimage', 'rich'}\n"
        "print('loaded:', *sorted(heavy & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1].strip() == "loaded:"
