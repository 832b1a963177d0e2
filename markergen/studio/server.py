"""The studio's server: requests of its page, and of nobody else on or beyond this computer."""

import json
import mimetypes
import secrets
import socket
import webbrowser
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from functools import partial
from importlib.resources import files
from pathlib import Path
from threading import Thread
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

from markergen.errors import InputError, MarkergenError, OutputError
from markergen.guard import KINDS, read
from markergen.presentation.results import plain as as_json
from markergen.studio.look import look, more
from markergen.studio.opening import opened
from markergen.studio.regions import place_in, with_region
from markergen.studio.showing import detected, exported, parsed_request, scene, table_in, view
from markergen.studio.state import declared_options, plain, words
from markergen.studio.work import Job, Latest, design_rig, failure, optimize, streamed

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
                own = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                kept = [each for each in message["headers"] if each[0].decode().lower() not in HEADERS]
                message = {**message, "headers": [*kept, *own]}
            await send(message)

        status = self._refused(scope)
        app = self._app if status is None else Response("not found" if status == 404 else "refused", status)
        await app(scope, receive, with_headers)

    def _refused(self, scope: Scope) -> int | None:
        """Return the status of a refusal."""
        given = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"]]
        host = [value for name, value in given if name == "host"]
        origins = [value for name, value in given if name == "origin"]
        if len(host) != 1 or host[0] not in self._hosts or any(each != f"http://{host[0]}" for each in origins):
            return 403
        token = scope["path"].split("/")[1:2]
        known = bool(token) and secrets.compare_digest(token[0].encode(), self._token.encode())
        return None if known else 404


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
        opened(file.name, begin)
    here, shared = files("markergen.studio").joinpath("static"), files("markergen.presentation")
    known: Mapping[str, Answer] = {
        "look": lambda asked: look(asked.get("options")),
        # What cannot be used is refused here, at once.
        "more": lambda asked: MORE(plain(asked.get("options")), str(asked.get("page", ""))),
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
        *(Route(f"/{name}", _answering(answer), methods=["POST"]) for name, answer in known.items()),
        Route("/view", _refusing(_view), methods=["POST"]),
        Route("/export", _refusing(_export), methods=["POST"]),
        Route("/open", _refusing(_open), methods=["POST"]),
        Route("/detect", _refusing(_detect), methods=["POST"]),
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


async def aside(function: Callable[..., Any], *given: Any) -> Any:
    """Return what a function returns, computed in a thread; whoever ends the server does not wait for it."""
    return await to_thread.run_sync(partial(function, *given), abandon_on_cancel=True)


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
    return _json(await aside(opened, _name(request), await body(request, "upload"), unit, layer, origin))


async def _detect(request: Request) -> Response:
    # What to look for, as JSON in one line, comes before the photograph.
    asked, _, photo = (await body(request, "upload")).partition(b"\n")
    return _json(await aside(detected, parsed_request(asked), _name(request), photo))


async def _optimize(request: Request) -> Response:
    options = plain(parsed_request(await body(request, "request")).get("options"))
    return _streaming(lambda tell: optimize(options, tell))


async def _rig(request: Request) -> Response:
    asked = parsed_request(await body(request, "request"))
    options = table_in(asked, "options")
    return _streaming(lambda tell: design_rig(asked.get("shape"), options, tell))


def _streaming(job: Job) -> Response:
    return StreamingResponse(streamed(job), media_type="application/x-ndjson")


def serve(file: Path | None = None, port: int | None = None, browser: bool = True) -> None:
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
        print(f"server at {address}; Ctrl-C ends it", flush=True)
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
