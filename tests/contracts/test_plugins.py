"""Entries of another package work in every command, in worker processes, and on a cluster, and keep every contract."""

import json
import re
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from dask_cluster import Cluster
from installed import PLUGIN, ROOT, environment, install

from markergen.estimators import ESTIMATORS
from markergen.exporters import EXPORTERS
from markergen.maths.lenses import LENSES
from markergen.model.body_json import to_json
from markergen.model.boundary import Circle
from markergen.model.fabrication import PROCESSES
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import POSES
from markergen.objectives import OBJECTIVES
from markergen.objectives.criteria import regular_polygon
from markergen.read.cameras import CAMERA_FORMATS
from markergen.read.outlines.formats import OUTLINE_FORMATS
from markergen.read.poses import POSE_FORMATS
from markergen.studies.named import STUDIES

GROUPS = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]["entry-points"]
SWEEP = """
objective = "volume"
poses = "helix:turns=2,count=6"
dot = "30mm"
restarts = 1

[study]
name = "Plug-ins"
runs = 4
estimators = ["refined", "dlt"]

[grid]
n = [4, 5]
"""
CAMERA = """
cam0:
  camera_model: pinhole
  intrinsics: [500.0, 500.0, 320.0, 240.0]
  resolution: [640, 480]
  distortion_model: field_of_view
  distortion_coeffs: [0.9]
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder that the example package is installed in."""
    return install(PLUGIN, tmp_path_factory.mktemp("site"))


FORMER = ("-W", "ignore:markergen.solid:DeprecationWarning")
"""The example names modules as the release before did, which work for one more."""


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    folder = tmp_path_factory.mktemp("here")
    points = tuple(
        ControlPoint(i, float(x), float(y), 0.0, Feature(0.02)) for i, (x, y) in enumerate(regular_polygon(5, 0.08))
    )
    (folder / "plain.json").write_bytes(to_json(Marker(points, Circle(0.1), 0.002, provenance={"spec_hash": "1a2b"})))
    (folder / "camera.yaml").write_text(CAMERA)
    (folder / "sweep.toml").write_text(SWEEP)
    return folder


@pytest.fixture(scope="module")
def run(site, here):
    def run(arguments, status=0, folders=(site,)):
        command = [sys.executable, "-W", "error", *FORMER, "-m", "markergen", *arguments.split()]
        done = subprocess.run(command, cwd=here, env=environment(*folders), capture_output=True, text=True)
        assert done.returncode == status, done.stderr
        assert "plug-in" not in done.stderr
        return done.stdout if status == 0 else done.stderr

    return run


def test_the_example_has_one_of_each():
    assert set(GROUPS) == {
        f"markergen.{kind}" for kind in ("objectives", "estimators", "exporters", "camera_models", "processes", "poses")
    }
    for file in (PLUGIN / "markergen_extras").glob("*.py"):
        assert len(file.read_text().splitlines()) <= 40, file.name


def test_every_table_that_is_open_is_described():
    text = (ROOT / "docs" / "plugins.md").read_text()
    tables = OBJECTIVES, ESTIMATORS, EXPORTERS, LENSES, PROCESSES, POSES
    assert {table._group for table in tables} == set(GROUPS)
    for table in (*tables, CAMERA_FORMATS, POSE_FORMATS, OUTLINE_FORMATS, STUDIES):
        assert f"`{table._group}`" in text
    for group, points in GROUPS.items():
        assert group in text
        assert all(value.startswith("markergen_extras.") for value in points.values())


def test_the_snippets_of_the_documentation_run():
    snippets = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "plugins.md").read_text(), re.DOTALL)
    assert len(snippets) >= 2
    code = "\n".join([*snippets, "assert {'far', 'depth'} <= set(OBJECTIVES)"])
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_a_design_with_objective_and_poses_of_a_package(run, here):
    message = run("design --n 4 --objective volume --poses helix:count=20 --restarts 1 -o d.json -o d.xyz --details")
    assert "volume mrad" in message
    assert "seen from 20 poses (helix:turns=3,count=20)" in message
    provenance = json.loads((here / "d.json").read_text())["provenance"]
    assert provenance["criteria"]["design"]["volume_mrad"] > 0
    assert provenance["spec"]["poses"] == "helix:turns=3,count=20"
    assert np.loadtxt(here / "d.xyz").shape == (4, 3)
    message = run(
        "design --n 5 --objective volume --poses helix:count=10 --survive 1 --restarts 1 -o lost.json --details"
    )
    assert "objective volume after" in message


@pytest.mark.long
def test_estimators_in_worker_processes(run, here):
    run("validate plain.json --poses helix:count=12 --runs 20 --views 0 --workers 2 --json two.json")
    run("validate plain.json --poses helix:count=12 --runs 20 --views 0 --workers 1 --json one.json")
    assert (here / "one.json").read_bytes() == (here / "two.json").read_bytes()
    results = json.loads((here / "two.json").read_text())["estimators"]
    refined, lm = (results[name]["rotation_deg"]["rms"] for name in ("refined", "lm"))
    assert refined == pytest.approx(lm, rel=0.1)


@pytest.mark.long
def test_a_lens_from_a_camera_file_to_the_detector(run, here):
    run("design --n 5 --camera camera.yaml --poses cone:distance=0.7..1,count=20 --restarts 1 -o lens.json")
    lens = json.loads((here / "lens.json").read_text())["provenance"]["camera"]["distortion"]
    assert lens == {"model": "fov", "coefficients": [0.9]}
    run("validate lens.json --runs 5 --views 6 --workers 2 --json lens-found.json")
    views = json.loads((here / "lens-found.json").read_text())["views"]
    assert views["detected"] == 6
    assert views["point_px"]["rms"] < 0.1


def test_a_process_and_a_format(run, here):
    message = run("export plain.json -o m.xyz -o m.fab.pdf -o m.dxf --process etch")
    assert "5 points in m." in message
    assert "(etch: etched plate)" in message
    assert "the plate's outline" in message
    assert "--fit with --process cnc, found --process etch" in run(
        "export plain.json -o m.dxf --process etch --fit slip", 2
    )


SEVERAL = """
import sys
from markergen.cli import main
for line in sys.stdin.read().splitlines():
    assert main(line.split()) == 2, line
"""


def test_names_of_plug_ins_are_among_the_known_ones(run, site, here):
    (here / "wrong.yaml").write_text(CAMERA.replace("field_of_view", "omni"))
    reference = {
        "design --objective volum -o no.json": "volume",
        "design --poses helicopter -o no.json": "helix:turns=N,count=N",
        "export plain.json -o m.step --process etsch": "did you mean 'etch'?",
        "export plain.json -o m.abc": ".xyz",
        "design --camera wrong.yaml -o no.json": "fov, field_of_view",
    }
    command = [sys.executable, "-W", "error", *FORMER, "-c", SEVERAL]
    options = {"cwd": here, "env": environment(site), "capture_output": True, "text": True}
    done = subprocess.run(command, input="\n".join(reference), **options)
    assert done.returncode == 0, done.stderr
    for line, name in zip(done.stderr.splitlines(), reference.values(), strict=True):
        assert name in line
    # Without the package, a marker that needs it says what is missing.
    marker = json.loads((here / "plain.json").read_text())
    marker["provenance"] = {"spec": {"poses": "helix:count=12"}}
    (here / "helix.json").write_text(json.dumps(marker))
    assert "known pose distribution" in run("validate helix.json --runs 0 --views 0", 2, folders=())


# What comes from a script goes to a cluster in test_scripts.
@pytest.mark.long
def test_a_sweep_gets_the_same_table_from_processes_and_from_a_cluster(run, here, site, tmp_path):
    run("study sweep.toml -o local --workers 2")
    cluster = Cluster(tmp_path, workers=1, paths=(site, ROOT))
    try:
        run(f"study sweep.toml -o cluster --scheduler {cluster.address}")
    finally:
        cluster.end()
    table = (here / "local" / "table.csv").read_text()
    assert (here / "cluster" / "table.csv").read_text() == table
    header, *rows = table.splitlines()
    assert "criterion_volume_mrad" in header
    assert sum(",all,refined," in row for row in rows) == 2
    assert not any("expected" in row for row in rows)


def test_plug_ins_keep_the_contracts_of_their_tables(site):
    """The suites over all entries, run where the package is installed, for what it adds."""
    least = {"volume": 20, "refined": 6, "fov": 5, "etch": 3, "helix": 3, "xyz": 5}
    # Of formats the tests that write no solids of all the others.
    formats = "(xyz and (list or bare or relief or several or suffixes))"
    chosen = " or ".join([*(name for name in least if name != "xyz"), formats, "(exact_without_noise and gon)"])
    suites = [f"tests/contracts/test_{item}.py" for item in
              ("objectives", "estimators", "lenses", "processes", "poses", "exporters")]  # fmt: skip
    options = ["-p", "no:cacheprovider", "-vv", "--no-header", *FORMER, "-k", chosen]
    command = [sys.executable, "-m", "pytest", *options, *suites]
    done = subprocess.run(command, cwd=ROOT, env=environment(site), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    passed = [line for line in done.stdout.splitlines() if " PASSED" in line]
    for name, count in least.items():
        assert sum(name in line.partition("::")[2] for line in passed) >= count, name
