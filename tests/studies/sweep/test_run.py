import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from markergen.studies.engines import ENGINES, engine_for
from markergen.studies.sweep.grid import read_sweep
from markergen.studies.sweep.run import run_sweep

ROOT = Path(__file__).parents[3]


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def alone(small, tmp_path_factory):
    """Folder of the small sweep, computed in this process."""
    folder = tmp_path_factory.mktemp("alone")
    run_sweep(read_sweep(str(small)), folder, ENGINES["serial"]())
    return folder


@pytest.mark.long
def test_processes_write_the_same_bytes_as_this_one(small, alone, tmp_path):
    output = []
    written = run_sweep(
        read_sweep(str(small)), tmp_path / "two", engine_for(2), progress=lambda *parts: output.append(parts[:2])
    )
    assert files(tmp_path / "two") == files(alone)
    assert [path.name for path in written] == [
        "table.csv", "rotation-error.svg", "translation-error.svg", "index.html",
    ]  # fmt: skip
    # Four layouts, and each with two noises.
    assert output[-1] == (12, 12)


@pytest.mark.long
def test_a_cluster_writes_the_same_bytes(small, alone, cluster, tmp_path):
    """Whose workers begin with two threads of BLAS: with them designs differ in the last digits."""
    run_sweep(read_sweep(str(small)), tmp_path / "cluster", engine_for(scheduler=cluster.address))
    assert files(tmp_path / "cluster") == files(alone)


def start(small, folder, *options):
    command = [sys.executable, "-m", "markergen", "study", str(small), "-o", str(folder), "--workers", "2", *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def until(count, folder, process):
    while process.poll() is None and len(list(folder.glob("cells/*.npz"))) < count:
        time.sleep(0.005)


@pytest.mark.long
def test_ctrl_c_says_how_to_continue(small, alone, tmp_path):
    folder = tmp_path / "study"
    process = start(small, folder)
    until(1, folder, process)
    process.send_signal(signal.SIGINT)
    _, complaint = process.communicate(timeout=30)
    assert process.returncode == 130
    assert f"cells remain in {folder}; continue" in complaint
    assert "Traceback" not in complaint
    run_sweep(read_sweep(str(small)), folder, ENGINES["serial"](), resume=True)
    assert files(folder) == files(alone)


@pytest.mark.long
def test_after_ten_kills_at_random_moments_the_table_is_the_same(small, alone, tmp_path):
    folder, rng, killed = tmp_path / "study", random.Random(), 0
    while killed < 10:
        process = start(small, folder, "--resume")
        done = len(list(folder.glob("cells/*.npz")))
        # Also before the first cell, and in the middle of writing the table.
        until(done + rng.randint(0, 2), folder, process)
        time.sleep(rng.random() * 0.2)
        process.kill()
        process.communicate()
        killed += process.returncode == -signal.SIGKILL
        if process.returncode == 0:  # faster than the kill: the next ones meet a new study
            assert files(folder) == files(alone)
            folder = tmp_path / f"study after {killed} kills"
    process = start(small, folder, "--resume")
    process.communicate()
    assert process.returncode == 0
    assert files(folder) == files(alone)
