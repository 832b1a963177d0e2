"""What a user gets: built, checked, installed away from the source tree, and every command run from there."""

import json
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from markergen.exporters import EXPORTERS

from .conftest import ROOT, call

pytestmark = pytest.mark.package

DRAWN = sorted(suffix for suffix in EXPORTERS if not EXPORTERS[suffix].kernel)
MADE = [suffix for suffix in EXPORTERS if EXPORTERS[suffix].kernel]
SWEEP = """
dot = "30mm"
poses = "cone:distance=0.6..1m,tilt=0..60,count=4,seed=1"
[study]
runs = 2
[grid]
n = [4, 5]
"""


@pytest.fixture(scope="session")
def desk(bare, tmp_path_factory):
    """Folder with what the commands work on, made by the installation itself."""
    folder = tmp_path_factory.mktemp("desk")
    call(
        bare / "markergen",
        "design",
        "--n",
        5,
        "--radius",
        0.15,
        "--tag",
        "apriltag:36h11:0",
        "-o",
        "marker.json",
        cwd=folder,
    )
    (folder / "sweep.toml").write_text(SWEEP)
    shutil.copy(ROOT / "examples" / "take_photos.py", folder)
    call(bare / "python", "take_photos.py", "marker.json", "photos", cwd=folder)
    call(bare / "markergen", "export", "marker.json", *(f"-om{suffix}" for suffix in DRAWN), cwd=folder)
    return folder


def size(programs: Path) -> int:
    """MB on disk of an environment."""
    return sum(path.lstat().st_blocks * 512 for path in programs.parent.rglob("*")) // 1_000_000


def tracked() -> set[str]:
    try:
        listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("what belongs into the sdist is known from a git checkout alone")
    return set(listed.stdout.split())


def test_metadata_and_readme_hold_what_an_index_asks_for(distributions, tmp_path):
    pytest.importorskip("twine", reason="needs the dependency group package: make test-package")
    call(sys.executable, "-m", "twine", "check", "--strict", *distributions.values(), cwd=tmp_path)


def test_the_sdist_has_everything(distributions):
    with tarfile.open(distributions[".gz"]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert tracked() <= names


def test_the_wheel_has_templates_schemas_and_the_marker_of_types(distributions):
    names = set(zipfile.ZipFile(distributions[".whl"]).namelist())
    assert "markergen/py.typed" in names
    for kind, folder, pattern in (("templates", "templates", "**/*.toml"), ("schemas", "docs", "*.schema.json")):
        for path in (ROOT / folder).glob(pattern):
            assert f"markergen/{kind}/{path.relative_to(ROOT / folder)}" in names
    for folder in ("studio/static", "presentation"):
        shipped = [path for path in (ROOT / "markergen" / folder).iterdir() if path.is_file()]
        assert {f"markergen/{folder}/{path.name}" for path in shipped} <= names
    study = ROOT / "examples" / "paper_study"
    assert {path.relative_to(study).as_posix() for path in study.glob("markergen_paper/*.py")} <= names
    assert not [name for name in names if name.startswith(("tests", "docs", "benchmarks", "examples"))]


def test_the_wheel_is_for_any_platform(distributions):
    assert distributions[".whl"].name.endswith("-py3-none-any.whl")
    assert not [name for name in zipfile.ZipFile(distributions[".whl"]).namelist() if name.endswith((".so", ".dll"))]


def test_it_is_imported_from_where_it_is_installed(bare, tmp_path):
    code = (
        "import markergen, importlib.metadata, markergen.files as f; "
        "print(markergen.__file__, *f.schemas().values(), sep='\\n'); "
        "assert importlib.metadata.version('markergen') == markergen.__version__"
    )
    lines = call(bare / "python", "-c", code, cwd=tmp_path).stdout.splitlines()
    assert len(lines) >= 2
    for line in lines:
        assert Path(line).is_relative_to(bare.parent)


def test_requirements_agree_with_each_other(bare, tmp_path):
    call(bare / "python", "-m", "pip", "check", cwd=tmp_path)


@pytest.mark.parametrize(
    "phrase",
    [
        "--version", "--help", "templates", "templates desk-a4",
        "design --template desk-a4 -o desk.pdf",
        "validate marker.json --runs 5 --views 2 --json v.json --report v.html",
        "compare marker.json square aruco:DICT_4X4_50:7 --views 2 --plot compare.svg",
        "verify marker.json m.pdf m.svg m.png m.dxf m.opencv.yaml",
        "rescale marker.json --measured-x 198.6mm -o printed.json",
        "study sweep.toml -o sweep",
    ],
)  # fmt: skip
def test_every_command_works_without_extras(bare, desk, phrase):
    assert call(bare / "markergen", *phrase.split(), cwd=desk).stdout


def test_every_help_works_without_extras(bare, desk):
    message = call(bare / "markergen", "--help", cwd=desk).stdout.partition("Commands:")[2]
    commands = [line.split()[0] for line in message.splitlines() if line.startswith("  ") and line[2] != " "]
    assert {"design", "validate", "export", "detect", "compare", "verify", "rescale", "study"} <= set(commands)
    for command in commands:
        assert f"markergen {command}" in call(bare / "markergen", command, "--help", cwd=desk).stdout


def test_every_drawing_is_written_without_extras(desk):
    assert DRAWN
    for suffix in DRAWN:
        assert (desk / f"m{suffix}").stat().st_size > 0


def test_a_marker_is_found_in_photos_without_extras(bare, desk):
    phrase = "detect photos --marker marker.json --camera photos/camera.yaml --json found.json --overlay seen"
    call(bare / "markergen", *phrase.split(), cwd=desk)
    findings = json.loads((desk / "found.json").read_text())
    assert len(findings) == 6
    assert len(list((desk / "seen").iterdir())) == 6


@pytest.mark.parametrize("suffix", MADE)
def test_a_solid_is_refused_in_one_line_that_says_what_to_install(bare, desk, suffix):
    done = call(bare / "markergen", "export", "marker.json", "-o", f"m{suffix}", cwd=desk, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "No module named 'OCP'" in line
    assert "pip install 'markergen[step]'" in line
    assert not (desk / f"m{suffix}").exists()


def test_a_cluster_is_refused_in_one_line_that_says_what_to_install(bare, desk):
    phrase = "study sweep.toml -o far --scheduler tcp://127.0.0.1:9"
    done = call(bare / "markergen", *phrase.split(), cwd=desk, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "pip install 'markergen[cluster]'" in line


def test_solids_are_made_with_every_extra(whole, bare, desk, tmp_path, capsys):
    shutil.copy(desk / "marker.json", tmp_path)
    solids = ["m.step", "m.stl", "m.3mf", "m.glb"]
    call(whole / "markergen", "export", "marker.json", *(f"-o{name}" for name in solids), cwd=tmp_path)
    call(whole / "markergen", "verify", "marker.json", *solids, cwd=tmp_path)
    # A STEP is read without the kernel no more than it is written.
    done = call(bare / "markergen", "verify", "marker.json", "m.step", cwd=tmp_path, check=False)
    assert done.returncode != 0
    assert "pip install 'markergen[step]'" in done.stdout + done.stderr
    with capsys.disabled():
        print(f"\ninstalled: {size(bare)} MB, with every extra {size(whole)} MB")


def test_every_extra_brings_what_it_names(whole, tmp_path):
    names = "OCP, distributed, threadpoolctl, pupil_apriltags, stag, ringgrid, starlette, uvicorn, pandas"
    call(whole / "python", "-c", f"import {names}", cwd=tmp_path)
    call(whole / "python", "-m", "pip", "check", cwd=tmp_path)
