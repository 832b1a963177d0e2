"""What the commands share on the terminal: progress with time left, tables, and the list of files written."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markergen.tables import Table

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
    with Progress(
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


def length(text: str) -> float:
    """Read a length for an option, so that a bad one is told with the option's name."""
    from typer import BadParameter

    from markergen.errors import InputError
    from markergen.units import parse_length

    try:
        return parse_length(text)
    except InputError as error:
        raise BadParameter(str(error)) from None


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> None:
    """Print rows of text under a header, none of it cut off: the first column to the left, the others to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(
        box=box.SIMPLE_HEAD, title=title, caption=caption or None, title_justify="left", caption_justify="left"
    )
    table.title_style = "bold"
    for index, name in enumerate(header):
        table.add_column(name, justify="right" if index and len(header) > 2 else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    # A pipe has no width of its own; no table needs more than this.
    Console(width=None if sys.stdout.isatty() else 100, highlight=False).print(table)


def print_parts(parts: Iterable["str | Table"]) -> None:
    """Print sentences and tables; a terminal decides on their width."""
    from markergen.tables import print_parts

    print_parts(parts, sys.stdout)


def print_results(results: Mapping[str, Any]) -> None:
    """Print what a validation found, as tables and sentences."""
    from markergen.validation import tables, view_tables

    print(tables.heading(results))
    if results["estimators"]:
        print_table(*tables.rotation_table(results))
        print_table(*tables.translation_table(results))
        print_table(*tables.polar_angle_table(results, "rotation_deg"))
        print_table(*tables.polar_angle_table(results, "translation_pct"))
        if results["homography"]:
            print_table(*tables.homography_table(results))
    print_table(*tables.comparison_table(results))
    print_table(*view_tables.budget_table(results))
    if results["views"]:
        print_table(*view_tables.group_table(results["views"]))
        if results["views"]["detected"]:
            print_table(*view_tables.estimator_table(results["views"]))
        if "stress" in results["views"]:
            print_table(*view_tables.stress_table(results["views"]))
    print(*tables.sentences(results), *view_tables.sentences(results), sep="\n")
