"""The architecture: data flows down, and starting up is light."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from inspect import Parameter, signature
from pathlib import Path

import pytest

from benchmarks.structure import Arrow, Figure, Module, import_figures, package

ROOT = Path(__file__).parent.parent / "markergen"
ORDER = [
    ("arrays", "defaults", "errors", "units", "registry", "files", "guard", "pool", "occt"),
    ("options",), ("presentation",), ("geometry",), ("maths",), ("model",), ("read",),
    ("objectives",), ("estimators",), ("bounds",), ("optimize",), ("drawing",), ("solid",),
    ("exporters",), ("render",), ("detect",), ("validation",),
    ("calibration", "comparison", "studies", "verification", "workshop"), ("api",), ("studio",), ("cli", "__main__"),
]  # fmt: skip
LEAVES = {"calibration", "comparison", "studies", "studio", "verification", "workshop"}
"""Siblings: each imports the core and none of the others; the core reaches them by tables alone."""
HALLS = {"api", "cli", "__main__"}
"""What puts the leaves together."""
STUDIO_DOOR = "studio/look.py"
"""The module of the studio that asks other leaves."""
DOORS = {
    # A class is loaded by its own name, from what is read a layer above.
    ("model/camera.py", "Camera.load"): "read.cameras.load_camera",
    ("model/camera.py", "Camera.from_message"): "read.cameras.calibration.camera_of_message",
    ("model/camera.py", "Camera.from_cv2"): "read.cameras.calibration.camera_of_arrays",
    ("model/camera.py", "Camera.save"): "read.cameras.files.camera_file",
    ("model/marker.py", "Marker.load"): "model.body_json.load_marker",
    ("model/rig.py", "Rig.load"): "model.body_json.load_rig",
    ("model/rig.py", "Rig.save"): "api.export.export",
    ("model/poses.py", "Poses.load"): "read.poses.poses_from",
    # Boards are markers that nobody searches for.
    ("model/marker.py", "Marker.grid"): "model.boards.grid",
    ("model/marker.py", "Marker.hexagonal"): "model.boards.hexagonal",
    ("model/marker.py", "Marker.circles"): "model.boards.circles",
    ("model/marker.py", "Marker.from_points"): "model.boards.from_points",
    # A marker is saved by its own name, too.
    ("model/marker.py", "Marker.save"): "api.export.export",
    # A body is a solid to build on, in CAD.
    ("model/body.py", "Body.to_cadquery"): "api.export.to_cadquery",
    # Pictures are drawn from the marker, and shown by its own methods.
    ("model/marker.py", "Marker.plot"): "model.picture.draw_marker",
    ("model/rig.py", "Rig.plot"): "model.picture.draw_rig",
    ("model/marker.py", "Marker._repr_html_"): "model.picture.svg",
}
"""Methods that call what stands above them, by `markergen.registry.door`, and what they call; there are no others."""
CUT_IN_TWO = {
    "api/rescale.py <- model/rescale.py",
    "calibration/camera_choice.py <- calibration/judging.py",
    "calibration/calibration.py <- calibration/scale.py",
}
"""Pairs that stand today; each is to become one room, or to get a smaller door. None is to be added."""
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
MODULES = sorted(ROOT.rglob("*.py"))
PATHS = {
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__"): path for path in MODULES
}


@cache
def modules_and_arrows() -> tuple[dict[Path, Module], list[Arrow]]:
    modules, arrows = package(ROOT)
    return {ROOT / module.path: module for module in modules}, arrows


@cache
def import_statements(path: Path) -> list[ast.Import | ast.ImportFrom]:
    return modules_and_arrows()[0][path].import_statements()


@pytest.fixture(scope="module")
def figures() -> dict[str, Figure]:
    modules, arrows = modules_and_arrows()
    return import_figures(list(modules.values()), arrows)


def doors(path: Path) -> Iterator[tuple[tuple[str, str], str]]:
    """Calls of `door` in a module: the method that it is in, and what it names."""
    text = path.read_text()
    for kind in ast.parse(text).body if "door(" in text else ():
        for method in getattr(kind, "body", []):
            for node in ast.walk(method):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "door":
                    assert isinstance(node.args[0], ast.Constant)
                    yield (path.relative_to(ROOT).as_posix(), f"{kind.name}.{method.name}"), node.args[0].value


def imported(path: Path) -> set[str]:
    """Top-level parts of markergen that a module imports."""
    result = set()
    for node in import_statements(path):
        if isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            if node.module == "markergen":
                result.update(alias.name for alias in node.names if alias.name in LEVEL)
            elif (node.module or "").startswith("markergen."):
                result.add(node.module.split(".")[1])
        else:
            result.update(alias.name.split(".")[1] for alias in node.names if alias.name.startswith("markergen."))
    return result


def needed(name: str, path: Path) -> set[str]:
    """Modules that a module imports, also within its functions."""
    result = set()
    for node in import_statements(path):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "markergen":
            parts = {f"{node.module}.{alias.name}" for alias in node.names}
            result |= {part if part in PATHS else str(node.module) for part in parts}
    return result - {name}


def part_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def test_nothing_reaches_back_up():
    assert not imported(ROOT / "__init__.py")
    arrows = ((path, name) for path in MODULES if path != ROOT / "__init__.py" for name in imported(path))
    assert [(str(path), name) for path, name in arrows if LEVEL[name] > LEVEL[part_of(path)]] == []


def test_leaves_import_the_core_and_never_each_other():
    arrows = [(path, name) for path in MODULES for name in imported(path) if name in LEAVES]
    inside = [(path, name) for path, name in arrows if part_of(path) not in {*HALLS, name}]
    assert [(str(path), name) for path, name in inside if path != ROOT / STUDIO_DOOR] == []


def test_there_are_no_other_doors():
    assert dict(door for path in MODULES for door in doors(path)) == DOORS
    # By name, nothing else is imported but entries of tables and what the package shows at its front.
    by_name = {part_of(path) for path in MODULES if "import_module(" in path.read_text()}
    assert by_name == {"__init__", "cli", "registry", "exporters", "occt", "read", "solid"}


@pytest.mark.parametrize(("where", "room"), DOORS.items(), ids=lambda each: each if isinstance(each, str) else each[1])
def test_a_door_leads_to_what_takes_the_same_arguments(where, room):
    (file, method), (module, _, name) = where, room.rpartition(".")
    kind, _, method = method.partition(".")
    holder = getattr(import_module(f"markergen.{file.removesuffix('.py').replace('/', '.')}"), kind)
    stated = list(signature(getattr(holder, method)).parameters.values())
    taken = list(signature(getattr(import_module(f"markergen.{module}"), name)).parameters.values())
    ours = [item for item in stated if item.kind is not Parameter.VAR_KEYWORD]
    assert [(item.kind, item.default) for item in ours] == [(item.kind, item.default) for item in taken[: len(ours)]]
    assert len(ours) < len(stated) or len(ours) == len(taken)


def test_no_module_needs_itself():
    needs = {name: needed(name, path) for name, path in PATHS.items()}
    for middle in needs:
        for name in needs:
            if middle in needs[name]:
                needs[name] |= needs[middle]
    assert not {name.removeprefix("markergen.") for name in needs if name in needs[name]}


def test_a_long_module_has_one_subject(figures):
    """At most 900 lines; a module of more than 500 shows fewer than six names."""
    sizes = {path: len(path.read_text().splitlines()) for path in MODULES}
    assert [str(path) for path, lines in sizes.items() if lines > 900] == []
    names = [
        (place.text, int(re.search(r"(\d+) names used outside", place.text)[1])) for place in figures["large"].places
    ]
    assert [text for text, count in names if count >= 6] == []


def test_no_subject_is_cut_in_two(figures):
    """A module gives six names or more to another and to no third: they are one room, or need a smaller door."""
    pairs = {place.text.partition(": ")[0] for place in figures["cut-in-two"].places}
    assert pairs - CUT_IN_TWO == set()


@pytest.mark.parametrize(
    ("call", "only_in"),
    [
        ("solvePnP", "estimators"),
        ("OCP", "workshop read"),
        ("reportlab", "exporters workshop"),
        ("shapely", "geometry"),
    ],
)
def test_what_belongs_in_one_place_stays_there(call, only_in):
    def used(path):
        text, names = path.read_text(), set()
        for node in ast.walk(ast.parse(text)) if call in text else ():
            if isinstance(node, ast.Attribute):
                names.add(node.attr)
            elif isinstance(node, ast.ImportFrom):
                names.add((node.module or "").split(".")[0])
            elif isinstance(node, ast.Import):
                names.update(alias.name.split(".")[0] for alias in node.names)
        return any(name.startswith(call) for name in names)

    assert {part_of(path) for path in MODULES if used(path)} == set(only_in.split())


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


def test_every_module_has_tests_of_its_name_or_names_them():
    missing = []
    for path in MODULES:
        if path.name.startswith("__") or path == ROOT / "arrays.py":
            continue
        where = path.relative_to(ROOT)
        if (ROOT.parent / "tests" / where.parent / f"test_{path.stem}.py").is_file():
            continue
        named = re.search(r"^# tests: (.+)$", path.read_text(), re.MULTILINE)
        if not named or not all((ROOT.parent / test).is_file() for test in named[1].split()):
            missing.append(str(where))
    assert missing == []
