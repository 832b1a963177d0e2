"""``markergen validate``."""

from pathlib import Path
from typing import Annotated

import typer


def validate(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design.")],
    runs: Annotated[int, typer.Option(help="Noisy trials for each pose; 0 gives the bounds alone.")] = 1000,
    noise: Annotated[float, typer.Option(metavar="PX", help="Standard deviation on every image coordinate.")] = 0.2,
    views: Annotated[int, typer.Option(help="Synthetic images to render and to find the dots in.")] = 0,
    poses: Annotated[
        str | None, typer.Option(metavar="NAME", help="paper or paper-roll. [default: what it was designed for]")
    ] = None,
    trials_for_all: Annotated[
        bool, typer.Option("--trials-for-all", help="Run trials for the n-gon, square and random layouts too.")
    ] = False,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the results as JSON; - is standard output.")
    ] = None,
    fail_if: Annotated[
        list[str] | None,
        typer.Option(metavar="EXPR", help="Exit with 1 if this holds, e.g. 'estimators.lm.rotation_deg.rms > 0.5'."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the noise; the same seed gives the same results.")] = 0,
    workers: Annotated[int | None, typer.Option(help="Processes. [default: one for each processor]")] = None,
) -> None:
    """Prove a marker: homography and pose errors of every estimator over all poses, with their bounds beside them.

    \b
    Example:
      markergen validate marker.json --views 20 --fail-if 'estimators.lm.rotation_deg.rms > 1'
    """
    from markergen.cli import FAILED
    from markergen.cli.console import print_results, progress_bar
    from markergen.files import check_folder, write_atomic
    from markergen.model.marker_json import read_marker
    from markergen.validate.fail_if import check, parse
    from markergen.validate.proof import prove, setting_of, to_json

    for expression in fail_if or []:
        parse(expression)
    to_stdout = str(json) == "-"
    if json and not to_stdout:
        check_folder(json)
    judged = read_marker(marker)
    setting = setting_of(judged, poses)
    with progress_bar() as progress:
        results = prove(judged, setting, noise, runs, views, seed, workers, trials_for_all, progress)
    verdicts = [check(expression, results) for expression in fail_if or []]
    if to_stdout:
        typer.echo(to_json(results).decode(), nl=False)
    else:
        print_results(results)
        if json:
            write_atomic(json, to_json(results))
            print(f"wrote {json}")
    for passed, found in verdicts:
        typer.echo(f"{'passed' if passed else 'FAILED'}: {found}", err=True)
    if not all(passed for passed, _ in verdicts):
        raise typer.Exit(FAILED)
