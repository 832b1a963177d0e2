"""Print every quick benchmark, each in a process of its own: `python -m benchmarks`.

`python -m benchmarks.optima` and the full `python -m benchmarks.trials` take minutes and are run by name.
"""

import subprocess
import sys

for module, *arguments in (["condition"], ["views"], ["trials", "--poses", "40"]):
    print(f"\n== {module} ==", flush=True)
    subprocess.run([sys.executable, "-m", f"benchmarks.{module}", *arguments], check=True)
