"""``markergen study``."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import inf, isnan
from pathlib import Path
from time import monotonic
from typing import Annotated, Any

import typer

SECONDS_BETWEEN_LINES = 30


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
    workers: Annotated[int | None, typer.Option(help="Processes. [default: one for each processor]")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Compute on a running Dask cluster instead, such as tcp://10.0.0.1:8786."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue in a folder: what is finished is not computed again.")
    ] = False,
    runs: Annotated[
        int | None,
        typer.Option(help="Noisy runs of each layout and pose. [default: paper 20, sweep 100 or the file's]"),
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Share of the paper's study; 0.01 is a quick look. [default: 1]")
    ] = None,
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
    from markergen.cli.console import complain
    from markergen.errors import InputError
    from markergen.studies.engines import engine_for
    from markergen.studies.sweep import read_sweep, run_sweep

    engine = engine_for(workers, scheduler)
    if what == "paper":
        from markergen.studies.paper import PaperOptions, estimated_seconds, run_paper

        given: dict[str, Any] = {
            key: value for key, value in {"runs": runs, "scale": scale}.items() if value is not None
        }
        options = PaperOptions(**given)
        run = partial(run_paper, output, options)
        engine.check()
        if not scheduler:
            complain(f"the whole study: about {_words(estimated_seconds(options, workers))}")
    elif scale is None:
        run = partial(run_sweep, read_sweep(what, runs), output)
        engine.check()
    else:
        raise InputError("--scale with the study paper", f"--scale with {what}", "leave it out, or give --runs")
    try:
        with _progress() as progress:
            written = run(engine=engine, resume=resume, progress=progress)
    except KeyboardInterrupt:
        complain(f"markergen: what is finished remains in {output}; continue with the same command and --resume")
        raise
    for path in written:
        print(f"wrote {path}")


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
    return "" if isnan(seconds) else f"{_words(seconds)} left"


def _words(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
