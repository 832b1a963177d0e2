"""Open CASCADE, the CAD kernel, through OCP, its bindings for Python: imported once, and only where solids need it."""
# tests: tests/exporters/test_save.py tests/verification/test_solid_readers.py

import gc
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import FrameType

from markergen.errors import MissingLibraryError, install


def import_kernel() -> None:
    """Import Open CASCADE; raises MissingLibraryError with what is missing and how to install it.

    Ctrl-C takes effect after the import: its modules are a single library, which can be initialized only once, and
    report an interrupted initialization as an ImportError.
    """
    try:
        if sys.modules.get("OCP") is None:
            with _interrupted_later(), _uncollected():
                import_module("OCP")
        # Its bindings of Open CASCADE 8 name functions in another way.
        if (version := getattr(sys.modules["OCP"], "__version__", "7")).startswith("8."):
            raise ImportError(f"version {version} instead of 7")
    except ImportError as error:
        raise missing_kernel("solids need", " ".join(str(error).split())) from None


@contextmanager
def _uncollected() -> Iterator[None]:
    """Turn garbage collection off: it would visit the kernel's 200,000 objects 300 times while they are made."""
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()


@contextmanager
def _interrupted_later() -> Iterator[None]:
    """Handle Ctrl-C when the block ends; only the main thread receives it."""
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    waiting: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: waiting.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if waiting:
            handler(*waiting[0])


def missing_kernel(need: str, actual: str) -> MissingLibraryError:
    """Return the error with what needs Open CASCADE, what was found, and what to install."""
    return MissingLibraryError(
        f"{need} Open CASCADE 7 (cadquery, or its kernel alone) with the system's libGL and libX11, found: {actual}; "
        f"install them with: {install('step')} && apt-get install libgl1 libx11-6"
    )
