"""What the commands share on the terminal: progress with time left, tables, and the list of files written."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markergen.objectives.survive import HiddenDots

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


def print_criteria(table: Mapping[str, Mapping[str, float]], n: int, noise: str) -> None:
    """Print the criteria of a design beside those of the layouts that it is compared with."""
    from markergen.objectives.criteria import columns
    from markergen.validate.tables import LAYOUTS

    but = " and ".join(each.title for each in columns().values() if not each.proportional)
    names = {"design": "this marker", **LAYOUTS, "ngon": f"regular {n}-gon"}
    print_table(
        f"What the layout allows, for {noise}",
        ["", *(each.title for each in columns().values())],
        [[names[name], *_criteria_cells(row)] for name, row in table.items()],
        f"RMS over the poses; proportional to the noise but for {but}.",
    )


def print_hidden(table: Sequence["HiddenDots"], noise: str) -> None:
    """Print the criteria of a marker with none, one and more of its dots hidden."""
    from markergen.objectives.criteria import columns

    rows = []
    for row in table:
        worst = f"dot{'s' * (row.hidden > 1)} {', '.join(map(str, row.worst_dots))}"
        dots = f"worst: {worst} hidden" if row.hidden else "none hidden"
        rows.append([dots, *_criteria_cells(row.worst)])
        if row.hidden:
            rows.append([f"mean of any {row.hidden} hidden", *_criteria_cells(row.mean)])
    print_table(
        f"With dots hidden, for {noise}",
        ["", *(each.title for each in columns().values())],
        rows,
        "Each criterion after the loss that is worst for it; dots named are those whose loss is worst for the pose.",
    )


def _criteria_cells(row: Mapping[str, float]) -> list[str]:
    """Cells for the columns of criteria; a relief lacks some."""
    from markergen.objectives.criteria import columns
    from markergen.validate.tables import number

    return [number(row[each.key] * each.factor, 4) if each.key in row else "-" for each in columns().values()]


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


def print_results(results: Mapping[str, Any]) -> None:
    """Print what a validation found, as tables and sentences."""
    from markergen.validate import tables, view_tables

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
