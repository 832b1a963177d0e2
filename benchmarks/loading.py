"""How long it takes to start: importing and loading from a cold interpreter, beside `import numpy` in the same run.

Everything is compiled to bytecode before, as it is once installed.

python -m benchmarks.loading
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

ROUNDS = 9
MARKER = Path(__file__).parents[1] / "tests" / "model" / "data" / "designed-v1.json"
"""Twelve dots in a polygon with a hole, a keep-out, a tag and holes in the plate."""

STARTS = {
    "empty interpreter": "pass",
    "import numpy": "import numpy",
    "import markergen": "import markergen",
    "Camera(...)": "from markergen.model.camera import Camera; Camera(640, 480, 800, 800, 320, 240)",
    "import body_json": "import markergen.model.body_json",
    "Marker.load(...)": f"from markergen.model.marker import Marker; Marker.load({str(MARKER)!r})",
}
FLOOR = "import numpy"


def seconds(code: str, bytecode: str) -> float:
    """Processor time of an interpreter of its own that runs some code and ends, s; `bytecode` is a folder for that."""
    ours = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True, env={**ours, "PYTHONPYCACHEPREFIX": bytecode})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the least of several rounds, taken in turn so that other work is unfair to none."""
    with tempfile.TemporaryDirectory() as folder:
        # The first of them compiles, and so is never the least.
        times = [{name: seconds(code, folder) for name, code in STARTS.items()} for _ in range(ROUNDS)]
    least = {name: min(time[name] for time in times) for name in STARTS}
    print(f"{'':20} {'s':>6} {'over numpy':>11}")
    for name, value in least.items():
        print(f"{name:20} {value:6.3f} {value / least[FLOOR]:11.2f}")


if __name__ == "__main__":
    main()
