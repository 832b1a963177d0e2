"""STEP and BREP files read back: what their parts look like from above, by Open CASCADE in a process of its own.

Open CASCADE ends its whole process on some broken files. The one that reads is a plain script (`worker`) that is
started at the first file and kept for the next ones.
"""

import atexit
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from threading import Lock, Timer
from typing import Any

import numpy as np

from markergen.errors import InputError
from markergen.solid.kernel import missing_kernel
from markergen.solid.surface import Ball, Face, Loop, SolidPart

LARGEST = 100_000_000
"""Bytes; a marker of a thousand dots has ten million."""

HUGE = re.compile(rb"'[^']*'|(\d\.?\d*[eE]\+?0*[1-9]\d|\d{12}\.)")
"""Words, and numbers beyond 1e10 between them, with which Open CASCADE never ends."""

PATIENCE, PATIENCE_PER_BYTE, BEGINNING = 10.0, 3e-5, 120.0
"""Seconds that a file may take, and the kernel to be there at all: it never ends with some broken files."""

WORKER = Path(__file__).with_name("worker.py")

_lock = Lock()
_worker: subprocess.Popen[bytes] | None = None
_owner = 0


def read_step(data: bytes, name: str = "the STEP file") -> tuple[SolidPart, ...]:
    """Parts of a STEP file, moved to where its assemblies have them, in mm.

    Raises
    ------
    InputError
        If it is incomplete, has no shapes, or Open CASCADE cannot read it.
    MissingLibraryError
        If the CAD kernel or a system library that it needs is missing.
    """
    # The end may be followed by blanks; what is cut off would be read as far as it goes.
    if not data.lstrip().startswith(b"ISO-10303-21") or b"END-ISO-10303-21" not in data[-1000:]:
        raise InputError(f"a complete STEP file in {name}", "no beginning or end of one", "export it again")
    if any(match[1] for match in HUGE.finditer(data)):
        raise InputError(f"lengths below 10 000 km in {name}", "numbers beyond 1e10", "export it again")
    return _read(b"step", data, name, "STEP")


def read_brep(data: bytes, name: str = "the BREP file") -> tuple[SolidPart, ...]:
    """Parts of a BREP file of Open CASCADE, in mm; they have neither names nor colors. Raises as `read_step` does."""
    if b"CASCADE Topology" not in data[:1000]:
        raise InputError(f"a BREP file of Open CASCADE in {name}", "something else", "export it again")
    return _read(b"brep", data, name, "BREP")


def _read(kind: bytes, data: bytes, name: str, called: str) -> tuple[SolidPart, ...]:
    if len(data) > LARGEST:
        raise InputError(f"a file of at most {LARGEST // 10**6} MB in {name}", "a larger one", "check the path")
    with _lock:
        reply = _ask(kind, data)
    if reply is None:
        raise InputError(f"a {called} file that Open CASCADE reads in {name}", "one that breaks it", "export it again")
    if "error" in reply:
        raise InputError(f"a {called} file that Open CASCADE reads in {name}", reply["error"], "export it again")
    parts = tuple(_part(each) for each in reply["parts"])
    if not parts:
        raise InputError(f"shapes in {name}", "none", "export it again")
    return parts


def _ask(kind: bytes, data: bytes) -> dict[str, Any] | None:
    """What the worker replies; None if it broke or took too long."""
    worker = _running()
    assert worker.stdin is not None
    try:
        worker.stdin.write(kind + len(data).to_bytes(8, "big") + data)
        worker.stdin.flush()
    except OSError:
        _end()
        return None
    return _reply(worker, PATIENCE + PATIENCE_PER_BYTE * len(data))


def _reply(worker: subprocess.Popen[bytes], patience: float) -> dict[str, Any] | None:
    assert worker.stdout is not None
    timer = Timer(patience, worker.kill)
    timer.start()
    try:
        size = worker.stdout.read(8)
        found: dict[str, Any] = json.loads(worker.stdout.read(int.from_bytes(size, "big")))
    except (OSError, ValueError):
        _end()
        return None
    finally:
        timer.cancel()
        timer.join()
    return found


def _running() -> subprocess.Popen[bytes]:
    """The worker, started if need be; raises MissingLibraryError if it has no kernel."""
    global _worker, _owner
    # After a fork the pipes are the parent's.
    if _worker is not None and _owner == os.getpid():
        if _worker.poll() is None:
            return _worker
        _end()
    # -P: the script's folder has modules of the same names as those of libraries.
    _worker = subprocess.Popen(
        [sys.executable, "-P", str(WORKER)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    _owner = os.getpid()
    worker, hello = _worker, _reply(_worker, BEGINNING)
    if hello is None or "missing" in hello:
        found = hello["missing"] if hello else "a kernel that does not start"
        _end()
        raise missing_kernel("reading solids needs", found)
    return worker


@atexit.register
def _end() -> None:
    """Let the worker go."""
    global _worker
    worker, _worker = _worker, None
    if worker is None or _owner != os.getpid():
        return
    # It has no work that is worth waiting for.
    worker.kill()
    for pipe in (worker.stdin, worker.stdout):
        try:
            if pipe is not None:
                pipe.close()
        except OSError:
            pass
    worker.wait()


def _part(each: dict[str, Any]) -> SolidPart:
    def loop(found: dict[str, Any]) -> Loop:
        circle = found["circle"]
        return Loop(np.array(found["points"], dtype=float).reshape(-1, 2), tuple(circle) if circle else None)

    def color(found: list[float] | None) -> tuple[float, float, float] | None:
        return (found[0], found[1], found[2]) if found else None

    faces = []
    for face in each["faces"]:
        loops = sorted((loop(found) for found in face["loops"]), key=lambda found: -found.area)
        if loops and np.isfinite([face["z"], *(found.area for found in loops)]).all():
            faces.append(Face(face["z"], tuple(loops), color(face["color"])))
    balls = tuple(Ball(**{**ball, "color": color(ball["color"])}) for ball in each["balls"])
    low, high = each["low"], each["high"]
    return SolidPart(
        each["name"], color(each["color"]), each["volume"], each["valid"], each["closed"],
        (low[0], low[1], low[2]), (high[0], high[1], high[2]), tuple(faces), balls,
    )  # fmt: skip
