"""The compiled core under AddressSanitizer and UndefinedBehaviorSanitizer, on random images, bodies and cameras."""

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SEEDS, ROUNDS = 4, 150
PATIENCE_S = 900

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def sanitized(tmp_path_factory):
    """A copy of the package with its core so compiled, and the library to load before it."""
    compiler = next(filter(None, map(shutil.which, ("gcc", "clang"))), None)
    if compiler is None:
        pytest.skip("neither gcc nor clang, which have the sanitizers, is there")
    runtime = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True).stdout.strip()
    if not Path(runtime).is_absolute():
        pytest.skip(f"{compiler} has no libasan.so")
    folder = tmp_path_factory.mktemp("sanitized")
    package = folder / "markergen_detect"
    shutil.copytree(HERE.parent / "markergen_detect", package, ignore=shutil.ignore_patterns("lib*"))
    shutil.copy(HERE / "fuzzed.py", folder)
    builder = runpy.run_path(str(HERE.parent / "build_core.py"))
    flags = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", compiler)
        builder["build"](package, flags)
    return folder, runtime


@pytest.mark.parametrize("seed", range(SEEDS))
def test_no_input_makes_the_core_read_or_count_where_it_must_not(sanitized, seed):
    folder, runtime = sanitized
    environment = {**os.environ, "PYTHONPATH": str(folder), "LD_PRELOAD": runtime, "OPENBLAS_NUM_THREADS": "1"}
    environment["ASAN_OPTIONS"] = "detect_leaks=0:allocator_may_return_null=1"
    done = subprocess.run(
        [sys.executable, folder / "fuzzed.py", str(seed), str(ROUNDS)],
        env=environment, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-4000:]
