"""``markergen validate``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli.options import with_options
from markergen.options import ValidateKeywords


@with_options(ValidateKeywords)
def validate(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design.")],
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: what it was designed for]",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="Write everything as one page to look at.")
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write views that failed, the worst and typical ones as PNG.")
    ] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the results as JSON; - is standard output.")
    ] = None,
    fail_if: Annotated[
        list[str] | None,
        typer.Option(metavar="EXPR", help="Exit with 1 if this holds, e.g. 'estimators.lm.rotation_deg.rms > 0.5'."),
    ] = None,
    **options: Any,
) -> None:
    """Prove a marker: homography and pose errors of every estimator over all poses with their bounds, then synthetic
    views in which it is found as a program would, and what limits the accuracy: image, print, or calibration.

    \b
    Example:
      markergen validate marker.json --report report.html --fail-if 'estimators.lm.rotation_deg.rms > 1'
    """
    from markergen.api.validate import validate as prove
    from markergen.cli import FAILED, console
    from markergen.validation.fail_if import parse

    for expression in fail_if or []:
        parse(expression)
    to_stdout = str(json) == "-"
    files: dict[str, Any] = {"json": None if to_stdout else json, "report": report, "pictures": pictures}
    with console.progress_bar() as progress:
        found = prove(marker, camera, progress=progress, **files, **options)
    console.print_found(found, to_stdout)
    verdicts = [found.check(expression) for expression in fail_if or []]
    for passed, said in verdicts:
        console.complain(f"{'passed' if passed else 'FAILED'}: {said}")
    if not all(passed for passed, _ in verdicts):
        raise typer.Exit(FAILED)
