"""Guard for untrusted files: each is read completely, without blocking and within limits, or refused in one line.

`read` reads the bytes of a path or an open file; `in_child` runs a parser on them in a child process with limited time
and memory, whose crash does not affect this process. One table, `KINDS`, lists the limits on size, parsing time and
memory.
"""

import atexit
import errno
import io
import json
import logging
import os
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from itertools import islice
from pathlib import Path
from threading import Lock, Timer
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from markergen.errors import InputError, MissingLibraryError, brief, reason_of

if TYPE_CHECKING:
    import numpy as np

LOG = logging.getLogger("markergen")


@dataclass(frozen=True)
class Limits:
    """A kind of file and its limits.

    Attributes
    ----------
    name : str
        Name with its article, for messages.
    largest : int
        Maximum size, in bytes.
    why : str
        Reason for the limits.
    smaller, again : str
        Remedies for a file that is too large, and for an empty one; if `again` is empty, empty files reach the parser.
    pipes : bool
        True if it may come through a pipe, which is read to its end.
    seconds, seconds_per_byte : float
        Maximum processor time of parsing in a child process: a constant, plus a time per byte.
    memory : int
        Maximum address space of that process, in bytes.
    """

    name: str
    largest: int
    why: str
    smaller: str = "check the path"
    again: str = "check the path"
    pipes: bool = False
    seconds: float = 10.0
    seconds_per_byte: float = 3e-5
    memory: int = 4 << 30

    @property
    def size(self) -> str:
        """Maximum size in words."""
        for unit, factor in (("GiB", 1 << 30), ("MB", 10**6), ("kB", 10**3)):
            if self.largest % factor == 0:
                return f"{self.largest // factor} {unit}"
        return f"{self.largest} bytes"


KINDS = {
    "camera": Limits("a camera file", 1_000_000, "a calibration with all its images' residuals has some 100 kB"),
    "covariance": Limits("a camera covariance", 1_000_000, "a matrix of 20 parameters has some kB"),
    "file": Limits("a file", 50_000_000, "100,000 poses; anything else is smaller", "take a part of it"),
    "image": Limits("an image", 1 << 30, "100 million pixels of 16 bits in color, not packed", again="export it again"),
    "marker": Limits(
        "a marker.json", 10_000_000, "200 dots with their joint covariance in space have 9 MB", again="", pipes=True
    ),
    "measured": Limits("a table of measured dots", 1_000_000, "10,000 rows", "give one row for each dot", pipes=True),
    "layout": Limits("a table of points", 1_000_000, "200 rows", "give one row for each dot", pipes=True),
    "outline": Limits(
        "an outline", 10_000_000, "an outline has some kB, a drawing with a photograph inside some MB",
        "export the outline alone, simplified",
    ),
    "poses": Limits("a file of poses", 50_000_000, "100,000 poses, an hour of video", "take every tenth pose"),
    "marker or rig": Limits("a marker.json", 50_000_000, "that of a rig", again="", pipes=True),
    "rig": Limits(
        "a rig.json", 50_000_000, "a hundred markers of ten dots have 1 MB", "name the markers as files", pipes=True
    ),
    "spec": Limits("a spec", 10_000, "one dotted key of ten times as many keeps a TOML parser busy for a minute"),
    "artifact": Limits(
        "a file to verify", 1 << 30, "a PNG of a large sheet has some ten MB", "check it", "export it again",
    ),
    "request": Limits("a request", 10_000_000, "an outline of thousands of corners, a marker.json", "reload the page"),
    "upload": Limits(
        "a file for the studio", 100_000_000, "a photograph has some ten MB", "use the command line for it"
    ),
    "photographs": Limits(
        "a set of photographs", 400_000_000, "twenty of a phone have 100 MB", "leave some out"
    ),
    "list": Limits("a list", 10_000_000, "a thousand points have 100 kB"),
    "SVG": Limits("an SVG", 10_000_000, "a sheet has 1 MB; its text is parsed in Python", "verify the PDF"),
    "PDF": Limits(
        "a PDF", 100_000_000, "a family of a hundred sheets has some MB; a page may unpack to any size",
        "print fewer pages into one file", seconds=9.0, seconds_per_byte=0.0, memory=5 << 28,
    ),
    "CAD": Limits(
        "a STEP or BREP file", 40_000_000, "a marker of 1000 dots has 10 MB; Open CASCADE never ends with some files",
        seconds_per_byte=4e-6, memory=3 << 30,
    ),
    "mesh": Limits(
        "a mesh", 200_000_000, "1.5 million triangles of 50 bytes, as text five times as many",
        seconds=20.0, seconds_per_byte=2e-7, memory=3 << 29,
    ),
}  # fmt: skip
"""Kinds of files and their limits."""

MOST_TRIANGLES = 1_500_000
"""Maximum number of triangles in a mesh: they take 75 MB as binary STL."""

BEGINNING = 120.0
"""Maximum startup time of a child process, in seconds: a CAD kernel may load from a cold disk."""

WAITING = 10
"""Ratio of elapsed to processor time after which a child process is ended: a busy machine, or one that hangs."""

_NEIGHBORS = 1000
"""Maximum number of names that are compared with one that does not exist."""


# --- Bytes ------------------------------------------------------------------------------------------------------------


class Content(NamedTuple):
    """Bytes of a file, and its name for messages."""

    name: str
    data: bytes


def read(source: object, kind: str) -> Content:
    """Read the bytes of a file without blocking, up to the size limit of its kind.

    Parameters
    ----------
    source : path or open file
        Text from a file opened in text mode is encoded as UTF-8.
    kind : str
        Key of `KINDS`.

    Raises
    ------
    InputError
        If the path does not exist, is a folder, a pipe or a device, or the file is not readable, empty, or too large.
    """
    limits = KINDS[kind]
    wanted = f"a readable {limits.name.partition(' ')[2]}"
    if isinstance(source, str | os.PathLike):
        name = place_of(source)
        try:
            data = read_start(Path(source), limits.largest + 1, limits.pipes)
        except (OSError, ValueError) as error:  # ValueError: a path with a null character.
            raise InputError(f"{wanted} at {name}", reason_of(error), _near(Path(source))) from None
    else:
        name = file_name(source)
        try:
            content = source.read(limits.largest + 1)  # type: ignore[attr-defined]
            data = content.encode() if isinstance(content, str) else bytes(content)
        except (OSError, ValueError, TypeError) as error:  # The file is closed, open for writing, or not a file.
            remedy = "open it for reading" if isinstance(error, io.UnsupportedOperation) else "check the path"
            raise InputError(f"{wanted} at {name}", reason_of(error), remedy) from None
    if len(data) > limits.largest:
        raise InputError(f"{limits.name} of at most {limits.size} at {name}", "a larger one", limits.smaller)
    if limits.again and not data.strip():
        raise InputError(f"{limits.name} at {name}", "an empty file", limits.again)
    return Content(name, data)


def check_size(content: Content, kind: str) -> None:
    """Refuse a file that is too large for its kind, going by its content or its name; raises InputError."""
    limits = KINDS[kind]
    if len(content.data) > limits.largest:
        raise InputError(f"{limits.name} of at most {limits.size} in {content.name}", "a larger one", limits.smaller)


def read_start(path: Path, count: int, pipes: bool = False) -> bytes:
    """Return the first `count` bytes of a regular file (with `pipes`, of any file), or all bytes of a shorter one.

    Raises
    ------
    OSError
        If it cannot be read or is not a regular file: a pipe without a writer would block forever.
    ValueError
        If the path has a null character.
    """
    at_once = getattr(os, "O_NONBLOCK", 0)
    with open(path, "rb", opener=None if pipes else lambda name, flags: os.open(name, flags | at_once)) as file:
        if not pipes and not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "a pipe or a device, not a regular file")
        return file.read(count)


def text_of(content: Content) -> str:
    """Decode UTF-8 text, with or without a byte order mark; raises InputError if it is not UTF-8."""
    try:
        text = content.data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError(f"text in {content.name}", "bytes that are not UTF-8 text", "check the path")
    return text


def place_of(path: "str | os.PathLike[str]") -> str:
    """Return a path as a single line for messages."""
    text = str(path)
    return text if text.isprintable() and text.strip() and len(text) <= 200 else brief(text)


def file_name(file: object) -> str:
    """Return the name of an open file for messages."""
    name = getattr(file, "name", None)
    return place_of(name) if isinstance(name, str) else "the open file"


def _near(path: Path) -> str:
    """Return what to do about a path that cannot be read: one beside it with nearly its name, if there is one."""
    from difflib import get_close_matches

    if str(path) == "-":
        return "standard input is not read here: give the name of a file"
    try:
        if path.is_symlink() and not path.exists():
            return f"it is a link to {place_of(path.readlink())}, which is not there"
        names = [] if path.exists() else [neighbor.name for neighbor in islice(path.parent.iterdir(), _NEIGHBORS)]
    except (OSError, ValueError):
        names = []
    matches = get_close_matches(path.name, names, 1)
    return f"check the path; there is {path.with_name(matches[0])}" if matches else "check the path"


# --- Child processes --------------------------------------------------------------------------------------------------


class Reply(NamedTuple):
    """Output of a parser: JSON values, and arrays by name."""

    values: dict[str, Any]
    arrays: "Mapping[str, np.ndarray[Any, Any]]"


def in_child(script: Path, function: str, content: Content, kind: str, expected: str) -> Reply:
    """Parse a file in a child process, which is started for the first file and reused for the next.

    The script runs as a module of its own. Its function `function` takes the bytes and returns JSON values, or those
    and a dict of arrays; an InputError that it raises is raised here. An optional function `prepare` is called once
    before, for imports that are slow or may fail.

    Parameters
    ----------
    kind : str
        Key of `KINDS`, for the limits of size, processor time and memory. Where memory is not limited (Windows,
        macOS), the log says so.
    expected : str
        Description of a valid file, for the message if the parser crashes or exceeds its time or memory.

    Raises
    ------
    InputError
        If the file is too large, or the parser refuses it or crashes.
    MissingLibraryError
        If the script cannot be started; the message is only the reason.
    """
    limits = KINDS[kind]
    check_size(content, kind)
    child = start_child(script, kind)
    with child.lock:
        seconds = limits.seconds + limits.seconds_per_byte * len(content.data)
        reply = child.ask(function, content.data, seconds)
    if reply is None:
        actual = f"one that takes more than {seconds:.3g} s" if child.is_late else "one that breaks it"
        raise InputError(expected, actual, "export it again")
    if "refused" in reply.values:
        expected, actual, remedy = reply.values["refused"]
        raise InputError(f"{expected} in {content.name}", actual, remedy)
    if "error" in reply.values:
        raise InputError(expected, reply.values["error"], "export it again")
    return reply


def start_child(script: Path, kind: str) -> "_Child":
    """Start the process for `in_child` ahead of time, without waiting for it."""
    child = _CHILDREN.setdefault(script, _Child(script, KINDS[kind].memory))
    with child.lock:
        child.start()
    return child


def end_children() -> None:
    """Kill all child processes; none holds work worth waiting for."""
    for child in list(_CHILDREN.values()):
        child.end()


@dataclass
class _Child:
    """A process that runs `run_parser`."""

    script: Path
    memory: int
    lock: Lock = field(default_factory=Lock)
    process: "subprocess.Popen[bytes] | None" = None
    owner: int = 0
    greeted: bool = False
    is_late: bool = False

    def start(self) -> None:
        """Start the process unless it is running."""
        # After a fork the pipes belong to the parent.
        if self.process is not None and self.owner == os.getpid():
            if self.process.poll() is None:
                return
            self.end()
        # -P: modules in the script's folder have the same names as libraries.
        root = Path(__file__).parents[1]
        code = (
            f"import sys; sys.path.append({str(root)!r}); from markergen import guard; guard.run_parser(*sys.argv[1:])"
        )
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", code, str(self.script), str(self.memory)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self.owner, self.greeted = os.getpid(), False

    def ask(self, function: str, data: bytes, seconds: float) -> Reply | None:
        """Return the parser's reply; None if it crashed or, as `is_late` says, took too long."""
        self._greet()
        assert self.process is not None
        assert self.process.stdin is not None
        head = json.dumps({"function": function, "size": len(data), "seconds": seconds}).encode() + b"\n"
        # If the process is gone, its reply says so.
        with suppress(OSError):
            self.process.stdin.write(head + data)
            self.process.stdin.flush()
        return self._reply(WAITING * seconds)

    def _greet(self) -> None:
        """Wait until the script has started; raises MissingLibraryError if it cannot."""
        self.start()
        if self.greeted:
            return
        hello = self._reply(BEGINNING)
        if hello is None or "missing" in hello.values:
            self.end()
            raise MissingLibraryError(hello.values["missing"] if hello else "a process that does not start")
        if "unlimited" in hello.values:
            LOG.info("the memory of what reads files is not limited: %s", hello.values["unlimited"])
        self.greeted = True

    def _reply(self, patience: float) -> Reply | None:
        process = self.process
        assert process is not None
        assert process.stdout is not None
        timer = Timer(patience, process.kill)
        timer.start()
        try:
            values = json.loads(self._part(process.stdout))
            arrays = self._part(process.stdout)
            return Reply(values, _arrays(arrays) if arrays else {})
        except (OSError, ValueError):
            self.end()
            self.is_late = not timer.is_alive() or process.returncode == -getattr(signal, "SIGPROF", 0)
            return None
        finally:
            timer.cancel()
            timer.join()

    def _part(self, stream: Any) -> bytes:
        size = int.from_bytes(stream.read(8), "big")
        if size > self.memory:
            raise ValueError(size)
        part: bytes = stream.read(size)
        if len(part) < size:
            raise ValueError(size)
        return part

    def end(self) -> None:
        """Kill the process."""
        process, self.process = self.process, None
        if process is None or self.owner != os.getpid():
            return
        process.kill()
        for pipe in (process.stdin, process.stdout):
            try:
                if pipe is not None:
                    pipe.close()
            except OSError:
                pass
        process.wait()


_CHILDREN: dict[Path, _Child] = {}
atexit.register(end_children)


def _arrays(data: bytes) -> "dict[str, np.ndarray[Any, Any]]":
    import numpy as np

    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return dict(archive)


def run_parser(script: str, memory: str) -> None:
    """Parse files from standard input with the functions of a script, in a child process.

    A request is a line of JSON followed by the bytes of a file. A reply is JSON and an .npz archive or nothing, each
    preceded by its size in 8 bytes; the first reply is sent without a request.
    """
    replies = os.fdopen(os.dup(1), "wb")
    # The parent handles Ctrl-C, and a library that is interrupted while it loads would seem to be missing.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Libraries print remarks about files on standard output.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    hello = _limit_memory(int(memory))
    functions: dict[str, Any] = {}
    try:
        functions = _functions(script)
        functions.get("prepare", dict)()
    except ImportError as error:
        hello = {"missing": " ".join(str(error).split())}
    _send(replies, hello, {})
    # A signal ends this process. On Windows only the parent does.
    has_timer = hasattr(signal, "setitimer")
    end_after: Callable[[float], object] = partial(signal.setitimer, signal.ITIMER_PROF) if has_timer else float
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        data = sys.stdin.buffer.read(request["size"])
        end_after(request["seconds"])
        _send(replies, *_answer(functions[request["function"]], data))
        end_after(0)


def _functions(script: str) -> dict[str, Any]:
    spec = spec_from_file_location("markergen_parser", script)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["markergen_parser"] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return vars(module)


def _answer(function: Callable[[bytes], Any], data: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        reply = function(data)
    except InputError as error:
        return {"refused": error.args}, {}
    except MemoryError:
        return {"error": "one that needs too much memory"}, {}
    # Exceptions of parsers for broken files have no common root; those of Open CASCADE are not even Python classes.
    except Exception as error:
        return {"error": f"{type(error).__name__} {' '.join(str(error).split())}"[:200].strip()}, {}
    return reply if isinstance(reply, tuple) else (reply, {})


def _send(replies: BinaryIO, values: dict[str, Any], arrays: dict[str, Any]) -> None:
    archive = io.BytesIO()
    if arrays:
        import numpy as np

        np.savez(archive, **arrays)
    for part in (json.dumps(values).encode(), archive.getvalue()):
        replies.write(len(part).to_bytes(8, "big") + part)
    replies.flush()


def _limit_memory(most: int) -> dict[str, Any]:
    """Limit the address space of this process; return what to report to the parent if that is impossible."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
    except (ImportError, ValueError, OSError) as error:
        return {"unlimited": f"{type(error).__name__} {error}"}
    return {}


def as_file(data: bytes, suffix: str, read: Callable[[str], Any]) -> Any:
    """Read bytes with a library function that accepts only paths, through a temporary file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{suffix}"
        path.write_bytes(data)
        return read(str(path))
