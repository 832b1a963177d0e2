"""``markergen study``."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf, isnan
from pathlib import Path
from time import monotonic
from typing import Annotated, Any

import typer

from markergen.cli.options import with_options
from markergen.options import StudyKeywords

SECONDS_BETWEEN_LINES = 30


@with_options(StudyKeywords)
def study(
    what: Annotated[
        str,
        typer.Argument(
            metavar="paper|NAME|SPEC.toml",
            help="paper: the claims of the paper, measured. Otherwise a sweep: a TOML file with [study] and [grid], or "
            "one that is shipped: layouts.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for tables, figures and finished cells.")
    ],
    **options: Any,
) -> None:
    """Reproduce the paper, or run any grid of designs, as one tidy table with figures and a page.

    The results do not depend on the number of workers, nor on where they compute. Whatever ends it early, --resume
    continues.

    \b
    Example:
      markergen study paper --scale 0.01 -o paper
      markergen study layouts -o layouts
      markergen study sweep.toml -o sweep --scheduler tcp://10.0.0.1:8786
    """
    from markergen.api.study import study as run
    from markergen.cli.console import complain, print_parts

    try:
        with _progress() as progress:
            found = run(what, output, progress=progress, announce=complain, **options)
    except KeyboardInterrupt:
        complain(f"markergen: what is finished remains in {output}; continue with the same command and --resume")
        raise
    print_parts(found.parts())


@contextmanager
def _progress() -> Iterator[Callable[[int, int, float], None]]:
    """Yield a callback ``(done, total, seconds left)``: a bar on a terminal, and now and then a line elsewhere."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    if not sys.stderr.isatty():
        yield _Lines()
        return
    columns = (TextColumn("{task.completed}/{task.total} cells"), BarColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, left="")
        yield lambda done, total, seconds: bar.update(task, completed=done, total=total, left=_left(seconds))


class _Lines:
    """Progress for a log: the first line, the last one, and one in half a minute."""

    def __init__(self) -> None:
        self._told = -inf

    def __call__(self, done: int, total: int, seconds: float) -> None:
        if monotonic() > self._told + SECONDS_BETWEEN_LINES or done == total:
            self._told = monotonic()
            print(", ".join(filter(None, [f"{done} of {total} cells", _left(seconds)])), file=sys.stderr, flush=True)


def _left(seconds: float) -> str:
    from markergen.api.study import duration

    return "" if isnan(seconds) else f"{duration(seconds)} left"
