"""Process pool that leaves no processes behind, however it ends."""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from contextlib import ContextDecorator, closing, contextmanager, nullcontext, suppress
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from time import perf_counter, sleep
from traceback import format_exception
from typing import Any, ClassVar, Generic, TypeVar

from markergen.errors import InputError, MarkergenError
from markergen.registry import Luggage, outside, receive

C = TypeVar("C")
R = TypeVar("R")

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
_STARTING = threading.Lock()
"""Lock for starting processes: the environment and signal mask that they inherit belong to all threads."""

FIRST_PART = 0.005
"""Part of the cost by which a kind of tasks is expected to err as all do: with 0.02 a kind that takes ten times as long
is noticed too late, with none a single task decides."""

IMPORTING_MS = 10_000
"""Longest wait in ms for another thread that imports OpenCV."""

MOST_WORKERS = 256
"""Maximum number of processes; each loads its own copy of the library, and a number beyond this is a slip."""


class OneBlasThread(ContextDecorator):
    """Computes with one thread of linear algebra: sums over several, and so last digits, depend on their number.

    The limit is the process's, and is lifted when the last of all threads that ask for it is done.
    """

    _lock: ClassVar = threading.Lock()
    _users: ClassVar[int] = 0
    _limits: ClassVar[Any] = None

    def __enter__(self) -> None:
        from threadpoolctl import threadpool_limits

        # SciPy's library can be limited once it is loaded; where the variable says so, it loads with one thread.
        if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
            import scipy.linalg  # noqa: F401
        with self._lock:
            if not OneBlasThread._users:
                OneBlasThread._limits = threadpool_limits(1, user_api="blas")
            OneBlasThread._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            OneBlasThread._users -= 1
            if not OneBlasThread._users:
                OneBlasThread._limits.restore_original_limits()


def processor_count() -> int:
    """Return the number of processors available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers_for(wanted: int | None, worth: int) -> int:
    """Return the number of processes to start: `wanted`, or the number of processors, at most `worth`.

    Raises
    ------
    InputError
        If the number wanted is below 1 or above MOST_WORKERS.
    """
    if wanted is None:
        return min(processor_count(), worth)
    if not 1 <= wanted <= MOST_WORKERS:
        raise InputError(f"1 to {MOST_WORKERS} workers", f"workers={wanted}", "give the number of processors, or less")
    return wanted


def map_chunks(
    function: Callable[[C], R], chunks: Sequence[C], workers: int, finished: Callable[[int, R], object]
) -> list[R]:
    """Return function(chunk) for every chunk, computed by `workers` processes; 1 computes in this process.

    Calls finished(index, result) as each chunk is done. Anything that interrupts the caller ends the workers at once.

    Raises
    ------
    MarkergenError
        If a worker ends early: out of memory, or a script that does not guard its entry point.
    """
    results: dict[int, R] = {}
    if workers == 1:
        for index, chunk in enumerate(chunks):
            results[index] = function(chunk)
            finished(index, results[index])
    else:
        with closing(as_completed_chunks(function, chunks, workers)) as completed:
            for index, result in completed:
                results[index] = result
                finished(index, result)
    return [results[index] for index in range(len(chunks))]


def chunks_of(count: int, size: int) -> list[range]:
    """Split the numbers from 0 to count - 1 into chunks of `size`; the last one may be shorter.

    >>> chunks_of(5, 2)
    [range(0, 2), range(2, 4), range(4, 5)]
    """
    return [range(start, min(start + size, count)) for start in range(0, count, size)]


def map_counted(
    function: Callable[[C], R],
    chunks: Sequence[C],
    workers: int,
    progress: Callable[[int, int], None] | None = None,
    size: Callable[[C], int] = len,  # type: ignore[assignment]
    finished: Callable[[int, R], object] = lambda *_: None,
) -> list[R]:
    """Return function(chunk) for every chunk as `map_chunks` does, and report progress.

    Parameters
    ----------
    workers : int
        Maximum number of processes; no more are started than there are chunks.
    progress : callable or None
        Called with the total size of the finished chunks, and of all chunks; first with 0.
    size : callable
        Size of a chunk, for progress.
    finished : callable
        Called with the index and the result of each chunk as it is done.
    """
    total, done = sum(map(size, chunks)), 0
    if progress:
        progress(0, total)

    def count(index: int, result: R) -> None:
        nonlocal done
        finished(index, result)
        done += size(chunks[index])
        if progress:
            progress(done, total)

    return map_chunks(function, chunks, max(1, min(workers, len(chunks))), count)


class TimeForecast(Generic[C]):
    """Time left, from what the finished tasks of each kind took against their costs.

    Parameters
    ----------
    costs : mapping
        Relative costs of all tasks.
    kind : callable
        Kind of a task; costs of one kind are wrong by about the same factor.
    later : float
        Total cost of tasks that come after these.
    prior : float
        Part of the total cost by which a kind is expected to err as all do.
    """

    def __init__(
        self,
        costs: Mapping[C, float],
        kind: Callable[[C], Hashable],
        later: float = 0.0,
        prior: float = FIRST_PART,
    ) -> None:
        self.left, self._kind, self._later, self._begin = dict(costs), kind, later, perf_counter()
        self._first = prior * sum(costs.values())
        self._done: dict[Hashable, float] = defaultdict(float)
        self._took: dict[Hashable, float] = defaultdict(float)
        self._elapsed = 0.0

    def finished(self, task: C, seconds: float) -> None:
        """Take note of a finished task, and the time that its worker needed."""
        self._done[self._kind(task)] += self.left.pop(task)
        self._took[self._kind(task)] += seconds
        self._elapsed = perf_counter() - self._begin

    def seconds(self) -> float:
        """Seconds left; nan before the first task has finished."""
        took, done = sum(self._took.values()), sum(self._done.values())
        if not took:
            return float("nan")
        left: dict[Hashable, float] = defaultdict(float)
        for task, cost in self.left.items():
            left[self._kind(task)] += cost
        usual = took / done
        needed = sum(
            cost * (self._took[kind] + usual * self._first) / (self._done[kind] + self._first)
            for kind, cost in left.items()
        )
        # As many tasks at once as in the time that has passed.
        return (needed + usual * self._later) * self._elapsed / took


def as_completed_chunks(
    function: Callable[[C], R], chunks: Sequence[C], workers: int
) -> Generator[tuple[int, R], None, None]:
    """Yield the index and function(chunk) of each chunk as it is done, computed by `workers` other processes.

    Closing the generator early, as any error does, ends the workers at once. Raises as `map_chunks` does.

    Each worker has a pipe to this thread, and no two share a lock or a queue, so a worker that dies affects no other.
    ProcessPoolExecutor watches its workers from a thread. On CPython 3.11 that thread tears its queues down when one
    dies while others are being started, as happens on a loaded machine, and the caller sees a closed handle instead.
    """
    luggage = outside()
    team: dict[Connection, SpawnProcess] = {}
    busy: dict[Connection, int] = {}
    waiting = iter(enumerate(chunks))

    def occupy(pipe: Connection) -> None:
        for index, chunk in islice(waiting, 1):
            busy[pipe] = index
            with _broken_pipes_are_errors():
                _unless_dead(pipe.send, (function, chunk))

    try:
        script = nullcontext() if _needs_script(function, chunks, luggage) else _without_script()
        with _STARTING, _inherited_by_workers(), script:
            for _ in range(min(workers, len(chunks))):
                ours, worker = _started(luggage)
                team[ours] = worker
        for pipe in team:
            occupy(pipe)
        while busy:
            ready: list[Any] = wait(list(busy))
            for pipe in ready:
                failed, result = _unless_dead(pipe.recv)
                if failed:
                    raise result
                index = busy.pop(pipe)
                # Before the caller spends time on the result.
                occupy(pipe)
                yield index, result
    except BaseException:
        for worker in team.values():
            worker.terminate()
        raise
    finally:
        for pipe in team:
            pipe.close()
        for worker in team.values():
            worker.join()


class Worker:
    """One process that is kept for further calls, with all that they leave in its memory."""

    def __init__(self) -> None:
        with _STARTING, _inherited_by_workers(), _without_script():
            self._pipe, self._process = _started(outside(), daemon=True)

    def __call__(self, function: Callable[[C], R], chunk: C) -> R:
        """Return function(chunk); raises what it raises, and MarkergenError if the process ends."""
        with _broken_pipes_are_errors():
            _unless_dead(self._pipe.send, (function, chunk))
        failed, result = _unless_dead(self._pipe.recv)
        if failed:
            raise result
        return result

    def end(self) -> None:
        """End the process at once, whatever it is doing."""
        self._process.terminate()
        self._process.join()


def _started(luggage: Luggage, daemon: bool = False) -> tuple[Connection, SpawnProcess]:
    """Start a worker, a daemon if it is to end with this process; return our end of its pipe, too."""
    _opencv_imported()

    # A fresh interpreter, because fork would copy locks that threads of BLAS and OpenCV may hold at that moment.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    worker = context.Process(target=_work, args=(theirs, luggage), daemon=daemon)
    worker.start()
    # Now only the worker holds that end, so ours reports its death.
    theirs.close()
    return ours, worker


def _opencv_imported() -> None:
    """Import OpenCV, or wait until another thread has.

    Workers inherit sys.path, which meanwhile begins with a folder that has a ``typing``. ``import cv2`` alone does not
    wait for another thread's: before OpenCV has put sys.path right, it puts a module that is complete, its binary part,
    into sys.modules.
    """
    import cv2  # noqa: F401

    for _ in range(IMPORTING_MS):  # Its flag stays if that import failed.
        if not hasattr(sys, "OpenCV_LOADER"):
            break
        sleep(0.001)


@contextmanager
def _inherited_by_workers() -> Iterator[None]:
    """Start processes with one BLAS thread each and with Ctrl-C blocked: the parent handles it.

    BLAS reads its variables when numpy is imported, which in a worker happens before any of our code runs. Unlike an
    ignored signal, a blocked one still reaches the parent afterwards.
    """
    before = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    can_block = hasattr(signal, "pthread_sigmask")
    if can_block:
        # Starting it unblocks the signal (Python 3.11), which would be between here and the first worker.
        resource_tracker.ensure_running()
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


@contextmanager
def _broken_pipes_are_errors() -> Iterator[None]:
    """Survive writing to a dead worker even where a library, such as gmsh, has reset SIGPIPE."""
    if not hasattr(signal, "sigtimedwait"):
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGPIPE})
    try:
        yield
    finally:
        if signal.SIGPIPE not in mask and signal.SIGPIPE in signal.sigpending():
            signal.sigtimedwait({signal.SIGPIPE}, 0)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _needs_script(*sent: object) -> bool:
    """Return whether anything sent to workers is defined in the running script, so that they have to import it."""
    try:
        return b"__main__" in pickle.dumps(sent)
    except Exception:  # Objects that cannot be pickled are reported when they are sent.
        return True


@contextmanager
def _without_script() -> Iterator[None]:
    """Start processes that do not import the running script, which would repeat all of its work in each of them.

    A script then needs no ``if __name__ == "__main__":``. `multiprocessing` detects a script by the spec or file of
    `__main__`.
    """
    script = sys.modules["__main__"].__dict__
    before: dict[str, Any] = {name: script.pop(name) for name in ("__spec__", "__file__") if name in script}
    script["__spec__"] = None
    try:
        yield
    finally:
        script.pop("__spec__")
        script.update(before)


def _unless_dead(talk: Callable[..., Any], *arguments: Any) -> Any:
    """Send to or receive from a worker; raises MarkergenError if it has died."""
    try:
        return talk(*arguments)
    except (EOFError, OSError) as error:
        raise MarkergenError(
            "expected worker processes that stay alive, found one that ended early; use one worker, or put a"
            ' script\'s entry under if __name__ == "__main__"'
        ) from error


def _work(pipe: Connection, luggage: Luggage) -> None:
    """Answer every (function, chunk) with (False, result) or (True, error), until the parent closes the pipe."""
    import cv2

    receive(luggage)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            order = pipe.recv_bytes()
            try:
                # A chunk or result that cannot be unpickled or sent is an error of the chunk, too.
                function, chunk = pickle.loads(order)
                answer = pickle.dumps((False, function(chunk)))
            except BaseException as error:
                answer = _packed(error)
            pipe.send_bytes(answer)


def _packed(error: BaseException) -> bytes:
    """Pickle an answer with an error and its traceback, or only with its message if it cannot be pickled."""
    text = "".join(format_exception(error))
    error.add_note(f"In a worker process:\n{text}")
    try:
        answer = pickle.dumps((True, error))
        pickle.loads(answer)
    except Exception:
        return pickle.dumps((True, RuntimeError(text)))
    return answer


def _end_with_parent() -> None:
    """End this worker if its parent is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
