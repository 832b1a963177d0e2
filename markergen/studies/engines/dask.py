"""Engine for a running Dask cluster."""

import asyncio
import logging
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

from markergen.errors import InputError, MarkergenError, MissingLibraryError, install
from markergen.pool import OneBlasThread
from markergen.registry import Luggage, outside, receive
from markergen.studies.cells import Cell, Result, Work, versions
from markergen.studies.engines import ENGINES, Engine

if TYPE_CHECKING:
    from distributed import Client

ANSWER_SECONDS = 5.0
"""Timeout for the scheduler to respond and have a worker, while the user waits at a terminal."""

LOST_SECONDS = 60.0
"""Timeout for a cluster without workers: most replace a worker that died."""

LOOK_SECONDS = 5.0
"""Interval between checks for workers."""


@ENGINES.register("dask")
class Dask(Engine):
    """Submits the cells to the scheduler at `Engine.scheduler`, and survives the loss of workers.

    The workers need the same versions of markergen and its libraries; start them with ``--nthreads 1``.
    """

    def check(self) -> None:
        """Reject a scheduler that does not respond or has no workers."""
        try:
            import distributed
        except ImportError as error:
            raise MissingLibraryError(
                f"expected Dask for --scheduler, found: {error}; install it with {install('cluster')}"
            ) from None
        del distributed
        address = self.scheduler
        try:
            with _quiet():
                identity = asyncio.run(asyncio.wait_for(self._identity(), ANSWER_SECONDS + 1))
        except OSError:
            raise self._unreached(f"no answer in {ANSWER_SECONDS:.0f} s") from None
        except (ValueError, TypeError) as error:
            # Invalid addresses have messages of their own.
            raise self._unreached(str(error)) from None
        except Exception:
            # Dask interprets any response as its own protocol, and may fail in any way.
            raise self._unreached("something else") from None
        if not identity.get("workers"):
            raise InputError(
                "a Dask scheduler with workers",
                f"{identity.get('type', 'something else')} without workers at {address}",
                f"start some with: dask worker {address} --nthreads 1",
            )

    def run(self, work: Work, cells: Sequence[Cell]) -> Generator[tuple[Cell, Result], None, None]:
        """See `Engine.run`."""
        from distributed import as_completed

        with self._client() as client:
            wanted, luggage = versions(), outside()
            # Not pure: unique keys cannot collide with results of other clients.
            futures = {client.submit(_compute, work, cell, wanted, luggage, pure=False): cell for cell in cells}
            completed = as_completed(list(futures), loop=client.loop, with_results=True, raise_errors=False)
            while completed.count():
                self._wait(client, completed)
                future, result = next(completed)
                # Do not rely on the state of the future: that of a result that has already arrived returns to
                # pending when the worker that had it dies.
                if not isinstance(result, dict):
                    raise self._failure(future)
                yield futures.pop(future), result
                del future, result

    def _wait(self, client: "Client", completed: "as_completed") -> None:  # type: ignore[name-defined]  # noqa: F821
        """Return when a cell is finished; raises if none can finish because there are no workers."""
        looked = seen = monotonic()
        while not completed.has_ready():
            sleep(0.02)
            now = monotonic()
            if now > looked + LOOK_SECONDS:
                looked = now
                if client.status != "running":
                    raise self._lost("the scheduler is gone")
                if client.scheduler_info()["workers"]:
                    seen = now
                elif now > seen + LOST_SECONDS:
                    raise self._lost(f"no worker for {LOST_SECONDS:.0f} s")

    @contextmanager
    def _client(self) -> Iterator["Client"]:
        self.check()
        from distributed import Client

        with _quiet(), Client(self.scheduler, timeout=ANSWER_SECONDS, set_as_default=False) as client:
            yield client

    async def _identity(self) -> dict[str, Any]:
        """Return the scheduler's description of itself once it has a worker or the time is up."""
        from distributed.core import rpc

        begin, identity = monotonic(), dict[str, Any]()
        async with rpc(self.scheduler, timeout=ANSWER_SECONDS) as scheduler:
            while True:
                identity = await asyncio.wait_for(scheduler.identity(), begin + ANSWER_SECONDS - monotonic())
                if identity.get("workers") or monotonic() > begin + ANSWER_SECONDS - 1:
                    return identity
                await asyncio.sleep(0.2)

    def _unreached(self, reason: str) -> InputError:
        where = f"a Dask scheduler at {self.scheduler}"
        return InputError(where, reason, "start one with: dask scheduler; give tcp://HOST:PORT")

    def _failure(self, future: "Future") -> Exception:  # type: ignore[name-defined]  # noqa: F821
        from distributed import KilledWorker

        if future.status != "error":
            return self._lost("the scheduler is gone")
        error = future.exception()
        if isinstance(error, KilledWorker):
            return self._lost("a cell on which several workers died, perhaps out of memory")
        # The scheduler deserializes tasks, and reports failures with its own messages.
        if isinstance(error, ImportError) or "deserialization" in str(error):
            return InputError(
                "markergen where the Dask scheduler and its workers run",
                str(error).partition(". ")[0],
                "install the same version there",
            )
        return error

    def _lost(self, reason: str) -> MarkergenError:
        return MarkergenError(
            f"expected a Dask cluster at {self.scheduler} to the end, found: {reason}; "
            "finished cells remain: fix it, and use --resume"
        )


def _compute(work: Work, cell: Cell, wanted: dict[str, str], luggage: Luggage) -> Result:
    """Compute a cell on a worker with one thread, after checking that its versions match."""
    import cv2

    here = versions()
    if here != wanted:
        differing = [f"{name} {here[name]} in place of {wanted[name]}" for name in wanted if here[name] != wanted[name]]
        raise InputError("the same versions on the Dask workers", ", ".join(differing), "install the same there")
    receive(luggage)
    cv2.setNumThreads(1)
    with OneBlasThread():
        return work(cell)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the library's log: errors are reported as exceptions, in one line."""
    loggers = [logging.getLogger(name) for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
