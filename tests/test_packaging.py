"""What pyproject.toml, constraints.txt and the README promise about the package."""

import ast
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

import markergen
from markergen.files import schemas, shipped_folder

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
DETECTOR = tomllib.loads((ROOT / "detector/pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]
DISTRIBUTIONS = {
    "OCP": "cadquery", "PIL": "pillow", "cv2": "opencv-contrib-python-headless", "distributed": "dask",
    "fontTools": "fonttools", "pupil_apriltags": "pupil-apriltags", "skimage": "scikit-image", "stag": "stag-python",
    "yaml": "pyyaml",
}  # fmt: skip
"""Distributions of modules that are not named as they are."""
OWN = {"markergen", "markergen_detect", ""}


def named(requirement: str) -> str:
    """Name of a requirement, as an index writes it."""
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement).group()).lower()


def declared(*groups: list[str]) -> set[str]:
    return {named(requirement) for group in groups for requirement in group}


def third_party(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").split(".")[0])
    return {named(DISTRIBUTIONS.get(name, name)) for name in names - sys.stdlib_module_names - OWN}


def test_what_is_imported_is_declared():
    used = set().union(*map(third_party, (ROOT / "markergen").rglob("*.py")))
    optional = declared(*EXTRAS.values())
    core = declared(PROJECT["project"]["dependencies"]) - {"markergen-detect"}
    assert used <= core | optional
    assert core <= used
    assert not core & optional


def test_all_has_every_extra():
    (ours,) = (item for item in EXTRAS["all"] if named(item) == "markergen")
    # The extra step is instead of solids: two distributions of OCP would overwrite each other's files.
    assert set(re.search(r"\[(.*)\]", ours).group(1).split(",")) == set(EXTRAS) - {"all", "step"}


def test_every_requirement_is_pinned_by_version_alone():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", line) for line in lines)
    assert lines == sorted(lines, key=str.lower)
    groups = [PROJECT["project"]["dependencies"], *EXTRAS.values(), *PROJECT["dependency-groups"].values()]
    assert declared(*groups) - {"markergen", "markergen-detect"} <= declared(lines)


def test_the_version_is_one():
    assert PROJECT["project"]["version"] == markergen.__version__


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == markergen.__version__
    assert citation["license"] == PROJECT["project"]["license"]
    assert [author["name"] for author in citation["authors"]] == [
        author["name"] for author in PROJECT["project"]["authors"]
    ]


@pytest.mark.parametrize(
    "path", [*sorted((ROOT / ".github").rglob("*.yml")), ROOT / ".pre-commit-config.yaml"], ids=lambda path: path.name
)
def test_what_the_code_host_reads_is_yaml(path):
    assert isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)


def test_every_supported_python_is_tested():
    supported = [name for line in PROJECT["project"]["classifiers"] for name in re.findall(r":: (3\.\d+)$", line)]
    job = yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text(encoding="utf-8"))["jobs"]["test"]
    assert job["strategy"]["matrix"]["python"] == supported
    assert PROJECT["project"]["requires-python"] == f">={supported[0]}"
    oldest = DETECTOR["project"]["requires-python"].removeprefix(">=").replace(".", "")
    assert DETECTOR["tool"]["cibuildwheel"]["build"] == f"cp{oldest}-manylinux_*"


def test_hooks_run_the_pinned_versions():
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines())
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    (ruff,) = (hook["rev"] for hook in hooks if hook["repo"].endswith("/ruff-pre-commit"))
    assert ruff == f"v{pinned['ruff']}"


def test_every_schema_goes_into_the_wheel():
    inside = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    published = sorted((ROOT / "docs").glob("*.schema.json"))
    assert published
    for path in published:
        assert inside[f"docs/{path.name}"] == f"markergen/schemas/{path.name}"
    assert [path.name for path in schemas().values()] == [path.name for path in published]


def test_the_detector_is_a_distribution_of_its_own_of_the_same_version():
    project = DETECTOR["project"]
    assert project["version"] == PROJECT["project"]["version"]
    assert f"markergen-detect=={project['version']}" in PROJECT["project"]["dependencies"]
    package = ROOT / "detector" / "markergen_detect"
    assert set().union(*map(third_party, package.glob("*.py"))) == declared(project["dependencies"]) == {"numpy"}
    assert (ROOT / "detector/LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_the_detector_is_compiled_by_a_hook_that_needs_what_builds_the_package():
    assert DETECTOR["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"] == {}
    # hatchling itself requires packaging.
    assert third_party(ROOT / "detector/hatch_build.py") == {"hatchling", "packaging"}
    assert third_party(ROOT / "detector/build_core.py") == set()
    # What is built in a checkout is of this computer, and goes neither into git nor by itself into a distribution.
    library = runpy.run_path(str(ROOT / "detector/build_core.py"))["LIBRARY"]
    assert {f"*{Path(library).suffix}", "detector/markergen_detect/detector.h"} <= set(
        (ROOT / ".gitignore").read_text().splitlines()
    )


def test_the_papers_study_is_installed_and_found_in_a_checkout():
    build = PROJECT["tool"]["hatch"]["build"]
    inside = build["targets"]["wheel"]["force-include"]
    assert inside["examples/paper_study/markergen_paper"] == "markergen_paper"
    assert "examples/paper_study" in build["dev-mode-dirs"]
    assert PROJECT["project"]["entry-points"]["markergen.studies"] == {"paper": "markergen_paper:PAPER"}
    # In a process of its own: here the folder is on the path for the tests.
    code = "from markergen.studies.named import STUDIES; print(STUDIES.names(), STUDIES['paper'].run.__module__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["['paper']", "markergen_paper.study"]


@pytest.mark.parametrize("name", ["templates", "schemas"])
def test_the_wheel_comes_before_the_checkout(tmp_path, monkeypatch, name):
    package = tmp_path / "markergen"
    monkeypatch.setattr("markergen.files.__file__", str(package / "files.py"))
    assert shipped_folder(name).parent == tmp_path
    (package / name).mkdir(parents=True)
    assert shipped_folder(name) == package / name
