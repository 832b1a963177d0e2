"""Terminal helpers shared by the commands: exit status, progress with time left, tables, and files written."""
# tests: tests/cli/test_detect_video.py

import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from math import inf, isnan
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from typer import CallbackParam

from markergen.options import STAGES

if TYPE_CHECKING:
    from markergen.optimize.ending import TimeLimit
    from markergen.options import Progress
    from markergen.presentation.results import Result
    from markergen.presentation.tables import Table

FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130
"""Exit status: a check failed; unusable input; Ctrl-C."""


class Terminated(Exception):
    """A search was asked to end, and what it had found by then is written."""


class Silence:
    """Whether nothing but errors, and JSON on standard output, is to be printed: ``--quiet``."""

    on = False


SECONDS_BETWEEN_LINES = 30
"""Seconds between lines of progress in a log."""


@contextmanager
def progress_bar() -> Iterator["Progress"]:
    """Yield a callback ``(stage, done, total)`` that shows a bar with the time left on stderr, removed at the end.

    A log gets an occasional line instead.
    """
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    if Silence.on or not sys.stderr.isatty():
        lines = _LogLines(SECONDS_BETWEEN_LINES)
        yield lambda stage, done, total: lines(f"{STAGES.get(stage, stage)}, {100 * done / max(total, 1):.0f} %")
        return
    columns = (
        TextColumn("{task.description:>27}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
    )
    with Bar(
        *columns,
        console=Console(stderr=True),
        transient=True,
        # Lines for the same terminal go above the bar; a file or a pipe gets its own.
        redirect_stdout=sys.stdout.isatty(),
    ) as bar:
        tasks: dict[str, Any] = {}

        # A stage is announced with nothing done, so that the time left is measured from its start.
        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(STAGES.get(stage, stage), total=total)
            bar.update(tasks[stage], completed=done, total=total)

        yield advance


@contextmanager
def status_line(first: str) -> Iterator[Callable[[str], None]]:
    """Yield a callback for a line that is shown on stderr until the next one or the end; nothing is shown in a log."""
    from rich.console import Console
    from rich.live import Live
    from rich.spinner import Spinner
    from rich.text import Text

    console = Console(stderr=True)
    if Silence.on or not console.is_terminal:
        yield lambda _: None
        return

    def text_of(line: str) -> Text:
        # On one line, with the spinner before it.
        room = console.width - 3
        return Text(line if len(line) <= room else f"{line[: room - 3]}...")

    spinner = Spinner("dots", text_of(first))
    with Live(spinner, console=console, refresh_per_second=12.5, transient=True, redirect_stdout=sys.stdout.isatty()):
        yield lambda line: spinner.update(text=text_of(line))


@contextmanager
def cells_progress() -> Iterator[Callable[[int, int, float], None]]:
    """Yield a callback ``(done, total, seconds left)`` for a study: a bar, or an occasional line in a log."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    if Silence.on or not sys.stderr.isatty():
        lines = _LogLines(-inf)
        yield lambda done, total, seconds: lines(
            ", ".join(filter(None, [f"{done} of {total} cells", _left(seconds)])), done == total
        )
        return
    columns = (TextColumn("{task.completed}/{task.total} cells"), BarColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, left="")
        yield lambda done, total, seconds: bar.update(task, completed=done, total=total, left=_left(seconds))


class _LogLines:
    """Progress for a log: a line every half minute, the first one after some seconds, and the last one."""

    def __init__(self, first: float) -> None:
        self._next = monotonic() + first

    def __call__(self, line: str, is_last: bool = False) -> None:
        if is_last or monotonic() > self._next:
            self._next = monotonic() + SECONDS_BETWEEN_LINES
            note(line)


@contextmanager
def interruptible() -> Iterator["TimeLimit"]:
    """End searches at the first Ctrl-C or SIGTERM, so that what they have found is written; the next ends the program.

    Yields the limit of the searches, which knows whether one was `asked` to end.
    """
    from markergen.optimize.ending import TimeLimit, limited

    limit, signals = TimeLimit(), (signal.SIGINT, signal.SIGTERM)

    def ask(*_: object) -> None:
        limit.asked = True
        restore()
        note("ending the search; once more ends at once")

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    is_main = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, ask) for number in signals} if is_main else {}
    try:
        with limited(limit):
            yield limit
    finally:
        restore()


def _left(seconds: float) -> str:
    from markergen.units import duration

    return "" if isnan(seconds) else f"{duration(seconds)} left"


def complain(line: str) -> None:
    """Print a line on stderr, where it cannot mix with data."""
    print(line, file=sys.stderr)


def note(line: str) -> None:
    """Print a remark on stderr."""
    if not Silence.on:
        complain(line)


def ignored(param: CallbackParam, value: str | None) -> str | None:
    """Print that an option of the release before has no effect, where it is given."""
    if value is not None:
        note(f"--{param.name} has no effect any more, and goes with the next release")
    return value


def report(line: str) -> None:
    """Print a line of a result."""
    if not Silence.on:
        print(line)


def is_stdout(json: Path | None) -> bool:
    """Return whether ``--json`` asks for results on standard output."""
    return str(json) == "-"


def file_of(json: Path | None) -> Path | None:
    """Return the file that ``--json`` names, if any."""
    return None if is_stdout(json) else json


def print_result(
    result: "Result", json: Path | None, parts: Iterable["str | Table"] | None = None, details: bool = True
) -> None:
    """Print all or some parts of a result and the files written; or JSON, if standard output is wanted for that."""
    from markergen.presentation.tables import print_parts

    if is_stdout(json):
        sys.stdout.write(result.to_json().decode())
    elif not Silence.on:
        print_parts((result.parts() if details else result.brief()) if parts is None else parts, sys.stdout)
    lines = [str(file) if details else file.brief for file in result.written]
    if not details:
        lines = [*lines[:-1], f"{f'{lines[-1]} ' if lines else ''}(--details shows all else)"]
    for line in lines:
        (note if is_stdout(json) else report)(line)
