"""What the commands share on the terminal: progress with time left, tables, and the list of files written."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markergen.options.base import Progress
    from markergen.presentation.tables import Table
    from markergen.validation.comparison import Comparison
    from markergen.validation.validation import Validation
    from markergen.verification.verification import Verification

    Found = Validation | Comparison | Verification


@contextmanager
def progress_bar() -> Iterator["Progress"]:
    """Yield a callback ``(stage, done, total)`` that keeps a bar with the time left on stderr, gone at the end."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description:>9}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
    )
    with Bar(
        *columns, console=Console(stderr=True), transient=True, redirect_stdout=False, disable=not sys.stderr.isatty()
    ) as bar:
        tasks: dict[str, Any] = {}

        # A stage announces itself with nothing done, so that the time left is reckoned from its start.
        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done, total=total)

        yield advance


@contextmanager
def busy(words: str) -> Iterator[None]:
    """Show on stderr that something is under way that has no parts to count."""
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_terminal:
        with console.status(words):
            yield
    else:
        yield


def complain(line: str) -> None:
    """Print a line on stderr, where it cannot mix with data."""
    print(line, file=sys.stderr)


def print_found(found: "Found", as_json: bool, parts: Iterable["str | Table"] | None = None) -> None:
    """Print a result as JSON, or all its parts, or some; then the files that were written, never amid JSON."""
    if as_json:
        sys.stdout.write(found.to_json().decode())
    else:
        print_parts(found.parts() if parts is None else parts)
    for each in found.written:
        print(each, file=sys.stderr if as_json else sys.stdout)


def print_parts(parts: Iterable["str | Table"]) -> None:
    """Print sentences and tables; a terminal decides on their width."""
    from markergen.presentation.tables import print_parts

    print_parts(parts, sys.stdout)
