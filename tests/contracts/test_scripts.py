"""What a user's own script registers works in worker processes and on a cluster, without being installed."""

import subprocess
import sys

import pytest
from dask_cluster import Cluster
from installed import environment

from markergen.model.body_json import to_json

SCRIPT = """
import sys
from pathlib import Path
import numpy as np
from markergen.estimators import ESTIMATORS, PoseEstimates, PoseEstimator
from markergen.objectives import OBJECTIVES
from markergen.objectives.pose import PoseObjective
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import named_poses
from markergen.model.body_json import read_marker

class Mine(PoseEstimator):
    name = "mine"
    def solve(self, batch):
        return batch.once(ESTIMATORS["lm"])

ESTIMATORS.register("mine")(Mine())

@OBJECTIVES.register("far")
class Far(PoseObjective):
    criterion = None

if __name__ == "__main__":
    from markergen.studies.engines import engine_for
    from markergen.studies.sweep.grid import read_sweep
    from markergen.studies.sweep.run import run_sweep
    from markergen.validation.trials import run_experiment
    poses = named_poses("cone:count=12")
    marker = read_marker(Path("m.json"))
    # In this process, and in others unless a cluster computes.
    for workers in (1, 2) if len(sys.argv) == 2 else (1,):
        found = run_experiment(marker, PAPER_CAMERA, poses, runs=3, estimators=["mine", "lm"], workers=workers)
        mine, lm = (found.errors[name] for name in ("mine", "lm"))
        assert np.array_equal(mine.rotation_deg, lm.rotation_deg, equal_nan=True)
    run_sweep(read_sweep("sweep.toml"), Path(sys.argv[1]), engine_for(2, *sys.argv[2:]))
"""

SWEEP = """
objective = "far"
poses = "cone:distance=0.6..1m,tilt=0..60,count=8,seed=1"
dot = "30mm"
restarts = 1

[study]
name = "Mine"
runs = 3
estimators = ["mine"]

[grid]
n = [4]
"""


@pytest.fixture
def here(tmp_path, make_ngon):
    (tmp_path / "script.py").write_text(SCRIPT)
    (tmp_path / "m.json").write_bytes(to_json(make_ngon(5, 0.1, 0.02)))
    (tmp_path / "sweep.toml").write_text(SWEEP)
    return tmp_path


def run(here, *phrase):
    command = [sys.executable, "-W", "error", "script.py", *phrase]
    done = subprocess.run(command, cwd=here, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    table = (here / phrase[0] / "table.csv").read_text()
    assert table.count(",all,mine,") == 1
    return table


@pytest.mark.long
def test_in_worker_processes_and_on_a_cluster(here, tmp_path_factory):
    table = run(here, "local")
    cluster = Cluster(tmp_path_factory.mktemp("cluster"), workers=1)
    try:
        assert run(here, "cluster", cluster.address) == table
    finally:
        cluster.end()
