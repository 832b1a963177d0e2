"""``markergen design``."""

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli.console import length


def design(
    n: Annotated[int | None, typer.Option("--n", help="Number of control points, 4 to 60. [default: 5]")] = None,
    radius: Annotated[
        float | None,
        typer.Option(parser=length, metavar="LENGTH", help="Of the disk that the dots must lie in. [default: 150mm]"),
    ] = None,
    template: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="Start from a ready-made spec; see markergen templates.")
    ] = None,
    objective: Annotated[
        str | None, typer.Option(metavar="NAME", help="pose, homography or condition. [default: pose]")
    ] = None,
    aggregate: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Over the poses: rms, mean, logmean or max. [default: the objective's]"),
    ] = None,
    coordinates: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="That condition is written in: unit, metric, pixel, hartley. [default: unit]"
        ),
    ] = None,
    poses: Annotated[str | None, typer.Option(metavar="NAME", help="paper or paper-roll. [default: paper]")] = None,
    dot: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH|auto",
            help="Dot diameter; auto: the one with the least predicted error, see --print-sigma. "
            "[default: what the camera needs]",
        ),
    ] = None,
    clearance: Annotated[
        float | None,
        typer.Option(parser=length, metavar="LENGTH", help="Smallest gap around dots. [default: a tenth of --dot]"),
    ] = None,
    noise_model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="point: 1 px everywhere; image: what each dot's image tells in each pose. [default: point]",
        ),
    ] = None,
    print_sigma: Annotated[
        float | None,
        typer.Option(
            parser=length,
            metavar="LENGTH",
            help="Error of a printed dot's place along each axis, for --noise-model image and --dot auto. "
            "[default: 0mm]",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Of the random starts; the same seed gives the same bytes. [default: 0]")
    ] = None,
    restarts: Annotated[int | None, typer.Option(min=1, help="Random starts. [default: the objective's]")] = None,
    paper: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="A0..A5, letter, ... [default: the smallest ISO size that holds it]"),
    ] = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o", "--output", metavar="PATH", help="Written by suffix (.pdf .svg .step .json); may be repeated."
        ),
    ] = None,
) -> None:
    """Find the best layout of control points, and write the marker; <stem>.json always comes with it.

    \b
    Example:
      markergen design --n 5 --radius 0.15 -o marker.pdf
    """
    from markergen.cli.console import busy, print_criteria, print_outputs, progress_bar
    from markergen.export import ExportOptions, check_outputs, save, with_record
    from markergen.optimize.design import design as find
    from markergen.read.spec_file import read_template, spec_from_mapping

    values = read_template(template) if template else {}
    options = {
        "n": n, "radius": radius, "objective": objective, "aggregate": aggregate, "coordinates": coordinates,
        "poses": poses, "dot": dot, "clearance": clearance, "noise_model": noise_model, "print_sigma": print_sigma,
        "seed": seed, "restarts": restarts,
    }  # fmt: skip
    if radius is not None:
        values.pop("boundary", None)
    values.update({key: value for key, value in options.items() if value is not None})
    spec = spec_from_mapping(values, template or "the options")
    choices = ExportOptions(paper=paper)
    paths = with_record(output or [Path("marker.pdf")])
    check_outputs(paths, choices)

    with progress_bar() as progress:
        found = find(spec, progress)
    with busy("writing"):
        written = save(found.marker, paths, choices)
    for warning in found.warnings:
        typer.echo(f"markergen: warning: {warning}", err=True)
    print(found.summary)
    print_criteria(found.criteria, spec.n, found.setting.noise_words)
    print_outputs(written)
