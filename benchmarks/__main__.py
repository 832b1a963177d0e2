"""Print every quick benchmark, each in a process of its own: `python -m benchmarks`.

`python -m benchmarks.optima` and the full `benchmarks.shapes` and `benchmarks.trials` take minutes and are run by name.
"""

import subprocess
import sys

SHAPES = ["shapes", "--dot", "0.01", "--n", "7", "--seeds", "3", "--starts", "20"]

for module, *arguments in (["condition"], SHAPES, ["views"], ["trials", "--poses", "40"]):
    print(f"\n== {module} ==", flush=True)
    subprocess.run([sys.executable, "-m", f"benchmarks.{module}", *arguments], check=True)
