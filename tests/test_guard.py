"""Files that strangers send: read within limits, parsed in processes that may break, refused in one line."""

import io
import os
import time
from dataclasses import replace

import pytest

from markergen import guard
from markergen.errors import InputError, MissingLibraryError
from markergen.guard import KINDS, Content, in_child, read, text_of

PARSER = """
import os
import time

import numpy as np

from markergen.errors import InputError


def count(data):
    return {"bytes": len(data)}, {"values": np.frombuffer(data, np.uint8)}


def refuse(data):
    raise InputError("a file of zeros", "ones", "write zeros")


def fail(data):
    raise OSError("of two\\nlines")


def fill(data):
    return {"sum": int(np.ones(1 << 32, np.uint8).sum())}


def crash(data):
    os._exit(1)


def hang(data):
    time.sleep(100)


def compute(data):
    while True:
        pass


def nap(data):
    time.sleep(0.5)
    return {}
"""
SOME = Content("a.bin", bytes(range(100)))


def test_every_kind_has_limits_and_a_reason():
    for kind in KINDS.values():
        assert kind.name.split()[0] in ("a", "an")
        assert kind.why
        assert kind.largest > 0 < kind.memory
        assert kind.seconds > 0
    assert [KINDS[name].size for name in ("camera", "spec", "image")] == ["1 MB", "10 kB", "1 GiB"]


def test_paths_and_open_files_are_read(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("K: 1")
    assert read(path, "camera") == read(str(path), "camera") == Content(str(path), b"K: 1")
    assert read(io.BytesIO(b"\xef\xbb\xbfK: 1"), "camera").name == "the open file"
    assert text_of(read(io.StringIO("K: \u00fc"), "camera")) == "K: \u00fc"
    assert text_of(Content("a", b"\xef\xbb\xbfK")) == "K"


def test_what_is_no_file_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(KINDS, "camera", replace(KINDS["camera"], largest=1000))
    (tmp_path / "empty").write_bytes(b" \n")
    (tmp_path / "large").write_bytes(b"a" * 1001)
    os.mkfifo(tmp_path / "pipe")
    closed = io.StringIO()
    closed.close()
    for source, message in (
        (tmp_path / "none", "a readable camera file at .*none, found No such file or directory; check the path"),
        (tmp_path, "found Is a directory"),
        (tmp_path / "empty", "a camera file at .*empty, found an empty file"),
        (tmp_path / "large", "a camera file of at most 1 kB at .*large, found a larger one; check the path"),
        (tmp_path / "pipe", "found a pipe or a device, not a regular file"),
        ("a\0b", "at 'a.x00b', found embedded null byte"),
        (closed, "a readable camera file at the open file, found I/O operation on closed file"),
        (io.StringIO("a" * 1001), "at most 1 kB"),
    ):
        with pytest.raises(InputError, match=message):
            read(source, "camera")
    with pytest.raises(InputError, match="not UTF-8 text"):
        text_of(Content("a", b"\xff"))


def test_a_file_of_nearly_the_name_is_named(tmp_path):
    (tmp_path / "camera.yaml").write_text("K: 1")
    with pytest.raises(InputError, match=r"path; there is .*camera\.yaml$"):
        read(tmp_path / "camra.yaml", "camera")
    with pytest.raises(InputError, match=r"check the path$"):
        read(tmp_path / "nowhere" / "camera.yaml", "camera")


def test_a_link_to_nothing_and_standard_input_are_no_misspelled_names(tmp_path):
    (tmp_path / "camera.yaml").symlink_to("calibration.yaml")
    with pytest.raises(InputError, match=r"; it is a link to calibration\.yaml, which is not there$"):
        read(tmp_path / "camera.yaml", "camera")
    with pytest.raises(InputError, match=r"; standard input is not read here: give the name of a file$"):
        read("-", "camera")


@pytest.fixture
def ask(tmp_path):
    """What a function of a parser replies in a child process."""
    script = tmp_path / "parser.py"
    script.write_text(PARSER)
    yield lambda function, content=SOME, kind="mesh": in_child(script, function, content, kind, "a file that is fine")
    guard.end_children()


def test_a_child_replies_with_values_and_arrays(ask):
    for _ in range(2):
        values, arrays = ask("count")
        assert values == {"bytes": 100}
        assert bytes(arrays["values"]) == SOME.data


def test_a_child_that_breaks_is_one_line_and_the_next_file_is_read(ask, monkeypatch):
    with pytest.raises(InputError, match=r"^expected a file of zeros in a.bin, found ones; write zeros$"):
        ask("refuse")
    with pytest.raises(InputError, match=r"is fine, found OSError of two lines;"):
        ask("fail")
    with pytest.raises(InputError, match="breaks it"):
        ask("crash")
    monkeypatch.setitem(KINDS, "mesh", replace(KINDS["mesh"], seconds=0.2, largest=1000))
    start = time.perf_counter()
    for function in ("hang", "compute"):
        with pytest.raises(InputError, match=r"is fine, found one that takes more than 0\.2 s;"):
            ask(function)
    assert time.perf_counter() - start < 30
    # Time in which others use the processor does not count.
    assert ask("nap").values == {}
    with pytest.raises(InputError, match=r"1 kB in a\.bin"):
        ask("count", Content("a.bin", bytes(1001)))
    monkeypatch.undo()
    assert ask("count").values == {"bytes": 100}


def test_the_memory_of_a_child_is_limited(ask):
    pytest.importorskip("resource")
    with pytest.raises(InputError, match="too much memory"):
        ask("fill")
    assert ask("count").values == {"bytes": 100}


def test_a_system_that_does_not_limit_memory_says_so(monkeypatch):
    import resource

    def refuse(*_):
        raise ValueError("current limit exceeds maximum limit")

    monkeypatch.setattr(resource, "setrlimit", refuse)
    assert guard._limit_memory(1) == {"unlimited": "ValueError current limit exceeds maximum limit"}


def test_a_parser_that_lacks_a_library(tmp_path):
    script = tmp_path / "lacks.py"
    script.write_text("import no_such_library")
    with pytest.raises(MissingLibraryError, match="No module named 'no_such_library'"):
        in_child(script, "any", SOME, "mesh", "")
