"""``markergen validate``."""
# tests: tests/cli/test_validate.py

from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import console
from markergen.cli.options import Details, Json, MarkerFile, Refine, Report, calibration_file, with_options
from markergen.options.declarations import ValidateKeywords


@with_options(
    ValidateKeywords,
    first="camera poses runs views optics print_sigma camera_covariance report pictures json fail_if details",
)
def validate(
    marker: MarkerFile,
    camera: Annotated[Path | None, calibration_file("the camera of the design")] = None,
    report: Report = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write failed, worst and typical views as PNG.")
    ] = None,
    json: Json = None,
    details: Details = False,
    fail_if: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EXPR",
            help="Exit with 1 if this holds of a number in the results, such as 'headline.rotation_deg > 0.5', the "
            "error to plan with.",
        ),
    ] = None,
    refine: Refine = None,  # noqa: ARG001 - of the release before
    **options: Any,
) -> None:
    """Prove how accurate a marker is: homography and pose errors of every estimator over all poses with their bounds,
    then detection in synthetic views, and what limits the accuracy: image, print, or calibration.

    \b
    Example:
      markergen validate marker.json --report report.html --fail-if 'headline.rotation_deg > 1'
    """
    from markergen.api.validate import validate as prove
    from markergen.validation.result import parse_condition

    for expression in fail_if or []:
        parse_condition(expression)
    files: dict[str, Any] = {"json": console.file_of(json), "report": report, "pictures": pictures}
    with console.progress_bar() as progress:
        result = prove(marker, camera, progress=progress, **files, **options)
    console.print_result(result, json, details=details)
    verdicts = [result.check(expression) for expression in fail_if or []]
    for passed, verdict in verdicts:
        (console.note if passed else console.complain)(f"{'passed' if passed else 'FAILED'}: {verdict}")
    if not all(passed for passed, _ in verdicts):
        raise typer.Exit(console.FAILED)
