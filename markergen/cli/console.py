"""What the commands share on the terminal: progress with time left, tables, and the list of files written."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

Progress = Callable[[str, int, int], None]

CRITERIA = {
    "pose_m": ("pose mm", 1e3),
    "rotation_deg": ("rotation deg", 1.0),
    "translation_pct": ("translation %", 1.0),
    "homography_px": ("homography px", 1.0),
    "condition": ("c(A)", 1.0),
}
"""Column title and factor of each criterion."""

LAYOUTS = {"design": "this marker", "ngon": "regular n-gon", "square": "square, 4 dots", "random": "random, median"}


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

        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done, total=total)

        yield advance


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> None:
    """Print rows of text under a header: the first column to the left, numbers to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(
        title=title, caption=caption or None, box=box.SIMPLE_HEAD, title_justify="left", caption_justify="left"
    )
    for index, name in enumerate(header):
        table.add_column(name, justify="right" if index else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    # A pipe has no width; tables are then as wide as they need to be.
    Console(width=None if sys.stdout.isatty() else 120, highlight=False).print(table)


def print_criteria(table: Mapping[str, Mapping[str, float]], n: int) -> None:
    """Print the criteria of a design beside those of the layouts that it is compared with."""
    from markergen.validate.tables import number

    rows = [
        [
            LAYOUTS[name].replace("n-gon", f"{n}-gon"),
            *(number(row[key] * factor) for key, (_, factor) in CRITERIA.items()),
        ]
        for name, row in table.items()
    ]
    print_table(
        "What the layout allows",
        ["", *(title for title, _ in CRITERIA.values())],
        rows,
        "RMS over the poses, for image noise of 1 px (at 0.2 px: a fifth); c(A) is free of noise.",
    )


def print_outputs(written: Sequence[tuple[Path, Sequence[str]]]) -> None:
    """Print each file that was written, with the sentences that its exporter has for the user."""
    for path, notes in written:
        print(f"wrote {path}", *notes, sep="\n  ")


def print_results(results: Mapping[str, Any]) -> None:
    """Print what a validation found, as tables and sentences."""
    from markergen.validate import tables

    if results["estimators"]:
        print_table(*tables.estimator_table(results))
        print_table(*tables.polar_angle_table(results))
        print_table(*tables.homography_table(results))
    print_table(*tables.comparison_table(results))
    print(*tables.sentences(results), sep="\n")
