"""``markergen studio`` as it is started and ended."""

import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest

from markergen.cli import main


@contextmanager
def ended(process):
    """A process that does not outlive a test that fails."""
    try:
        yield
    except BaseException:
        process.kill()
        raise


def test_it_says_where_it_serves_and_ends_with_ctrl_c(tmp_path):
    (tmp_path / "mine.toml").write_text('title = "Mine"\nn = 6\n')
    command = [sys.executable, "-m", "markergen", "studio", "mine.toml", "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, cwd=tmp_path) as process, ended(process):
        line = process.stdout.readline()
        address = line.rpartition(" ")[2].strip()
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(f"{address}options", timeout=30) as answer:
            assert b'"file":"mine.toml"' in answer.read()
        with urllib.request.urlopen(f"{address}file", timeout=30) as answer:
            assert answer.read() == (tmp_path / "mine.toml").read_bytes()
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(address.rsplit("/", 2)[0] + "/", timeout=30)
        # While a search is going on that would take many times as long.
        search = urllib.request.Request(f"{address}optimize", b'{"options": {"n": 40}}')
        with urllib.request.urlopen(search, timeout=30) as answer:
            assert b'"stage": "regular"' in answer.readline()
            process.send_signal(signal.SIGINT)
            message, complaint = process.communicate(timeout=30)
    assert (process.returncode, message, complaint) == (0, "", "")


def test_what_cannot_be_served_is_told_in_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.json").write_text("")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        for arguments, phrase in (
            (["--port", str(port)], f"--port {port}"),
            (["--port", "70000"], "--port"),
            (["missing.json"], "missing.json"),
            (["empty.json"], "empty.json"),
        ):
            assert main(["studio", "--no-browser", *arguments]) == 2
            output = capsys.readouterr()
            assert output.out == ""
            assert len(output.err.splitlines()) == 1
            assert phrase in output.err


@pytest.mark.parametrize("name", ["starlette", "uvicorn"])
def test_without_the_extra_it_says_what_to_install(capsys, monkeypatch, name):
    monkeypatch.delattr("markergen.studio.server", raising=False)
    monkeypatch.delitem(sys.modules, "markergen.studio.server", raising=False)
    monkeypatch.setattr("socket.socket.listen", None)  # Nothing is served if it is not told.
    for module in [item for item in sys.modules if item.partition(".")[0] == name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    assert main(["studio", "--no-browser"]) == 2
    message = capsys.readouterr().err
    assert "pip install ./detector '.[studio]'" in message
    assert len(message.splitlines()) == 1
