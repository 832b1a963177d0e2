import errno
import math
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from study_work import cells, noise, refusing, slow_noise

from markergen.errors import InputError, OutputError
from markergen.pool import TimeForecast
from markergen.studies.cells import Cell
from markergen.studies.engines import ENGINES, engine_for
from markergen.studies.run import _kind, _of_all_kinds, run_cells

IDENTITY = {"study": "test"}
ROOT = Path(__file__).parents[2]

RUN_SLOWLY = """
import sys
from pathlib import Path
from study_work import cells, slow_noise
from markergen.studies.engines import engine_for
from markergen.studies.run import run_cells

if __name__ == "__main__":
    run_cells(slow_noise, cells(40), Path(sys.argv[1]), {"study": "test"}, engine_for(2), resume=True)
"""


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Folder of 40 cells that one process computed one after the other."""
    folder = tmp_path_factory.mktemp("alone")
    run_cells(noise, cells(40), folder, IDENTITY, ENGINES["serial"]())
    return folder


def test_results_come_in_the_order_of_the_cells(tmp_path):
    wanted = cells(5)[::-1]
    results = run_cells(noise, wanted, tmp_path, IDENTITY, ENGINES["serial"]())
    assert list(results) == wanted
    assert [int(result["index"]) for result in results.values()] == [4, 3, 2, 1, 0]
    np.testing.assert_array_equal(results[wanted[0]]["values"], noise(wanted[0])["values"])
    with pytest.raises(KeyError):
        results[cells(6)[5]]


@pytest.mark.parametrize("workers", [1, 2])
def test_the_number_of_workers_changes_no_bit(alone, tmp_path, workers):
    run_cells(noise, cells(40), tmp_path, IDENTITY, engine_for(workers))
    assert files(tmp_path) == files(alone)


def test_a_cell_that_is_asked_for_twice_is_computed_once(tmp_path):
    calls = []
    results = run_cells(
        lambda cell: calls.append(cell) or noise(cell),
        cells(2) * 2,
        tmp_path,
        IDENTITY,
        ENGINES["serial"](),
    )
    assert len(calls) == len(results) == 2


def test_finished_cells_are_never_computed_again_but_spoiled_ones_are(alone, tmp_path):
    engine = ENGINES["serial"]()
    run_cells(noise, cells(40)[:30], tmp_path, IDENTITY, engine)
    spoiled, cut, calls = cells(40)[3], cells(40)[7], []
    for cell, data in ((spoiled, b"nonsense"), (cut, (tmp_path / "cells" / f"{cut.name}.npz").read_bytes()[:-9])):
        (tmp_path / "cells" / f"{cell.name}.npz").write_bytes(data)
    run_cells(lambda cell: calls.append(cell) or noise(cell), cells(40), tmp_path, IDENTITY, engine, resume=True)
    assert calls == [spoiled, cut, *cells(40)[30:]]
    assert files(tmp_path) == files(alone)


def test_progress_counts_and_tells_the_time_left(tmp_path):
    output = []
    run_cells(
        slow_noise, cells(4), tmp_path, IDENTITY, ENGINES["serial"](),
        progress=lambda *parts: output.append(parts), cost=lambda cell: 0.5 + cell.settings["index"],
    )  # fmt: skip
    assert [(done, total) for done, total, _ in output] == [(done, 4) for done in range(5)]
    assert math.isnan(output[0][2])
    assert output[1][2] > 0.29
    # 100 ms were two parts of eight: six more to come. Between sleeping and waking a loaded machine takes its time.
    assert 0.29 < output[2][2] < 6
    assert output[-1][2] == 0


def test_an_error_of_a_cell_ends_the_study_and_leaves_what_is_finished(tmp_path):
    with pytest.raises(InputError, match="index=3"):
        run_cells(refusing, cells(6), tmp_path, IDENTITY, engine_for(1))
    # One worker takes the cells in turn, and may have gone on to the next before it was ended.
    kept = {path.stem for path in (tmp_path / "cells").iterdir()}
    assert {cell.name for cell in cells(3)} <= kept
    assert cells(6)[3].name not in kept


def test_a_full_disk_stops_the_study_and_making_room_continues_it(alone, tmp_path, monkeypatch):
    real, calls = os.fsync, []

    def full(handle):
        calls.append(handle)
        if len(calls) > 12:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(handle)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match="No space left"):
            run_cells(noise, cells(40), tmp_path, IDENTITY, ENGINES["serial"]())
    # The first file is that which says what study it is.
    assert len(list((tmp_path / "cells").iterdir())) == 11
    run_cells(noise, cells(40), tmp_path, IDENTITY, ENGINES["serial"](), resume=True)
    assert files(tmp_path) == files(alone)


def start(folder):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "support")])}
    script = folder.with_suffix(".py")
    script.write_text(RUN_SLOWLY)
    return subprocess.Popen([sys.executable, str(script), str(folder)], env=environment)


def until(count, folder, process):
    while process.poll() is None and len(list(folder.glob("cells/*.npz"))) < count:
        time.sleep(0.005)


@pytest.mark.long
def test_a_study_that_is_killed_again_and_again_ends_with_the_same_files(alone, tmp_path):
    folder, rng, killed = tmp_path / "study", random.Random(1), 0
    for _ in range(2):
        process = start(folder)
        until(len(list(folder.glob("cells/*.npz"))) + rng.randint(0, 9), folder, process)
        time.sleep(rng.random() * 0.1)
        process.kill()
        killed += process.wait() == -signal.SIGKILL
    assert killed == 2
    assert start(folder).wait() == 0
    assert files(folder) == files(alone)


def test_workers_end_with_a_study_that_is_killed(tmp_path):
    """They would go on computing for nobody otherwise."""
    if not Path("/proc").is_dir():
        pytest.skip("needs /proc to look for processes")
    process = start(tmp_path / "study")
    until(2, tmp_path / "study", process)
    workers = [int(word) for word in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    process.kill()
    process.wait()
    assert len(workers) >= 2
    limit = time.monotonic() + 10
    while any(Path(f"/proc/{worker}").exists() and not _is_zombie(worker) for worker in workers):
        assert time.monotonic() < limit
        time.sleep(0.05)


def _is_zombie(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def test_a_kind_whose_cost_is_underestimated_is_measured_first_and_by_itself():
    slow, fast = [Cell("slow", {"index": k}) for k in range(10)], [Cell("fast", {"index": k}) for k in range(90)]
    order = _of_all_kinds([*fast, *slow])
    assert order[:2] == [fast[0], slow[0]]
    assert order[2:] == [*fast[1:], *slow[1:]]
    forecast = TimeForecast(dict.fromkeys(order, 1.0), _kind)
    # All are thought to take a second; those of one kind take ten.
    for cell in order[:20]:
        forecast.finished(cell, 10.0 if cell.kind == "slow" else 1.0)
    took = 19 + 10
    forecast._elapsed = took / 2  # By two workers.
    left = (71 + 9 * 10) / 2
    # One cell of the slow kind against half a one that errs as all do; without kinds, 58 s would be expected.
    assert forecast.seconds() == pytest.approx(left, rel=0.2)
