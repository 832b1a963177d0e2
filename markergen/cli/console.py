"""What the commands share on the terminal: progress with time left, tables, and the list of files written."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markergen.objectives.survive import HiddenDots
    from markergen.tables import Result

Progress = Callable[[str, int, int], None]


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Yield a callback ``(stage, done, total)`` that keeps a bar with the time left on stderr, gone at the end."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description:>9}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
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


def length(text: str) -> float:
    """Read a length for an option, so that a bad one is told with the option's name."""
    from typer import BadParameter

    from markergen.errors import InputError
    from markergen.units import parse_length

    try:
        return parse_length(text)
    except InputError as error:
        raise BadParameter(str(error)) from None


def print_result(result: "Result") -> None:
    """Print what a result has to say: its sentences and tables."""
    from markergen.tables import print_parts

    print_parts(result.parts(), sys.stdout)


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> None:
    """Print rows of text under a header, see `Table`."""
    from markergen.tables import Table, print_parts

    print_parts([Table(title, header, rows, caption)], sys.stdout)


def print_criteria(criteria: Mapping[str, Mapping[str, float]], n: int, noise: str) -> None:
    """Print the criteria of a design beside those of the layouts that it is compared with."""
    from markergen.optimize.criteria_tables import criteria_table

    print_table(*criteria_table(criteria, n, noise))


def print_hidden(errors: Sequence["HiddenDots"], noise: str) -> None:
    """Print the criteria of a marker with none, one and more of its dots hidden."""
    from markergen.optimize.criteria_tables import hidden_table

    print_table(*hidden_table(errors, noise))


def print_effort(seconds: float) -> None:
    """Print how long a design took and how much memory the process has used, where the system tells."""
    words = f"found in {seconds:.1f} s"
    try:
        import resource
    except ImportError:  # Windows
        print(words)
        return
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts in kB, macOS in bytes.
    print(f"{words}, {peak / (1e6 if sys.platform == 'darwin' else 1e3):.0f} MB of memory at most")


def print_outputs(written: Sequence[tuple[Path, Sequence[str]]]) -> None:
    """Print each file that was written, with the sentences that its exporter has for the user."""
    for path, notes in written:
        print(f"wrote {path}", *notes, sep="\n  ")
