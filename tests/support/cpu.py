"""CPU time of a call, for ratios to another call in the same run."""

import time
from collections.abc import Callable


def cpu_seconds(call: Callable[[], object], repeats: int = 5) -> float:
    """Least CPU time in s of some calls."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)
