"""The command line: thin commands and no logic. A library exception becomes one line and status 2."""

import gc
import io
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from shlex import join

from markergen.cli.console import INTERRUPTED, UNUSABLE, Silence, Terminated, complain, report


class _Warnings(logging.Handler):
    """Prints library warnings on stderr, one line each."""

    def emit(self, record: logging.LogRecord) -> None:
        print("markergen: warning:", " ".join(record.getMessage().split()), file=sys.stderr)


WARNINGS = _Warnings(logging.WARNING)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Anywhere, ``--quiet`` leaves nothing but errors and JSON, and ``--debug`` shows the traceback of an error.
    """
    # The matrices here are tiny and come in batches: threads inside the linear algebra only cost time and memory.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # By default, a tenth of the time of a design is spent on looking for garbage among modules being imported.
    gc.set_threshold(50_000)
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    debug, Silence.on, whole = (flag in arguments for flag in ("--debug", "--quiet", "--help-all"))
    WARNINGS.setLevel(logging.ERROR if Silence.on else logging.WARNING)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: PTH123, SIM115 - a device, until the process ends
    if sys.stdout is None:
        # The next file that is opened would take its place, and get what is printed.
        _complain("expected a standard output, found it closed; send it to a file or /dev/null")
        return UNUSABLE
    for stream in (sys.stdout, sys.stderr):
        # What a terminal's encoding does not have must not turn success into an error.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    # Not where it is ignored, as under nohup, or handled by a program that calls this one.
    is_ours = threading.current_thread() is threading.main_thread() and (
        signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    )
    if is_ours:
        signal.signal(signal.SIGTERM, _terminate)
    try:
        command = [word for word in arguments if word not in ("--debug", "--quiet", "--help-all")]
        command += ["--help"] * whole
        if not command and sys.stdin and sys.stdin.isatty() and sys.stdout.isatty():
            command = asked()
        # As with git: `markergen help design`.
        status = _run([*command[1:], "--help"] if command[:1] in ([], ["help"]) else command, whole)
        sys.stdout.flush()
    except Terminated:
        return INTERRUPTED
    except (KeyboardInterrupt, EOFError):
        status = INTERRUPTED
    except BrokenPipeError:
        _discard_output()
        return 0
    except Exception as error:
        if debug:
            raise
        _complain(_explain(error))
        try:
            sys.stdout.flush()
        except OSError:
            _discard_output()
        return UNUSABLE
    finally:
        if is_ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # Typer turns Ctrl-C into this status itself, without a message.
    if status == INTERRUPTED:
        _complain("interrupted")
    return status


def _discard_output() -> None:
    """Drop what is left for a standard output that is full or closed; Python would complain again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


FARTHEST, NEAREST = 1.5, 0.4
"""Distance of the farthest pose by default, m, and of the nearest over it."""


def asked() -> list[str]:
    """Ask for paper, camera and distance, show the command that the answers make, and return its words."""
    from markergen.drawing.paper import find_paper, paper_of_locale
    from markergen.model.camera import SIZE_AND_ANGLE, Camera
    from markergen.model.pose_sources.cone import Cone
    from markergen.units import parse_length

    def poses_to(distance: str) -> str:
        farthest = parse_length(distance, "distance")
        return f"cone:distance={NEAREST * farthest:.4g}..{farthest:.4g}m,tilt=0..70"

    command = ["design", "--paper", _answer("Paper in the printer", paper_of_locale(os.environ), find_paper)]
    cameras = f"Camera: webcam, phone, such as {SIZE_AND_ANGLE}, or its calibration file"
    camera = _answer(cameras, "webcam", Camera.load)
    command += ["--camera", camera] if camera != "webcam" else []
    usual = f"{FARTHEST}m"
    farthest = _answer("How far away is the marker at most", usual, lambda text: Cone.parse(poses_to(text)))
    command += ["--poses", poses_to(farthest)] if farthest != usual else []
    command += ["-o", "marker.pdf"]
    report(f"markergen {join(command)}")
    return command


def _answer(question: str, default: str, read: Callable[[str], object]) -> str:
    """Ask until the answer can be read."""
    from markergen.errors import InputError

    while True:
        answer = input(f"{question} [{default}]: ").strip() or default
        try:
            read(answer)
        except InputError as error:
            report(str(error))
        else:
            return answer


def _terminate(number: int, _: object) -> None:
    """Leave by an exception, which closes and removes what is open; a second one ends the process at once."""
    signal.signal(number, signal.SIG_DFL)
    raise SystemExit(128 + number)


def _run(arguments: list[str], whole_help: bool) -> int:
    import typer

    from markergen.cli.options import Help

    Help.whole = whole_help
    from markergen.cli.commands import app
    from markergen.errors import MarkergenError

    logging.getLogger("markergen").addHandler(WARNINGS)
    try:
        return int(app(arguments, standalone_mode=False, prog_name="markergen") or 0)
    except typer.Abort:
        return INTERRUPTED
    # Depending on its version, Typer bundles its own click; the base of BadParameter is UsageError either way.
    except typer.BadParameter.__base__ as error:  # type: ignore[misc]
        command = error.ctx.command_path if error.ctx else "markergen"
        message = error.format_message().rstrip(".")
        see = " See" if message.endswith("?") else "; see"
        raise MarkergenError(f"{message}{see} {command} --help") from error
    except SystemExit as end:
        # Click ends the program itself where the reader of our output has closed the pipe.
        if isinstance(end.__context__, BrokenPipeError):
            raise end.__context__ from None
        raise
    finally:
        logging.getLogger("markergen").removeHandler(WARNINGS)


def _explain(error: Exception) -> str:
    from markergen.errors import MarkergenError
    from markergen.registry import plug_in_of, unforeseen

    if isinstance(error, MarkergenError):
        return str(error)
    if isinstance(error, OSError) and not any(plug_in_of(error)):
        return f"expected to read and write, found: {error}; free some space or choose another place"
    return unforeseen(error, "run again with --debug and report it")


def _complain(message: str) -> None:
    complain(f"markergen: error: {' '.join(message.split())}")
