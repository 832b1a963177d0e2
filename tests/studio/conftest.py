"""A studio that is served for real, and what talks to it as a page would."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection, HTTPResponse
from typing import NamedTuple

import pytest
import uvicorn

from markergen.studio.server import _listening, studio_app

TOKEN = "token"


class Answer(NamedTuple):
    status: int
    headers: dict[str, str]
    data: bytes

    @property
    def json(self):
        return json.loads(self.data)

    @property
    def lines(self):
        return [json.loads(line) for line in self.data.splitlines()]


class Studio:
    def __init__(self, port: int) -> None:
        self.port = port

    @contextmanager
    def connect(self, method: str, path: str, body: bytes | None = None, **headers: str) -> Iterator[HTTPResponse]:
        """The answer while it is still coming."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
            with connection.getresponse() as response:
                yield response
        finally:
            connection.close()

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> Answer:
        with self.connect(method, path, body, **headers) as response:
            return Answer(response.status, dict(map(_lower, response.getheaders())), response.read())

    def get(self, name: str, **headers: str) -> Answer:
        return self.ask("GET", f"/{TOKEN}/{name}", **headers)

    def post(self, name: str, body: object = None, **headers: str) -> Answer:
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        return self.ask("POST", f"/{TOKEN}/{name}", data, **headers)


def _lower(pair):
    return pair[0].lower(), pair[1]


@pytest.fixture(scope="package")
def studio() -> Iterator[Studio]:
    with _listening(None) as sock:
        port = sock.getsockname()[1]
        settings = uvicorn.Config(studio_app(TOKEN, port), log_level="warning", lifespan="off", ws="none")
        server = uvicorn.Server(settings)
        thread = threading.Thread(target=server.run, args=([sock],), daemon=True)
        thread.start()
        yield Studio(port)
        server.should_exit = True
        thread.join(10)
        assert not thread.is_alive()


@pytest.fixture
def options():
    """A state whose numbers take no time."""
    points = [[0.0, 0.1], [-0.095, 0.031], [-0.02, -0.1], [0.09, -0.03]]
    return {"radius": "150mm", "dot": "30mm", "points": points, "poses": "cone:count=3"}
