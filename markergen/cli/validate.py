"""``markergen validate``."""

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli.console import length


def validate(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design.")],
    runs: Annotated[int, typer.Option(help="Noisy trials for each pose; 0 gives the bounds alone.")] = 1000,
    noise: Annotated[float, typer.Option(metavar="PX", help="Standard deviation on every image coordinate.")] = 0.2,
    views: Annotated[
        int | None, typer.Option(help="Synthetic images to find the marker in. [default: 100; 0 for bare points]")
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: what it was designed for]",
        ),
    ] = None,
    poses: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|CONE|FILE",
            help="paper, paper-roll, cone:tilt=0..60,distance=0.4..1m, or a CSV, JSON, TUM or COLMAP file. "
            "[default: what it was designed for]",
        ),
    ] = None,
    trials_for_all: Annotated[
        bool, typer.Option("--trials-for-all", help="Run trials for the n-gon, square and random layouts too.")
    ] = False,
    optics: Annotated[
        str, typer.Option(metavar="KEY=VALUE,...", help="Of the views, such as blur_px=1.5,noise_grey=4.")
    ] = "",
    background: Annotated[
        str, typer.Option(metavar="NAME", help="Behind the marker: plain, clutter or photo.")
    ] = "plain",
    hide: Annotated[int, typer.Option(help="Dots of each view that something lies on.")] = 0,
    refine: Annotated[
        str, typer.Option(metavar="NAME", help="none, or photometric: align the rendered model with the image.")
    ] = "none",
    stress: Annotated[
        bool, typer.Option("--stress", help="Repeat the views with blur, noise, little light, a hidden dot, clutter.")
    ] = False,
    print_sigma: Annotated[
        float,
        typer.Option(
            parser=length, metavar="LENGTH", help="Error of each dot's place in print, 1 sigma along an axis."
        ),
    ] = "0.1mm",  # type: ignore[assignment]
    camera_covariance: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Covariance, or a row of standard deviations, of fx, fy, cx, cy, ..."),
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
    seed: Annotated[int, typer.Option(help="Of the noise; the same seed gives the same results.")] = 0,
    workers: Annotated[int | None, typer.Option(help="Processes. [default: one for each processor]")] = None,
) -> None:
    """Prove a marker: homography and pose errors of every estimator over all poses with their bounds, then synthetic
    views in which it is found as a program would, and what limits the accuracy: image, print, or calibration.

    \b
    Example:
      markergen validate marker.json --report report.html --fail-if 'estimators.lm.rotation_deg.rms > 1'
    """
    from markergen.cli import FAILED
    from markergen.cli.console import busy, print_results, progress_bar
    from markergen.errors import InputError
    from markergen.estimators.budget import ErrorSources
    from markergen.files import check_outputs, make_folder, write_atomic
    from markergen.model.marker_json import read_marker
    from markergen.read.cameras import read_camera, read_camera_covariance
    from markergen.render import optics_from_text
    from markergen.validation.bounds import budget_of
    from markergen.validation.fail_if import check, parse
    from markergen.validation.pictures import pictures as taken
    from markergen.validation.pictures import remove_earlier
    from markergen.validation.proof import prove, setting_of, to_json
    from markergen.validation.report import check_report, html_report
    from markergen.validation.views import Shoot

    for expression in fail_if or []:
        parse(expression)
    to_stdout = str(json) == "-"
    if report:
        check_report(report)
    inputs = [marker, *(path for path in (camera, camera_covariance, poses and Path(poses)) if path)]
    check_outputs([path for path in (None if to_stdout else json, report) if path], inputs)
    judged = read_marker(marker)
    setting = setting_of(judged, poses, read_camera(camera) if camera else None)
    covariance = read_camera_covariance(camera_covariance, setting.camera) if camera_covariance else None
    errors = ErrorSources(print_sigma, covariance)
    if views is None:
        views = 100 if judged.dot_diameter else 0
    lens = optics_from_text(optics)
    shoot = Shoot(judged, setting.camera, setting.poses, views, seed, lens, background, hide, errors, refine)
    if not views and (stress or pictures):
        raise InputError("views to take", "--views 0", "leave out --stress and --pictures, or ask for views")
    if pictures:
        make_folder(pictures)
    with progress_bar() as progress:
        results = prove(judged, setting, noise, runs, shoot, seed, workers, trials_for_all, stress, progress)
    if to_stdout:
        typer.echo(to_json(results).decode(), nl=False)
    else:
        print_results(results)
    written = {}
    if json and not to_stdout:
        written[json] = to_json(results)
    shown = []
    if views and (pictures or report):
        with busy("taking pictures"):
            shown = list(taken(shoot, results["views"]))
    if report:
        with busy("writing the report"):
            written[report] = html_report(results, judged, setting, shown, budget_of(shoot, noise))
    if pictures:
        remove_earlier(pictures)
        written |= {pictures / f"{picture.name}.png": picture.png for picture in shown}
    for path, content in written.items():
        write_atomic(path, content)
        typer.echo(f"wrote {path}", err=to_stdout)
    verdicts = [check(expression, results) for expression in fail_if or []]
    for passed, found in verdicts:
        typer.echo(f"{'passed' if passed else 'FAILED'}: {found}", err=True)
    if not all(passed for passed, _ in verdicts):
        raise typer.Exit(FAILED)
