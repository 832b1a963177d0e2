"""Who may ask the studio, and how it answers what it cannot use."""

import re
import socket
import subprocess
import sys

import pytest

from markergen.errors import OutputError
from markergen.guard import KINDS, Limits
from markergen.studio.server import _listening, studio_app

from .conftest import TOKEN


def test_the_page_and_its_files_are_served(studio):
    page = studio.get("")
    assert page.status == 200
    assert page.headers["content-type"].startswith("text/html")
    dome = studio.get("static/dome.js")
    assert (dome.status, b"dome" in dome.data) == (200, True)
    # Browsers run no script that calls itself something else.
    assert dome.headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize(
    "path", ["/", "/options", "/nottoken/", "/nottoken/options", f"/{TOKEN}x/", f"//{TOKEN}/", "/static/dome.js", "*"]
)
def test_without_the_token_there_is_nothing(studio, path):
    assert studio.ask("GET", path).status == 404


@pytest.mark.parametrize(
    "path", ["static/../server.py", "static/%2e%2e/server.py", "static//etc/passwd", "static/..%5c"]
)
def test_no_other_files_are_served(studio, path):
    assert studio.get(path).status == 404


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "[::1]:{port}", ""]
)
def test_a_name_that_leads_here_is_refused(studio, host):
    """As a site would use that has its name resolve to 127.0.0.1."""
    assert studio.get("options", Host=host.format(port=studio.port)).status == 403


def test_both_own_names_are_let_in(studio):
    for name in ("127.0.0.1", "localhost"):
        ours = f"{name}:{studio.port}"
        assert studio.get("options", Host=ours, Origin=f"http://{ours}").status == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1"])
def test_a_foreign_origin_is_refused_even_with_the_token(studio, options, origin):
    foreign = origin.format(port=studio.port)
    assert studio.post("words", {"options": options}, Origin=foreign).status == 403


def test_every_answer_forbids_what_is_not_our_own(studio):
    answers = [studio.get(""), studio.get("options"), studio.get("nothing"), studio.get("static/dome.js")]
    answers += [studio.ask("GET", "/"), studio.post("view", b"["), studio.get("options", Origin="http://evil.example")]
    for answer in answers:
        policy = dict(part.strip().split(" ", 1) for part in answer.headers["content-security-policy"].split(";"))
        assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
        assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"


@pytest.mark.parametrize("name", ["look", "more", "words", "view", "export", "scene", "optimize", "rig", "region"])
@pytest.mark.parametrize("body", [b"", b"[]", b"{", b'{"options": 5}', b"[" * 100_000, b"\xff"])
def test_what_is_no_request_is_told_in_one_line(studio, name, body):
    answer = studio.post(name, body)
    assert answer.status == 422
    message = answer.json
    assert message["line"] == f"expected {message['expected']}, found {message['found']}; {message['remedy']}"
    assert "\n" not in message["line"]


def test_a_request_has_a_size_limit(studio, monkeypatch):
    small = Limits("a request", 1000, "in a test", "reload the page")
    monkeypatch.setitem(KINDS, "request", small)
    monkeypatch.setitem(KINDS, "upload", small)
    for name in ("words", "open", "detect"):
        answer = studio.post(name, b" " * 1001)
        assert answer.status == 422
        assert "at most 1 kB" in answer.json["line"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("camera", "/etc/passwd"),
        ("camera_covariance", "sigma.txt"),
        ("boundary", "plate.svg"),
        ("keep_out", ["circle:3mm@40mm,0mm", "plate.dxf#HOLES"]),
        ("keep_outs", ["plate.dxf"]),
        ("outline", "plate.dxf"),
        ("substrate", {"outline": "plate.dxf"}),
        ("poses", "flights.csv"),
        ("points", "dots.csv"),
        ("template", "desk-a4"),
        ("output", "/tmp/marker.pdf"),
        ("trace", ["trace.csv"]),
        ("coverage", "seen.svg"),
    ],
)
def test_a_shared_address_names_no_files(studio, options, name, value):
    """Nothing is read or written, whatever the state says."""
    asked = {"options": {**options, name: value}}
    for request in ("export", "view", "look", "more", "words", "scene", "optimize", "region"):
        answer = studio.post(request, {**asked, "suffix": ".json", "move": {"index": 0, "by": [0, 0]}})
        assert answer.status == 422, request
        assert re.search("in the studio|options of a layout", answer.json["line"]), request


def test_what_should_not_happen_is_told_as_such(studio, monkeypatch, caplog):
    def broken(request):
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr("markergen.studio.server.view", broken)
    answer = studio.post("view", {})
    assert answer.status == 500
    assert answer.json["line"].startswith("this should not happen: ZeroDivisionError: ")
    assert "Traceback" in caplog.text


def test_a_request_that_breaks_off_is_not_a_failure(studio, caplog):
    with socket.create_connection(("127.0.0.1", studio.port)) as wire:
        host = f"127.0.0.1:{studio.port}"
        wire.sendall(f"POST /{TOKEN}/words HTTP/1.1\r\nHost: {host}\r\nContent-Length: 100\r\n\r\n{{".encode())
    # Whatever the server says of it, it has said before it answers the next one.
    assert studio.post("words", {"options": {}}).status == 200
    assert "in the studio" not in caplog.text


def test_opencv_is_there_before_the_first_request():
    """Requests of a page come together, and one would meet OpenCV half imported by another."""
    script = (
        "import sys, uvicorn\n"
        "from markergen.studio.server import run_server\n"
        "uvicorn.Server.run = lambda self, sockets: print('cv2' in sys.modules)\n"
        "run_server(browser=False)\n"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "True"


def test_the_page_begins_with_a_file(tmp_path, studio, options):
    made = studio.post("export", {"options": {**options, "dot": "0mm"}, "suffix": ".json"}).data
    (tmp_path / "marker.json").write_bytes(made)
    # Opened before anything is served: what cannot be used ends the command.
    studio_app(TOKEN, 1, tmp_path / "marker.json")
    assert studio.get("options").json["file"] is None
    assert studio.get("file").status == 404
    assert studio.post("open", made, X_Name="marker.json").json["options"]["points"] == options["points"]


def test_a_port_that_is_taken_is_told(studio):
    with pytest.raises(OutputError, match=rf"a free port, found --port {studio.port}: .*"):
        _listening(studio.port)


@pytest.mark.parametrize("options", [{"wall": 1}, {"": 1}, {"n": {"a": [1]}}, {"shape": "cube", "sideways": 1}])
def test_words_of_no_options_are_refused(studio, options):
    assert studio.post("words", {"options": options}).status in (200, 422)
    assert studio.post("look", {"options": options}).status == 422
