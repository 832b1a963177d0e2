"""The architecture: data flows down, and starting up is light."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "markergen"
ORDER = [
    ("errors", "units", "registry", "files", "guard", "tables"), ("options",), ("geometry",), ("maths",), ("model",),
    ("read",), ("objectives",), ("estimators",), ("optimize",), ("drawing",), ("solid",), ("exporters",), ("render",),
    ("detect",), ("validation",), ("verification",), ("studies",), ("api",), ("cli", "__main__"),
]  # fmt: skip
DOORS = {
    # A class is loaded by its own name, from what is read a layer above; imported when called, and nowhere else.
    ("model/camera.py", "Camera.load"): "read",
    ("model/camera.py", "Camera.from_message"): "read",
    ("model/camera.py", "Camera.from_cv2"): "read",
    # A marker is saved and drawn by its own name, too.
    ("model/marker.py", "Marker.save"): "api",
    ("model/marker.py", "Marker.plot"): "validation",
}
"""Methods that reach up, and to which layer."""
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
MODULES = sorted(ROOT.rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Top-level parts of markergen that a module imports, wherever in it but in its doors."""
    tree, name = ast.parse(path.read_text()), path.relative_to(ROOT).as_posix()
    for door, method in _methods(tree):
        if layer := DOORS.get((name, door)):
            within = [node for node in ast.walk(method) if isinstance(node, ast.ImportFrom)]
            assert {(node.module or "").split(".")[1] for node in within} == {layer}, f"{door} is no door to {layer}"
            method.body = []
    return imports(tree)


def _methods(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    for kind in tree.body:
        if isinstance(kind, ast.ClassDef):
            yield from ((f"{kind.name}.{each.name}", each) for each in kind.body if isinstance(each, ast.FunctionDef))


class WithoutTypes(ast.NodeTransformer):
    """What is imported for a type checker alone is not there when the program runs."""

    def visit_If(self, node):
        return None if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" else node


def imports(tree: ast.Module) -> set[str]:
    found = set()
    for node in ast.walk(WithoutTypes().visit(tree)):
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


def test_every_door_is_there():
    known = {
        (path.relative_to(ROOT).as_posix(), name)
        for path in MODULES
        for name, _ in _methods(ast.parse(path.read_text()))
    }
    assert set(DOORS) <= known


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
        ("reportlab", "exporters"),
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


def loaded_by(code: str) -> set[str]:
    """Modules that an interpreter of its own has loaded after some code."""
    code += "\nimport sys\nprint(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    return set(run.stdout.splitlines()[-1].split())


HEAVY = {
    "scipy",
    "cv2",
    "cadquery",
    "OCP",
    "matplotlib",
    "reportlab",
    "skimage",
    "pandas",
    "PIL",
    "ezdxf",
    "numpy.random",
}


def test_loading_a_marker_loads_nothing_heavy():
    path = Path(__file__).parent / "model" / "data" / "designed-v1.json"
    loaded = loaded_by(f"from markergen.model.marker import Marker\nassert len(Marker.load({str(path)!r})) == 12")
    assert loaded & {*HEAVY, "yaml"} == set()
    # Reading needs the model, and no layer above it.
    parts = {name.split(".")[1] for name in loaded if name.startswith("markergen.")}
    assert {part for part in parts if LEVEL[part] > LEVEL["model"]} == set()


def test_a_camera_by_its_numbers_needs_numpy_alone():
    loaded = loaded_by("from markergen.model.camera import Camera\nCamera(640, 480, 800, 800, 320, 240)")
    assert loaded & {*HEAVY, "yaml", "pydantic", "shapely"} == set()
