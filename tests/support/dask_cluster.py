"""A real Dask cluster on the loopback address."""

import asyncio
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


class Cluster:
    """A real Dask scheduler and its workers, each a process of its own on the loopback address."""

    def __init__(self, folder, workers, paths=(ROOT, ROOT / "tests" / "support")):
        pytest.importorskip("distributed")
        self.paths = os.pathsep.join(map(str, paths))
        self.file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.workers = [self.add_worker() for _ in range(workers)]
        limit = time.monotonic() + 120
        while not self.file.exists():
            assert time.monotonic() < limit
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]
        # On a busy machine workers need longer to start than a user waits for them.
        asyncio.run(asyncio.wait_for(self._joined(workers), 120))

    async def _joined(self, workers):
        from distributed.core import rpc

        async with rpc(self.address) as scheduler:
            while len((await scheduler.identity())["workers"]) < workers:
                await asyncio.sleep(0.1)

    def add_worker(self):
        return self._start("worker", "--nthreads", "1", "--no-nanny", "--no-dashboard")

    def _start(self, kind, *options):
        environment = {**os.environ, "PYTHONPATH": self.paths, "OPENBLAS_NUM_THREADS": "2"}
        command = [sys.executable, "-m", "dask", kind, "--scheduler-file", str(self.file), *options]
        return subprocess.Popen(
            command, env=environment, cwd=self.file.parent, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def end(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()
