"""``markergen compare``."""

from pathlib import Path
from typing import Annotated

import typer

from markergen.cli.console import length


def compare(
    contestants: Annotated[
        list[str],
        typer.Argument(
            metavar="A B...",
            help="MARKER.json, ngon:N, square, random:N, aruco:DICT[:ID], apriltag:FAMILY[:ID] or charuco:CxR[:DICT]; "
            "one alone is compared with one of each.",
        ),
    ],
    views: Annotated[int, typer.Option(help="Synthetic images of each, from the same poses.")] = 200,
    poses: Annotated[
        str | None, typer.Option(metavar="NAME", help="paper or paper-roll. [default: what the first was designed for]")
    ] = None,
    print_sigma: Annotated[
        float,
        typer.Option(parser=length, metavar="LENGTH", help="Error of each dot's or corner's place, 1 sigma per axis."),
    ] = "0",  # type: ignore[assignment]
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the results as JSON; - is standard output.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the errors: .svg or .png.")] = None,
    seed: Annotated[int, typer.Option(help="Of noise and poses; the same seed gives the same results.")] = 0,
    workers: Annotated[int | None, typer.Option(help="Processes. [default: one for each processor]")] = None,
) -> None:
    """Compare markers with each other and with square tags and boards: same circle, poses, optics and noise.

    \b
    Example:
      markergen compare marker.json
      markergen compare marker.json aruco:DICT_4X4_50:7 charuco:4x4 --views 400 --plot compare.svg
    """
    from markergen.cli.console import print_table, progress_bar
    from markergen.files import check_outputs, write_atomic
    from markergen.validation import compare_report
    from markergen.validation.compare import compare as run
    from markergen.validation.compare import to_json

    to_stdout = str(json) == "-"
    if plot:
        compare_report.check_plot(plot)
    read = [Path(text) for text in contestants if Path(text).is_file()]
    check_outputs([path for path in (plot, None if to_stdout else json) if path], read)
    with progress_bar() as progress:
        results = run(contestants, views, seed, poses, print_sigma, workers=workers, progress=progress)
    if to_stdout:
        typer.echo(to_json(results).decode(), nl=False)
    else:
        print(compare_report.heading(results))
        for table in compare_report.tables(results):
            print_table(*table)
        print(*compare_report.sentences(results), sep="\n")
    written = [(json, to_json(results))] if json and not to_stdout else []
    if plot:
        written.append((plot, compare_report.plot_bytes(results, plot)))
    for path, data in written:
        write_atomic(path, data)
        typer.echo(f"wrote {path}", err=to_stdout)
