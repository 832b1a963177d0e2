"""Guard for files that strangers send: read whole, without waiting and within limits, or refused in one line.

`read` takes in the bytes of a path or an open file; `in_child` runs a parser on them in a process of its own, whose
time and memory are limited and whose end is not that of this process. How large a file may be, how long it may take to
parse and how much memory that may need stands in one table, `KINDS`.
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
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from threading import Lock, Timer
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from markergen.errors import InputError, MissingLibraryError, brief

if TYPE_CHECKING:
    import numpy as np

LOG = logging.getLogger("markergen")


@dataclass(frozen=True)
class Kind:
    """A kind of file and its limits.

    Attributes
    ----------
    name : str
        With its article, for messages.
    largest : int
        Bytes.
    why : str
        Reason for the limits.
    smaller, again : str
        Remedies for a file that is too large, and for one that is empty; without one the parser has to refuse it.
    pipes : bool
        Whether it may come through a pipe, which is waited for.
    seconds, seconds_per_byte : float
        How long it may take to parse in a child process, for any file and for its size.
    memory : int
        Bytes of address space of that process.
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
        """Largest size in words."""
        for unit, factor in (("GiB", 1 << 30), ("MB", 10**6), ("kB", 10**3)):
            if self.largest % factor == 0:
                return f"{self.largest // factor} {unit}"
        return f"{self.largest} bytes"


KINDS = {
    "camera": Kind("a camera file", 1_000_000, "a calibration with all its images' residuals has some 100 kB"),
    "covariance": Kind("a camera covariance", 1_000_000, "a matrix of 20 parameters has some kB"),
    "image": Kind("an image", 1 << 30, "100 million pixels of 16 bits in color, not packed", again="export it again"),
    "marker": Kind(
        "a marker.json", 10_000_000, "200 dots with their joint covariance in space have 9 MB", again="", pipes=True
    ),
    "measured": Kind("a table of measured dots", 1_000_000, "10,000 rows", "give one row for each dot", pipes=True),
    "outline": Kind(
        "an outline", 10_000_000, "an outline has some kB, a drawing with a photograph inside some MB",
        "export the outline alone, simplified",
    ),
    "poses": Kind("a file of poses", 50_000_000, "100,000 poses, an hour of video", "take every tenth pose"),
    "spec": Kind("a spec", 10_000, "one dotted key of ten times as many keeps a TOML parser busy for a minute"),
    "artifact": Kind(
        "a file to verify", 1 << 30, "a PNG of a large sheet has some ten MB", "check it", "export it again",
    ),
    "list": Kind("a list", 10_000_000, "a thousand points have 100 kB"),
    "SVG": Kind("an SVG", 10_000_000, "a sheet has 1 MB; its text is parsed in Python", "verify the PDF"),
    "CAD": Kind(
        "a STEP or BREP file", 100_000_000, "a marker of 1000 dots has 10 MB; Open CASCADE never ends with some files",
        memory=8 << 30,
    ),
    "mesh": Kind(
        "a mesh", 1 << 30, "4 million triangles of 50 bytes, as text five times as many; trimesh loads for a second",
        seconds=60.0, seconds_per_byte=1e-6,
    ),
}  # fmt: skip
"""Kinds of files and their limits."""

BEGINNING = 120.0
"""Seconds that a child process may take to be there at all: a CAD kernel is loaded from a cold disk."""


# --- Bytes ------------------------------------------------------------------------------------------------------------


class Content(NamedTuple):
    """Bytes of a file, and what messages call it."""

    name: str
    data: bytes


def read(source: object, kind: str) -> Content:
    """Read the bytes of a file, which is not waited for and not read beyond the limit of its kind.

    Parameters
    ----------
    source : path or open file
        A file that is open for text is taken as UTF-8.
    kind : str
        Key of `KINDS`.

    Raises
    ------
    InputError
        If there is no such file, it is a folder, a pipe or a device, may not be read, is empty, or is too large.
    """
    limits = KINDS[kind]
    wanted = f"a readable {limits.name.partition(' ')[2]}"
    if isinstance(source, str | os.PathLike):
        name = place_of(source)
        try:
            data = read_start(Path(source), limits.largest + 1, limits.pipes)
        except (OSError, ValueError) as error:  # ValueError: a path with a null character.
            raise InputError(f"{wanted} at {name}", reason_of(error), "check the path") from None
    else:
        name = name_of(source)
        try:
            some = source.read(limits.largest + 1)  # type: ignore[attr-defined]
            data = some.encode() if isinstance(some, str) else bytes(some)
        except (OSError, ValueError, TypeError) as error:  # A file that is closed, or open for writing, or none.
            remedy = "open it for reading" if isinstance(error, io.UnsupportedOperation) else "check the path"
            raise InputError(f"{wanted} at {name}", reason_of(error), remedy) from None
    if len(data) > limits.largest:
        raise InputError(f"{limits.name} of at most {limits.size} at {name}", "a larger one", limits.smaller)
    if limits.again and not data.strip():
        raise InputError(f"{limits.name} at {name}", "an empty file", limits.again)
    return Content(name, data)


def check_size(content: Content, kind: str) -> None:
    """Refuse a file that is too large for its kind, which its content or its name tells; raises InputError."""
    limits = KINDS[kind]
    if len(content.data) > limits.largest:
        raise InputError(f"{limits.name} of at most {limits.size} in {content.name}", "a larger one", limits.smaller)


def read_start(path: Path, count: int, pipes: bool = False) -> bytes:
    """First `count` bytes of a regular file, or with `pipes` of any, fewer if it has not as many.

    Raises
    ------
    OSError
        If it cannot be read or is no regular file: a pipe that nobody writes to would be waited for without end.
    ValueError
        If the path has a null character.
    """
    with open(path, "rb", opener=None if pipes else _open_at_once) as file:
        if not pipes and not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "a pipe or a device, not a regular file")
        return file.read(count)


def text_of(content: Content) -> str:
    """Text in UTF-8, with or without a byte order mark; raises InputError if it is none."""
    try:
        text = content.data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError(f"text in {content.name}", "bytes that are not UTF-8 text", "check the path")
    return text


def place_of(path: "str | os.PathLike[str]") -> str:
    """Return a path in one line for messages."""
    text = str(path)
    return text if text.isprintable() and text.strip() and len(text) <= 200 else brief(text)


def name_of(file: object) -> str:
    """Name of an open file for messages."""
    name = getattr(file, "name", None)
    return place_of(name) if isinstance(name, str) else "the open file"


def reason_of(error: Exception) -> str:
    """Return why a file could not be read, in a few words."""
    return str((error.strerror if isinstance(error, OSError) else None) or error or type(error).__name__)


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


# --- Child processes --------------------------------------------------------------------------------------------------


class Reply(NamedTuple):
    """What a parser made of a file: values of JSON, and arrays by name."""

    values: dict[str, Any]
    arrays: "Mapping[str, np.ndarray[Any, Any]]"


def in_child(script: Path, function: str, content: Content, kind: str, expected: str) -> Reply:
    """Parse a file in a process of its own, which is started with the first one and kept for the next.

    The script is run as a module of its own. Its function `function` takes the bytes and returns what can be written
    as JSON, or that and a dict of arrays; what it raises as InputError is raised here. A function `prepare`, if it has
    one, is called once before, for imports that take long or may fail.

    Parameters
    ----------
    kind : str
        Key of `KINDS`, for the limits of size, time and memory. Where the system does not limit memory (Windows,
        macOS), time alone is limited, and the log says so.
    expected : str
        What the file should have been, if the parser breaks, or takes too long or too much memory.

    Raises
    ------
    InputError
        If the file is too large, or the parser refuses it or breaks.
    MissingLibraryError
        If the script cannot be started; the message is the reason alone.
    """
    limits = KINDS[kind]
    check_size(content, kind)
    child = _child(script, kind)
    with child.lock:
        reply = child.ask(function, content.data, limits.seconds + limits.seconds_per_byte * len(content.data))
    if reply is None:
        raise InputError(expected, "one that breaks it", "export it again")
    if "refused" in reply.values:
        expected, found, remedy = reply.values["refused"]
        raise InputError(f"{expected} in {content.name}", found, remedy)
    if "error" in reply.values:
        raise InputError(expected, reply.values["error"], "export it again")
    return reply


def start_child(script: Path, kind: str) -> None:
    """Start the process that `in_child` is going to ask, to have it ready sooner; does not wait for it."""
    child = _child(script, kind)
    with child.lock:
        child.start()


def end_children() -> None:
    """End all child processes; they have no work that is worth waiting for."""
    for child in list(_CHILDREN.values()):
        child.end()


@dataclass
class _Child:
    """A process that runs `serve`."""

    script: Path
    memory: int
    lock: Lock = field(default_factory=Lock)
    process: "subprocess.Popen[bytes] | None" = None
    owner: int = 0
    greeted: bool = False

    def start(self) -> None:
        """Start the process unless it runs."""
        # After a fork the pipes are the parent's.
        if self.process is not None and self.owner == os.getpid():
            if self.process.poll() is None:
                return
            self.end()
        # -P: the script's folder has modules of the same names as those of libraries.
        root = Path(__file__).parents[1]
        code = f"import sys; sys.path.append({str(root)!r}); from markergen.guard import serve; serve(*sys.argv[1:])"
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", code, str(self.script), str(self.memory)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self.owner, self.greeted = os.getpid(), False

    def ask(self, function: str, data: bytes, patience: float) -> Reply | None:
        """What the parser replies; None if it broke or took too long."""
        self._greet()
        assert self.process is not None
        assert self.process.stdin is not None
        head = json.dumps({"function": function, "size": len(data), "seconds": patience}).encode() + b"\n"
        try:
            self.process.stdin.write(head + data)
            self.process.stdin.flush()
        except OSError:
            self.end()
            return None
        return self._reply(patience)

    def _greet(self) -> None:
        """Wait for the script to be there; raises MissingLibraryError if it is not."""
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


def _child(script: Path, kind: str) -> _Child:
    return _CHILDREN.setdefault(script, _Child(script, KINDS[kind].memory))


def _arrays(data: bytes) -> "dict[str, np.ndarray[Any, Any]]":
    import numpy as np

    with np.load(io.BytesIO(data), allow_pickle=False) as found:
        return dict(found)


def serve(script: str, memory: str) -> None:
    """Parse the files that come on standard input with the functions of a script, in a child process.

    A request is a line of JSON and the bytes of a file. A reply, of which the first comes unasked, is JSON and an
    .npz archive or nothing, each after its size in 8 bytes.
    """
    replies = os.fdopen(os.dup(1), "wb")
    # Libraries say on standard output what they think of files.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    hello = _limit_memory(int(memory))
    functions: dict[str, Any] = {}
    try:
        functions = _functions(script)
        functions.get("prepare", dict)()
    except ImportError as error:
        hello = {"missing": " ".join(str(error).split())}
    _send(replies, hello, {})
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        data = sys.stdin.buffer.read(request["size"])
        # Whoever asked ends what takes too long, unless it was ended itself.
        alarm: Callable[[int], object] = getattr(signal, "alarm", int)
        alarm(60 + int(2 * request["seconds"]))
        _send(replies, *_answer(functions[request["function"]], data))
        alarm(0)


def _functions(script: str) -> dict[str, Any]:
    spec = spec_from_file_location("markergen_parser", script)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["markergen_parser"] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return vars(module)


def _answer(function: Callable[[bytes], Any], data: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        found = function(data)
    except InputError as error:
        return {"refused": error.args}, {}
    except MemoryError:
        return {"error": "one that needs too much memory"}, {}
    # What parsers raise at broken files has no common root; that of Open CASCADE is not even known to Python.
    except Exception as error:
        return {"error": f"{type(error).__name__} {' '.join(str(error).split())}"[:200].strip()}, {}
    return found if isinstance(found, tuple) else (found, {})


def _send(replies: BinaryIO, values: dict[str, Any], arrays: dict[str, Any]) -> None:
    archive = io.BytesIO()
    if arrays:
        import numpy as np

        np.savez(archive, **arrays)
    for part in (json.dumps(values).encode(), archive.getvalue()):
        replies.write(len(part).to_bytes(8, "big") + part)
    replies.flush()


def _limit_memory(most: int) -> dict[str, Any]:
    """Limit the address space of this process; what the parent is to know where it cannot be limited."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
    except (ImportError, ValueError, OSError) as error:
        return {"unlimited": f"{type(error).__name__} {error}"}
    return {}


def as_file(data: bytes, suffix: str, read: Callable[[str], Any]) -> Any:
    """Return what a library that takes paths alone makes of bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{suffix}"
        path.write_bytes(data)
        return read(str(path))
