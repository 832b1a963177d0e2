"""A pool of processes that leaves nothing behind, whatever ends it."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from typing import TypeVar

from markergen.errors import InputError, MarkergenError
from markergen.registry import Luggage, outside, receive

C = TypeVar("C")
R = TypeVar("R")

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


MOST_WORKERS = 256


def processor_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers_for(wanted: int | None, worth: int) -> int:
    """Processes to start: those wanted, or as many as there are processors and as the work is worth.

    Raises
    ------
    InputError
        If the number that is wanted is below 1, or so large that the machine would choke.
    """
    if wanted is None:
        return min(processor_count(), worth)
    if not 1 <= wanted <= MOST_WORKERS:
        raise InputError(f"1 to {MOST_WORKERS} workers", f"workers={wanted}", "give the number of processors, or less")
    return wanted


def map_chunks(
    function: Callable[[C], R], chunks: Sequence[C], workers: int, finished: Callable[[int], None]
) -> list[R]:
    """Return function(chunk) of every chunk, computed by `workers` processes; 1 computes in this process.

    Calls finished(index) as each chunk is done. Whatever interrupts the caller ends the workers at once.

    Raises
    ------
    MarkergenError
        If a worker ends early: out of memory, or a script that does not guard its entry point.
    """
    results: dict[int, R] = {}
    if workers == 1:
        for index, chunk in enumerate(chunks):
            results[index] = function(chunk)
            finished(index)
    else:
        with closing(as_completed_chunks(function, chunks, workers)) as completed:
            for index, result in completed:
                results[index] = result
                finished(index)
    return [results[index] for index in range(len(chunks))]


def as_completed_chunks(
    function: Callable[[C], R], chunks: Sequence[C], workers: int
) -> Generator[tuple[int, R], None, None]:
    """Yield the index and function(chunk) of each chunk as it is done, computed by `workers` other processes.

    Closing it early, as any error does, ends the workers at once; raises as `map_chunks` does.
    """
    others = set(multiprocessing.active_children())
    # A fresh interpreter, because fork would copy the locks that threads of BLAS and OpenCV hold at that moment.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, initializer=_start_worker, initargs=(outside(),))
    try:
        with _inherited_by_workers():
            futures = {pool.submit(function, chunk): index for index, chunk in enumerate(chunks)}
        for future in as_completed(list(futures)):
            # Nobody else keeps what may be large.
            yield futures.pop(future), future.result()
    except BaseException as error:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        if isinstance(error, BrokenProcessPool):
            raise MarkergenError(
                "expected worker processes that stay alive, found one that ended early; use one worker, or put a"
                ' script\'s entry under if __name__ == "__main__"'
            ) from error
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _inherited_by_workers() -> Iterator[None]:
    """Start processes with one thread of BLAS each, and deaf to Ctrl-C: that is for the parent to answer.

    BLAS reads its variables when numpy is imported, which in a worker is before any code of ours. A signal that is
    blocked, other than one that is ignored, still reaches the parent afterwards.
    """
    before = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    can_block = hasattr(signal, "pthread_sigmask")
    if can_block:
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if can_block:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _start_worker(luggage: Luggage) -> None:
    import cv2

    receive(luggage)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Leave no worker waiting for work from a parent that was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
