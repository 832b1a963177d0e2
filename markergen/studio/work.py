"""Work of seconds to minutes: done in a thread, told in lines of JSON as it goes, and stopped by its listener."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from threading import Condition, Event, Thread
from time import monotonic
from typing import Any

from markergen.api.design import design
from markergen.api.rig import rig
from markergen.errors import InputError, MarkergenError
from markergen.model.boundary import Circle
from markergen.model.marker_json import to_json
from markergen.model.rig_json import rig_to_json
from markergen.optimize.design import Design
from markergen.pool import Worker
from markergen.presentation.results import plain as as_json
from markergen.studio.state import plain, rig_of

log = logging.getLogger(__name__)

Tell = Callable[[dict[str, Any]], None]
Job = Callable[["Teller"], Mapping[str, Any]]

PAUSE = 0.05
"""Seconds between two lines about the same stage."""


class Stopped(Exception):
    """Nobody listens any more."""


class Teller:
    """Passes lines on, not too many of them, and ends the work by raising `Stopped` once nobody listens."""

    def __init__(self, tell: Tell, stop: Event) -> None:
        self._tell, self._stop = tell, stop
        self._stage, self._done, self._total, self._next = "", 0, 0, 0.0

    def progress(self, stage: str, done: int, total: int) -> None:
        """See `markergen.options.Progress`."""
        self._say(stage, done, total, {})

    def watch(self, stage: str, points: Any, value: float) -> None:
        """See `markergen.options.Watch`; the amount done is that which was told last."""
        del stage
        self._next = 0.0
        self._say(self._stage or "search", self._done, self._total, {"dots": points.tolist(), "value": value})

    def _say(self, stage: str, done: int, total: int, more: dict[str, Any]) -> None:
        if self._stop.is_set():
            raise Stopped
        hurried = stage == self._stage and done < total and monotonic() < self._next
        self._stage, self._done, self._total = stage, done, total
        if not hurried:
            self._next = monotonic() + PAUSE
            self._tell({"stage": stage, "done": done, "total": total, **more})


async def streamed(job: Job) -> AsyncIterator[bytes]:
    """Do a job in a thread, and yield its lines of JSON; the last one is its result, or ``{"error": ...}``.

    Where the iteration ends early, the job is stopped.
    """
    loop, lines, stop = asyncio.get_running_loop(), asyncio.Queue[dict[str, Any] | None](), Event()

    def tell(line: dict[str, Any] | None) -> None:
        # After a stop the loop may be closed.
        if not stop.is_set():
            loop.call_soon_threadsafe(lines.put_nowait, line)

    def work() -> None:
        try:
            tell(dict(job(Teller(tell, stop))))
        except Stopped:
            log.info("stopped")
        except Exception as error:
            tell({"error": failure(error)})
        finally:
            tell(None)

    Thread(target=work, daemon=True).start()
    try:
        while (line := await lines.get()) is not None:
            yield (json.dumps(as_json(line), allow_nan=False) + "\n").encode()
    finally:
        stop.set()


class Latest:
    """A function whose calls are answered by another process, so that this one stays free.

    A call ends an older one of the same page, and waits for one of another page.

    Parameters
    ----------
    function : callable
        Takes and returns JSON values.
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function, self._turn = function, Condition()
        self._worker: Worker | None = None
        self._newest: dict[str, object] = {}
        self._served: str | None = None

    def __call__(self, asked: Any, page: str = "") -> Any:
        """Return what the function returns.

        Raises
        ------
        InputError
            If a newer call of the same page has come meanwhile, or as the function.
        """
        with self._turn:
            mine = self._newest[page] = object()
            if self._served == page and self._worker:
                self._worker.end()
                self._worker = self._served = None
            self._turn.notify_all()
            self._turn.wait_for(lambda: self._served is None or self._newest.get(page) is not mine)
            if self._newest.get(page) is not mine:
                raise InputError(*_OLDER)
            self._served, self._worker = page, self._worker or Worker()
            worker = self._worker
        try:
            return worker(self._function, asked)
        except MarkergenError as error:
            with self._turn:
                newest = worker is self._worker
                if newest and not isinstance(error, InputError):  # It has ended by itself.
                    self._worker = None
                    self._served = None
            if newest:
                raise
            raise InputError(*_OLDER) from None
        finally:
            with self._turn:
                if self._newest.get(page) is mine:
                    del self._newest[page]
                if worker is self._worker:
                    self._served = None
                self._turn.notify_all()

    def end(self) -> None:
        """End the process."""
        with self._turn:
            if self._worker:
                self._worker.end()
            self._worker = self._served = None
            self._turn.notify_all()


_OLDER = ("the newest request", "an older one", "wait for the newer answer")


def failure(error: Exception) -> dict[str, str]:
    """Return what a page shows of an error: what was expected and found, the remedy, and the line of the command."""
    if isinstance(error, InputError):
        expected, found, remedy = error.args
        return {"expected": expected, "found": found, "remedy": remedy, "line": str(error)}
    if isinstance(error, MarkergenError):
        return {"expected": "", "found": "", "remedy": "", "line": str(error)}
    log.error("in the studio", exc_info=error)
    line = f"this should not happen: {type(error).__name__}: {error}; report it with what the terminal shows"
    return {"expected": "", "found": "", "remedy": "", "line": " ".join(line.split())}


def optimize(options: Mapping[str, Any], tell: Teller) -> dict[str, Any]:
    """Design a marker from options without points.

    Returns
    -------
    dict
        ``options`` that give the same marker without a search, or None and ``marker``, a marker.json, if the dots have
        several sizes; ``summary``, ``warnings``, ``outlook``, and ``certificate``: ``sentence`` and ``gap``.
    """
    asked = {name: value for name, value in plain(options).items() if name != "points"}
    found = design(progress=tell.progress, watch=tell.watch, **asked)
    certificate = found.certify(tell.progress)
    one_size = len({point.feature.diameter for point in found.marker.control_points}) == 1
    return {
        "options": settled(asked, found) if one_size else None,
        **({} if one_size else {"marker": json.loads(to_json(found.marker))}),
        "summary": found.summary,
        "warnings": found.warnings,
        "outlook": found.outlook,
        "certificate": {"sentence": certificate.sentence, "gap": None if certificate.reason else certificate.gap},
    }


def settled(options: Mapping[str, Any], found: Design) -> dict[str, Any]:
    """Return the options that give a design again without a search: its points, and what was left open."""
    spec, marker = found.spec, found.marker
    kept = {name: value for name, value in options.items() if name not in ("n", "target")}
    kept["points"] = (marker.xyz if spec.relief else marker.xyz[:, :2]).tolist()
    kept["dot"] = found.dots.diameter
    if options.get("target"):
        kept["objective"] = spec.objective
    if (options.get("radius") == "fit" or options.get("target")) and isinstance(spec.boundary, Circle):
        kept.pop("boundary", None)
        kept["radius"] = spec.boundary.radius
    # Both depend on what was open.
    stored = spec.as_dict()
    return kept | {name: stored[name] for name in ("noise_model", "print_sigma") if name in stored}


def design_rig(shape: object, options: Mapping[str, Any], tell: Teller) -> dict[str, Any]:
    """Design a rig from a shape and its options.

    Returns
    -------
    dict
        ``rig``, a rig.json, ``summary`` and ``warnings``.
    """
    shape, asked = rig_of(shape, options)
    found = rig(shape, progress=tell.progress, **asked)
    return {"rig": json.loads(rig_to_json(found.rig)), "summary": found.summary, "warnings": found.warnings}
