"""The studio's server: requests of its page, and of nobody else on or beyond this computer."""

# tests: tests/studio/test_server.py tests/studio/test_work.py

import asyncio
import json
import logging
import mimetypes
import secrets
import socket
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import suppress
from functools import partial
from importlib.resources import files
from pathlib import Path
from threading import Condition, Event, Thread
from time import monotonic
from typing import Any
from urllib.parse import quote, unquote

import uvicorn
from anyio import to_thread
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from markergen.api.design import design, rig
from markergen.errors import InputError, MarkergenError, OutputError
from markergen.guard import KINDS, read
from markergen.model.body_json import rig_to_json, to_json
from markergen.model.boundary import Circle
from markergen.optimize.design import Design
from markergen.pool import Worker
from markergen.presentation.results import plain as as_json
from markergen.registry import unforeseen
from markergen.studio.look import look, more
from markergen.studio.opening import opened_file
from markergen.studio.photographs import calibrated, detected
from markergen.studio.showing import exported, parsed_request, scene, view
from markergen.studio.state import (
    declared_options,
    place_in,
    plain_options,
    rig_of,
    table_in,
    with_lengths_typed,
    with_region,
    words,
)

HOST = "127.0.0.1"

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
"""Of every answer: the page loads nothing from elsewhere, and no other page loads anything from here."""

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

    def __call__(self, asked: Any, page: str = "", mine: object = None) -> Any:
        """Return what the function returns.

        Raises
        ------
        InputError
            If a newer call of the same page has come meanwhile, this one was given up, or as the function.
        """
        mine = mine or object()
        with self._turn:
            self.give_up(page)
            self._newest[page] = mine
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

    def give_up(self, page: str, call: object = None) -> None:
        """End a page's call, if it is still this one; None for any."""
        with self._turn:
            if call in (None, self._newest.get(page)):
                self._newest.pop(page, None)
                if self._served == page:
                    self._end_worker()
                self._turn.notify_all()

    def end(self) -> None:
        """End the process, and all calls."""
        with self._turn:
            self._newest.clear()
            self._end_worker()
            self._turn.notify_all()

    def _end_worker(self) -> None:
        if self._worker:
            self._worker.end()
        self._worker = self._served = None


_OLDER = ("the newest request", "an older one", "wait for the newer answer")


def failure(error: Exception) -> dict[str, str]:
    """Return what a page shows of an error: what was expected and found, the remedy, and the line of the command."""
    if isinstance(error, InputError):
        expected, value, remedy = error.args
        return {"expected": expected, "found": value, "remedy": remedy, "line": str(error)}
    if isinstance(error, MarkergenError):
        return {"expected": "", "found": "", "remedy": "", "line": str(error)}
    log.error("in the studio", exc_info=error)
    line = unforeseen(error, "report it with what the terminal shows")
    return {"expected": "", "found": "", "remedy": "", "line": " ".join(line.split())}


def optimize(options: Mapping[str, Any], tell: Teller) -> dict[str, Any]:
    """Design a marker from options without points.

    Returns
    -------
    dict
        ``options`` that give the same marker without a search, or None and ``marker``, a marker.json, if the dots have
        several sizes; ``summary``, ``warnings``, ``outlook``, and ``certificate``: ``sentence`` and ``gap``.
    """
    asked = {name: value for name, value in plain_options(options).items() if name != "points"}
    finished = design(progress=tell.progress, watch=tell.watch, **asked).certified(tell.progress)
    certificate = finished.certificate
    one_size = len({point.feature.diameter for point in finished.marker.control_points}) == 1
    return {
        "options": settled_options(asked, finished) if one_size else None,
        **({} if one_size else {"marker": json.loads(to_json(finished.marker))}),
        "summary": finished.summary,
        "warnings": finished.warnings,
        "outlook": finished.outlook,
        "certificate": {"sentence": certificate.sentence, "gap": None if certificate.reason else certificate.gap},
    }


def settled_options(options: Mapping[str, Any], finished: Design) -> dict[str, Any]:
    """Return the options that give a design again without a search: its points, and what was left open."""
    spec, marker = finished.spec, finished.marker
    kept = {name: value for name, value in options.items() if name not in ("n", "target")}
    kept["points"] = (marker.xyz if spec.relief else marker.xyz[:, :2]).tolist()
    kept["dot"] = finished.dots.diameter
    if options.get("target"):
        kept["objective"] = spec.objective
    if (options.get("radius") == "fit" or options.get("target")) and isinstance(spec.boundary, Circle):
        kept.pop("boundary", None)
        kept["radius"] = spec.boundary.radius
    # Both depend on what was open.
    stored = spec.as_dict()
    return with_lengths_typed(kept | {name: stored[name] for name in ("noise_model", "print_sigma") if name in stored})


def rig_result(shape: object, options: Mapping[str, Any], tell: Teller) -> dict[str, Any]:
    """Design a rig from a shape and its options.

    Returns
    -------
    dict
        ``rig``, a rig.json, ``summary`` and ``warnings``.
    """
    shape, asked = rig_of(shape, options)
    finished = rig(shape, progress=tell.progress, **asked).certified(tell.progress)
    return {"rig": json.loads(rig_to_json(finished.rig)), "summary": finished.summary, "warnings": finished.warnings}


MORE = Latest(more)
"""What takes seconds."""

Answer = Callable[[dict[str, Any]], Any]


class Gate:
    """Lets in what comes from the page itself: by its token, addressed to this computer, from no other site.

    A page elsewhere could else have a browser on this computer ask for it: by a name that leads to 127.0.0.1, which the
    header Host tells, or by a request across sites, which Origin tells.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] != "http":
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                fixed = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                kept = [header for header in message["headers"] if header[0].decode().lower() not in HEADERS]
                message = {**message, "headers": [*kept, *fixed]}
            await send(message)

        status = self._refused(scope)
        app = self._app if status is None else Response("not found" if status == 404 else "refused", status)
        await app(scope, receive, with_headers)

    def _refused(self, scope: Scope) -> int | None:
        """Return the status of a refusal."""
        headers = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"]]
        host = [value for name, value in headers if name == "host"]
        origins = [value for name, value in headers if name == "origin"]
        if len(host) != 1 or host[0] not in self._hosts or any(origin != f"http://{host[0]}" for origin in origins):
            return 403
        token = scope["path"].split("/")[1:2]
        is_ours = bool(token) and secrets.compare_digest(token[0].encode(), self._token.encode())
        return None if is_ours else 404


def studio_app(token: str, port: int, file: Path | None = None) -> ASGIApp:
    """Make the application that answers under ``/<token>/`` at a port.

    Parameters
    ----------
    file : Path or None
        File that the page begins with, as if it were opened there; read and checked now.

    Raises
    ------
    InputError
        If the file cannot be opened.
    """
    # Some systems call JavaScript plain text, which browsers then refuse to run.
    mimetypes.add_type("text/javascript", ".js")
    begin = None if file is None else read(file, "upload").data
    if file is not None and begin is not None:
        opened_file(file.name, begin)
    here, shared = files("markergen.studio").joinpath("static"), files("markergen.presentation")
    answers: Mapping[str, Answer] = {
        "look": lambda asked: look(asked.get("options")),
        "words": lambda asked: words(asked.get("options")),
        "scene": scene,
        "region": with_region,
    }

    async def page(request: Request) -> Response:
        del request
        return FileResponse(str(here.joinpath("index.html")))

    async def dome(request: Request) -> Response:
        del request
        return FileResponse(str(shared.joinpath("dome.js")))

    async def options(request: Request) -> Response:
        del request
        return _json({**await aside(declared_options), "file": None if file is None else file.name})

    async def first(request: Request) -> Response:
        del request
        return Response(begin, 200 if begin is not None else 404, media_type="application/octet-stream")

    routes = [
        Route("/", page),
        Route("/options", options),
        Route("/file", first),
        *(Route(f"/{name}", _answering(answer), methods=["POST"]) for name, answer in answers.items()),
        Route("/more", _refusing(_more), methods=["POST"]),
        Route("/view", _refusing(_view), methods=["POST"]),
        Route("/export", _refusing(_export), methods=["POST"]),
        Route("/open", _refusing(_open), methods=["POST"]),
        Route("/detect", _refusing(_detect), methods=["POST"]),
        Route("/calibrate", _refusing(_calibrate), methods=["POST"]),
        Route("/optimize", _refusing(_optimize), methods=["POST"]),
        Route("/rig", _refusing(_rig), methods=["POST"]),
        Route("/static/dome.js", dome),
        Mount("/static", StaticFiles(directory=str(here))),
    ]
    return Gate(Starlette(routes=[Mount(f"/{token}", routes=routes)]), token, port)


async def body(request: Request, kind: str) -> bytes:
    """Return the body of a request, up to the size limit of its kind in `guard.KINDS`; raises InputError."""
    limits, data = KINDS[kind], bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > limits.largest:
            raise InputError(f"{limits.name} of at most {limits.size}", "a larger one", limits.smaller)
    return bytes(data)


async def aside(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns, computed in a thread; whoever ends the server does not wait for it."""
    return await to_thread.run_sync(partial(function, *arguments), abandon_on_cancel=True)


Handler = Callable[[Request], Awaitable[Response]]


def _refusing(handler: Handler) -> Handler:
    """Return a handler that answers errors as the page shows them: status 422, or 500 for what should not happen."""

    async def handle(request: Request) -> Response:
        try:
            return await handler(request)
        except ClientDisconnect:  # In the middle of its request: nobody reads the answer.
            return Response(status_code=400)
        except Exception as error:
            return _json(failure(error), 422 if isinstance(error, MarkergenError) else 500)

    return handle


def _answering(answer: Answer) -> Handler:
    async def handle(request: Request) -> Response:
        return _json(await aside(answer, parsed_request(await body(request, "request"))))

    return _refusing(handle)


def _json(value: Any, status: int = 200) -> Response:
    try:
        text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    except (TypeError, ValueError):
        text = json.dumps(as_json(value), allow_nan=False, separators=(",", ":"))
    return Response(text, status, media_type="application/json")


def _name(request: Request) -> str:
    """Name of an uploaded file, percent-encoded in a header, which has no other letters than those of English."""
    return unquote(request.headers.get("x-name", "")) or "file"


async def _more(request: Request) -> Response:
    asked = parsed_request(await body(request, "request"))
    # What cannot be used is refused here, at once.
    options, page, call = plain_options(asked.get("options")), str(asked.get("page", "")), object()

    async def given_up() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        await aside(MORE.give_up, page, call)

    watching = asyncio.create_task(given_up())
    try:
        return _json(await aside(MORE, options, page, call))
    finally:
        watching.cancel()


async def _view(request: Request) -> Response:
    png, dots = await aside(view, parsed_request(await body(request, "request")))
    return Response(png, media_type="image/png", headers={"X-Dots": json.dumps(as_json(dots.round(2).tolist()))})


async def _export(request: Request) -> Response:
    file = await aside(exported, parsed_request(await body(request, "request")))
    kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    disposition = f"attachment; filename*=UTF-8''{quote(Path(file.name).name)}"
    return Response(file.data, media_type=kind, headers={"Content-Disposition": disposition})


async def _open(request: Request) -> Response:
    unit, layer = (unquote(request.headers.get(name, "")) or None for name in ("x-unit", "x-layer"))
    origin = place_in(request.headers.get("x-origin", "0,0").split(","))
    return _json(await aside(opened_file, _name(request), await body(request, "upload"), unit, layer, origin))


async def _detect(request: Request) -> Response:
    # What to look for, as JSON in one line, comes before the photograph.
    asked, _, photo = (await body(request, "upload")).partition(b"\n")
    return _json(await aside(detected, parsed_request(asked), _name(request), photo))


async def _calibrate(request: Request) -> Response:
    # As with one photograph; all of them come one after the other.
    asked, _, photographs = (await body(request, "photographs")).partition(b"\n")
    wanted = parsed_request(asked)
    return _streaming(lambda tell: calibrated(wanted, photographs, tell.progress))


async def _optimize(request: Request) -> Response:
    options = plain_options(parsed_request(await body(request, "request")).get("options"))
    return _streaming(lambda tell: optimize(options, tell))


async def _rig(request: Request) -> Response:
    asked = parsed_request(await body(request, "request"))
    options = table_in(asked, "options")
    return _streaming(lambda tell: rig_result(asked.get("shape"), options, tell))


def _streaming(job: Job) -> Response:
    return StreamingResponse(streamed(job), media_type="application/x-ndjson")


def run_server(file: Path | None = None, port: int | None = None, browser: bool = True) -> None:
    """Serve the studio until Ctrl-C, and say where.

    Parameters
    ----------
    file : Path or None
        marker.json, rig.json or another file to begin with.
    port : int or None
        None takes a free one.
    browser : bool
        Open the page in the browser.

    Raises
    ------
    InputError
        If the file cannot be opened.
    OutputError
        If the port is not free.
    """
    # The first requests of a page come together; none of them should meet OpenCV half imported by another.
    import cv2  # noqa: F401

    with _listening(port) as sock:
        place = sock.getsockname()[1]
        token = secrets.token_urlsafe(16)
        app = studio_app(token, place, file)
        address = f"http://{HOST}:{place}/{token}/"
        print(f"Ctrl-C ends the server at {address}", flush=True)
        if browser:
            # Some browsers keep whoever opens them waiting.
            Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        settings = uvicorn.Config(
            app, log_level="critical", access_log=False, lifespan="off", ws="none", server_header=False,
            timeout_graceful_shutdown=1,
        )  # fmt: skip
        # Ctrl-C, with which uvicorn ends, is how this ends.
        with suppress(KeyboardInterrupt):
            uvicorn.Server(settings).run(sockets=[sock])
        MORE.end()


def _listening(port: int | None) -> socket.socket:
    # Named, or asyncio does not send at once, and every answer waits 40 ms for the acknowledgment of its header.
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    if hasattr(socket, "SO_REUSEADDR"):
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((HOST, port or 0))
        sock.listen()
    except (OSError, OverflowError) as error:
        sock.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(
            f"expected a free port, found --port {port}: {reason}; choose another one, or leave it out"
        ) from None
    return sock
