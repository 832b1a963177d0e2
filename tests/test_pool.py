import doctest
import itertools
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import markergen as mg
from markergen import pool
from markergen.errors import MarkergenError
from markergen.pool import BLAS_THREADS, OneBlasThread, chunks_of, map_chunks, map_counted

ROOT = Path(__file__).parents[1]
SCRIPT = """
import time
from markergen.pool import map_chunks
map_chunks(time.sleep, [0, 0, 60, 60], 2, lambda index, _: print("done", index, flush=True))
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_results_keep_the_order_of_the_chunks(workers):
    finished = []
    assert map_chunks(math.factorial, range(6), workers, lambda *done: finished.append(done)) == [1, 1, 2, 6, 24, 120]
    assert sorted(finished) == [(k, math.factorial(k)) for k in range(6)]


def test_workers_use_one_thread_each_and_the_parent_keeps_its_own(monkeypatch):
    monkeypatch.setenv(BLAS_THREADS[0], "7")
    monkeypatch.delenv(BLAS_THREADS[1], raising=False)
    assert map_chunks(os.getenv, BLAS_THREADS, 2, lambda *_: None) == ["1"] * len(BLAS_THREADS)
    assert os.environ[BLAS_THREADS[0]] == "7"
    assert BLAS_THREADS[1] not in os.environ


def test_an_error_in_a_worker_arrives():
    with pytest.raises(ValueError, match="factorial"):
        map_chunks(math.factorial, [3, -1], 2, lambda *_: None)
    assert not multiprocessing.active_children()


def test_a_worker_that_ends_early_is_told_from_an_error_of_its_own():
    with pytest.raises(MarkergenError, match="ended early; use one"):
        map_chunks(os._exit, [3, 3], 2, lambda *_: None)


@pytest.fixture(params=[signal.SIG_IGN, signal.SIG_DFL], ids=["as in Python", "as after gmsh"])
def sigpipe(request):
    """What a process does that writes to a pipe nobody reads: Python makes it an error, and some libraries deadly."""
    before = signal.signal(signal.SIGPIPE, request.param)
    yield
    signal.signal(signal.SIGPIPE, before or signal.SIG_IGN)


@pytest.mark.usefixtures("sigpipe")
def test_a_worker_that_ends_while_others_are_being_started(monkeypatch):
    """As on a loaded machine, where the parent may get its next turn after the first worker had its last."""
    start, started = multiprocessing.context.SpawnProcess.start, []

    def start_late(process):
        for other in started:
            other.kill()
            other.join()
            time.sleep(0.5)
        start(process)
        started.append(process)

    monkeypatch.setattr(multiprocessing.context.SpawnProcess, "start", start_late)
    with pytest.raises(MarkergenError, match="ended early; use one"):
        map_chunks(math.factorial, [3, 3], 2, lambda *_: None)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(
    ("function", "chunk", "error"),
    [
        (open, os.devnull, TypeError),
        (exec, "class Odd(Exception): pass\nraise Odd('said in full')", RuntimeError),
    ],
    ids=["result", "error"],
)
def test_what_cannot_travel_is_an_error_of_its_chunk(function, chunk, error):
    with pytest.raises(error, match=r"cannot pickle|Odd: said"):
        map_chunks(function, [chunk, chunk], 2, lambda *_: None)


def test_large_chunks_and_results_pass():
    """Beyond what a pipe holds, in both directions at once."""
    chunks = [bytes([k]) * 3_000_000 for k in range(6)]
    assert map_chunks(bytes, chunks, 2, lambda *_: None) == chunks


def test_an_interrupt_between_chunks_ends_the_workers_at_once():
    def interrupt(*_):
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        map_chunks(time.sleep, [0, 60, 60], 2, interrupt)
    # Two interpreters start in a second or two; sleeping out would take sixty.
    assert time.monotonic() - start < 30
    assert not multiprocessing.active_children()


def run_file(path, text):
    path.write_text(text)
    return subprocess.run(
        [sys.executable, str(path)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_a_script_needs_no_guard_and_runs_once(tmp_path):
    script = (
        'print("runs")\n'
        "import math\n"
        "from markergen.pool import map_chunks\n"
        "print(map_chunks(math.factorial, [3, 4], 2, lambda *_: None), __spec__, __file__)\n"
    )
    ran = run_file(tmp_path / "script.py", script)
    assert (ran.stdout, ran.stderr) == (f"runs\n[6, 24] None {tmp_path / 'script.py'}\n", "")


def test_a_worker_starts_while_another_thread_imports_opencv(tmp_path):
    """OpenCV puts its own folder, in which there is a `typing`, first in sys.path while it is imported.

    And its binary part, which is complete, into sys.modules.
    """
    (tmp_path / "cv2").mkdir()
    (tmp_path / "cv2" / "typing.py").write_text('raise ImportError("not the typing of Python")\n')
    (tmp_path / "cv2" / "__init__.py").write_text(
        "import sys, time, types\n"
        "before, setNumThreads = sys.path[:], int\n"
        "sys.OpenCV_LOADER = True\n"
        "sys.path.insert(0, __path__[0])\n"
        "package = sys.modules.pop('cv2')\n"
        "sys.modules['cv2'] = types.ModuleType('cv2')\n"
        "sys.importing = True\n"
        "time.sleep(0.3)\n"
        "sys.modules['cv2'] = package\n"
        "sys.path[:] = before\n"
        "del sys.OpenCV_LOADER\n"
    )
    script = (
        "import math, sys, threading\n"
        "from markergen.pool import Worker\n"
        'threading.Thread(target=__import__, args=("cv2",)).start()\n'
        'while not hasattr(sys, "importing"):\n'
        "    pass\n"
        "print(Worker()(math.factorial, 4))\n"
    )
    ran = run_file(tmp_path / "script.py", script)
    assert (ran.stdout, ran.stderr) == ("24\n", "")


def test_what_a_script_defines_reaches_the_workers_and_ctrl_c_does_not(tmp_path):
    script = (
        "import signal\n"
        "from markergen.pool import map_chunks\n"
        "def double(x):\n"
        "    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])\n"
        "    return 2 * x, signal.SIGINT in blocked\n"
        'if __name__ == "__main__":\n'
        "    print(map_chunks(double, [3, 4], 2, lambda *_: None))\n"
    )
    ran = run_file(tmp_path / "script.py", script)
    assert (ran.stdout, ran.stderr) == ("[(6, True), (8, True)]\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="process groups are POSIX")
@pytest.mark.parametrize("killed", [False, True], ids=["Ctrl-C", "parent killed"])
def test_nothing_is_left_behind(killed):
    """Ctrl-C reaches the whole process group; only the parent says so. A parent that is killed can say nothing."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith("done")
    if killed:
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGINT)
    # The pipe closes when the last of the workers that inherited it has gone.
    _, stderr = process.communicate(timeout=30)
    assert process.returncode == (-signal.SIGKILL if killed else -signal.SIGINT)
    assert stderr.count("Traceback") == (0 if killed else 1)


@pytest.mark.parametrize("workers", [1, 9])
def test_what_is_done_is_counted_from_nothing_to_all(workers):
    calls = []
    chunks = chunks_of(7, 3)
    assert chunks == [range(3), range(3, 6), range(6, 7)]
    assert map_counted(sum, chunks, workers, lambda *call: calls.append(call)) == [3, 12, 6]
    assert (calls[0], calls[-1]) == ((0, 7), (7, 7))
    assert sorted(b[0] - a[0] for a, b in itertools.pairwise(calls)) == [1, 3, 3]
    assert map_counted(max, [(1, 5), (2, 3)], 1, lambda *call: calls.append(call), size=max) == [5, 3]
    assert calls[-3:] == [(0, 8), (5, 8), (8, 8)]
    assert map_counted(sum, [], workers) == []


def test_the_examples_run():
    assert doctest.testmod(pool).failed == 0


def blas_threads():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_one_blas_thread_holds_until_the_last_of_those_that_ask_for_it():
    before = blas_threads()
    first, second = OneBlasThread(), OneBlasThread()
    first.__enter__()
    # From another thread, as in a server.
    with ThreadPoolExecutor(1) as executor:
        executor.submit(second.__enter__).result()
        first.__exit__()
        assert set(blas_threads()) == {1}
        executor.submit(second.__exit__).result()
    assert blas_threads()[: len(before)] == before


@pytest.mark.parametrize("function", [mg.calibrate, mg.compare, mg.design, mg.handeye, mg.rig, mg.study, mg.validate])
def test_what_the_library_computes_does_not_depend_on_the_number_of_processors(monkeypatch, function):
    asked = []
    monkeypatch.setattr(OneBlasThread, "__enter__", lambda self: asked.append(function))
    monkeypatch.setattr(OneBlasThread, "__exit__", lambda self, *_: None)
    with pytest.raises((TypeError, mg.InputError)):
        function(*[None] * sum(p.default is p.empty for p in signature(function).parameters.values()), n=np.zeros(2))
    assert asked == [function]
