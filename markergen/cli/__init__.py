"""The command line: one file per command, no logic. A library exception becomes one line and status 2."""

import os
import sys
from collections.abc import Sequence
from typing import Any

FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130
"""Exit status: a check failed; unusable input; Ctrl-C."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status; ``--debug`` anywhere asks for the traceback of an error."""
    # The matrices here are tiny and come in batches: threads inside the linear algebra only cost time and memory.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    import typer

    from markergen.cli.app import app
    from markergen.errors import MarkergenError

    # typer carries its own click or not, depending on the version; the base of BadParameter is UsageError in both.
    usage_error: Any = typer.BadParameter.__base__
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    try:
        status = app([word for word in given if word != "--debug"], standalone_mode=False, prog_name="markergen")
    except (typer.Abort, KeyboardInterrupt):
        status = INTERRUPTED
    except usage_error as error:
        command = error.ctx.command_path if error.ctx else "markergen"
        _complain(f"{error.format_message().rstrip('.')}; see {command} --help")
        return UNUSABLE
    except BrokenPipeError:
        # Whoever read our output has seen enough; without this Python complains again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MarkergenError as error:
        if debug:
            raise
        _complain(str(error))
        return UNUSABLE
    except Exception as error:
        if debug:
            raise
        _complain(f"this should not happen: {type(error).__name__}: {error}; run again with --debug and report it")
        return UNUSABLE
    # Typer turns Ctrl-C into this status itself, without a word.
    if status == INTERRUPTED:
        _complain("interrupted; nothing was written")
    return int(status or 0)


def _complain(message: str) -> None:
    print("markergen: error:", " ".join(message.split()), file=sys.stderr)
