"""Print every quick benchmark: `python -m benchmarks`.

First the times, ours beside a peer or a floor for the same work, with the ratio to the fastest in brackets; then the
start of an interpreter beside that of numpy; detection beside that of tags and grids; solids beside the CAD kernel
alone; the trials of `validate`, whose workers are measured together; and how reliably the search finds what is best.
What follows `python -m benchmarks` goes to pytest, such as `-k descent`. `python -m benchmarks.optima` and the full
`benchmarks.shapes`, `benchmarks.trials` and `benchmarks.detection` take minutes and are run by name, as are
`benchmarks.detection_quality`, how accurate and how often wrong detection is, `benchmarks.detection_photos`,
`benchmarks.headline`, the error to plan with beside that of rendered views, and `benchmarks.rigs`, a cube and a wall
beside those of tags. `benchmarks.structure` measures the code itself.
"""

import subprocess
import sys
from pathlib import Path

TIMED = ["-o", "addopts=", "-o", "filterwarnings=", "-q", "--import-mode=importlib", "--no-header"]
TABLE = ["--benchmark-timer=time.process_time", "--benchmark-columns=min,median,rounds", "--benchmark-sort=min"]
SHAPES = ["--dot", "0.01", "--n", "7", "--seeds", "3", "--starts", "20"]

chosen = sys.argv[1:]
subprocess.run(
    [sys.executable, "-m", "pytest", str(Path(__file__).parent), *TIMED, *TABLE, "--benchmark-warmup=off", *chosen],
    check=True,
)
if not chosen:
    for module, arguments in (
        ("loading", []),
        ("detection", ["--only", "starts", "sizes", "--sizes", "640x480", "--views", "5"]),
        ("solids", []),
        ("trials", ["--poses", "40"]),
        ("shapes", SHAPES),
    ):
        print(f"\n== {module} ==", flush=True)
        subprocess.run([sys.executable, "-m", f"benchmarks.{module}", *arguments], check=True)
